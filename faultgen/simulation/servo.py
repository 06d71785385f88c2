"""The control signal of a cycle: what the controller commands, computed before the simulation.

The position and velocity loops run inside MuJoCo (``drive{i}``: torque =
kp (pos - q) + kd (vel - w) + ff, then saturation). Set points and feed-forward torques are computed
for the nominal robot. A worn robot is thus controlled as if it were healthy, as in reality.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque, nominal_friction
from faultgen.simulation.motion import Motion


@dataclass(frozen=True)
class Planned:
    """What a motion asks of the motors of the nominal robot, whatever the controller commands."""

    joint_speed: np.ndarray
    """Speed of the joints, shape (steps, n_axes), in [rad/s], or [m/s]."""
    angle: np.ndarray
    """Angle of the motors, shape (steps, n_axes), in [rad]."""
    speed: np.ndarray
    """Speed of the motors half a step earlier, same shape, in [rad/s]."""
    torque: np.ndarray
    """Torque of the motors, same shape, in [N m]."""


def planned(motion: Motion, timestep: float) -> Planned:
    """Compute what one cycle asks of the motors.

    With MuJoCo's semi-implicit integration, the velocity at step k is the velocity half a step
    before t_k. The speed is therefore computed for that earlier time, so that the set point and the
    simulated velocity belong to the same time.

    Args:
        motion: The motion.
        timestep: Step of the simulation [s].

    Returns:
        Angles, speeds and torques for every simulation step.
    """
    robot = motion.robot
    times = np.arange(round(motion.period / timestep)) * timestep
    q, qd, qdd = motion(times)
    half = motion(times - timestep / 2)[1]
    outputs = robot.gearing.outputs
    return Planned(
        joint_speed=qd,
        angle=outputs(q) * robot.gear_ratio,
        speed=outputs(half) * robot.gear_ratio,
        torque=motor_torque(Arm(robot), q, qd, qdd),
    )


def control_signal(motion: Motion, timestep: float) -> np.ndarray:
    """Compute the control signal of one cycle for every simulation step.

    Args:
        motion: The motion.
        timestep: Step of the simulation [s].

    Returns:
        Shape (steps, n_controls), as from `commanded`.
    """
    return commanded(motion.robot, planned(motion, timestep))


def commanded(robot: Robot, motion: Planned) -> np.ndarray:
    """Compute what the controller of a robot commands for a motion.

    Args:
        robot: The nominal robot.
        motion: What the motion asks of its motors.

    Returns:
        Shape (steps, n_controls). Each drive has three consecutive columns: motor position [rad],
        motor velocity [rad/s] and feed-forward motor torque [N m].
    """
    model = robot.model
    control = np.zeros((len(motion.angle), model.nu))
    at = model.actuator_ctrladr[robot.ids("actuator", "drive")]
    control[:, at] = motion.angle
    control[:, at + 1] = motion.speed * robot.set_points[1]
    control[:, at + 2] = _in_advance(robot, motion.torque, motion.joint_speed)
    return control


def feed_forward(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Compute the torque that the controller commands in advance.

    Args:
        arm: The rigid arm of the nominal robot.
        q: Commanded joint position, shape (samples, n_axes), in [rad].
        qd: Its velocity, same shape, in [rad/s].
        qdd: Its acceleration, same shape, in [rad/s^2].

    Returns:
        Torque at the motors, shape (samples, n_axes), in [N m].
    """
    return _in_advance(arm.robot, motor_torque(arm, q, qd, qdd), qd)


def _in_advance(robot: Robot, torque: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """The part of a needed torque that the controller commands."""
    known = torque + other_friction(robot, qd, *robot.servo_friction)
    return known * float(robot.set_points[2])


def other_friction(robot: Robot, qd: np.ndarray, share: float, width: float) -> np.ndarray:
    """Compute by how much the friction that a controller expects differs from the model's.

    Args:
        robot: The nominal robot.
        qd: Commanded joint velocity, shape (samples, n_axes), in [rad/s].
        share: Share of the model's friction that it expects.
        width: Speed over which the step at zero speed is smoothed, over the Stribeck velocity.

    Returns:
        Torque at the motors, shape (samples, n_axes), in [N m].
    """
    if (share, width) == (1.0, 1.0):
        return np.zeros_like(qd)
    speed = robot.gearing.outputs(qd) * robot.gear_ratio
    return share * nominal_friction(robot, speed, width) - nominal_friction(robot, speed)
