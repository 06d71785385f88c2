"""Checks of a recording against its robot: units, signs, gears, gaps, delays and motion by axis.

The recording is compared with the torque that the model predicts for the measured motion. Wrong
signs or units change this torque much more than a missing effect does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from faultgen.effects.prior import torque_offset_std
from faultgen.recordings.recording import Recording
from faultgen.recordings.torque_doubts import torque_doubts, without_weight
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot
from faultgen.simulation.arm import Arm, motor_torque

_LAGS = 12  # samples by which a channel may be late to be told so
_STILL = 1e-3  # range of a joint that does not move [rad]
_STUCK = 0.25  # time without any change of position while the reference moves [s]
_TURN = 2 * np.pi  # [rad]
_NEAR = 5  # steps before and after a jump that tell how far an axis usually moves
_MISSING = 2.5  # usual steps that a jump may take more: two missing samples
_FRICTION_APART = 10.0  # ratio of torques up to which friction may be the reason: assumed
_HARDLY = 0.03  # share of a torque that says nothing about its unit: assumed
_MOST_POSES = 20_000  # samples in which the weight is looked for: enough, and quick
_UNKNOWN_ZERO = 10.0  # offset of a sensor that nobody calibrated, over a usual one: assumed
_SLOW = 3.0  # motor speed, in Stribeck velocities, that friction has to be told from


@dataclass(frozen=True)
class Finding:
    """One thing in a recording that is wrong or doubtful."""

    level: str
    """'refuse' if the data cannot be used as they are, otherwise 'warn'."""
    axis: int
    """Axis, from 1, or 0 if it concerns all axes."""
    message: str
    """What is wrong, where, and what would be right."""

    def __str__(self) -> str:
        where = f"axis {self.axis}: " if self.axis else ""
        return f"{self.level}: {where}{self.message}"


def without_friction(robot: Robot) -> np.ndarray:
    """Find the axes whose model has neither Coulomb nor static friction.

    Args:
        robot: The robot.

    Returns:
        Mask of shape (n_axes,).
    """
    bias = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    return np.asarray((bias[:, COULOMB] == 0) & (bias[:, STICTION] == 0))


def check_recording(recording: Recording, robot: Robot) -> list[Finding]:
    """Check a recording against the model of its robot.

    Args:
        recording: The measured data.
        robot: The robot's model.

    Returns:
        Findings, refusals first. The list is empty if nothing is wrong.
    """
    if recording.n_axes != robot.n_axes:
        text = f"{recording.n_axes} axes, but {robot.name} has {robot.n_axes}"
        return [Finding("refuse", 0, text)]
    if recording.current:
        text = "its torque is a motor current: convert it, see discovery.calibration.motor_current"
        return [Finding("refuse", 0, text)]
    findings = [Finding("warn", 0, note) for note in recording.notes]
    findings += [Finding("warn", axis, text) for axis, text in torque_doubts(recording)]
    if recording.robot and recording.robot != robot.name:
        text = f"the file says robot '{recording.robot}', the model is {robot.name}"
        findings.append(Finding("warn", 0, text))
    motor = recording.side == "motor"
    joint = recording.joint_position(robot)
    findings += _units(recording, robot, joint)
    findings += _gaps(recording, robot, joint)
    if any(finding.level == "refuse" for finding in findings):
        return _sorted(findings)  # derivatives and torques of such data mean nothing
    q, qd, qdd = recording.derivatives(joint)
    outputs = robot.gearing.outputs(qd)
    findings += _velocity(recording, outputs * robot.gear_ratio if motor else qd)
    findings += _excitation(recording, robot, robot.gearing.outputs(q), outputs)
    if recording.link:
        expected = Arm(robot).inverse_dynamics(q, qd, qdd)
        findings += _weight(recording, robot, expected, q, qd)
        return _sorted(findings + _torque(recording, robot, expected, qd))
    bare = np.flatnonzero(without_friction(robot)) + 1
    if len(bare):
        axes = f"axis {bare[0]}" if len(bare) == 1 else f"axes {', '.join(map(str, bare))}"
        text = f"the model has no friction on {axes}: it is found from the recording"
        findings.append(Finding("warn", 0, text))
    expected = motor_torque(Arm(robot), q, qd, qdd)
    if not motor:
        expected = expected * robot.gear_ratio
    expected += _missing_friction(recording, robot, expected, outputs)
    findings += _weight(recording, robot, expected, q, outputs)
    findings += _torque(recording, robot, expected, outputs)
    return _sorted(findings)


def _sorted(findings: list[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: (finding.level != "refuse", finding.axis))


def _units(recording: Recording, robot: Robot, joint: np.ndarray) -> list[Finding]:
    findings = []
    low, high = robot.joint_range.T
    slack = 0.05 * (high - low)
    for axis in range(robot.n_axes):
        least, most = joint[:, axis].min(), joint[:, axis].max()
        if least >= low[axis] - slack[axis] and most <= high[axis] + slack[axis]:
            continue
        guess = ""
        for factor, unit in ((np.pi / 180, "degrees"), (1 / abs(robot.gear_ratio[axis]), "motor")):
            inside = least * factor >= low[axis] - slack[axis]
            if inside and most * factor <= high[axis] + slack[axis]:
                told = "in degrees" if unit == "degrees" else "of the motor, not of the joint"
                guess = f"; are the positions {told}?"
                break
        turns = round(((low[axis] + high[axis]) - (least + most)) / 2 / _TURN)
        moved = np.array([least, most]) + turns * _TURN
        inside = moved[0] >= low[axis] - slack[axis] and moved[1] <= high[axis] + slack[axis]
        if turns and inside and not robot.slides[axis]:
            guess = f"; does the log count them from another turn? {turns:+d} turn would be inside"
        text = (
            f"joint angles from {least:.3g} to {most:.3g} rad are outside of the range "
            f"{low[axis]:.3g} to {high[axis]:.3g} rad{guess}"
        )
        findings.append(Finding("refuse", axis + 1, text))
    return findings


def _is_gap(steps: np.ndarray, k: int) -> bool:
    """Whether more than two samples are missing before step `k` of an axis.

    A sample that was logged late is followed by a step that catches up. The steps around it then
    add up to the usual ones.
    """
    near = steps[max(k - _NEAR, 0) : k + _NEAR + 1]
    usual = float(np.median(near))
    return bool(abs(np.sum(near - usual)) > _MISSING * abs(usual) + 1e-6)


def _gaps(recording: Recording, robot: Robot, joint: np.ndarray) -> list[Finding]:
    findings = []
    period = recording.sample_period
    fastest = robot.motor_velocity_limit / np.abs(robot.gear_ratio)
    for part in recording.parts:
        steps = np.diff(joint[part], axis=0)
        for axis in range(robot.n_axes):
            far = np.flatnonzero(np.abs(steps[:, axis]) > 1.5 * fastest[axis] * period + 1e-6)
            gaps = [k for k in far.tolist() if _is_gap(steps[:, axis], k)]
            if len(far):
                first = gaps[0] if gaps else int(far[0])
                text = (
                    f"jumps by {steps[first, axis]:.3g} rad at sample {part.start + first + 1}, "
                    f"more than {fastest[axis]:.3g} rad/s allow"
                )
                turned = abs(abs(steps[first, axis]) - _TURN) <= 2 * fastest[axis] * period
                text += (
                    ": the angle starts again after a whole turn; 'faultgen import' and "
                    "numpy.unwrap continue it"
                    if turned and not robot.slides[axis]
                    else ": a gap? begin a new segment there"
                    if gaps
                    else f" ({len(far)} such jumps in all): samples were logged late, or one or "
                    "two are missing"
                )
                findings.append(Finding("refuse" if gaps else "warn", axis + 1, text))
        if recording.reference_position is None:
            continue
        reference = np.abs(np.diff(recording.reference_position[part], axis=0))
        length = max(2, round(_STUCK / period))
        for axis in range(robot.n_axes):
            moving = reference[:, axis] > 0.05 * fastest[axis] * period
            frozen = (steps[:, axis] == 0) & moving
            if len(frozen) < length:
                continue
            run = np.convolve(frozen.astype(int), np.ones(length, int), "valid") == length
            if run.any():
                sample = part.start + int(np.argmax(run))
                text = (
                    f"position is stuck from sample {sample} on while the reference moves: "
                    "stiction, or a dead encoder?"
                )
                findings.append(Finding("warn", axis + 1, text))
    return findings


def _lag(x: np.ndarray, y: np.ndarray) -> tuple[int, float]:
    """Number of samples by which y lags behind x, and their correlation without a lag.

    A lag is reported only if it explains half of the variance that remains without it. Near its
    maximum the correlation is so flat that elasticity and smoothing shift it by some samples.
    """
    x, y = x - x.mean(), y - y.mean()

    def correlation(lag: int) -> float:
        a, b = (x[: len(x) - lag], y[lag:]) if lag >= 0 else (x[-lag:], y[:lag])
        size = np.sqrt((a @ a) * (b @ b))
        return float(a @ b / size) if size > 0 else 0.0

    by_lag = {lag: correlation(lag) for lag in range(-_LAGS, _LAGS + 1)}
    best = max(by_lag, key=lambda lag: abs(by_lag[lag]))
    left, left_without = 1 - by_lag[best] ** 2, 1 - by_lag[0] ** 2
    return (best if left < 0.5 * left_without else 0), by_lag[0]


def _velocity(recording: Recording, derived: np.ndarray) -> list[Finding]:
    findings: list[Finding] = []
    if recording.velocity is None:
        return findings
    for axis in range(recording.n_axes):
        given, own = recording.velocity[:, axis], derived[:, axis]
        if np.ptp(own) < 1e-9 or np.ptp(given) < 1e-9:
            continue
        lag, correlation = _lag(own, given)
        slope = float(given @ own / (own @ own))
        if correlation < -0.5:
            text = "velocity has the opposite sign of the change of position"
            findings.append(Finding("refuse", axis + 1, text))
        elif not 0.8 < slope < 1.25:
            text = f"velocity is {slope:.3g} times the change of position: other units, or side?"
            findings.append(Finding("refuse", axis + 1, text))
        elif lag:
            text = f"velocity is {abs(lag)} samples {'late' if lag > 0 else 'early'}"
            findings.append(Finding("warn", axis + 1, text))
    return findings


def _excitation(recording: Recording, robot: Robot, q: np.ndarray, qd: np.ndarray) -> list[Finding]:
    findings = []
    friction = robot.ids("actuator", "friction")
    stribeck = robot.model.actuator_biasprm[friction, STRIBECK_VELOCITY]
    speed = np.abs(qd * robot.gear_ratio)
    for axis in range(robot.n_axes):
        if np.ptp(q[:, axis]) < _STILL:
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
        findings.append(Finding("warn", axis + 1, text))
    return findings


def _missing_friction(
    recording: Recording, robot: Robot, expected: np.ndarray, qd: np.ndarray
) -> np.ndarray:
    """Friction of axes whose model has none: the Coulomb and viscous friction that fit best.

    Without it, the torque of such an axis would look like that of another robot. Calibration finds
    the friction.
    """
    friction = np.zeros_like(expected)
    for axis in np.flatnonzero(without_friction(robot)):
        shapes = _friction_shapes(qd[:, axis])
        left = recording.torque[:, axis] - expected[:, axis]
        friction[:, axis] = shapes @ nnls(shapes, left)[0]
    return friction


def _friction_shapes(speed: np.ndarray) -> np.ndarray:
    """Coulomb and viscous friction of an axis without their size, shape (samples, 2)."""
    return np.stack([np.sign(speed), speed], axis=1)


def _has_other_friction(measured: np.ndarray, model: np.ndarray, speed: np.ndarray) -> bool:
    """Whether friction may be the reason why a torque is several times that of the model.

    Friction and a factor of the model's torque are fitted to the recording. If what friction does
    not explain has the size of the model's, its unit is right.

    Args:
        measured: Torque of an axis, shape (samples,).
        model: Torque of the model, same shape and unit.
        speed: Speed of the axis, same shape.
    """
    if not 1 / _FRICTION_APART < measured.std() / model.std() < _FRICTION_APART:
        return False
    shapes = np.column_stack([_friction_shapes(speed), np.ones_like(speed)])
    own, other = (x - shapes @ np.linalg.lstsq(shapes, x, rcond=None)[0] for x in (model, measured))
    factor = float(own @ other / (own @ own))
    return bool(own.std() < _HARDLY * measured.std() or 1 / 3 < factor < 3)


def _weight(
    recording: Recording, robot: Robot, expected: np.ndarray, q: np.ndarray, speed: np.ndarray
) -> list[Finding]:
    """Say which torques lack the weight of the arm, as those that some controllers command do.

    One axis may be balanced by a spring that the model lacks. If all loaded axes of an arm have no
    weight, that is no explanation.
    """
    every = max(1, len(q) // _MOST_POSES)
    still = np.zeros_like(q[::every])
    gravity = Arm(robot).inverse_dynamics(q[::every], still, still)
    if not recording.link:
        gravity = robot.gearing.torque(gravity)
        gravity = gravity / robot.gear_ratio if recording.side == "motor" else gravity
    rest = expected[::every] - gravity
    offsets = np.array([torque_offset_std(robot, k + 1) for k in range(robot.n_axes)])
    if recording.side == "joint":
        offsets *= np.abs(robot.gear_ratio)
    found, certain = without_weight(
        recording.torque[::every], gravity, rest, speed[::every], _UNKNOWN_ZERO * offsets
    )
    if not found:
        return []
    axes = ", ".join(str(axis) for axis, _, _ in found)
    shares = ", ".join(f"{share:.2f} ± {error:.2f}" for _, share, error in found)
    unless = (
        "; or correct the model, if the arm is mounted another way"
        if certain
        else "; unless a spring that the model lacks carries it"
    )
    several = "axes" if len(found) > 1 else "axis"
    text = (
        f"the torque of {several} {axes} has no weight in it (share of the model's: {shares}): log "
        f"the measured torque, not the one that the controller adds to the weight{unless}"
    )
    return [Finding("refuse" if certain else "warn", 0, text)]


def _torque(
    recording: Recording, robot: Robot, expected: np.ndarray, qd: np.ndarray
) -> list[Finding]:
    findings = []
    for axis in range(robot.n_axes):
        measured, model = recording.torque[:, axis], expected[:, axis]
        if np.ptp(qd[:, axis]) * recording.sample_period < 1e-9 or np.ptp(measured) == 0:
            continue
        lag, correlation = _lag(model, measured)
        scale = float(measured.std() / model.std())
        ratio = abs(robot.gear_ratio[axis])
        if abs(correlation) < 0.5:
            text = (
                f"torque is hardly that of the model (correlation {correlation:.2f}): another "
                "robot, axis or payload?"
            )
            findings.append(Finding("warn", axis + 1, text))
        elif correlation < 0:
            text = "torque has the opposite sign of the model's: reverse its sign"
            findings.append(Finding("refuse", axis + 1, text))
        elif not 1 / 3 < scale < 3:
            side = "joint" if recording.side == "motor" else "motor"
            near = ratio if recording.side == "motor" else 1 / ratio
            guess = f", about the gear ratio: is it {side} side?" if 0.5 < scale / near < 2 else ""
            text = f"torque is {scale:.3g} times the model's{guess}"
            rubs = not guess and _has_other_friction(measured, model, qd[:, axis])
            if rubs:
                text += ": its friction differs; calibrate the model first"
            elif not guess:
                text += ": check its unit, the gear ratio and the torque constant of the motor"
            findings.append(Finding("warn" if rubs else "refuse", axis + 1, text))
        elif lag:
            milliseconds = 1000 * abs(lag) * recording.sample_period
            late = "late" if lag > 0 else "early"
            text = f"torque is {abs(lag)} samples ({milliseconds:.3g} ms) {late} behind the motion"
            findings.append(Finding("warn", axis + 1, text))
    return findings
