"""The motor torque that a motion of the rotors needs, with elastic gearboxes and friction.

The rotors of the simulated robot are made so heavy that nothing but the prescribed torque moves
them. They then follow any motion exactly, and the arm behind the gearboxes answers as it does in
the robot. No servo takes part. The torque that the real rotors need is

    tau = J a + gear torque / gear ratio + friction

with the inertia J and the acceleration a of the rotor (Spong 1987), and with the inertia and the
friction that two rotors of a wrist share.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from faultgen.mjcf.dcmotor import POSITION_GAIN, VELOCITY_GAIN
from faultgen.mjcf.gearing import tendon_coefficients
from faultgen.robot import COUPLING, Robot
from faultgen.simulation.plant import Plant, assemble
from faultgen.simulation.stepping import simulate

_HEAVIER = 1e8  # inertia of the heavy rotors over their own
_FREQUENCY = 100.0  # of the servo that keeps the heavy rotors from drifting [rad/s]


def prescribed_torque(robot: Robot, rotors: np.ndarray) -> np.ndarray:
    """Compute the motor torque that moves the rotors in a given way.

    Args:
        robot: The robot. Effects of its own that act on what is commanded or logged have no part.
        rotors: Position of the rotors at every simulation step, shape (steps, n_axes), in [rad].

    Returns:
        Torque at every step, same shape, in [N m].

    Raises:
        SimulationFailed: The simulation diverged.
    """
    model = copy.copy(assemble(robot).model)
    timestep = model.opt.timestep
    drives = robot.ids("actuator", "drive", model)
    motors = model.jnt_dofadr[robot.ids("joint", "motor", model)]
    inertia = model.dof_M0[motors].copy()
    model.dof_armature[motors] += _HEAVIER * inertia
    mujoco.mj_setConst(model, mujoco.MjData(model))  # it uses the armature from here on
    model.actuator_forcelimited[drives] = False
    model.actuator_gainprm[drives, POSITION_GAIN] = _HEAVIER * inertia * _FREQUENCY**2
    model.actuator_gainprm[drives, VELOCITY_GAIN] = _HEAVIER * inertia * 2 * _FREQUENCY

    # what MuJoCo's semi-implicit integration needs in order to reach the next position
    velocity = np.diff(rotors, axis=0, prepend=2 * rotors[:1] - rotors[1:2]) / timestep
    acceleration = np.diff(velocity, axis=0, append=velocity[-1:]) / timestep
    control = np.zeros((len(rotors), model.nu))
    at = model.actuator_ctrladr[drives]
    control[:, at], control[:, at + 1] = rotors, velocity
    control[:, at + 2] = (1 + _HEAVIER) * inertia * acceleration
    (run,) = simulate(robot, control, [Plant(model)], sample_period=timestep, lead_in=0.0)
    load = run.gear_torque / robot.gear_ratio
    shared = _shared(robot, model, velocity, acceleration)
    return np.asarray(inertia * acceleration + load - run.friction_torque + shared)


def _shared(
    robot: Robot, model: mujoco.MjModel, velocity: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Torque of the inertia and viscous friction that rotors share, shape (steps, n_axes)."""
    torque = np.zeros_like(velocity)
    for actuator in range(model.nactuator):
        if not model.actuator(actuator).name.startswith(COUPLING):
            continue
        tendon = model.actuator_trnid[actuator, 0]
        lever = tendon_coefficients(model, tendon)[list(robot.motors)]
        viscous = model.actuator_damping[actuator] * (velocity @ lever)
        inertial = model.tendon_armature[tendon] * (acceleration @ lever)
        torque += np.outer(viscous + inertial, lever)
    return torque
