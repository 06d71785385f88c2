"""Checks of a recorded motion against the robot: units, sides, gaps, velocity, and what moves.

    recording, findings = checked_motion(recording, robot)

What a unit, a sign, another turn or a gap explains is corrected, and told. The torque is tested by
`discovery.accept`, which needs a model of the arm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from faultgen.recordings.recording import Recording
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot

REFUSE, CORRECTED, LEFT_OUT, WARN = "refuse", "corrected", "left out", "warn"

TRUST = "--trust-log takes the file as it is"
"""End of each line about something that is not taken as it was logged."""

_LAGS = 12  # samples by which a velocity may be late to be told so
STILL = 1e-3  # range of a joint that does not move [rad]
_STUCK = 0.25  # time without any change of position while the reference moves [s]
_TURN = 2 * np.pi  # [rad]
_NEAR = 5  # steps before and after a jump that tell how far an axis usually moves
_MISSING = 2.5  # usual steps that a jump may take more: two missing samples
_MANY_GAPS = 20  # from which jumps are not gaps, but the speed that the model allows is wrong
_SHORTEST = 50  # samples of a segment between gaps that is worth keeping: assumed
_ROOM = 0.05  # share of a joint's range by which positions may be outside of it
_SAME = 0.9  # correlation from which a velocity is the derivative of the position, but for its unit
_SLOW = 3.0  # motor speed, in Stribeck velocities, that friction has to be told from


@dataclass(frozen=True)
class Finding:
    """One thing in a recording that is wrong or doubtful."""

    level: str
    """'refuse' if the data cannot be used, 'corrected' if they were, 'left out' if the axis is not
    used, otherwise 'warn'."""
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


def sorted_findings(findings: list[Finding]) -> list[Finding]:
    """Sort findings: by how much they change what is used, and then by axis.

    Args:
        findings: The findings.
    """
    order = (REFUSE, LEFT_OUT, CORRECTED, WARN)
    return sorted(findings, key=lambda one: (order.index(one.level), one.axis))


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
    if recording.robot and recording.robot != robot.name:
        text = f"the file says robot '{recording.robot}', the model is {robot.name}"
        findings.append(Finding(WARN, 0, text))
    if trust_log:
        return recording, findings
    for check in (_with_unit, _without_gaps, _with_velocity):
        recording, more = check(recording, robot)
        findings += more
    findings += _stuck(recording, robot)
    _, qd, _ = recording.derivatives(recording.joint_position(robot))
    return recording, findings + _excitation(recording, robot, robot.gearing.outputs(qd))


def _with_unit(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """Positions in radians of their side, counted from the turn that the model has."""
    findings: list[Finding] = []
    low, high = robot.joint_range.T
    slack = _ROOM * (high - low)
    joint = recording.joint_position(robot)
    position = recording.position.copy()
    reference = recording.reference_position
    reference = None if reference is None else reference.copy()

    def fits(axis: int, values: np.ndarray) -> bool:
        inside = (values >= low[axis] - slack[axis]) & (values <= high[axis] + slack[axis])
        return bool(inside.all())

    for axis in range(robot.n_axes):
        own, ratio = joint[:, axis], robot.gear_ratio[axis]
        if fits(axis, own):
            continue
        told = (
            f"joint angles from {own.min():.3g} to {own.max():.3g} rad are outside of the range "
            f"{low[axis]:.3g} to {high[axis]:.3g} rad"
        )
        turns = round((low[axis] + high[axis] - own.min() - own.max()) / 2 / _TURN)
        degrees, motor = np.pi / 180, 1 / ratio
        per_joint = ratio if recording.side == "motor" else 1.0
        if turns and not robot.slides[axis] and fits(axis, own + turns * _TURN):
            position[:, axis] += turns * _TURN * per_joint
            if reference is not None and not fits(axis, reference[:, axis]):
                reference[:, axis] += turns * _TURN
            told += f": {turns:+d} turn is added, with which they are inside; {TRUST}"
        elif (not robot.slides[axis] and fits(axis, own * degrees)) or fits(axis, own * motor):
            in_degrees = not robot.slides[axis] and fits(axis, own * degrees)
            factor, unit = (
                (degrees, "in degrees") if in_degrees else (motor, "of the motor, not of the joint")
            )
            position[:, axis] *= factor
            if reference is not None and not fits(axis, reference[:, axis]):
                reference[:, axis] *= factor
            told += f": they are {unit}, and multiplied by {factor:.4g}; {TRUST}"
        else:
            told += "; the range is widened"
            findings.append(Finding(WARN, axis + 1, told))
            continue
        findings.append(Finding(CORRECTED, axis + 1, told))
    if not findings:
        return recording, []
    return replace(recording, position=position, reference_position=reference), findings


def _is_gap(steps: np.ndarray, k: int) -> bool:
    """Whether more than two samples are missing before step `k` of an axis.

    A sample that was logged late is followed by a step that catches up. The steps around it then
    add up to the usual ones.
    """
    near = steps[max(k - _NEAR, 0) : k + _NEAR + 1]
    usual = float(np.median(near))
    return bool(abs(np.sum(near - usual)) > _MISSING * abs(usual) + 1e-6)


def _without_gaps(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """Angles that continue over whole turns, and separate recordings before and after gaps."""
    findings: list[Finding] = []
    period = recording.sample_period
    fastest = robot.motor_velocity_limit / np.abs(robot.gear_ratio)
    per_joint = robot.gear_ratio if recording.side == "motor" else np.ones(robot.n_axes)
    position = recording.position.copy()
    starts: set[int] = set()
    for axis in range(robot.n_axes):
        turned, gaps, late = 0, [], 0
        first = (0.0, 0)
        for part in recording.parts:
            steps = np.diff(recording.joint_position(robot)[part, axis])
            for k in np.flatnonzero(np.abs(steps) > 1.5 * fastest[axis] * period + 1e-6).tolist():
                if not turned + len(gaps) + late:
                    first = (float(steps[k]), part.start + k + 1)
                whole = abs(abs(steps[k]) - _TURN) <= 2 * fastest[axis] * period
                if whole and not robot.slides[axis] and not robot.gearing.coupled.any():
                    back = -np.sign(steps[k]) * _TURN * per_joint[axis]
                    position[part.start + k + 1 : part.stop, axis] += back
                    turned += 1
                elif _is_gap(steps, k):
                    gaps.append(part.start + k + 1)
                else:
                    late += 1
        if not turned + len(gaps) + late:
            continue
        text = (
            f"jumps by {first[0]:.3g} rad at sample {first[1]}, more than {fastest[axis]:.3g} "
            "rad/s allow"
        )
        if turned:
            more = f": the angle starts again after a whole turn, and is continued; {TRUST}"
            findings.append(Finding(CORRECTED, axis + 1, text + more))
        elif len(gaps) > _MANY_GAPS:
            more = f" ({len(gaps)} such jumps): the model allows too little, or samples are missing"
            findings.append(Finding(WARN, axis + 1, text + more))
        elif gaps:
            starts.update(gaps)
            more = f": a gap, after which a new segment begins ({len(gaps)} in all); {TRUST}"
            findings.append(Finding(CORRECTED, axis + 1, text + more))
        else:
            more = (
                f" ({late} such jumps in all): samples were logged late, or one or two are missing"
            )
            findings.append(Finding(WARN, axis + 1, text + more))
    if not any(one.level == CORRECTED for one in findings):
        return recording, findings
    return _cut_at(replace(recording, position=position), sorted(starts)), findings


def _cut_at(recording: Recording, starts: list[int]) -> Recording:
    """Begin segments at some samples, and leave out those that are too short to use."""
    edges = sorted({*recording.segments, *starts, len(recording.position)})
    new = set(starts)
    pieces = [
        slice(start, stop)
        for start, stop in zip(edges, edges[1:], strict=False)
        if stop - start >= _SHORTEST or not ({start, stop} & new)
    ]
    if not pieces or len(pieces) == len(recording.segments):
        return recording
    rows = np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])
    ends = np.cumsum([piece.stop - piece.start for piece in pieces])
    arrays = {
        name: None if getattr(recording, name) is None else getattr(recording, name)[rows]
        for name in ("position", "torque", "velocity", "reference_position", "temperature", "lost")
    }
    segments = (0, *(int(end) for end in ends[:-1]))
    return replace(recording, **arrays, segments=segments)  # type: ignore[arg-type]


def _stuck(recording: Recording, robot: Robot) -> list[Finding]:
    """Positions that do not change while the reference moves."""
    if recording.reference_position is None:
        return []
    findings = []
    period = recording.sample_period
    fastest = robot.motor_velocity_limit / np.abs(robot.gear_ratio)
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

    by_lag = {lag: correlation(lag) for lag in range(-_LAGS, _LAGS + 1)}
    best = max(by_lag, key=lambda lag: abs(by_lag[lag]))
    is_clear = 1 - by_lag[best] ** 2 < 0.5 * (1 - by_lag[0] ** 2)
    return (best, by_lag[best]) if is_clear else (0, by_lag[0])


def _with_velocity(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """A velocity in the unit and with the sign of the change of position; none if it is neither."""
    if recording.velocity is None or len(recording.position) <= 2 * _LAGS:
        return recording, []
    findings: list[Finding] = []
    velocity = recording.velocity.copy()
    _, derived, _ = recording.derivatives(recording.position)
    size = np.abs(robot.gear_ratio) if recording.side == "motor" else np.ones(robot.n_axes)
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
            velocity[:, axis] /= -1.0 if -1.25 < slope < -0.8 else slope
            factor = -1.0 if -1.25 < slope < -0.8 else 1 / slope
            text += f": it is multiplied by {factor:.4g}; {TRUST}"
            findings.append(Finding(CORRECTED, axis + 1, text))
        elif abs(correlation) > 0.5 or not 0.5 < slope < 2:
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
