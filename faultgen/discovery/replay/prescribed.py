"""The torque of a robot whose rotors move in a given way.

The rotors of the simulated robot are made so heavy that nothing but the prescribed torque moves
them. They then follow any motion exactly, and the arm behind the gearboxes answers as it does in
the robot. The torque that the real drives give is that of the drives of the simulated robot, less
what the added inertia H takes:

    tau = tau_simulated - H a

with the acceleration a that the rotors really have. It holds for everything that acts on a rotor:
gearbox, friction, ripple, and inertia and friction that two rotors share.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import mujoco
import numpy as np

from faultgen.mjcf.dcmotor import POSITION_GAIN, VELOCITY_GAIN
from faultgen.robot import Robot
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.plant import Plant
from faultgen.simulation.stepping import simulate

TURN = 0.2
"""Motor angle after which friction no longer depends on how the axis came to rest [rad]: assumed,
about ten times the reach of the bristles."""

STIFFER = 25.0
"""Factor of the stiffness of gearboxes whose joints, and not rotors, are on their measured
positions: the twist is negligible then. Assumed; resonances are 5 times as high."""

_HEAVIER = 1e7  # inertia that is added to the rotors, over their own
_DRIFT = 10.0  # frequency of the spring that keeps the rotors from drifting [rad/s]
_RUN_UP = 0.3  # time before a motion in which it gets up to its speed and the arm settles [s]
_REST = 2  # steps before that
_BEYOND = 8  # steps after the end: the last accelerations of a motion are not known


def prescribed(robot: Robot, plant: Plant, rotors: np.ndarray) -> Cycle:
    """Simulate a robot whose rotors move in a given way.

    Args:
        robot: The healthy robot.
        plant: The robot with effects. Those that shift commanded positions shift the motion.
        rotors: Logged position of the rotors at every simulation step, shape (steps, n_axes), in
            [rad]. They get up to their first speed before.

    Returns:
        What would be logged, at every step.

    Raises:
        SimulationFailed: The simulation diverged.
    """
    model = copy.copy(plant.model)
    timestep = model.opt.timestep
    drives = robot.ids("actuator", "drive", model)
    motors = model.jnt_dofadr[robot.ids("joint", "motor", model)]
    added = _HEAVIER * robot.model.dof_M0[list(robot.motors)]
    model.dof_armature[motors] += added
    mujoco.mj_setConst(model, mujoco.MjData(model))  # it uses the armature from here on
    model.actuator_forcelimited[drives] = False
    model.actuator_gainprm[drives, POSITION_GAIN] = added * _DRIFT**2
    model.actuator_gainprm[drives, VELOCITY_GAIN] = 0.0

    at = model.actuator_ctrladr[drives]
    before = _run_up(rotors, timestep)
    last = rotors[-1] + np.arange(1, _BEYOND + 1)[:, None] * (rotors[-1] - rotors[-2])
    way = np.concatenate([before, rotors, last])
    command = np.zeros((len(way), model.nu))
    command[:, at] = way
    command = plant.command(command, False)
    position, further = command[:, at], command[:, at + 2].copy()
    # what MuJoCo's semi-implicit integration needs in order to reach the next position
    velocity = np.diff(position, axis=0, prepend=position[:1]) / timestep
    acceleration = np.diff(velocity, axis=0, append=velocity[-1:]) / timestep
    control = command.copy()  # further actuators may be commanded, too
    control[:, at + 2] = added * acceleration
    heavy = Plant(model, (), plant.updates, plant.interval)
    (run,) = simulate(robot, control, [heavy], sample_period=timestep, lead_in=0.0)
    moved = np.diff(run.motor_velocity, axis=0, append=run.motor_velocity[-1:]) / timestep
    torque = run.motor_torque + (further - added * moved) / robot.torque_gain
    whole = plant.log(replace(run, motor_torque=torque))
    kept = slice(len(before), len(before) + len(rotors))
    return Cycle(**{name: values[kept] for name, values in vars(whole).items()})


def speeds_of(rotors: np.ndarray, timestep: float) -> tuple[np.ndarray, int]:
    """Compute the speed of prescribed rotors in each step, from rest before the motion on.

    Args:
        rotors: Position of the rotors at every step, shape (steps, n_axes), in [rad].
        timestep: Step [s].

    Returns:
        Speeds, shape (steps before the motion + steps, n_axes), in [rad/s], and the number of steps
        before the motion.
    """
    before = _run_up(rotors, timestep)
    way = np.concatenate([before, rotors])
    return np.diff(way, axis=0, prepend=way[:1]) / timestep, len(before)


def _run_up(rotors: np.ndarray, timestep: float) -> np.ndarray:
    """Positions of some time before a motion, from rest on; shape (steps, n_axes), in [rad]."""
    steps = round(_RUN_UP / timestep)
    share = np.arange(steps) / steps
    # the way to go, over the first speed: the speed rises as 3 x^2 - 2 x^3
    to_go = (share**3 - share**4 / 2 - 0.5) * _RUN_UP
    speed = (rotors[1] - rotors[0]) / timestep
    speed[np.abs(speed) * _RUN_UP / 2 < TURN] = 0.0  # at rest: the bristles stay as they are
    way = rotors[0] + to_go[:, None] * speed
    return np.concatenate([np.repeat(way[:1], _REST, axis=0), way])


def stiffen(gearbox: mujoco.MjsTendon) -> None:
    """Make a gearbox so stiff that its joint moves as its rotor does, with the same damping ratio.

    Args:
        gearbox: Tendon of the gearbox, changed in place.
    """
    gearbox.stiffness *= STIFFER
    gearbox.damping *= np.sqrt(STIFFER)
