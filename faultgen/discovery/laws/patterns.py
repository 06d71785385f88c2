"""Patterns in the error that remains, judged by how well they predict data they were not fitted to.

A pattern is the mean error in each bin of a quantity such as the joint angle. The samples are
divided into folds, which are contiguous periods of time. The means of all other folds predict the
errors of a fold. A pattern counts if this makes the squared error smaller. Its uncertainty comes
from blocks of samples, so that the result does not depend on a model of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from faultgen.discovery.fit.regression import Kinematics, Problem


@dataclass(frozen=True)
class Pattern:
    """A pattern in the error that remains."""

    axis: int
    """From 1."""
    along: str
    """Name of the quantity on which the error depends."""
    strength: float
    """Amount by which the pattern reduces the squared whitened error of data to which it was not
    fitted."""
    p_value: float
    """Probability that noise alone causes it, corrected for the number of patterns tested."""
    place: float
    """Value of that quantity at which the pattern is strongest, in the unit of the quantity."""


_FAMILIES = (
    ("joint angle", (24, 6)),
    ("motor turn", (16,)),
    ("speed", (16, 6)),
    ("acceleration", (12, 4)),
)
"""Numbers of bins: many for sharp patterns, few for smooth ones."""

_FEWEST = 200  # samples of an axis in which patterns are looked for
_FOLDS = 6  # periods of time of which each is predicted from the others
_BLOCK = 0.05  # time of the blocks from which the uncertainty is found [s]
_PERIOD = 0.2  # time of a burst [s]
_BURST = 5.0  # median error, over that of noise, beyond which a period cannot be noise: assumed


def patterns(
    problem: Problem,
    error: np.ndarray,
    parts: Sequence[int],
    columns: Sequence[tuple[int, np.ndarray]] = (),
) -> list[Pattern]:
    """Test whether the remaining error has a pattern of any form, with means over bins.

    Args:
        problem: The recording.
        error: Whitened error that remains, shape (samples, n_axes).
        parts: Indices of the separate recordings that are tested.
        columns: Axis (from 1) and whitened change, shape (samples, n_axes), of each fitted effect.
            It is tested as well whether the severity of these effects depends on a quantity.

    Returns:
        All patterns that were tested, the most certain first.
    """
    motion = problem.motion
    use = problem.samples(parts)
    tested = [(axis, np.ones(len(error))) for axis in range(error.shape[1])]
    tested += [(axis - 1, column[:, axis - 1].astype(float)) for axis, column in columns]
    found = []
    for k, (axis, weight) in enumerate(tested):
        rows = use & problem.inside[:, axis]
        if rows.sum() < _FEWEST:
            continue
        found += _along_all(problem, motion, axis, rows, error[:, axis], weight)
        if k < error.shape[1]:
            found += _bursts(problem, axis, error[:, axis], rows, parts)
    tests = max(len(found), 1)
    corrected = [replace(one, p_value=min(1.0, tests * one.p_value)) for one in found]
    return sorted(corrected, key=lambda one: (one.p_value, -one.strength))


def _along_all(
    problem: Problem,
    motion: Kinematics,
    axis: int,
    rows: np.ndarray,
    error: np.ndarray,
    weight: np.ndarray,
) -> list[Pattern]:
    """Patterns of an error along every quantity, for each direction of motion."""
    at = np.flatnonzero(rows)
    # folds and blocks are periods of time, so that neighbours are not on both sides
    fold = np.arange(len(at)) * _FOLDS // len(at)
    length = max(5, round(_BLOCK / problem.recording.sample_period))
    block = at // length
    forward = (motion.velocity[rows, axis] > 0).astype(int)
    features = {
        "joint angle": motion.position[rows, axis] / problem.robot.gear_ratio[axis],
        "motor turn": np.mod(motion.position[rows, axis], 2 * np.pi),
        "speed": motion.velocity[rows, axis],
        "acceleration": motion.acceleration[rows, axis],
    }
    found = []
    for name, counts in _FAMILIES:
        direction = np.zeros_like(forward) if name == "speed" else forward
        for count in counts:
            edges = np.unique(np.quantile(features[name], np.linspace(0, 1, count + 1)))
            last = max(len(edges) - 2, 0)
            side = np.searchsorted(edges, features[name], side="right") - 1
            bins = np.clip(side, 0, last) + direction * (last + 1)
            strength, p_value, best = _held_out(error[rows], weight[rows], bins, fold, block)
            k = best % (last + 1)
            place = float((edges[k] + edges[min(k + 1, len(edges) - 1)]) / 2)
            found.append(Pattern(axis + 1, name, strength, p_value, place))
    return found


def _held_out(
    error: np.ndarray, weight: np.ndarray, bins: np.ndarray, fold: np.ndarray, block: np.ndarray
) -> tuple[float, float, int]:
    """Predict the errors of each fold from the others.

    Args:
        error: Whitened errors, shape (samples,).
        weight: What the pattern is multiplied by in each sample, same shape.
        bins: Bin of each sample, from 0.
        fold: Fold of each sample, from 0.
        block: Block of each sample, ascending.

    Returns:
        The reduction of the squared error, the probability that it is an accident, and the bin in
        which it is largest.
    """
    shape = (int(bins.max()) + 1, int(fold.max()) + 1)
    cell = bins * shape[1] + fold
    size = np.bincount(cell, weight**2, shape[0] * shape[1]).reshape(shape)
    total = np.bincount(cell, weight * error, shape[0] * shape[1]).reshape(shape)
    size, total = (x.sum(axis=1, keepdims=True) - x for x in (size, total))
    known = size > 0
    mean = np.where(known, total / np.where(known, size, 1.0), 0.0)
    # shrinkage of James and Stein: what many means of pure noise would have is taken away
    energy = (total * mean).sum(axis=0)
    kept = np.maximum(1 - known.sum(axis=0) / np.maximum(energy, 1e-300), 0.0)
    guess = weight * (kept * mean)[bins, fold]
    gain = guess * (2 * error - guess)
    if not gain.any():
        return 0.0, 1.0, 0
    strength = float(gain.sum())
    return strength, _chance(guess, error, block), int(np.argmax(np.bincount(bins, gain)))


def _chance(guess: np.ndarray, error: np.ndarray, block: np.ndarray) -> float:
    """Probability that a prediction is as good by accident.

    The errors are regressed on the prediction. The variance of the slope comes from the sums over
    blocks (cluster-robust, Liang and Zeger 1986), and is at least that of the whitened noise.
    """
    size = float(guess @ guess)
    slope = float(guess @ error) / size
    sums = np.bincount(np.unique(block, return_inverse=True)[1], guess * (error - slope * guess))
    sums = sums[sums != 0]
    count = max(len(sums), 2)
    spread = np.sqrt(max(count / (count - 1) * float(sums @ sums), size)) / size
    return float(student.sf(slope / spread, count - 1))


def _bursts(
    problem: Problem, axis: int, error: np.ndarray, rows: np.ndarray, parts: Sequence[int]
) -> list[Pattern]:
    """Periods in which most errors are far larger than the noise.

    Nothing else predicts what happens only once. The median of a period is compared, so that single
    outliers and noise that is some times larger than usual do not count.
    """
    length = max(10, round(_PERIOD / problem.recording.sample_period))
    found: list[Pattern] = []
    for p in parts:
        part = problem.parts[p]
        for start in range(part.start, part.stop - length + 1, length):
            inside = rows[start : start + length]
            if inside.sum() < length // 2:
                continue
            own = error[start : start + length][inside]
            typical = float(np.median(np.abs(own))) / 0.6745
            if typical > _BURST and (not found or own @ own > found[0].strength):
                place = start * problem.recording.sample_period
                found = [Pattern(axis + 1, "time", float(own @ own), 1e-12, place)]
    return found
