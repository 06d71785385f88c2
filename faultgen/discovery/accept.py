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

from faultgen.discovery.rigid.log_fit import LogFit
from faultgen.discovery.rigid.torque_log import (
    CERTAIN,
    Evidence,
    Factor,
    common_factor,
    evidence_of,
    known_factors,
    own_factor,
    own_gain,
    signs,
)
from faultgen.errors import InputError
from faultgen.recordings.checks import (
    CORRECTED,
    LEFT_OUT,
    REFUSE,
    STILL,
    TRUST,
    WARN,
    Finding,
    checked_motion,
    sorted_findings,
    without_friction,
)
from faultgen.recordings.recording import Recording, TorqueConstants
from faultgen.recordings.torque_doubts import constant_torques, torque_doubts, without_weight
from faultgen.robot import Robot

LITTLE = 0.9
"""Error of a fit with free parameters on blocks that were not fitted, over the deviation of the
torque, from which an axis has no good model: less than a fifth of its variance is explained."""

FINE = 0.5
"""The same of the best axis, up to which the model and the motion can be right: assumed."""

_Found = list[list[Evidence | None]]


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
    scaled = _with_scale(made, robot, evidence, known, findings)
    if any(one is not other for one, other in zip(scaled, made, strict=True)):
        made = scaled
        fits, evidence = _judged(made, robot, empty)
    made = _with_sign(made, evidence, known, findings)
    for k, fit in enumerate(fits):
        factor = np.array(made[k].torque_factor)
        sign = np.sign(factor)
        _tell_of_lags(fit, evidence[k], findings[k])
        out = {*empty[k], *_weightless(fit, sign, empty[k], findings[k])}
        out |= set(_unexplained(fit, evidence[k], findings[k]))
        made[k] = _left_out(made[k], sorted(out), findings[k])
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
) -> tuple[list[LogFit], _Found]:
    """The fit and the evidence of each recording; none for axes without a torque."""
    fits = [LogFit(one, robot) for one in recordings]
    found = [evidence_of(fit) for fit in fits]
    for axes, out in zip(found, empty, strict=True):
        for axis in out:
            axes[axis - 1] = None
    return fits, found


def _with_scale(
    recordings: list[Recording],
    robot: Robot,
    evidence: _Found,
    known: Recording | None,
    findings: list[list[Finding]],
) -> list[Recording]:
    """Torques in the unit and of the side that is stated."""
    out = []
    chosen = [_factors(one, robot, axes) for one, axes in zip(recordings, evidence, strict=True)]
    for k, recording in enumerate(recordings):
        factors = known_factors(robot, recording.side)
        scale, gains = np.ones(robot.n_axes), np.ones(robot.n_axes)
        for axis in range(robot.n_axes):
            number = chosen[k][axis]
            one = evidence[k][axis]
            if number is None and one is not None:
                others = {c[axis] for c in chosen} - {None}
                number = next((o for o in others if _together(evidence, axis, o)), None)
            if number is not None:
                scale[axis] = factors[number].values[axis]
                text = (
                    f"the torque is in {factors[number].unit}: it is divided by "
                    f"{scale[axis]:.6g}; {TRUST}"
                )
                findings[k].append(Finding(CORRECTED, axis + 1, text))
            elif recording.constants is None and not recording.link:
                gain = _gain(evidence, axis)
                if gain is not None:
                    gains[axis] = gain
                    text = (
                        f"the torque is {gain:.3g} times what the model needs, and no usual unit "
                        "explains it: it is divided by that, and its gain counts as unknown; check "
                        f"its unit, the gear ratio and the torque constant; {TRUST}"
                    )
                    findings[k].append(Finding(CORRECTED, axis + 1, text))
        if known is not None and known.torque_factor:
            silent = np.array([one is None or not one.is_shown for one in evidence[k]])
            scale = np.where(silent & (scale == 1), 1 / np.abs(known.torque_factor), scale)
        total = scale * gains
        if np.any(total != 1):
            recording = replace(
                recording,
                torque=recording.torque / total,
                torque_factor=tuple((1 / total).tolist()),
            )
        if np.any(gains != 1):
            zero = np.zeros(robot.n_axes)
            constants = TorqueConstants(1 / gains, zero, recording.source)
            recording = replace(recording, constants=constants)
        out.append(recording)
    return out


def _factors(
    recording: Recording, robot: Robot, axes: Sequence[Evidence | None]
) -> list[int | None]:
    """Number of the known factor of each axis of a recording."""
    if recording.constants is not None:  # they were found from it
        return [None] * robot.n_axes
    factors: list[Factor] = known_factors(robot, recording.side)
    common = common_factor(axes, factors)
    if common is not None:
        return [common] * robot.n_axes
    return [None if one is None else own_factor(one, factors) for one in axes]


def _together(evidence: _Found, axis: int, number: int) -> bool:
    """Whether all recordings together show a factor of an axis."""
    of_axis = [axes[axis] for axes in evidence]
    return sum(one.factors[number] for one in of_axis if one is not None) >= CERTAIN


def _gain(evidence: _Found, axis: int) -> float | None:
    """The gain of an axis that no unit explains, as the recordings tell it together."""
    able = [axes[axis] for axes in evidence]
    told = [own_gain(one) for one in able if one is not None]
    gains = [one for one in told if one is not None]
    if not gains or 2 * len(gains) <= len(told):
        return None
    return float(np.exp(np.mean(np.log(gains))))


def _with_sign(
    recordings: list[Recording],
    evidence: _Found,
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
                by = f"log likelihood ratio {ratio:.0f}" if ratio >= CERTAIN else "as in the others"
                text = f"the torque has the opposite sign ({by}): it is multiplied by -1; {TRUST}"
                findings[k].append(Finding(CORRECTED, axis + 1, text))
            elif one is not None and abs(one.sign) < CERTAIN and one.sign < 0:
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


def _weightless(
    fit: LogFit, sign: np.ndarray, empty: Sequence[int], findings: list[Finding]
) -> list[int]:
    """Axes, from 1, whose torque lacks the weight of the arm for certain.

    One axis may be balanced by a spring that the model lacks. If all loaded axes of an arm have no
    weight, that is no explanation.
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


def _unexplained(
    fit: LogFit, evidence: Sequence[Evidence | None], findings: list[Finding]
) -> list[int]:
    """Axes, from 1, whose torque hardly depends on the motion, although others do."""
    fast = np.abs(fit.speed * fit.robot.gear_ratio).max(axis=0, initial=0.0)
    slides = fast > fit.robot.stribeck_velocity
    errors = [
        one.error if one is not None and slides[axis] else None for axis, one in enumerate(evidence)
    ]
    known = [error for error in errors if error is not None]
    if not known or min(known) > FINE:
        return []
    out = []
    for axis, error in enumerate(errors, start=1):
        if error is not None and error >= LITTLE:
            out.append(axis)
            text = (
                f"even free parameters of an arm leave {100 * error:.0f} % of the torque "
                "unexplained on motions that were not fitted: the axis has no good model, and no "
                f"effect is named on it; {TRUST}"
            )
            findings.append(Finding(LEFT_OUT, axis, text))
    return out


def _left_out(recording: Recording, axes: Sequence[int], findings: Sequence[Finding]) -> Recording:
    """The recording without some axes, whose samples count as lost.

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
