"""The small robot in motion: how tests run it with effects, and what its channels must obey."""

import mujoco
import numpy as np

from faultgen.effects import Applied
from faultgen.simulation.plant import assemble
from faultgen.simulation.stepping import simulate

STEP = 0.001


def run(robot, control, *effects, cycles=1, period=STEP, **context):
    """The last cycle of a robot with effects, and its plant."""
    plant = assemble(robot, [Applied(*effect) for effect in effects], **context)
    *_, cycle = simulate(robot, control, [plant] * cycles, sample_period=period)
    return cycle, plant


def force_added(model, healthy, position):
    """Generalised force that effects add at rest in a position."""
    forces = []
    for each in (model, healthy):
        data = mujoco.MjData(each)
        data.qpos[:] = position
        mujoco.mj_forward(each, data)
        forces.append(data.qfrc_passive + data.qfrc_actuator)
    return forces[0] - forces[1]


def channels(cycle):
    return np.concatenate([getattr(cycle, name) for name in cycle.__dataclass_fields__], axis=1)


def newton(robot, cycle, viscous=None):
    """Torque on each rotor that no channel tells: J dw/dt less drive, friction and gearbox."""
    inertia = robot.model.body_inertia[robot.model.jnt_bodyid[list(robot.motors)], 2]
    acceleration = np.diff(cycle.motor_velocity, axis=0) / STEP
    torque = cycle.motor_torque + cycle.friction_torque - cycle.gear_torque / robot.gear_ratio
    if viscous is None:
        viscous = robot.model.actuator_damping[robot.ids("actuator", "friction")][None]
    implicit = -viscous[: len(acceleration)] * np.diff(
        cycle.motor_velocity, axis=0
    )  # applied after the step
    return inertia * acceleration - torque[:-1] - implicit


def servo(robot, cycle, control):
    """Torque that the drive means to give, by what it was told and what is logged."""
    model = robot.model
    drive = robot.ids("actuator", "drive")
    at, gains = model.actuator_ctrladr[drive], model.actuator_gainprm[drive]
    torque = gains[:, 4] * (control[:, at] - cycle.motor_position) + control[:, at + 2]
    torque = torque + gains[:, 6] * (control[:, at + 1] - cycle.motor_velocity)
    return np.clip(torque, -robot.motor_torque_limit, robot.motor_torque_limit)
