"""Waves that were chosen without a twin, although they hardly change the simulated torque.

Calibration does not change waves, and what it leaves always contains some. So a wave must be a
considerable part of what differs on its axis.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from faultgen.discovery.fit import Fit, Group, fit
from faultgen.discovery.gap import gap
from faultgen.discovery.model_edit import build
from faultgen.discovery.regression import Problem
from faultgen.effects import get_effect

WAVE = 0.15
"""Share of what differs on its axis beyond noise that a periodic effect, or one at a place, must
explain when it is simulated. Of development cases, two real waves explain 0.23 and 0.35, and six
false ones at most 0.11."""


def without_small_waves(
    problem: Problem,
    refitted: Problem,
    best: Fit,
    solution: np.ndarray,
    inside: np.ndarray,
    evident: Collection[Group] = (),
) -> Fit:
    """Remove waves and effects at a place that explain hardly anything from a set.

    What differs is counted without all waves of the axis. So a harmonic of a large wave is small.

    Args:
        problem: The residual and the terms.
        refitted: The same, in the form in which sets are fitted.
        best: The set.
        solution: The calibrated values that go with it, in prior standard deviations; shape
            (terms,).
        inside: Samples that are compared, shape (samples, n_axes).
        evident: Effects that stay unless they are a small part of the waves of their axis.

    Returns:
        The set, or a smaller one.
    """
    floor = np.square(gap(problem, problem.noise.of_samples(), inside)[1])

    def open_gap(groups: Collection[Group], axis: int) -> float:
        """Squared simulated gap of an axis beyond noise; infinite if there is no such set."""
        fitted = best if tuple(groups) == best.groups else fit(refitted, list(groups))
        if fitted is None:
            return np.inf
        left = build(problem, fitted, solution).left
        return float(np.square(gap(problem, left, inside)[1])[axis] - floor[axis])

    for group in best.groups:
        axis = problem.terms[group[0]].axis - 1
        if not _is_wave(problem, group):
            continue
        alike = [
            g for g in best.groups if _is_wave(problem, g) and problem.terms[g[0]].axis == axis + 1
        ]
        if len(alike) == 1 and group in evident:
            continue
        nothing = open_gap([g for g in best.groups if g not in alike], axis)
        rest = [g for g in best.groups if g != group]
        if open_gap(rest, axis) - open_gap(best.groups, axis) < WAVE * nothing:
            smaller = fit(refitted, rest)
            if smaller is not None:
                return without_small_waves(problem, refitted, smaller, solution, inside, evident)
    return best


def _is_wave(problem: Problem, group: Group) -> bool:
    """Whether an effect is periodic, or acts at a place that is searched."""
    return get_effect(problem.terms[group[0]].name).prior.use in ("periodic", "searched")
