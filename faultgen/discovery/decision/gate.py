"""Whether the model of the healthy robot is good enough for an answer.

for line in gate(problem, choice, error): print(line)
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.decision.choice import Choice
from faultgen.discovery.fit.problem import Problem
from faultgen.inference.limits import MODEL_ERROR, MODEL_VARIANCE
from faultgen.inference.model import LARGEST

_NEARLY = 0.97  # of the largest scale: it stands at its bound
_ADVICE = {
    "links": "state masses and centres of mass",
    "friction": "state the friction of the drives, or run `calibrate` first",
    "friction at low speed": "record slow motion, or run `calibrate` first",
    "friction between motions": "let the robot warm up first",
    "form of friction": "record at several speeds",
    "form on one axis": "record at several speeds",
    "rotor inertia": "state the rotor inertia",
    "gain": "state the torque constants",
    "offset": "state the zero of the torque",
    "zero": "state the zero of the positions",
    "stiffness": "state the stiffness of the gearboxes",
    "hardening": "state the stiffness of the gearboxes",
    "damping": "state the damping of the gearboxes",
    "damping of bristles": "record at several speeds",
    "Stribeck exponent": "record slow motion",
    "lag of the log": "log torque and position at the same time",
    "smoothing": "log positions with less noise",
    "temperature": "record at one temperature",
}


def gate(problem: Problem, choice: Choice, error: float) -> list[str]:
    """Say why a model is not good enough.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.
        error: Torque error of the calibrated model on the scoring motions, over the torque.

    Returns:
        One line for each reason, with what would help; none if the model is good enough.
    """
    lines = []
    if error > MODEL_ERROR and not problem.baseline:
        lines.append(
            f"the calibrated model misses {100 * error:.0f} % of the torque on motions that were "
            "not fitted: check masses, gear ratios and the unit of the torque, or use --healthy"
        )
    variance = choice.variance.copy()
    variance[[axis - 1 for axis, _ in choice.unknown]] = np.nan  # nothing foretells that torque
    axes = [str(k + 1) for k in np.flatnonzero(variance > MODEL_VARIANCE)]
    if axes:
        worst = float(np.nanmax(variance))
        remedy = (
            "it may have changed in a way that nothing explains, or differ so from day to day: "
            "give more healthy recordings"
            if problem.baseline
            else "record more kinds of motion, or give --healthy"
        )
        lines.append(
            f"axis {', '.join(axes)}: on motions that were not fitted, the error is {worst:.2g} "
            f"times what the model expects (variances): {remedy}"
        )
    fitted = choice.found.fitted
    for group, scale in zip(fitted.model.groups, fitted.log_scales, strict=True):
        if group.name in _ADVICE and scale > _NEARLY * LARGEST:
            lines.append(
                f"{group.name}: the recording differs from the model {np.exp(scale):.0f} times as "
                f"much as usual: {_ADVICE[group.name]}"
            )
    return lines
