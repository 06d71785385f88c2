"""The timing of a move: jerk-limited, and within the limits of the robot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

from faultgen.errors import InputError
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.tasks import Move

TORQUE_SHARE = 0.85
"""Share of the motor torque limit that plans use; the rest is for the servo."""

GRID = 0.004
"""Time between the samples in which a planned motion is checked against the limits [s]."""

LONGEST = 3600.0
"""Longest cycle [s]. It protects against mistakes such as a speed of 1e-9."""

_JERK_TIME = 0.1  # time from zero to full acceleration [s]; assumed

JointPath = Callable[[np.ndarray, int], np.ndarray]
"""A path q(s) of the joints, and its derivatives by their order; s runs from 0 to 1."""

Timing = Callable[[np.ndarray], np.ndarray]
"""The timing s(t) of a path, with its two derivatives, shape (3, samples)."""


def timed(move: Move, path: JointPath, length: float, arm: Arm, where: str) -> tuple[Timing, float]:
    """Find a jerk-limited timing of a path within all limits.

    Args:
        move: The move, with its speed and duration.
        path: Its path.
        length: Length of the path of the tool [m].
        arm: The arm.
        where: Task and number of the move, for messages.

    Returns:
        The timing, a function from times [s] to an array of shape (3, samples), and its duration
        [s].

    Raises:
        InputError: The move needs too much torque at any speed, or would last longer than
            `LONGEST`.
    """
    robot = arm.robot
    # a move begins and ends at rest, so its ends must be held, whatever its timing
    ends = path(np.array([0.0, 1.0]), 0)
    torque = motor_torque(arm, ends, np.zeros_like(ends), np.zeros_like(ends))
    if (np.abs(torque) > TORQUE_SHARE * robot.motor_torque_limit).any():
        raise _too_weak(arm, torque, where)
    joint_speed = robot.joint_velocity_limit
    s = np.linspace(0, 1, 201)
    slope = np.abs(path(s, 1)).max(axis=0) + 1e-12
    turned = robot.gearing.outputs
    speed = move.speed * np.min(joint_speed / (np.abs(turned(path(s, 1))).max(axis=0) + 1e-12))
    if move.tool_speed is not None and length > 0:
        speed = min(speed, move.tool_speed / length)
    acceleration = move.speed * np.min(robot.joint_acceleration_limit / slope)
    scale, least = 1.0, move.duration
    for _ in range(60):
        slowest = max(1 / speed, least or 0.0)
        if slowest > LONGEST:
            raise InputError(
                f"{where}: would last {slowest:.3g} s, and a cycle may "
                f"last at most {LONGEST:g} s; choose a higher speed or a shorter duration"
            )
        timing, duration = _profile(speed, scale * acceleration, least)
        times = np.linspace(0, duration, max(50, int(duration / GRID)))
        at, rate, change = timing(times)
        slopes = path(at, 1)
        qd = slopes * rate[:, None]
        qdd = path(at, 2) * rate[:, None] ** 2 + slopes * change[:, None]
        torque = motor_torque(arm, path(at, 0), qd, qdd)
        excess = np.max(np.abs(torque) / (TORQUE_SHARE * robot.motor_torque_limit))
        excess_speed = np.max(np.abs(turned(qd)) / joint_speed)
        excess_acceleration = np.max(np.abs(qdd) / robot.joint_acceleration_limit)
        if excess <= 1 and excess_speed <= 1 + 1e-6 and excess_acceleration <= 1 + 1e-6:
            return timing, duration
        # acceleration that the path's curvature takes at this speed, however gentle the ramps
        bend = np.max(np.abs(path(at, 2)) * rate[:, None] ** 2 / robot.joint_acceleration_limit)
        if excess_speed > 1:
            speed *= min(0.98, 1 / excess_speed)
        if bend > 1:
            speed *= min(0.98, bend**-0.5)
            continue
        scale *= 0.93
        if excess > 1 and scale < 0.3:
            speed *= 0.93
    raise _too_weak(arm, torque, where)


def _too_weak(arm: Arm, torque: np.ndarray, where: str) -> InputError:
    """The error of a move that needs some torque of the motors, shape (samples, n_axes)."""
    axis = int(np.argmax(np.max(np.abs(torque) / arm.robot.motor_torque_limit, axis=0))) + 1
    return InputError(
        f"{where}: {arm.robot.label('axis ', axis)} needs more than "
        f"{100 * TORQUE_SHARE:.0f} % of its motor torque at any speed"
    )


def _profile(speed: float, acceleration: float, least: float | None) -> tuple[Timing, float]:
    """Timing s(t) from 0 to 1, at rest at both ends, by Ruckig; it lasts at least `least` [s]."""
    parameters = InputParameter(1)
    parameters.target_position = [1.0]
    parameters.max_velocity = [speed]
    parameters.max_acceleration = [acceleration]
    parameters.max_jerk = [acceleration / _JERK_TIME]
    if least is not None:
        parameters.minimum_duration = least
    trajectory = Trajectory(1)
    try:
        found = Ruckig(1).calculate(parameters, trajectory)
    except RuckigError:
        found = Result.Error
    if found not in (Result.Working, Result.Finished):
        raise InputError(
            "no timing was found for a move, because the limits of the robot are too far apart"
        )

    def timing(times: np.ndarray) -> np.ndarray:
        values = np.array([trajectory.at_time(float(t)) for t in times])
        return values.reshape(len(times), 3).T

    return timing, float(trajectory.duration)
