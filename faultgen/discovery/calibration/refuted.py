"""Calibrated numbers that motions to which they were not fitted refute, axis by axis.

basic, values, lines = without_refuted(problem, empty, basic, values)
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.calibration.compared import Compared, compared
from faultgen.discovery.calibration.model_edit import Built, build
from faultgen.discovery.fit.fit import Fit
from faultgen.discovery.fit.gap import gap, scored
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.terms.candidates import INERTIA


def without_refuted(
    problem: Problem, empty: Fit, basic: Built, values: np.ndarray
) -> tuple[Built, np.ndarray, list[str]]:
    """Take back what calibration has made worse on motions that it was not fitted to.

    An axis that has become worse beyond the interval of the difference keeps its own numbers of the
    given model: friction, rotor inertia, offset, stiffness. If an axis is worse still, the links of
    the given model are kept, and at last all numbers. These are also kept if the error of all axes
    together has grown.

    Args:
        problem: The residual and the terms.
        empty: The empty set of effects.
        basic: The model with the calibrated numbers.
        values: Value of every term in prior standard deviations, shape (terms,).

    Returns:
        The model, the values of shape (terms,), and one line for what was taken back.
    """
    worse = against_given(problem, basic).worse
    lines: list[str] = []
    weak = worse.copy()
    links = np.array([t.name == INERTIA for t in problem.terms])
    everything = np.ones_like(links)
    drives = "the numbers of its drive are"
    for kept in (drives, "the numbers of its drive and all links are", "the whole model is"):
        if not worse.any():
            break
        weak |= worse
        own = np.array([t.is_effect and weak[min(t.axis, len(weak)) - 1] for t in problem.terms])
        back = own if kept == drives else own | links if kept.endswith("are") else everything
        values = np.where(back, 0.0, values)
        basic = build(problem, empty, values)
        axes = ", ".join(str(k + 1) for k in np.flatnonzero(weak))
        lines = [
            f"axis {axes}: {kept} used as given, because after calibration the error on motions "
            "that were not fitted is larger than before"
        ]
        worse = against_given(problem, basic).worse
    if gap(problem, basic.left)[0] > gap(problem, problem.residual)[0]:
        values = np.zeros_like(values)
        basic = build(problem, empty, values)
    return basic, values, lines


def against_given(problem: Problem, built: Built) -> Compared:
    """Compare a model with the given one on the motions that are kept for scoring.

    Args:
        problem: The residual and the terms.
        built: The model.
    """
    recording = problem.recording
    size = np.sqrt(np.mean(recording.torque**2, axis=0))
    size = np.where(size > 0, size, np.inf)
    parts = [problem.parts[k] for k in problem.scoring]
    return compared(
        built.left / size, problem.residual / size, scored(problem), parts, recording.sample_period
    )
