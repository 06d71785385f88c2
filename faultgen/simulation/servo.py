"""The control signal of a cycle: what the controller commands, computed before the simulation.

The position and velocity loops run inside MuJoCo (``drive{i}``: torque =
kp (pos - q) + kd (vel - w) + ff, then saturation). Set points and feed-forward torques are computed
for the nominal robot. A worn robot is thus controlled as if it were healthy, as in reality.
"""

from __future__ import annotations

import numpy as np

from faultgen.simulation.arm import Arm, motor_torque
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
        control[:, at + 2] = motor_torque(Arm(robot), q, qd, qdd) * robot.set_points[2]
    return control
