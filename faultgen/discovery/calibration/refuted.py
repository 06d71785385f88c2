"""Calibrated numbers that motions to which they were not fitted refute, axis by axis.

    basic, values, lines = without_refuted(problem, empty, basic, values)

The motions that are kept for scoring have no say in this, so that the gap is measured on motions
that chose nothing here. Instead, the motions for fitting are divided into groups of neighbouring
periods, and each group is judged by numbers that were fitted to all others (cross-validation).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.discovery.calibration.compared import Compared, compared
from faultgen.discovery.calibration.model_edit import Built, build, simulated_numbers
from faultgen.discovery.fit.fit import Fit
from faultgen.discovery.fit.gap import gap
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.replay.samples import samples_of
from faultgen.discovery.terms.candidates import INERTIA, MASSES

_ARM = (INERTIA, *MASSES)
"""Terms that act on several axes; all others are numbers of the drive of one axis."""

_GROUPS = 5  # of neighbouring periods, so that each is judged by other motions: a usual number

_KEPT = (
    "the numbers of its drive are",
    "the numbers of its drive and all links are",
    "the whole model is",
)
"""What is used as given, in turn, until no axis is worse."""


def without_refuted(
    problem: Problem, empty: Fit, basic: Built, values: np.ndarray
) -> tuple[Built, np.ndarray, list[str]]:
    """Take back what calibration makes worse on motions that it was not fitted to.

    An axis that becomes worse beyond the interval of the difference keeps its own numbers of the
    given model: friction, rotor inertia, offset, stiffness. If an axis is worse still, the links
    and loads of the given model are kept, and at last all numbers. What is not kept is fitted again
    beside it. All numbers are also kept if the error of all axes together grows.

    Args:
        problem: The residual and the terms.
        empty: The empty set of effects.
        basic: The model with the calibrated numbers.
        values: Value of every term in prior standard deviations, shape (terms,), fitted to all
            motions for fitting.

    Returns:
        The model, the values of shape (terms,), and one line for what was taken back.
    """
    inside = problem.inside & problem.samples(problem.fitting)[:, None]
    arm = np.array([t.name in _ARM for t in problem.terms])
    n_axes = problem.residual.shape[1]
    axes = np.array([min(t.axis, n_axes) - 1 for t in problem.terms])  # a payload is one more link
    weak, back, kept = np.zeros(n_axes, bool), np.zeros(len(values), bool), ""
    for more in _KEPT:
        left = predicted(problem, empty, values, back)
        worse = against_given(problem, left, problem.folds).worse
        if not worse.any():
            break
        weak, kept = weak | worse, more
        back = (~arm & weak[axes]) | (arm & (more != _KEPT[0])) | (more == _KEPT[-1])
    if not back.all() and (
        gap(problem, left, inside)[0] > gap(problem, problem.residual, inside)[0]
    ):
        weak, kept, back = ~np.zeros_like(weak), _KEPT[-1], ~np.zeros_like(back)
    if not back.any():
        return basic, values, []
    values = simulated_numbers(problem, empty, fixed=back)
    told = ", ".join(str(k + 1) for k in np.flatnonzero(weak))
    line = (
        f"axis {told}: {kept} used as given, because after calibration the error on motions that "
        "were not fitted is larger than before"
    )
    return build(problem, empty, values), values, [line]


def predicted(problem: Problem, empty: Fit, values: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Simulate each group of periods for fitting with numbers that were fitted to the others.

    Args:
        problem: The residual and the terms.
        empty: The empty set of effects.
        values: Values that were fitted to all of them, shape (terms,), near which to search.
        back: Terms that stay as given, mask of shape (terms,).

    Returns:
        What is left of the residual, shape (samples, n_axes); outside of the motions for fitting it
        is the residual itself.
    """
    left, folds = problem.residual.copy(), problem.folds
    for group in np.array_split(np.arange(len(folds)), _GROUPS):
        tried = simulated_numbers(problem, empty, group.tolist(), back, values)
        built = build(problem, empty, tried)
        rows = samples_of([folds[k] for k in group], len(left))
        left[rows] = built.left[rows]
    return left


def against_given(problem: Problem, left: np.ndarray, parts: Sequence[slice]) -> Compared:
    """Compare a model with the given one.

    Args:
        problem: The residual and the terms.
        left: What the model leaves of the residual, shape (samples, n_axes).
        parts: Samples that are compared.
    """
    recording = problem.recording
    size = np.sqrt(np.mean(recording.torque**2, axis=0))
    size = np.where(size > 0, size, np.inf)
    period = recording.sample_period
    return compared(left / size, problem.residual / size, problem.inside, parts, period)
