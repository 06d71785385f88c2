"""Cycles of one program, simulated at a few conditions and interpolated for all others.

The torque of axis i is computed sample by sample from its gearbox temperature T_i, the payload
1 + p, the friction 1 + s_i and the damage d of the gearbox that fails:

    y_i = base_i(T_i) + p load_i + s_i friction_i + g_i wear_i(d, T_failing)

Here g = 1 + s at the axis that fails, because its wear is proportional to its friction; at all
other axes g = 1. `base` is the polynomial through four temperatures, `load` and `friction` are
slopes, and `wear` is a polynomial in the damage through zero and three values, linear between two
temperatures. The friction of one axis has almost no influence on the torque of another, because all
axes follow their set points. The sum ignores interactions; they are of second order.
`tests/fleet/test_fleet.py` compares it with direct simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from faultgen.effects import Applied
from faultgen.errors import InputError
from faultgen.fleet.robot_instance import Program, RobotInstance
from faultgen.robot import Robot, load_robot
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.grid import lagrange
from faultgen.simulation.motion import Motion, plan, shifted
from faultgen.simulation.servo import control_signal
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

TEMPERATURES = np.array([30.0, 41.0, 61.0, 80.0])
"""Gearbox temperatures at which cycles are simulated [deg C]."""

DAMAGES = (0.4, 1.0, 2.0)
"""Damages at which cycles are simulated; 1 is the damage at failure."""

SAMPLE_PERIOD = 0.02
"""Time between samples [s]."""

_WEAR_TEMPERATURES = (1, 2)  # of `TEMPERATURES`, at which damage is simulated
_LOAD, _FRICTION = 0.1, 0.2


@dataclass(frozen=True, eq=False)
class Cycles:
    """Simulated cycles of one program of one robot."""

    position: np.ndarray
    """Motor position, shape (samples, n_axes), in [rad]."""
    velocity: np.ndarray
    """Motor velocity, same shape, in [rad/s]."""
    base: np.ndarray
    """Motor torque [N m] and position error of the motor [rad] at each temperature, shape
    (nodes, 2, samples, n_axes)."""
    load: np.ndarray
    """Change of both if the payload's mass is doubled, shape (2, samples, n_axes)."""
    friction: np.ndarray
    """Change of both if the friction is doubled, shape (2, samples, n_axes)."""
    wear: np.ndarray
    """Change of both by damage, shape (2 temperatures, damages, 2, samples, n_axes)."""
    loss: np.ndarray
    """Mean friction power at each temperature, shape (nodes, n_axes), in [W]."""
    wear_loss: np.ndarray
    """Friction power that damage adds at the axis that fails, shape (2 temperatures, damages), in
    [W]."""
    axis: int
    """Axis of the gearbox that fails or ages, from 1; 0 if there is none."""

    @property
    def period(self) -> float:
        """Duration of a cycle [s]."""
        return len(self.position) * SAMPLE_PERIOD

    def at(
        self, temperature: np.ndarray, payload: float, friction: np.ndarray, damage: float
    ) -> np.ndarray:
        """Compute motor torque and position error of a cycle.

        Args:
            temperature: Temperature of each gearbox, shape (n_axes,), in [deg C]. Values outside
                the range of `TEMPERATURES` are clipped.
            payload: Relative difference of the payload's mass from the mass that the controller
                assumes.
            friction: Relative difference of the friction of each axis from the usual friction of
                this robot, shape (n_axes,).
            damage: Damage of the gearbox that fails. Larger values than the last of `DAMAGES` are
                clipped.

        Returns:
            Motor torque [N m] and position error of the motor [rad], shape (2, samples, n_axes).
        """
        warm = np.clip(temperature, TEMPERATURES[0], TEMPERATURES[-1])
        out = np.einsum("an,ncsa->csa", lagrange(TEMPERATURES, warm), self.base, optimize=False)
        out += payload * self.load + friction * self.friction
        if self.axis and damage > 0:
            by = by_damage([damage])[0]
            low, high = TEMPERATURES[list(_WEAR_TEMPERATURES)]
            part = (warm[self.axis - 1] - low) / (high - low)
            grown = np.ones(out.shape[-1])
            grown[self.axis - 1] += friction[self.axis - 1]
            for weight, wear in zip((1 - part, part), self.wear, strict=True):
                out += weight * grown * np.tensordot(by, wear, axes=1)
        return out

    def losses(self, damage: np.ndarray) -> np.ndarray:
        """Compute the mean friction power at each temperature.

        Args:
            damage: Damage of the gearbox that fails on each day, shape (days,).

        Returns:
            Shape (days, nodes, n_axes), in [W].
        """
        out = np.repeat(self.loss[None], len(damage), axis=0)
        if self.axis:
            known = TEMPERATURES[list(_WEAR_TEMPERATURES)]
            more = by_damage(damage) @ self.wear_loss.T
            out[:, :, self.axis - 1] += [np.interp(TEMPERATURES, known, row) for row in more]
        return out


def by_damage(damage: ArrayLike) -> np.ndarray:
    """Compute the weights with which simulated damages are combined to others.

    Args:
        damage: The other damages, shape (number,).

    Returns:
        Weights of `DAMAGES`, shape (number, damages), without unit.
    """
    return lagrange((0.0, *DAMAGES), np.clip(damage, 0.0, DAMAGES[-1]))[:, 1:]


@lru_cache(maxsize=16)
def _planned(robot: str, task: str) -> Motion:
    return plan(load_task(robot, task), load_robot(robot))


def program_motion(robot: Robot, program: Program) -> Motion:
    """Plan the motion of a program.

    If the robot cannot do the shifted motion, the shift is reduced until it can.

    Args:
        robot: The model with its payload.
        program: The program.

    Returns:
        The motion.

    Raises:
        InputError: The robot cannot even do the motion without a shift.
    """
    motion = _planned(robot.name, program.task)
    for share in (1.0, 0.7, 0.4, 0.2, 0.0):
        try:
            return shifted(motion, robot, share * program.shift, program.speed)
        except InputError:
            if share == 0:
                raise
    raise AssertionError


def simulate_program(instance: RobotInstance, program: Program) -> Cycles:
    """Simulate a program of a robot at all conditions that interpolation needs.

    Args:
        instance: The robot.
        program: The program.

    Returns:
        The simulated cycles.

    Raises:
        SimulationFailed: A condition diverged.
    """
    robot = instance.robot()
    control = control_signal(program_motion(robot, program), robot.model.opt.timestep)
    healthy = robot.spec()
    every = round(SAMPLE_PERIOD / robot.model.opt.timestep)
    set_points = control[::every, robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]]

    def run(
        temperature: float, payload: float = 0.0, effects: Sequence[Applied] = ()
    ) -> tuple[np.ndarray, Cycle]:
        condition = Condition(temperature, 1 + payload, (*instance.deviations, *effects))
        plant = plant_at(robot, healthy, condition)
        (cycle,) = simulate(robot, control, [plant], sample_period=SAMPLE_PERIOD)
        return np.stack([cycle.motor_torque, cycle.motor_position - set_points]), cycle

    nodes = [run(float(t)) for t in TEMPERATURES]
    base = np.stack([channels for channels, _ in nodes])
    loss = np.stack([_power(cycle) for _, cycle in nodes])
    middle = _WEAR_TEMPERATURES[0]
    warm = float(TEMPERATURES[middle])
    more = [Applied("friction_wear", axis, _FRICTION) for axis in range(1, robot.n_axes + 1)]
    wear = np.zeros((2, len(DAMAGES), *base.shape[1:]))
    wear_loss = np.zeros(wear.shape[:2])
    if instance.life is not None:
        failing = instance.life.axis - 1
        for row, node in enumerate(_WEAR_TEMPERATURES):
            for k, damage in enumerate(DAMAGES):
                worn, cycle = run(float(TEMPERATURES[node]), 0.0, instance.life.effects(damage))
                wear[row, k] = worn - base[node]
                wear_loss[row, k] = (_power(cycle) - loss[node])[failing]
    return Cycles(
        position=nodes[middle][1].motor_position,
        velocity=nodes[middle][1].motor_velocity,
        base=base,
        load=(run(warm, _LOAD)[0] - base[middle]) / _LOAD,
        friction=(run(warm, 0.0, more)[0] - base[middle]) / _FRICTION,
        wear=wear,
        loss=loss,
        wear_loss=wear_loss,
        axis=0 if instance.life is None else instance.life.axis,
    )


def _power(cycle: Cycle) -> np.ndarray:
    """Mean friction power, shape (n_axes,), in [W]."""
    return np.abs(cycle.friction_torque * cycle.motor_velocity).mean(axis=0)
