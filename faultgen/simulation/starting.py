"""Where a simulation starts: on the reference, with the gearboxes twisted by the load.

Elastic joints that do not start in equilibrium ring for seconds. A simulation that repeats a cycle
forgets its start before the first cycle. A simulation of a recorded motion has no such time, so
that it must start in the equilibrium of its own plant, whatever effects are in it.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from faultgen.mjcf.compiling import mujoco_warnings
from faultgen.mjcf.dcmotor import POSITION_GAIN
from faultgen.mjcf.gearing import tendon_coefficients
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm

_ROUNDS = 100
_DONE = 1e-9  # change of the twist at which the search ends [rad, joint side], or [m]
_MOVING = 0.01  # share of the speed limit from which a robot counts as moving: assumed


def start_on_reference(robot: Robot, batch: Batch, control: np.ndarray) -> None:
    """Put the robot on its reference, with the gearboxes twisted by the static load there.

    Args:
        robot: The robot.
        batch: A batch of one simulation of the robot, whose positions and velocities are set.
        control: Control signal at the start. Shape (n_controls,).
    """
    model = robot.model
    at = model.actuator_ctrladr[robot.ids("actuator", "drive")]
    motor, speed = control[at], control[at + 1]
    joint = robot.gearing.joints(motor)
    load = Arm(robot).inverse_dynamics(joint[None], 0 * joint[None], 0 * joint[None])[0]
    stiffness = model.tendon_stiffness[robot.ids("tendon", "gearbox")]
    position, velocity = batch.qpos, batch.qvel
    motors, joints = robot.addresses(batch.model)
    position[0, motors] = motor
    position[0, joints] = robot.gearing.joints(motor, robot.gearing.torque(load) / stiffness)
    velocity[0, motors] = speed
    velocity[0, joints] = robot.gearing.joints(speed)


def start_in_equilibrium(robot: Robot, batch: Batch, control: np.ndarray) -> None:
    """Put a changed robot on its reference, with the gearboxes twisted by the load of the motion.

    The twist is corrected by the torque that the joints lack, over the stiffness, until nothing
    changes. Play of a gearbox is passed through in this way, too. Rotors at rest give way until
    their servo carries what they lack.

    Args:
        robot: The unchanged robot.
        batch: A batch of one simulation of the changed robot, whose positions and velocities are
            set.
        control: Control signal, shape (steps, n_controls).
    """
    start_on_reference(robot, batch, control[0])
    model = batch.model
    motors, joints = robot.addresses(model)
    stiffness = model.tendon_stiffness[robot.ids("tendon", "gearbox", model)]
    gain = model.actuator_gainprm[robot.ids("actuator", "drive", model), POSITION_GAIN]
    at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")] + 1
    is_moving = np.abs(control[0, at]) > _MOVING * robot.motor_velocity_limit
    change = (control[1:2, at] - control[0, at]).sum(axis=0) / robot.model.opt.timestep
    acceleration = np.where(is_moving, change, 0.0)
    springs = np.zeros(model.nv)  # of all joints; only those that are neither rotor nor arm count
    for tendon in range(model.ntendon):
        springs += model.tendon_stiffness[tendon] * tendon_coefficients(model, tendon) ** 2
    springs[motors], springs[joints] = 0.0, 0.0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = batch.qpos[0], batch.qvel[0]
    data.ctrl[:] = control[0]
    with mujoco_warnings():
        for _ in range(_ROUNDS):
            mujoco.mj_forward(model, data)  # for springs and other actuators on the joints
            data.qacc[:] = 0
            data.qacc[motors] = acceleration
            data.qacc[joints] = robot.gearing.joints(acceleration)
            mujoco.mj_inverse(model, data)
            lacking = data.qfrc_inverse - data.qfrc_actuator
            twist = robot.gearing.torque(lacking[joints]) / stiffness
            gives = (gain > 0) & ~is_moving  # friction of moving rotors is still to build up
            turn = np.divide(-lacking[motors], gain, out=np.zeros_like(gain), where=gives)
            if not np.isfinite([twist, turn]).all():
                return
            data.qpos -= np.divide(lacking, springs, out=np.zeros_like(springs), where=springs > 0)
            data.qpos[motors] += turn
            data.qpos[joints] += robot.gearing.joints(turn, twist)
            if max(np.abs(twist).max(), np.abs(turn / robot.gear_ratio).max()) < _DONE:
                break
    batch.qpos[0] = data.qpos
