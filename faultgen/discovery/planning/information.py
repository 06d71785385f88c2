"""What motions tell about effects: inner products of the sensitivities, without any recording.

The information of several motions is the sum of theirs, so that a plan can be chosen without
further simulations. The sensitivities are those of `sensitivities`, with three short cuts that make
them about five times as fast. An effect that hardly moves any axis but its own is put on all axes
in one simulation. The columns of the links come from the linear regressor of a rigid arm. All
motions are simulated together, as separate recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import solve_toeplitz

from faultgen.discovery.laws.friction_discrepancy import (
    discrepancy_sensitivities,
    discrepancy_terms,
)
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import Term
from faultgen.discovery.terms.inertia import (
    PAIRS,
    inertia_terms,
    inertial_bodies,
    main_frame,
    parameters_of,
    pseudo_inertia,
)
from faultgen.discovery.terms.regressor import PER_LINK, link_ids, link_regressor
from faultgen.effects import EFFECTS
from faultgen.recordings.noise import Autoregression
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import Motion

SAMPLE_PERIOD = 0.004
"""Of the recordings for which motions are planned [s]."""

NOISE = 0.01
"""Noise of the torque, as a share of its RMS on the reference motion: assumed."""

_DRIFT = (
    0.5,
    0.018,
)  # share of the noise's variance that drifts, and its time constant [s]: assumed
_ORDER = 8  # of the autoregression by which the noise is whitened, as in `noise`

_THIN = 5  # samples from one to the next for which the regressor is computed
_SILENT = 1e-6  # noise of an axis over its torque limit, if it has no torque


@dataclass(frozen=True, eq=False)
class Information:
    """Inner products of the columns of all terms, for each motion."""

    terms: list[Term]
    """All terms."""
    gram: np.ndarray
    """Products of the whitened columns in units of the prior standard deviations, shape (motions,
    terms, terms)."""
    duration: np.ndarray
    """Shape (motions,), in [s]."""


def information(
    robot: Robot,
    motions: Sequence[Motion],
    terms: Sequence[Term],
    *,
    reference: int,
    workers: int = 1,
    cache: Path | None = None,
) -> Information:
    """Compute what each motion tells about each term.

    Samples at rest and shortly after rest and reversals do not count, as in a discovery without a
    healthy recording.

    Args:
        robot: The model.
        motions: The motions.
        terms: Effects that may be missing, each once. Terms of the links and of other forms of
            friction are added.
        reference: Number of the motion whose RMS torque sets the noise.
        workers: Number of processes. It has no effect on the result.
        cache: Folder in which simulations are kept.

    Returns:
        The information of each motion.

    Raises:
        SimulationFailed: The model diverges on a motion.
    """
    ways = [
        motion(np.arange(int(motion.period / SAMPLE_PERIOD)) * SAMPLE_PERIOD)[0]
        for motion in motions
    ]
    recording = Recording.planned(robot, ways, SAMPLE_PERIOD)
    replay = Replay(recording, robot, measured=False)
    links, forms = inertia_terms(robot), discrepancy_terms(robot)
    base, columns = _simulated(replay, terms, workers, cache)
    columns += _of_links(recording, robot, motions, links)
    told = discrepancy_sensitivities(replay, forms, base, workers=workers, cache=cache)
    columns += [(term.axis - 1, told[k, :, term.axis - 1]) for k, term in enumerate(forms)]
    every = [*terms, *links, *forms]

    torque = base[recording.parts[reference]]
    limit = np.where(np.isfinite(robot.motor_torque_limit), robot.motor_torque_limit, 1.0)
    noise = np.maximum(NOISE * np.sqrt(np.mean(torque**2, axis=0)), _SILENT * limit)
    inside = counted(recording, robot, baseline=False)
    stds = np.array([term.prior_std for term in every])
    gram = np.zeros((len(motions), len(every), len(every)))
    for k, part in enumerate(recording.parts):
        for axis in range(robot.n_axes):
            rows = [_on_axis(column, axis, part) for column in columns]
            own = [i for i, row in enumerate(rows) if row is not None]
            x = np.stack([row for row in rows if row is not None]) * stds[own, None]
            coloured = drifting(noise[axis : axis + 1])
            x = coloured.whiten(x[..., None], [slice(0, x.shape[1])])[..., 0] * inside[part, axis]
            gram[k][np.ix_(own, own)] += x @ x.T
    return Information(every, gram, np.array([motion.period for motion in motions]))


def drifting(deviation: np.ndarray) -> Autoregression:
    """Return noise of which a part is white and the other drifts.

    Args:
        deviation: Standard deviation of each axis, shape (n_axes,).

    Returns:
        The autoregression that predicts this noise best (Yule and Walker).
    """
    share, time = _DRIFT
    lags = share * np.exp(-SAMPLE_PERIOD / time * np.arange(_ORDER + 1))
    lags[0] = 1.0
    coefficients = solve_toeplitz(lags[:-1], lags[1:])
    innovation = float(np.sqrt(1 - coefficients @ lags[1:]))
    return Autoregression(np.tile(coefficients, (len(deviation), 1)), innovation * deviation)


_Column = tuple[int | None, np.ndarray]
"""An axis and the change of its torque, shape (samples,); or None and that of all axes, shape
(samples, n_axes)."""


def _on_axis(column: _Column, axis: int, part: slice) -> np.ndarray | None:
    own, values = column
    if own is None:
        return values[part, axis]
    return values[part] if own == axis else None


def _simulated(
    replay: Replay, terms: Sequence[Term], workers: int, cache: Path | None
) -> tuple[np.ndarray, list[_Column]]:
    """Torque of the model, shape (samples, n_axes), and its change per unit of each term."""
    base, told = sensitivities(replay, terms, workers=workers, cache=cache)
    columns: list[_Column] = [
        (term.axis - 1, change[:, term.axis - 1].copy())
        if EFFECTS[term.name].prior.own_axis_only
        else (None, change)
        for term, change in zip(terms, told, strict=True)
    ]
    return base, columns


def _of_links(
    recording: Recording, robot: Robot, motions: Sequence[Motion], terms: Sequence[Term]
) -> list[_Column]:
    """Change of the torque per unit of each term of the links, from the rigid arm."""
    arm = Arm(robot)
    turned = np.linalg.inv(robot.gearing.matrix.T) / robot.torque_gain[:, None]
    changes = _changes(robot, len(link_ids(arm)), terms)
    columns = []
    for motion, part in zip(motions, recording.parts, strict=True):
        times = np.arange(part.stop - part.start) * recording.sample_period
        thin = times[::_THIN]
        joint = link_regressor(arm, *motion(thin)) @ changes  # samples, axes, terms
        motor = np.einsum("ij,sjt->tsi", turned, joint)
        places = np.interp(times, thin, np.arange(len(thin)))
        before = np.minimum(places.astype(int), len(thin) - 2)
        share = (places - before)[:, None]
        columns.append(motor[:, before] * (1 - share) + motor[:, before + 1] * share)
    whole = np.concatenate(columns, axis=1).astype(np.float32)
    return [(None, column) for column in whole]


def _changes(robot: Robot, links: int, terms: Sequence[Term]) -> np.ndarray:
    """Change of the regressor's parameters per unit of each term, shape (10 links, terms)."""
    bodies = inertial_bodies(robot.spec(), robot)
    changes = np.zeros((links, PER_LINK, len(terms)))
    for k, term in enumerate(terms):
        body = bodies[term.axis - 1]
        unit = np.zeros((4, 4))
        unit[PAIRS[int(dict(term.parameters)["component"])]] = 1.0
        turned = main_frame(body) @ unit @ pseudo_inertia(body) @ main_frame(body).T
        changes[term.axis - 1, :, k] = parameters_of(turned + turned.T)
    return changes.reshape(links * PER_LINK, -1)
