"""The model with the found effects in it, simulated before any of its errors is reported.

The residual after calibration, and after each effect, is the error of this model on the recorded
motion. A recording of other motions is compared with the same model in the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.fit.fit import Fit, changes_of
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.discovery.rigid.drives import GAIN, edited
from faultgen.discovery.terms.candidates import INERTIA, Term, applied
from faultgen.discovery.terms.inertia import apply_inertia
from faultgen.effects import get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import Robot

SHARES = (1.0, 0.5, 0.25, 0.1)
"""Shares of the changes that are tried in turn if a model with all of them cannot be simulated."""


@dataclass(frozen=True, eq=False)
class Built:
    """A model that contains effects and calibrated numbers."""

    changes: list[tuple[Term, float]]
    """All changes of the model."""
    left: np.ndarray
    """Torque of the residual that remains, simulated, shape (samples, n_axes)."""
    share: float
    """Share of the calibrated changes that the model contains."""


def build(problem: Problem, fitted: Fit, solution: np.ndarray) -> Built:
    """Put effects and calibrated numbers into the model.

    The calibrated changes are reduced until the model can be simulated and its error on the motions
    for fitting is no larger than with the effects alone.

    Args:
        problem: The residual and the terms.
        fitted: The set of effects.
        solution: Value of every term in prior standard deviations, shape (terms,); 0 for the
            effects of the set.

    Returns:
        The model that was built.
    """
    return next(_candidates(problem, fitted, solution))


def build_stable(
    problem: Problem, fitted: Fit, solution: np.ndarray
) -> tuple[Built, Robot, list[str]]:
    """Build a model that also replays the recording after it was written to a file and read again.

    Args:
        problem: The residual and the terms.
        fitted: The set of effects.
        solution: As for `build`.

    Returns:
        The model that was built; the robot as it is written, which is the unchanged robot if
        nothing else can be simulated; and one line for each found change that this robot does not
        contain.
    """
    for built in _candidates(problem, fitted, solution):
        robot = replaying(problem.given, built.changes)
        if robot is not None:
            return built, robot, _lacks(problem, built, solution)
    line = "model.xml is the model as it was given: with the effects in it, its simulation diverges"
    return built, problem.given.robot, [f"{line} on the recorded motion"]


def _candidates(problem: Problem, fitted: Fit, solution: np.ndarray) -> Iterator[Built]:
    """Models with smaller and smaller shares of the calibrated changes, then the effects alone."""
    effects = changes_of(problem, fitted)
    left = problem.residual - fitted.change
    if problem.baseline:  # what differs between any two runs is no part of the gap
        size = solution * np.array([term.prior_std for term in problem.terms])
        left = left - np.tensordot(size.astype(np.float32), problem.raw, axes=1)
    alone = Built(effects, left, 0.0)
    numbers = [] if problem.baseline else _changes(problem, solution)
    limit = _fitting_error(problem, alone.left)
    for share in SHARES if numbers else ():
        changes = effects + [(term, share * value) for term, value in numbers]
        change = problem.change_of_given(changes)
        if change is not None and _fitting_error(problem, problem.residual - change) <= limit:
            yield Built(changes, problem.residual - change, share)
    yield alone


def _changes(problem: Problem, solution: np.ndarray) -> list[tuple[Term, float]]:
    """Calibrated values as changes of the model."""
    pairs = zip(problem.terms, solution.tolist(), strict=True)
    return [(term, value * term.prior_std) for term, value in pairs if abs(value) > 1e-3]


def _fitting_error(problem: Problem, left: np.ndarray) -> float:
    """Relative error on the motions for fitting."""
    inside = problem.inside & problem.samples(problem.fitting)[:, None]
    return relative_error(left**2, problem.recording, inside)


def _lacks(problem: Problem, built: Built, solution: np.ndarray) -> list[str]:
    """One line for each found change that a stable model does not contain."""
    if built.share == 1 or problem.baseline or not _changes(problem, solution):
        return []
    has = f"{built.share:.0%}" if built.share else "none"
    return [
        f"model.xml has {has} of the calibrated values: with more of them its simulation diverges, "
        "or comes no nearer to the recording"
    ]


def changed(robot: Robot, changes: Sequence[tuple[Term, float]]) -> Robot:
    """Put changes into a model. A change of the torque constant goes into `torque_gain`.

    Args:
        robot: The model.
        changes: Terms and values. Effects that MJCF cannot express join the robot's `effects`.

    Returns:
        The changed model.

    Raises:
        SimulationFailed: MuJoCo cannot compile the changed model.
    """
    spec = robot.spec()
    apply_inertia(spec, robot, [change for change in changes if change[0].name == INERTIA])
    gain = robot.torque_gain.copy()
    effects = applied(changes)
    for one in sorted(effects, key=lambda one: get_effect(one.effect).last):
        if one.effect == GAIN:
            gain[one.axis - 1] *= 1 - one.severity
        elif get_effect(one.effect).in_mjcf:
            get_effect(one.effect).apply(spec, one.axis, one.severity, **one.parameters)
    beside = [one for one in effects if not (one.effect == GAIN or get_effect(one.effect).in_mjcf)]
    return edited(robot, spec, gain).with_effects(beside)


def replaying(given: Replay, changes: Sequence[tuple[Term, float]]) -> Robot | None:
    """Put changes into a model, and check that the written model can move as the robot did.

    Where commanded positions were recorded, the servo of the model has to follow them.

    Args:
        given: The recording and the model.
        changes: Terms and values.

    Returns:
        The changed model as it is written to a file, or None if it cannot replay the recording.
    """
    try:
        made = changed(given.robot, changes) if changes else given.robot
        replay = given.on(made)
        if given.recording.reference_position is not None:
            replay = Replay(given.recording, made, measured=False)
        torque = replay.torque()
    except (InputError, SimulationFailed):
        return None
    return made if np.isfinite(torque).all() else None
