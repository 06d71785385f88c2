"""The servo's side of a simulation: what the controller commands, computed before stepping.

The position and velocity loops run inside MuJoCo (``drive{i}``: torque =
kp (pos - q) + kd (vel - w) + ff, then saturation). Set points and feed-forward come from the
nominal robot: a worn robot is driven as if it were healthy, as a real controller would.
"""

from __future__ import annotations

import numpy as np

from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.motion import Motion


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
