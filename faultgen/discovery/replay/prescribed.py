"""The motor torque that a motion of the rotors needs, and the servo that keeps them on it.

The rotors of the simulated robot are made so heavy that nothing but the prescribed torque moves
them. They then follow any motion exactly, and the arm behind the gearboxes answers as it does in
the robot. A slow servo only keeps them from drifting. The torque that the real rotors need is

    tau = J a + gear torque / gear ratio + friction

with the inertia J and the acceleration a of the rotor (Spong 1987), and with the inertia and the
friction that two rotors of a wrist share.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from faultgen.mjcf.dcmotor import POSITION_GAIN, VELOCITY_GAIN, set_servo
from faultgen.robot import Robot
from faultgen.simulation.arm import shared_torque
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
    # the friction torque holds the shared Coulomb friction already
    shared = shared_torque(robot, velocity, acceleration, sliding=False)
    return np.asarray(inertia * acceleration + load - run.friction_torque + shared)


def stiffen(spec: mujoco.MjSpec, robot: Robot, rate: float) -> None:
    """Give a model a fast servo.

    Args:
        spec: The model, which is changed.
        robot: The robot.
        rate: Where the poles of a rotor that is alone are, critically damped, in [rad] a step.
    """
    model = robot.model
    frequency = rate / model.opt.timestep
    for axis, inertia in enumerate(model.dof_M0[list(robot.motors)].tolist(), start=1):
        set_servo(spec.actuator(f"drive{axis}"), inertia * frequency**2, 0, inertia * 2 * frequency)
