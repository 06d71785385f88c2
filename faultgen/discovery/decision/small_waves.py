"""Waves that were chosen without a baseline, although they hardly change the simulated torque.

Calibration does not change waves, and what it leaves always contains some. So a wave must be a
considerable part of what differs on its axis.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache

import numpy as np

from faultgen.discovery.calibration.model_edit import build
from faultgen.discovery.fit.fit import Fit, Group, fit
from faultgen.discovery.fit.gap import gap
from faultgen.discovery.fit.regression import Problem
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

    @cache
    def set_of(groups: tuple[Group, ...]) -> Fit | None:
        return best if groups == best.groups else fit(refitted, groups)

    @cache
    def open_gaps(groups: tuple[Group, ...]) -> np.ndarray:
        """Squared simulated gap of each axis beyond noise; infinite if there is no such set."""
        fitted = set_of(groups)
        if fitted is None:
            return np.full(len(floor), np.inf)
        left = build(problem, fitted, solution).left
        return np.asarray(np.square(gap(problem, left, inside)[1]) - floor)

    waves = [group for group in best.groups if _is_wave(problem, group)]
    for group in waves:
        axis = problem.terms[group[0]].axis
        alike = [g for g in waves if problem.terms[g[0]].axis == axis]
        if len(alike) == 1 and group in evident:
            continue
        nothing = open_gaps(tuple(g for g in best.groups if g not in alike))
        rest = tuple(g for g in best.groups if g != group)
        explained = open_gaps(rest) - open_gaps(best.groups)
        smaller = set_of(rest)
        if smaller is not None and explained[axis - 1] < WAVE * nothing[axis - 1]:
            return without_small_waves(problem, refitted, smaller, solution, inside, evident)
    return best


def _is_wave(problem: Problem, group: Group) -> bool:
    """Whether an effect is periodic, or acts at a place that is searched."""
    return get_effect(problem.terms[group[0]].name).prior.use in ("periodic", "searched")
