"""The model with the found effects in it, simulated before any of its errors is reported.

The residual after calibration, and after each effect, is the error of this model on the recorded
motion. A recording of other motions is compared with the same model in the same way.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.calibration.ranges import severities
from faultgen.discovery.calibration.simulated_fit import SHARES, replaying, step_of
from faultgen.discovery.fit.fit import Fit, bounds_of, changes_of
from faultgen.discovery.fit.gap import unexplained
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.replay.replay import relative_error
from faultgen.discovery.terms.candidates import INERTIA, Term
from faultgen.effects import get_effect
from faultgen.robot import Robot

_STEPS = 6  # simulations in which numbers are calibrated
_SETTLED = 0.01  # share of the misfit that a step has to take off
_WITHIN = 0.9  # share of the bounds of an effect that a number may reach
_BENT = ("stiffness_hardening",)  # the torque is so far from straight in it that no step finds it


@dataclass(frozen=True, eq=False)
class Built:
    """A model that contains effects and calibrated numbers."""

    changes: list[tuple[Term, float]]
    """All changes of the model."""
    left: np.ndarray
    """Torque of the residual that remains, simulated, shape (samples, n_axes)."""
    share: float
    """Share of the calibrated changes that the model contains."""


def simulated_numbers(
    problem: Problem,
    fitted: Fit,
    left_out: Collection[int] = (),
    fixed: np.ndarray | None = None,
    start: np.ndarray | None = None,
) -> np.ndarray:
    """Calibrate the numbers that a model can contain, by simulation beside a set of effects.

    The regression also has terms that no model can contain, such as other forms of friction, and
    its sensitivities hold for small changes. Its numbers would therefore make a poor model. Here
    only the numbers of the model vary, within the bounds of their effects, and the model is
    simulated at each step (Levenberg and Marquardt, with the slopes of the unchanged model).

    Args:
        problem: The residual and the terms.
        fitted: The set of effects. Their severities stay as they are.
        left_out: Numbers of `Problem.folds` that are not fitted.
        fixed: Terms that stay as they were given, mask of shape (terms,). None: no term.
        start: Values from which the search starts, shape (terms,). None: the given model.

    Returns:
        Value of every term in prior standard deviations, shape (terms,); 0 for the effects of the
        set. With a baseline, which has the same numbers, they are those of the regression.
    """
    if problem.baseline:
        return unexplained(problem, fitted)[1]
    scale = np.array([term.prior_std for term in problem.terms])
    usable = _usable(problem, fitted)
    if fixed is not None:
        usable &= ~fixed
    bounded = [k for k in np.flatnonzero(usable).tolist() if problem.terms[k].is_effect]
    low, high = np.array([severities(t) for t in problem.terms]).T
    smallest, largest = bounds_of(problem, bounded)
    low[bounded] = np.maximum(low[bounded], _WITHIN * smallest)
    high[bounded] = np.minimum(high[bounded], _WITHIN * largest)
    low, high = np.where(usable, low / scale, 0.0), np.where(usable, high / scale, 0.0)
    weight = np.ones(len(scale))
    effects = changes_of(problem, fitted)
    kept = [k for k in range(len(problem.folds)) if k not in left_out]
    best, damping = np.zeros(len(scale)), 0.0
    left = problem.evidence(problem.residual - fitted.change).only(kept)
    least = float(left.energy.sum())
    if start is not None:
        value = np.clip(start, low, high)
        change = problem.change_of_given(effects + _changes(problem, value))
        if change is not None:
            best, left = value, problem.evidence(problem.residual - change).only(kept)
            least = float(left.energy.sum() + value @ value)
    for _ in range(_STEPS):
        value = step_of(left, weight, best, damping, (low, high))
        change = problem.change_of_given(effects + _changes(problem, value))
        here = np.inf
        if change is not None:
            now = problem.evidence(problem.residual - change).only(kept)
            here = float(now.energy.sum() + value @ value)
        if not here < least:
            damping = max(10 * damping, 0.1)
            continue
        done = here > (1 - _SETTLED) * least
        best, left, least, damping = value, now, here, damping / 10
        if done:
            break
    return best


def _usable(problem: Problem, fitted: Fit) -> np.ndarray:
    """Terms that are numbers of the model and may vary beside a set of effects, shape (terms,).

    Not among them are effects that differ from their absence by more than a number: waves, plays,
    effects at one place, and effects that act between steps. An effect that is probed with several
    severities counts once.
    """
    named = {problem.terms[t].key for t in fitted.terms}
    seen = set()
    usable = []
    for term in problem.terms:
        number = term.name == INERTIA
        which = (term.key, term.parameters)
        if term.is_effect and term.key not in named and which not in seen:
            effect = get_effect(term.name)
            number = (
                effect.prior.use in ("always", "on request")
                and term.name not in _BENT
                and not effect.prior.play
                and effect.between is None
            )
            seen.add(which)
        usable.append(number)
    return np.array(usable)


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
        robot = replaying(problem.recording, problem.given.robot, built.changes)
        if robot is not None:
            return built, robot, _lacks(problem, built, solution)
    line = "model.xml is the model as it was given: with the effects in it, its simulation diverges"
    return built, problem.given.robot, [f"{line} on the recorded motion"]


def _candidates(problem: Problem, fitted: Fit, solution: np.ndarray) -> Iterator[Built]:
    """Models with smaller and smaller shares of the calibrated changes, then the effects alone."""
    effects = changes_of(problem, fitted)
    left = problem.residual - fitted.change
    if problem.run_to_run is not None:  # what differs between any two runs is no part of the gap
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
