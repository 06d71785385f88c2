"""The control signal of a cycle: what the controller commands, computed before the simulation.

The position and velocity loops run inside MuJoCo (``drive{i}``: torque =
kp (pos - q) + kd (vel - w) + ff, then saturation). Set points and feed-forward torques are computed
for the nominal robot. A worn robot is thus controlled as if it were healthy, as in reality.
"""

from __future__ import annotations

import numpy as np

from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque, nominal_friction
from faultgen.simulation.motion import Motion


def control_signal(motion: Motion, timestep: float) -> np.ndarray:
    """Compute the control signal of one cycle for every simulation step.

    With MuJoCo's semi-implicit integration, the velocity at step k is the velocity half a step
    before t_k. The velocity set point is therefore computed for that earlier time, so that the set
    point and the simulated velocity belong to the same time.

    Args:
        motion: The motion.
        timestep: Step of the simulation [s].

    Returns:
        Shape (steps, n_controls). Each drive has three consecutive columns: motor position [rad],
        motor velocity [rad/s] and feed-forward motor torque [N m].
    """
    robot = motion.robot
    times = np.arange(round(motion.period / timestep)) * timestep
    q, qd, qdd = motion(times)
    half = motion(times - timestep / 2)[1]
    model = robot.model
    control = np.zeros((len(times), model.nu))
    at = model.actuator_ctrladr[robot.ids("actuator", "drive")]
    outputs = robot.gearing.outputs
    control[:, at] = outputs(q) * robot.gear_ratio
    control[:, at + 1] = outputs(half) * robot.gear_ratio * robot.set_points[1]
    if robot.set_points[2]:
        control[:, at + 2] = feed_forward(Arm(robot), q, qd, qdd)
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
    robot = arm.robot
    torque = motor_torque(arm, q, qd, qdd) + other_friction(robot, qd, *robot.servo_friction)
    return torque * float(robot.set_points[2])


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
