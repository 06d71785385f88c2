"""What healthy recordings of one motion show beside the model: noise and differences of the runs.

runs = run_differences(replay, recordings)       # how the robot differs from run to run
noise = torque_noise_of(runs.rest, ...)          # level, colour, growth with speed and load
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import nnls

from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.terms.candidates import Term, effect_terms
from faultgen.errors import SimulationFailed
from faultgen.recordings.noise import Autoregression, autoregression
from faultgen.recordings.noise_level import log_likelihood
from faultgen.recordings.recording import Recording

VARYING = (
    "coulomb_friction",
    "static_friction",
    "viscous_friction",
    "torque_offset",
    "payload_mass",
)
"""Effects by which an unchanged robot differs from run to run."""

_ASSUMED = 0.3  # deviation from run to run, over the usual error of a model, before there are data
_WORTH = 1.0  # number of differences that this assumption is worth
_FEWEST = 200  # samples of an axis that turns, from which its noise is learned
_ORDERS = (8, 3, 1)  # of the autoregression; a lower one is taken if a higher one is not steady
_STEADY = 0.999  # largest root of the autoregression
_CAP = 12.0  # squared noise over its variance beyond which a sample is a jump
_GAIN = 8.0  # log-likelihood by which speed and load must predict the size of the noise
_BLOCK = 64  # samples of each block that is left out in turn


@dataclass(frozen=True, eq=False)
class RunDifferences:
    """How runs of an unchanged robot differ."""

    terms: tuple[Term, ...]
    """What may differ."""
    severity: np.ndarray
    """Difference of each run from the mean of all, in the unit of the effect, shape (runs,
    terms)."""
    deviation: np.ndarray
    """Standard deviation from run to run, shape (terms,)."""
    mean: np.ndarray
    """Mean torque of the runs, shape (samples, n_axes), in [N m]."""
    rest: np.ndarray
    """What neither the mean nor the differences explain: noise, shape (runs, samples, n_axes)."""
    shrunk: float
    """Share of the noise's deviation that is left after the mean was subtracted."""

    def table(self, n_axes: int) -> dict[str, list[float]]:
        """Return the deviations by effect and axis, as `Sensors.run_to_run` has them."""
        found: dict[str, list[float]] = {}
        for term, deviation in zip(self.terms, self.deviation.tolist(), strict=True):
            found.setdefault(term.name, [0.0] * n_axes)[term.axis - 1] = float(f"{deviation:.4g}")
        return found


def run_differences(replay: Replay, recordings: Sequence[Recording]) -> RunDifferences:
    """Measure how runs of the same motions differ.

    The difference of each run from the mean is fitted by the change of torque that each effect of
    `VARYING` causes in the model. The variance of an effect is that of the fitted values, less
    their own uncertainty. With few runs, an assumed deviation counts as much as one difference.

    Args:
        replay: The motion, with the model.
        recordings: Recordings of it, at least one, all of the same shape.

    Returns:
        The differences.

    Raises:
        SimulationFailed: The model diverges.
    """
    robot, first = replay.robot, recordings[0]
    terms = tuple(
        term for term in effect_terms(robot) if term.name in VARYING and not term.parameters
    )
    base = replay.torque()
    columns, kept = [], []
    for term in terms:
        try:
            change = (replay.torque([(term, term.step)]) - base) / term.step
        except SimulationFailed:
            continue
        if np.abs(change).max() > 0:
            kept.append(term)
            columns.append(change)
    runs = np.stack([one.torque for one in recordings])
    count = len(runs)
    mean = runs.mean(axis=0)
    apart = runs - mean
    assumed = np.array([_ASSUMED * term.prior_std for term in kept])
    if count == 1:
        wide = max(5, 2 * round(0.03 / first.sample_period) + 1)
        smooth = _smoothed(mean - base, wide, first.parts)
        return RunDifferences(
            tuple(kept),
            np.zeros((1, len(kept))),
            assumed,
            mean,
            (mean - base - smooth)[None],
            float(np.sqrt(1 - 1 / wide)),
        )
    # axes are weighted by the size of their own differences
    size = np.maximum(np.sqrt((apart**2).mean(axis=(0, 1))), 1e-12)
    design = np.stack([(c / size).ravel() for c in columns], axis=1) * assumed
    gram = design.T @ design
    severity = np.zeros((count, len(kept)))
    error = np.zeros(len(kept))
    rest = apart
    level = 1.0
    for _ in range(2):
        # coloured noise: as many independent samples as its correlation leaves
        inverse = np.linalg.inv(gram / level + 1e-6 * np.eye(len(kept)))
        right = np.stack([design.T @ (one / size).ravel() for one in apart]) / level
        severity = right @ inverse.T * assumed
        rest = apart - np.stack([sum_of(columns, row) for row in severity])
        spread = np.sqrt((rest**2).mean(axis=(0, 1)))
        level = float(np.mean((spread / size) ** 2)) * _correlated(rest / np.maximum(spread, 1e-12))
        error = np.sqrt(np.diag(inverse)) * assumed
    variance = np.maximum((severity**2).sum(axis=0) / (count - 1) - error**2, 0.0)
    total = _WORTH * assumed**2 + (count - 1) * variance
    return RunDifferences(
        tuple(kept),
        severity,
        np.sqrt(total / (_WORTH + count - 1)),
        mean,
        rest,
        float(np.sqrt(1 - 1 / count)),
    )


def sum_of(columns: Sequence[np.ndarray], weights: np.ndarray) -> np.ndarray:
    """Add columns, each times its weight.

    Args:
        columns: Arrays of one shape.
        weights: One number for each column, shape (columns,).

    Returns:
        The sum, with the shape of a column.
    """
    return np.asarray(sum(w * c for w, c in zip(weights, columns, strict=True)))


def _correlated(x: np.ndarray, lags: int = 50) -> float:
    """Factor by which correlation in time raises the variance of a mean, at least 1."""
    total = 1.0
    for lag in range(1, min(lags, x.shape[1] // 4)):
        value = float(np.mean(x[:, lag:] * x[:, :-lag]))
        if value < 0.02:
            break
        total += 2 * value
    return total


def moving_average(x: np.ndarray, width: int) -> np.ndarray:
    """Average each sample with its neighbours.

    Args:
        x: Shape (samples, n_axes).
        width: Number of samples that are averaged, odd. Before the first sample and after the last
            one, these are repeated.

    Returns:
        Same shape.
    """
    return np.asarray(uniform_filter1d(x, width, axis=0, mode="nearest"))


def _smoothed(x: np.ndarray, width: int, parts: Sequence[slice]) -> np.ndarray:
    """Moving average within each separate recording."""
    out = x.copy()
    for part in parts:
        own = x[part]
        wide = min(width, 2 * ((len(own) - 1) // 2) + 1)
        out[part] = moving_average(own, wide)
    return out


@dataclass(frozen=True, eq=False)
class TorqueNoise:
    """Noise of the torque of each axis."""

    deviation: np.ndarray
    """Standard deviation, shape (n_axes,), in [N m]."""
    colour: list[list[float]]
    """Coefficients of the autoregression of each axis."""
    growth: list[list[float]]
    """Growth of the variance with |speed| and |torque| over their means, for each axis."""


def torque_noise_of(
    found: RunDifferences, replay: Replay, speed: np.ndarray, torque: np.ndarray
) -> TorqueNoise:
    """Learn the level, the colour and the growth of the noise.

    Args:
        found: Differences of the runs, with the noise that remains.
        replay: The motion.
        speed: |Motor speed|, shape (samples, n_axes), in [rad/s].
        torque: |Torque|, same shape.

    Returns:
        The noise.
    """
    recording, robot = replay.recording, replay.robot
    runs, samples, n_axes = found.rest.shape
    inside = settled(recording, robot)
    inside = np.where(inside.sum(axis=0) >= _FEWEST, inside, True)
    shifted = [
        slice(k * samples + part.start, k * samples + part.stop)
        for k in range(runs)
        for part in recording.parts
    ]
    rest = found.rest.reshape(-1, n_axes) / found.shrunk
    use = np.tile(inside, (runs, 1))
    colour, deviation, growth = [], np.zeros(n_axes), []
    for axis in range(n_axes):
        column = slice(axis, axis + 1)
        own = _steady(rest[:, column], use[:, column], shifted)
        colour.append([float(f"{a:.5g}") for a in own.coefficients[0]])
        drivers = [
            np.tile(one[:, axis] / max(float(one[:, axis].mean()), 1e-300), runs)
            for one in (speed, torque)
        ]
        rows = use[:, axis]
        deviation[axis] = float(own.deviation[0])  # by its median size: jumps do not count
        features = np.stack([np.ones(rows.sum()), *(d[rows] for d in drivers)], axis=1)
        growth.append(_growth(features, (rest[rows, axis] / max(deviation[axis], 1e-300)) ** 2))
    return TorqueNoise(deviation, colour, growth)


def _steady(rest: np.ndarray, use: np.ndarray, parts: Sequence[slice]) -> Autoregression:
    """The autoregression of highest order that is steady."""
    for order in _ORDERS:
        found = autoregression(rest, use, parts, order)
        if np.abs(np.roots([1.0, *(-found.coefficients[0])])).max(initial=0.0) < _STEADY:
            return found
    return Autoregression(np.zeros((1, 1)), found.innovation)


def _growth(features: np.ndarray, squares: np.ndarray) -> list[float]:
    """Growth of the variance with two drivers, or zeros if they do not predict it."""
    block = np.arange(len(squares)) // _BLOCK % 2
    gain = 0.0
    for fold in (0, 1):
        fit, left = block != fold, block == fold
        if not fit.any() or not left.any():
            return [0.0, 0.0]
        capped = np.minimum(squares[left], _CAP)
        constant = np.full(len(capped), float(np.mean(np.minimum(squares[fit], _CAP))))
        variance = np.maximum(features[left] @ _fitted(features[fit], squares[fit]), 1e-6)
        gain += log_likelihood(capped, variance) - log_likelihood(
            capped, np.maximum(constant, 1e-6)
        )
    if gain < _GAIN:
        return [0.0, 0.0]
    level, *slopes = _fitted(features, squares).tolist()
    return [float(f"{slope / max(level, 0.05):.4g}") for slope in slopes]


def _fitted(features: np.ndarray, squares: np.ndarray) -> np.ndarray:
    coefficients, _ = nnls(features, np.minimum(squares, _CAP))
    return np.asarray(coefficients)
