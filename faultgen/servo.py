"""The servo's side of a simulation: what the controller commands, computed before stepping.

The position and velocity loops run inside MuJoCo (``drive{i}``: torque =
kp (pos - q) + kd (vel - w) + ff, then saturation). Set points and feed-forward come from the
nominal robot: a worn robot is driven as if it were healthy, as a real controller would.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from faultgen.arm import Arm
from faultgen.robot import COULOMB, OFFSET, STRIBECK_VELOCITY, Robot

if TYPE_CHECKING:
    from faultgen.motion import Motion


def nominal_friction(robot: Robot, speed: np.ndarray) -> np.ndarray:
    """Friction torque that the controller reckons with: Coulomb, asymmetry and viscous.

    Args:
        robot: The healthy robot.
        speed: Motor speed, shape (samples, n_axes), in [rad/s].

    Returns:
        Torque that overcomes friction, shape (samples, n_axes), in [N m]. The step at zero speed is
        smoothed over the Stribeck velocity: tanh(speed / stribeck_velocity).
    """
    friction = robot.ids("actuator", "friction")
    bias = robot.model.actuator_biasprm[friction]
    width = bias[:, STRIBECK_VELOCITY]  # 0 only where there is no dry friction
    share = np.tanh(speed / np.where(width > 0, width, 1.0))
    sliding = bias[:, COULOMB] * share - bias[:, OFFSET] * np.abs(share)
    return sliding + robot.model.actuator_damping[friction] * speed


def motor_torque(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Motor torque that a motion needs: rigid arm, rotor inertia and nominal friction.

    Args:
        arm: The rigid arm.
        q: Joint angle, shape (samples, n_axes), in [rad].
        qd: Joint velocity, same shape, in [rad/s].
        qdd: Joint acceleration, same shape, in [rad/s^2].

    Returns:
        Torque at the motors, shape (samples, n_axes), in [N m].
    """
    robot = arm.robot
    inertia = robot.model.dof_M0[list(robot.motors)]
    load = arm.inverse_dynamics(q, qd, qdd) / robot.gear_ratio
    rotor = inertia * robot.gear_ratio * qdd
    return load + rotor + nominal_friction(robot, qd * robot.gear_ratio)


def control_signal(motion: Motion, timestep: float) -> np.ndarray:
    """Control of one cycle, for every step.

    MuJoCo's semi-implicit step makes its velocity at step k that of half a step before t_k; the
    velocity set point is taken at that time, so that the set points and the state belong together.

    Args:
        motion: The motion.
        timestep: Step of the simulation [s].

    Returns:
        Shape (steps, n_controls): position [rad], velocity [rad/s], feed-forward torque [N m], by
        drive, motor side.
    """
    robot = motion.robot
    times = np.arange(round(motion.period / timestep)) * timestep
    q, qd, qdd = motion(times)
    half = motion(times - timestep / 2)[1]
    model = robot.model
    control = np.zeros((len(times), model.nu))
    at = model.actuator_ctrladr[robot.ids("actuator", "drive")]
    control[:, at] = q * robot.gear_ratio
    control[:, at + 1] = half * robot.gear_ratio * robot.set_points[1]
    if robot.set_points[2]:
        control[:, at + 2] = motor_torque(Arm(robot), q, qd, qdd) * robot.set_points[2]
    return control
