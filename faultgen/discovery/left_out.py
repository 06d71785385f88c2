"""Axes of a recording that no effect can be named on, because their torque cannot be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgen.discovery.rigid.log_fit import LogFit
from faultgen.discovery.rigid.torque_log import Evidence
from faultgen.errors import InputError
from faultgen.inference.limits import NO_TORQUE, OTHERS_FINE
from faultgen.recordings.finding import LEFT_OUT, TRUST, WARN, Finding
from faultgen.recordings.recording import Recording
from faultgen.recordings.torque_doubts import without_weight


def weightless(
    fit: LogFit, sign: np.ndarray, empty: Sequence[int], findings: list[Finding]
) -> list[int]:
    """Find the axes, from 1, whose torque lacks the weight of the arm for certain.

    One axis may be balanced by a spring that the model lacks. If all loaded axes of an arm have no
    weight, that is no explanation.

    Args:
        fit: The fit of the recording.
        sign: Sign with which each torque is used, shape (n_axes,).
        empty: Axes, from 1, that are not asked.
        findings: What was found. What is found here is added.

    Returns:
        The axes.
    """
    rows = fit.rows
    if not len(rows):
        return []
    rest = fit.model - fit.gravity
    if not fit.recording.link:
        rest = rest + fit.rotor * fit.acceleration
    gravity = fit.gravity.copy()
    gravity[:, [axis - 1 for axis in empty]] = 0.0  # nothing is asked of a torque that is none
    found, is_certain = without_weight(
        fit.measured[rows] * sign, gravity, rest, fit.speed, fit.offset
    )
    if not found:
        return []
    axes = ", ".join(str(axis) for axis, _, _ in found)
    shares = ", ".join(f"{share:.2f} ± {error:.2f}" for _, share, error in found)
    several = "axes" if len(found) > 1 else "axis"
    text = (
        f"the torque of {several} {axes} has no weight in it (share of the model's: {shares}): log "
        "the measured torque, not the one that the controller adds to the weight"
    )
    if not is_certain:
        findings.append(
            Finding(WARN, 0, f"{text}; unless a spring that the model lacks carries it")
        )
        return []
    text += f"; or correct the model, if the arm is mounted another way; {TRUST}"
    findings.append(Finding(LEFT_OUT, 0, text))
    return [axis for axis, _, _ in found]


def unexplained(
    fit: LogFit, evidence: Sequence[Evidence | None], findings: list[Finding]
) -> list[int]:
    """Find the axes, from 1, whose torque hardly depends on the motion, although others do.

    Args:
        fit: The fit of the recording.
        evidence: The evidence by axis.
        findings: What was found. What is found here is added.

    Returns:
        The axes.
    """
    fast = np.abs(fit.speed * fit.robot.gear_ratio).max(axis=0, initial=0.0)
    slides = fast > fit.robot.stribeck_velocity
    errors = [
        one.error if one is not None and slides[axis] else None for axis, one in enumerate(evidence)
    ]
    known = [error for error in errors if error is not None]
    if not known or min(known) > OTHERS_FINE:
        return []
    out = []
    for axis, error in enumerate(errors, start=1):
        if error is not None and error >= NO_TORQUE:
            out.append(axis)
            text = (
                f"even free parameters of an arm leave {100 * error:.0f} % of the torque "
                "unexplained on motions that were not fitted: the axis has no good model, and no "
                f"effect is named on it; {TRUST}"
            )
            findings.append(Finding(LEFT_OUT, axis, text))
    return out


def left_out(recording: Recording, axes: Sequence[int], findings: Sequence[Finding]) -> Recording:
    """Leave axes out of a recording: their samples count as lost.

    Args:
        recording: The recording.
        axes: The axes, from 1.
        findings: What was found in the recording, for the message.

    Returns:
        The recording.

    Raises:
        InputError: No axis is left.
    """
    if not axes:
        return recording
    if len(axes) == recording.n_axes:
        reasons = "; ".join(
            f"axis {one.axis}: {one.message}" if one.axis else one.message
            for one in findings
            if one.level == LEFT_OUT
        )
        reasons = reasons.replace(f"; {TRUST}", "")
        raise InputError(f"{recording.source}: no axis can be used: {reasons}; {TRUST}")
    lost = np.zeros(recording.position.shape, bool) if recording.lost is None else recording.lost
    lost = lost.copy()
    lost[:, np.array(axes) - 1] = True
    return replace(recording, lost=lost, left_out=tuple(axes))
