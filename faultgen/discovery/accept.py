"""Recordings made usable: what is wrong with a log is tested, corrected and told.

    recordings, findings = accepted([healthy, measured], robot)

Nothing is refused that can be answered. A sign or a unit that the recording itself shows is
corrected by a stated factor. An axis without a usable torque is left out: its samples count as
lost, and everything else is answered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgen.discovery.left_out import left_out, unexplained, weightless
from faultgen.discovery.log_scale import Found, with_scale
from faultgen.discovery.rigid.log_fit import LogFit
from faultgen.discovery.rigid.torque_log import Evidence, evidence_of, signs
from faultgen.errors import InputError
from faultgen.inference.limits import LOG_CERTAIN
from faultgen.recordings.checks import STILL, checked_motion, without_friction
from faultgen.recordings.finding import (
    CORRECTED,
    LEFT_OUT,
    REFUSE,
    TRUST,
    WARN,
    Finding,
    sorted_findings,
)
from faultgen.recordings.recording import Recording
from faultgen.recordings.torque_doubts import constant_torques, torque_doubts
from faultgen.robot import Robot


def accepted(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    trust_log: bool = False,
    known: Recording | None = None,
) -> tuple[list[Recording], list[list[Finding]]]:
    """Test and correct recordings that come from the same sensors.

    Args:
        recordings: Recordings in units of torque.
        robot: The model.
        trust_log: Whether they are taken as they are, unless that is impossible.
        known: A recording of the same sensors that was accepted before. What a recording cannot
            tell is taken from it.

    Returns:
        The recordings that can be used, and the findings of each.

    Raises:
        InputError: A recording cannot be used. The message is one line with all reasons.
    """
    made: list[Recording] = []
    findings: list[list[Finding]] = []
    for recording in recordings:
        one, found = checked_motion(recording, robot, trust_log=trust_log)
        refused = [finding.message for finding in found if finding.level == REFUSE]
        if refused:
            raise InputError(f"{recording.source}: {'; '.join(refused)}")
        made.append(one)
        findings.append(found)
    _tell_of_friction(made, robot, findings)
    if trust_log:
        return made, [sorted_findings(found) for found in findings]
    empty = [_without_torque(one, found) for one, found in zip(made, findings, strict=True)]
    fits, evidence = _judged(made, robot, empty)
    scaled = with_scale(made, robot, evidence, known, findings)
    if any(one is not other for one, other in zip(scaled, made, strict=True)):
        made = scaled
        fits, evidence = _judged(made, robot, empty)
    made = _with_sign(made, evidence, known, findings)
    for k, fit in enumerate(fits):
        sign = np.sign(made[k].torque_factor)
        _tell_of_lags(fit, evidence[k], findings[k])
        out = {*empty[k], *weightless(fit, sign, empty[k], findings[k])}
        out |= set(unexplained(fit, evidence[k], findings[k]))
        made[k] = left_out(made[k], sorted(out), findings[k])
    return made, [sorted_findings(found) for found in findings]


def check_recording(recording: Recording, robot: Robot) -> list[Finding]:
    """Check a recording against the model of its robot.

    Args:
        recording: The measured data.
        robot: The robot's model.

    Returns:
        What was found, the worst first. The list is empty if nothing is wrong.
    """
    if recording.current and recording.n_axes == robot.n_axes:
        text = "its torque is a motor current: convert it, see discovery.calibration.motor_current"
        return [Finding(REFUSE, 0, text)]
    try:
        return accepted([recording], robot)[1][0]
    except InputError as error:
        return [Finding(REFUSE, 0, str(error).removeprefix(f"{recording.source}: "))]


def current_signs(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the signs of motor currents from the torque that they make with provisional constants.

    Args:
        recording: The recording in units of torque.
        robot: The model.

    Returns:
        1 and -1, shape (n_axes,).
    """
    return signs([evidence_of(LogFit(recording, robot))])[0]


def _tell_of_friction(
    recordings: Sequence[Recording], robot: Robot, findings: list[list[Finding]]
) -> None:
    """Say which axes of the model have no friction."""
    bare = np.flatnonzero(without_friction(robot)) + 1
    if not len(bare):
        return
    axes = f"axis {bare[0]}" if len(bare) == 1 else f"axes {', '.join(map(str, bare))}"
    text = f"the model has no friction on {axes}: it is found from the recording"
    for one, found in zip(recordings, findings, strict=True):
        if not one.link:
            found.append(Finding(WARN, 0, text))


def _without_torque(recording: Recording, findings: list[Finding]) -> list[int]:
    """Axes, from 1, whose torque is constant or something else; tells of other doubts."""
    out = []
    for axis in constant_torques(recording):
        out.append(axis)
        text = "the torque never changes while the axis moves: it is not used; check its column"
        findings.append(Finding(LEFT_OUT, axis, f"{text}; {TRUST}"))
    for axis, text, is_torque in torque_doubts(recording):
        level = WARN if is_torque else LEFT_OUT
        out += [] if is_torque else [axis]
        findings.append(Finding(level, axis, text if is_torque else f"{text}; {TRUST}"))
    return out


def _judged(
    recordings: Sequence[Recording], robot: Robot, empty: Sequence[Sequence[int]]
) -> tuple[list[LogFit], Found]:
    """The fit and the evidence of each recording; none for axes without a torque."""
    fits = [LogFit(one, robot) for one in recordings]
    found = [evidence_of(fit) for fit in fits]
    for axes, out in zip(found, empty, strict=True):
        for axis in out:
            axes[axis - 1] = None
    return fits, found


def _with_sign(
    recordings: list[Recording],
    evidence: Found,
    known: Recording | None,
    findings: list[list[Finding]],
) -> list[Recording]:
    """Torques with the sign of the positions."""
    out = []
    before = None if known is None else np.sign(known.torque_factor)
    for k, (recording, sign) in enumerate(zip(recordings, signs(evidence, before), strict=True)):
        for axis, one in enumerate(evidence[k]):
            if sign[axis] < 0:
                ratio = 0.0 if one is None else -one.sign
                by = (
                    f"log likelihood ratio {ratio:.0f}"
                    if ratio >= LOG_CERTAIN
                    else "as in the others"
                )
                text = f"the torque has the opposite sign ({by}): it is multiplied by -1; {TRUST}"
                findings[k].append(Finding(CORRECTED, axis + 1, text))
            elif one is not None and abs(one.sign) < LOG_CERTAIN and one.sign < 0:
                text = (
                    "the motion does not show the sign of the torque (log likelihood ratio "
                    f"{one.sign:.1f}): it is used as it was logged"
                )
                findings[k].append(Finding(WARN, axis + 1, text))
        factor = np.array(recording.torque_factor or np.ones(len(sign))) * sign
        torque = recording.torque * sign if np.any(sign < 0) else recording.torque
        out.append(replace(recording, torque=torque, torque_factor=tuple(factor.tolist())))
    return out


def _tell_of_lags(
    fit: LogFit, evidence: Sequence[Evidence | None], findings: list[Finding]
) -> None:
    """Say which torques are early or late."""
    for axis, one in enumerate(evidence, start=1):
        moves = np.ptp(fit.recording.joint_position(fit.robot)[:, axis - 1]) > STILL
        if one is not None and one.late and moves:
            milliseconds = 1000 * abs(one.late) * fit.recording.sample_period
            late = "late" if one.late > 0 else "early"
            text = f"torque is {abs(one.late)} samples ({milliseconds:.3g} ms) {late}"
            findings.append(Finding(WARN, axis, text))
