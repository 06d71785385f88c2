"""Where a simulation starts: on the reference, with the gearboxes twisted by the load.

Elastic joints that do not start in equilibrium ring for seconds. A simulation that repeats a cycle
forgets its start before the first cycle. A simulation of a recorded motion has no such time, so
that it must start in the equilibrium of its own plant, whatever effects are in it.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from faultgen.mjcf.dcmotor import BRISTLE_STIFFNESS, INTEGRAL_GAIN, POSITION_GAIN, STICTION
from faultgen.mjcf.gearing import tendon_coefficients
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm

_ROUNDS = 100
_DONE = 1e-9  # change of the twist at which the search ends [rad, joint side], or [m]
MOVING = 0.01
"""Share of the speed limit from which a rotor counts as moving: assumed."""


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

    Rotors at rest give way until their servo, and the bristles of their friction, carry the torque
    that the changes have added. A servo with an integral carries all torque without giving way.

    Args:
        robot: The unchanged robot.
        batch: A batch of one simulation of the changed robot, whose positions and velocities are
            set.
        control: Control signal, shape (steps, n_controls).
    """
    start_on_reference(robot, batch, control[0])
    usual = _Start(robot, robot.model, control)
    usual.settle()
    changed = _Start(robot, batch.model, control)
    # friction holds a rotor wherever it comes to: it must not turn before the twist is right
    if changed.settle() and changed.settle(usual.lacking[usual.motors]):
        batch.qpos[0], batch.act[0] = changed.data.qpos, changed.data.act


class _Start:
    """The first moment of a motion."""

    lacking: np.ndarray
    """Torque that each degree of freedom lacks for the acceleration of the motion, shape (nv,)."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, control: np.ndarray) -> None:
        self.robot, self.model = robot, model
        self.motors, self.joints = robot.addresses(model)
        at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
        motor, speed = control[0, at], control[0, at + 1]
        self.is_moving = np.abs(speed) > MOVING * robot.motor_velocity_limit
        change = (control[1:2, at + 1] - speed).sum(axis=0) / robot.model.opt.timestep
        self.acceleration = np.where(self.is_moving, change, 0.0)
        self.data = mujoco.MjData(model)
        self.data.ctrl[:] = control[0, : model.nu]  # learned laws have further columns
        self.data.qpos[self.motors], self.data.qvel[self.motors] = motor, speed
        self.data.qpos[self.joints] = robot.gearing.joints(motor)
        self.data.qvel[self.joints] = robot.gearing.joints(speed)

    def settle(self, usual: np.ndarray | None = None) -> bool:
        """Twist the gearboxes by what the joints lack over the stiffness, until nothing changes.

        Play of a gearbox is passed through in this way, too.

        Args:
            usual: Torque that the rotors of the unchanged robot lack, shape (n_axes,). Rotors at
                rest turn by what they lack beyond it. None: they stay where they are.

        Returns:
            Whether all numbers are finite.
        """
        model, data, robot = self.model, self.data, self.robot
        stiffness = model.tendon_stiffness[robot.ids("tendon", "gearbox", model)]
        drives = robot.ids("actuator", "drive", model)
        servo = model.actuator_gainprm[drives, POSITION_GAIN]
        integral = model.actuator_gainprm[drives, INTEGRAL_GAIN]
        holds = (integral > 0) & ~self.is_moving
        kept = model.actuator_actadr[drives[holds]]
        friction = robot.ids("actuator", "friction", model)
        bristles = model.actuator_dynprm[friction, BRISTLE_STIFFNESS]
        has = (bristles > 0) & (model.actuator_actnum[friction] == 1)
        bent = model.actuator_actadr[friction[has]]
        most = model.actuator_biasprm[friction[has], STICTION] / bristles[has]
        springs = self._springs()
        for _ in range(_ROUNDS):
            self._measure()
            twist = robot.gearing.torque(self.lacking[self.joints]) / stiffness
            turn = np.zeros(robot.n_axes)
            data.act[kept] += self.lacking[self.motors][holds] / integral[holds]
            if usual is not None:
                carry = servo.copy()
                carry[has] += bristles[has] * (np.abs(data.act[bent]) < most)
                carry[self.is_moving | holds] = 0.0  # friction of moving ones is still to build up
                beyond = self.lacking[self.motors] - usual
                turn = np.divide(-beyond, carry, out=turn, where=carry > 0)
            if not np.isfinite([twist, turn]).all():
                return False
            move = np.divide(self.lacking, springs, out=np.zeros_like(springs), where=springs > 0)
            data.qpos -= move
            data.qpos[self.motors] += turn
            data.act[bent] = np.clip(data.act[bent] + turn[has], -most, most)
            data.qpos[self.joints] += robot.gearing.joints(turn, twist)
            if max(np.abs(twist).max(), np.abs(turn / robot.gear_ratio).max()) < _DONE:
                break
        return True

    def _measure(self) -> None:
        """Compute what the degrees of freedom lack."""
        with mujoco_warnings():
            mujoco.mj_forward(self.model, self.data)  # for springs and other actuators
            self.data.qacc[:] = 0
            self.data.qacc[self.motors] = self.acceleration
            self.data.qacc[self.joints] = self.robot.gearing.joints(self.acceleration)
            mujoco.mj_inverse(self.model, self.data)
        self.lacking = self.data.qfrc_inverse - self.data.qfrc_actuator

    def _springs(self) -> np.ndarray:
        """Stiffness on joints that are neither of a rotor nor of the arm, shape (nv,)."""
        springs = np.zeros(self.model.nv)
        for tendon in range(self.model.ntendon):
            own = tendon_coefficients(self.model, tendon)
            springs += self.model.tendon_stiffness[tendon] * own**2
        springs[self.motors] = springs[self.joints] = 0.0
        return springs
