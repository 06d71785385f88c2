"""The servo of the robot, where it differs from that of the model.

The gains of each axis follow from the `servo_equation` by linear regression. This is done for every
form that a servo may have: with or without an integral, a commanded speed, and a torque that is
commanded in advance. The friction within this torque may be left out, and its step at zero speed
may be smoothed over another speed. A P loop of the position around a PI loop of the speed has the
form of a PID servo. The form counts that explains the torque best.

The model then gets this servo, so that it can follow the commanded positions as the robot does.

    robot, told = with_own_servo(recording, robot)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.replay.servo_equation import ServoSignals, has_equation
from faultgen.mjcf.dcmotor import set_servo
from faultgen.mjcf.edit import set_numeric
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.servo import other_friction

_WIDTHS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)  # of the friction's step, over that of the model
_FEWEST = 200  # samples of an axis
_EXPLAINED = 0.1  # torque error of the equation, over the torque, up to which it holds: assumed
_BETTER = 0.5  # this error over that of the model's own servo: assumed
_SIMPLER = 1.1  # error, over the smallest, up to which a simpler servo is preferred: assumed
_ROUNDS = 2  # of the regression with a delay


@dataclass(frozen=True)
class _Form:
    """A kind of servo."""

    speed: float
    """Whether a speed is commanded: 0 or 1."""
    forward: float
    """Whether a torque is commanded in advance: 0 or 1."""
    integral: bool
    friction: tuple[float, float] = (1.0, 1.0)
    """As `Robot.servo_friction`."""

    @property
    def parts(self) -> int:
        """How complicated it is."""
        return int(self.speed) + int(self.forward) + 2 * self.integral

    def put_into(self, robot: Robot) -> Robot:
        """The robot with the set points of this form, and with its own gains."""
        spec = robot.spec()
        set_numeric(spec, "servo_set_points", (1.0, self.speed, self.forward))
        set_numeric(spec, "servo_friction", self.friction)
        spec.compile()
        return robot.edited(spec)

    def __str__(self) -> str:
        loop = "PID" if self.integral else "PD"
        more = [name for name, share in (("speed", self.speed), ("torque", self.forward)) if share]
        return f"a {loop} servo with commanded {' and '.join(['position', *more])}"


def _forms() -> Iterator[_Form]:
    for speed in (0.0, 1.0):
        for integral in (False, True):
            yield _Form(speed, 0.0, integral)
            yield _Form(speed, 1.0, integral, (0.0, 1.0))
            for width in _WIDTHS:
                yield _Form(speed, 1.0, integral, (1.0, width))


def with_own_servo(recording: Recording, robot: Robot) -> tuple[Robot, str]:
    """Give a model the servo of the robot, if the recording shows that it is another one.

    Args:
        recording: A recording of the robot.
        robot: The model.

    Returns:
        The model, and a sentence about its new servo. The given robot and an empty text if its own
        servo explains the torque, if no servo does, or if the recording has no commanded position
        or no torque of the motors.
    """
    # of a current without a known constant, the torque has an unknown unit
    if not has_equation(recording) or recording.constants is not None:
        return robot, ""
    signals = ServoSignals(recording, robot)
    used = [axis for axis, rows in enumerate(signals.rows) if len(rows) >= _FEWEST]
    if not used:
        return robot, ""
    forms = list(_forms())
    rigid, speed = motor_torque(Arm(robot), *signals.motion), signals.motion[1]
    forward = {
        friction: recording.derivatives(rigid + other_friction(robot, speed, *friction))[0]
        for friction in {form.friction for form in forms if form.forward}
    }
    found = {form: _fitted(signals, form, forward, used) for form in forms}
    errors = {
        form: _mean(error)
        for form, (gains, error) in found.items()
        if (gains[:, 0] > 0).all() and (gains[:, 1:] >= 0).all()
    }
    if not errors:
        return robot, ""
    near = [form for form in errors if errors[form] <= _SIMPLER * min(errors.values())]
    form = min(near, key=lambda one: (one.parts, errors[one]))
    gains, error = found[form]
    changed = form.put_into(robot)
    # an axis with a fault of its own is no reason to change the gains of all
    kept = _errors(signals, changed, used)
    keeps = float(np.median(kept / error)) <= _SIMPLER
    after, before = _mean(kept if keeps else error), _mean(_errors(signals, robot, used))
    if after > min(_EXPLAINED, _BETTER * before):
        return robot, ""
    if not keeps:
        changed = _with_gains(changed, used, gains)
    return changed, (
        f"the robot has {form}, with {'the gains of the model' if keeps else 'other gains'}; it "
        f"explains the torque to {after:.4f}, and the servo of the model to {before:.4f}"
    )


def nearest_servo(recording: Recording, robot: Robot, fitted: Robot) -> Robot:
    """Choose the masses and the friction that the controller knows.

    Its feed-forward torque may be that of the given model, or that of the robot as it is.

    Args:
        recording: A recording of the healthy robot.
        robot: The given model.
        fitted: The same with the masses and the friction of the robot.

    Returns:
        The one whose servo explains the torque better.
    """
    if robot is fitted or not has_equation(recording):
        return robot
    signals = ServoSignals(recording, robot)
    used = [axis for axis, rows in enumerate(signals.rows) if len(rows) >= _FEWEST]
    if not used:
        return robot
    return min((robot, fitted), key=lambda one: _mean(_errors(signals, one, used)))


def _with_gains(robot: Robot, used: list[int], gains: np.ndarray) -> Robot:
    """The robot with other gains kp, kd and ki of some axes, shape (axes, 3)."""
    spec = robot.spec()
    for axis, (kp, kd, ki) in zip(used, gains.tolist(), strict=True):
        set_servo(spec.actuator(f"drive{axis + 1}"), kp, ki, kd)
    spec.compile()
    return robot.edited(spec)


def _fitted(
    signals: ServoSignals,
    form: _Form,
    forward: Mapping[tuple[float, float], np.ndarray],
    used: list[int],
) -> tuple[np.ndarray, np.ndarray]:
    """Gains kp, kd and ki of the axes that move, shape (axes, 3), and the error of each.

    The gains are those with which the set points of each axis may be late, if a torque is commanded
    in advance. Without it, a delay is not told from kd.
    """
    advance = forward[form.friction] if form.forward else 0 * signals.torque
    rate = form.speed * signals.rate - signals.speed
    columns = [signals.wanted - signals.position, rate, *([signals.integral] * form.integral)]
    gains, errors = np.zeros((len(used), 3)), np.zeros(len(used))
    for place, axis in enumerate(used):
        rows = signals.rows[axis]
        own = np.stack([column[rows, axis] for column in columns], axis=1)
        target = (signals.torque - advance)[rows, axis]
        values, left, _ = signals.regress(axis, own, target)
        for _ in range(_ROUNDS * int(form.forward)):
            kp, kd = values[:2]
            points = kp * signals.wanted + form.speed * kd * signals.rate + advance
            late = signals.rate_of(points, values[2] if form.integral else 0.0)[rows, axis]
            values, left, _ = signals.regress(axis, np.column_stack([own, -late]), target)
        gains[place, : len(columns)] = values[: len(columns)]
        errors[place] = left / _size(signals, axis)
    return gains, errors


def _errors(signals: ServoSignals, robot: Robot, used: list[int]) -> np.ndarray:
    """Errors of the servo of a robot, whose set points may be late."""
    made = signals.of_servo(robot)
    errors = []
    for axis in used:
        rows = signals.rows[axis]
        column = -made.rate[rows, axis][:, None] * robot.set_points[2]
        left = signals.regress(axis, column, (signals.torque - made.torque)[rows, axis])[1]
        errors.append(left / _size(signals, axis))
    return np.array(errors)


def _size(signals: ServoSignals, axis: int) -> float:
    """RMS torque of an axis beyond the constants."""
    rows = signals.rows[axis]
    none = np.zeros((len(rows), 0))
    return max(signals.regress(axis, none, signals.torque[rows, axis])[2], 1e-12)


def _mean(errors: np.ndarray) -> float:
    """Geometric mean over the axes."""
    return float(np.exp(np.mean(np.log(np.maximum(errors, 1e-12)))))
