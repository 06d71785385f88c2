"""Charts of a discovery: measured and simulated torque, and what explains the gap."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.discovery.discover import Discovery
from faultgen.report.chart import Chart, axes, line

_MOST = 3000  # samples of a line
_MEASURED, _FOUND, _GIVEN = 0, 1, 2  # numbers of the colours


def torque_charts(found: Discovery) -> list[Chart]:
    """Draw the torque of each axis over the time of the recording.

    Args:
        found: The results of a discovery.

    Returns:
        Measured and simulated torque; and the gap between them, with what explains it.
    """
    problem, answer = found.problem_, found.answer_
    measured = problem.recording.torque
    given, after = measured - problem.residual, measured - answer.left_torque
    explained = problem.residual - answer.left_torque
    side = "joint" if problem.recording.side == "joint" else "motor"
    as_given = "expected from the healthy recording" if problem.baseline else "model as given"
    every = -(-len(measured) // _MOST)
    step = every * problem.recording.sample_period
    torque: list[dict[str, Any]] = []
    gaps: list[dict[str, Any]] = []
    told = []
    for axis in range(1, measured.shape[1] + 1):
        inside = problem.inside[:, axis - 1]
        for name, values, number in (
            ("measured", measured, _MEASURED),
            (as_given, given, _GIVEN),
            ("with what was found", after, _FOUND),
        ):
            own = values[::every, axis - 1]
            torque.append(line(name, own, number, step=step, axis=axis))
        for name, values, number in (
            (f"measured minus {as_given}", problem.residual, _GIVEN),
            ("explained by what was found", explained, _FOUND),
        ):
            own = np.where(inside, values[:, axis - 1], np.nan)[::every]
            gaps.append(line(name, own, number, step=step, axis=axis))
        if inside.any():
            before, left = (
                float(np.sqrt(np.mean(one[inside, axis - 1] ** 2)))
                for one in (problem.residual, answer.left_torque)
            )
            told.append(f"axis {axis} {before:.3g} before and {left:.3g} after")
    unit = f"torque, {side} side [N m]"
    errors = ", ".join(told) or "none"
    return [
        Chart(
            title="Measured and simulated torque",
            traces=torque,
            layout=axes("time [s]", unit),
            over_time=True,
            caption="Where the line of the model as given leaves the measured one, something is "
            "missing; the line with what was found should be on the measured one."
            if not problem.baseline
            else "Expected: the torque of the model, and what the healthy recording had besides. "
            "The line with what was found should be on the measured one.",
            description="Lines of the measured torque over time, of that which is expected, and "
            f"of that with what was found. RMS difference from the measured one in N m: {errors}.",
        ),
        Chart(
            title="The gap, and what explains it",
            traces=gaps,
            layout=axes("time [s]", unit),
            over_time=True,
            caption="Where the two lines agree, nothing is missing. Samples that are not used, "
            "such as those at rest, are left out.",
            description="Lines of the difference between measured and expected torque over time, "
            f"and of the part that is explained. RMS in N m: {errors}.",
        ),
    ]
