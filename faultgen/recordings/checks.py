"""Checks of a recorded motion against the robot: units, sides, gaps, velocity, and what moves.

    recording, findings = checked_motion(recording, robot)

What a unit, a sign, another turn or a gap explains is corrected, and told. The torque is tested by
`discovery.accept`, which needs a model of the arm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from faultgen.recordings.finding import CORRECTED, REFUSE, TRUST, WARN, Finding
from faultgen.recordings.positions import continued, with_unit, without_gaps
from faultgen.recordings.rates import slow
from faultgen.recordings.recording import Recording
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot

STILL = 1e-3
"""Range of a joint that does not move [rad]."""

LATEST = 12
"""Samples by which a velocity or a torque is looked for earlier and later."""

_STUCK = 0.25  # time without any change of position while the reference moves [s]
_SAME = 0.9  # correlation from which a velocity is the derivative of the position, but for its unit
_SLOW = 3.0  # motor speed, in Stribeck velocities, that friction has to be told from


def without_friction(robot: Robot) -> np.ndarray:
    """Find the axes whose model has neither Coulomb nor static friction.

    Args:
        robot: The robot.

    Returns:
        Mask of shape (n_axes,).
    """
    bias = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    return np.asarray((bias[:, COULOMB] == 0) & (bias[:, STICTION] == 0))


def checked_motion(
    recording: Recording, robot: Robot, *, trust_log: bool = False
) -> tuple[Recording, list[Finding]]:
    """Check the motion of a recording, and correct what has one explanation.

    Args:
        recording: The measured data.
        robot: The robot's model.
        trust_log: Whether the recording is taken as it is, unless it is impossible.

    Returns:
        The corrected recording and the findings. If one of them refuses it, it cannot be used.
    """
    if recording.n_axes != robot.n_axes:
        text = f"{recording.n_axes} axes, but {robot.name} has {robot.n_axes}"
        return recording, [Finding(REFUSE, 0, text)]
    findings = [Finding(WARN, 0, note) for note in recording.notes]
    what = slow(recording.sample_period)
    if what is not None:
        findings.append(Finding(WARN, 0, what))
    if recording.robot and recording.robot != robot.name:
        text = f"the file says robot '{recording.robot}', the model is {robot.name}"
        findings.append(Finding(WARN, 0, text))
    if trust_log:
        return recording, findings
    for check in (continued, with_unit, without_gaps, _with_velocity):
        recording, more = check(recording, robot)
        findings += more
    findings += _stuck(recording, robot)
    _, qd, _ = recording.derivatives(recording.joint_position(robot))
    return recording, findings + _excitation(recording, robot, robot.gearing.outputs(qd))


def _stuck(recording: Recording, robot: Robot) -> list[Finding]:
    """Positions that do not change while the reference moves."""
    if recording.reference_position is None:
        return []
    findings = []
    period = recording.sample_period
    fastest = robot.joint_velocity_limit
    length = max(2, round(_STUCK / period))
    joint = recording.joint_position(robot)
    for part in recording.parts:
        steps = np.diff(joint[part], axis=0)
        asked = np.abs(np.diff(recording.reference_position[part], axis=0))
        for axis in range(robot.n_axes):
            frozen = (steps[:, axis] == 0) & (asked[:, axis] > 0.05 * fastest[axis] * period)
            if len(frozen) < length:
                continue
            run = np.convolve(frozen.astype(int), np.ones(length, int), "valid") == length
            if run.any():
                text = (
                    f"position is stuck from sample {part.start + int(np.argmax(run))} on while "
                    "the reference moves: stiction, or a dead encoder?"
                )
                findings.append(Finding(WARN, axis + 1, text))
    return findings


def _lag(x: np.ndarray, y: np.ndarray) -> tuple[int, float]:
    """Number of samples by which y lags behind x, and their correlation then.

    A lag is reported only if it explains half of the variance that remains without it. Near its
    maximum the correlation is so flat that smoothing shifts it by some samples.
    """
    x, y = x - x.mean(), y - y.mean()

    def correlation(lag: int) -> float:
        a, b = (x[: len(x) - lag], y[lag:]) if lag >= 0 else (x[-lag:], y[:lag])
        size = np.sqrt((a @ a) * (b @ b))
        return float(a @ b / size) if size > 0 else 0.0

    by_lag = {lag: correlation(lag) for lag in range(-LATEST, LATEST + 1)}
    best = max(by_lag, key=lambda lag: abs(by_lag[lag]))
    is_clear = 1 - by_lag[best] ** 2 < 0.5 * (1 - by_lag[0] ** 2)
    return (best, by_lag[best]) if is_clear else (0, by_lag[0])


def _with_velocity(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """A velocity in the unit and with the sign of the change of position; none if it is neither."""
    if recording.velocity is None or len(recording.position) <= 2 * LATEST:
        return recording, []
    findings: list[Finding] = []
    velocity = recording.velocity.copy()
    _, derived, _ = recording.derivatives(recording.position)
    size = np.abs(robot.gear_ratio) if recording.side == "motor" else np.ones(robot.n_axes)
    speed = robot.gearing.outputs(recording.derivatives(recording.joint_position(robot))[1])
    # the velocity of an axis that creeps is all noise
    fast = np.abs(speed * robot.gear_ratio).max(axis=0) > _SLOW * robot.stribeck_velocity
    is_used = True
    for axis in range(recording.n_axes):
        given, own = velocity[:, axis], derived[:, axis]
        if np.ptp(recording.position[:, axis]) < STILL * size[axis] or np.ptp(given) < 1e-9:
            continue
        lag, correlation = _lag(own, given)
        slope = float(given @ own / (own @ own))
        text = f"velocity is {slope:.3g} times the change of position"
        if slope < 0:
            text = "velocity has the opposite sign of the change of position"
        if 0.8 < slope < 1.25:
            if lag:
                text = f"velocity is {abs(lag)} samples {'late' if lag > 0 else 'early'}"
                findings.append(Finding(WARN, axis + 1, text))
        elif abs(correlation) > _SAME:
            divisor = -1.0 if -1.25 < slope < -0.8 else slope
            velocity[:, axis] /= divisor
            text += f": it is multiplied by {1 / divisor:.4g}; {TRUST}"
            findings.append(Finding(CORRECTED, axis + 1, text))
        elif fast[axis] and (abs(correlation) > 0.5 or not 0.5 < slope < 2):
            is_used = False
            text += f", to which it hardly belongs: no velocity is used; {TRUST}"
            findings.append(Finding(CORRECTED, axis + 1, text))
    if not any(one.level == CORRECTED for one in findings):
        return recording, findings
    return replace(recording, velocity=velocity if is_used else None), findings


def _excitation(recording: Recording, robot: Robot, qd: np.ndarray) -> list[Finding]:
    findings = []
    q = robot.gearing.outputs(recording.joint_position(robot))
    friction = robot.ids("actuator", "friction")
    stribeck = robot.model.actuator_biasprm[friction, STRIBECK_VELOCITY]
    speed = np.abs(qd * robot.gear_ratio)
    for axis in range(robot.n_axes):
        if np.ptp(q[:, axis]) < STILL:
            text = "does not move, so that no effect on this axis can be found"
        elif speed[:, axis].max() < _SLOW * stribeck[axis]:
            text = (
                f"motor speed stays below {speed[:, axis].max():.3g} rad/s: Coulomb, viscous and "
                "Stribeck friction cannot be distinguished"
            )
        elif qd[:, axis].max() <= 0 or qd[:, axis].min() >= 0:
            text = "moves in one direction only: friction and load cannot be distinguished"
        else:
            continue
        findings.append(Finding(WARN, axis + 1, text))
    return findings
