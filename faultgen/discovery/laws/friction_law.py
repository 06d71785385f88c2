"""Friction for axes whose model has none.

Users often have a model without friction, because no data sheet states it. Such an axis gets the
law of the other robots with assumed constants, and a Coulomb friction that is next to nothing.
Calibration then finds how much friction there is.
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.recordings.checks import without_friction
from faultgen.recordings.recording import Recording
from faultgen.robot import BRISTLE_STIFFNESS, Robot

STRIBECK_SHARE = 0.015
"""Stribeck velocity as a share of the largest speed in the recording: assumed. Static friction
equals Coulomb friction, so this velocity only separates slow from fast motion."""

REACH = 0.01
"""Angle of the motor by which the bristles are bent in sliding [rad]: assumed, as of the robots
that come with faultgen."""

NEXT_TO_NOTHING = 1e-3
"""Coulomb friction before calibration, as a share of the RMS motor torque of the axis."""

_PASSIVE = 16  # mjsActuator.ctrlspec of input="none"
_SLOW = 0.25  # largest h sqrt(bristle stiffness / rotor inertia) with a time step h
_DAMPED = 0.8  # bristle damping over the geometric mean of stiffness and rotor inertia


def with_friction_law(robot: Robot, recording: Recording) -> Robot:
    """Give a friction law to each axis that has none. Other axes are not changed.

    Args:
        robot: The robot.
        recording: Its motion, from which the Stribeck velocity is taken.

    Returns:
        The robot with friction on every axis; the given robot if it has friction everywhere.
    """
    lacking = np.flatnonzero(without_friction(robot))
    if not len(lacking):
        return robot
    position = recording.motor_position(robot)
    _, speed, _ = recording.derivatives(position)
    torque = recording.torque / (robot.gear_ratio if recording.side == "joint" else 1.0)
    spec = robot.spec()
    for axis in lacking.tolist():
        fastest = float(np.abs(speed[:, axis]).max())
        coulomb = NEXT_TO_NOTHING * max(float(np.sqrt(np.mean(torque[:, axis] ** 2))), 1e-9)
        actuator = spec.actuator(f"friction{axis + 1}")
        damping = np.array(actuator.damping)
        actuator.set_to_dcmotor(
            motorconst=[0.0, 0.0],
            resistance=1.0,
            lugre=[1.0, 1.0, coulomb, coulomb, max(STRIBECK_SHARE * fastest, 1e-3)],
            ctrlspec=_PASSIVE,
        )
        actuator.damping = damping
        inertia = float(robot.model.dof_M0[robot.motors[axis]])
        set_bristles(spec, axis + 1, coulomb, inertia, robot.model.opt.timestep)
    spec.compile()
    return robot.edited(spec)


def set_bristles(
    spec: mujoco.MjSpec, axis: int, coulomb: float, inertia: float, timestep: float
) -> None:
    """Give bristles to friction that hold it after an angle of `REACH`.

    Args:
        spec: The robot's specification, which is changed.
        axis: Axis, from 1.
        coulomb: Coulomb friction [N m].
        inertia: Inertia of the rotor [kg m^2].
        timestep: Time step of the model [s]. The bristles are softer if it needs that.
    """
    stiffness = min(coulomb / REACH, inertia * (_SLOW / timestep) ** 2)
    bristles = spec.actuator(f"friction{axis}").dynprm
    bristles[BRISTLE_STIFFNESS] = stiffness
    bristles[BRISTLE_STIFFNESS + 1] = _DAMPED * np.sqrt(stiffness * inertia)
