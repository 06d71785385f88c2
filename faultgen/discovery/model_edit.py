"""The model that an answer makes, simulated before anything is said of it.

The gap that is reported after calibration and after each effect is the error of this model on the
recorded motion. A recording of other motions is compared with the same model in the same way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.calibrate import SHARES, replaying
from faultgen.discovery.candidates import INERTIA, PERIODIC, Term
from faultgen.discovery.fit import Fit, changes_of
from faultgen.discovery.regression import Problem
from faultgen.discovery.replay import relative_error
from faultgen.effects import get_effect
from faultgen.robot import Robot


@dataclass(frozen=True, eq=False)
class Built:
    """A model with effects and calibrated numbers in it."""

    changes: list[tuple[Term, float]]
    """What was changed in the model."""
    left: np.ndarray
    """Torque of the gap that it leaves, simulated, shape (samples, n_axes)."""
    share: float
    """Share of the calibrated values that it has."""


def build(problem: Problem, fitted: Fit, solution: np.ndarray) -> Built:
    """Put effects and calibrated numbers into the model.

    The calibrated values are made smaller until the model can be simulated, and leaves no more of
    the motions for fitting than the effects alone leave.

    Args:
        problem: The gap and the terms.
        fitted: The set of effects.
        solution: Value of every term, in tolerances; 0 for the effects of the set.
    """
    return next(_candidates(problem, fitted, solution))


def build_stable(
    problem: Problem, fitted: Fit, solution: np.ndarray
) -> tuple[Built, Robot, list[str]]:
    """The same, for a model that also replays the recording once it is written and read again.

    Args:
        problem: The gap and the terms.
        fitted: The set of effects.
        solution: As for `build`.

    Returns:
        What was built; the robot as it is written, which is the given one where nothing else can be
        simulated; and one line for each thing that the robot lacks.
    """
    for built in _candidates(problem, fitted, solution):
        robot = replaying(problem.recording, problem.robot, built.changes)
        if robot is not None:
            return built, robot, _lacks(problem, built, solution)
    line = "model.xml is the model as it was given: with the effects in it, its simulation diverges"
    return built, problem.robot, [f"{line} on the recorded motion"]


def _candidates(problem: Problem, fitted: Fit, solution: np.ndarray) -> Iterator[Built]:
    """Models with less and less of the calibrated values, those with the effects alone last."""
    effects = changes_of(problem, fitted)
    alone = Built(effects, problem.gap - fitted.change, 0.0)
    numbers = _numbers(problem, solution)
    limit = _fitting_error(problem, alone.left)
    for share in SHARES if numbers else ():
        changes = effects + [(term, share * value) for term, value in numbers]
        change = problem.change(changes)
        if change is not None and _fitting_error(problem, problem.gap - change) <= limit:
            yield Built(changes, problem.gap - change, share)
    yield alone


def _numbers(problem: Problem, solution: np.ndarray) -> list[tuple[Term, float]]:
    """Calibrated values; none with a twin, since both recordings have the same numbers."""
    if problem.twin:
        return []
    pairs = zip(problem.terms, solution.tolist(), strict=True)
    values = [(term, value * term.tolerance) for term, value in pairs if abs(value) > 1e-3]
    return [(term, value) for term, value in values if _possible(term, value)]


def _possible(term: Term, value: float) -> bool:
    """Whether a model is given it: no waves that nobody named, nothing beyond its bounds."""
    if not term.is_effect:
        return term.name == INERTIA
    effect = get_effect(term.name)
    return term.name not in PERIODIC and effect.smallest < value < effect.largest


def _fitting_error(problem: Problem, left: np.ndarray) -> float:
    """Relative error on the motions for fitting."""
    inside = problem.inside & problem.samples(problem.fitting)[:, None]
    return relative_error(left**2, problem.recording, inside)


def _lacks(problem: Problem, built: Built, solution: np.ndarray) -> list[str]:
    """What a stable model lacks of what was found."""
    if built.share == 1 or not _numbers(problem, solution):
        return []
    has = f"{built.share:.0%}" if built.share else "none"
    return [
        f"model.xml has {has} of the calibrated values: with more of them its simulation diverges, "
        "or comes no nearer to the recording"
    ]
