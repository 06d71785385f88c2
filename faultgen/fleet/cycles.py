"""Cycles of one program, simulated at few conditions and put together for all others.

Torque of axis i, sample by sample, with its own gearbox temperature T_i, payload 1 + p, friction
1 + s_i and damage d of the gearbox that fails:

    y_i = base_i(T_i) + p load_i + s_i friction_i + g_i wear_i(d, T_failing)

with g = 1 + s at the axis that fails, whose wear is a share of its friction, else 1. `base`
is the polynomial through four temperatures, `load` and `friction` are slopes, `wear` a polynomial
through zero and three damages, linear between two temperatures. Friction of one axis hardly reaches
the torque of another, since all follow their set points; what is left out is second order.
`tests/test_fleet.py` holds it against direct simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from faultgen.effects import Applied
from faultgen.errors import InputError
from faultgen.fleet.robot_instance import Program, Unit
from faultgen.robot import Robot, load_robot
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.motion import Motion, plan, shifted
from faultgen.simulation.servo import control_signal
from faultgen.simulation.state import Condition, machine_at
from faultgen.simulation.stepping import simulate
from faultgen.simulation.surrogate import lagrange
from faultgen.tasks import load_task

TEMPERATURES = np.array([30.0, 41.0, 61.0, 80.0])
"""At which cycles are simulated [deg C]."""

DAMAGES = (0.4, 1.0, 2.0)
"""The same of damage."""

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
    """Torque and position error at each temperature, shape (nodes, 2, samples, n_axes), in [N m]
    and [rad], motor side."""
    load: np.ndarray
    """Their change by a payload that is heavier by its mass, shape (2, samples, n_axes)."""
    friction: np.ndarray
    """The same by friction that is more by its nominal value."""
    wear: np.ndarray
    """The same by damage, shape (2 temperatures, damages, 2, samples, n_axes)."""
    loss: np.ndarray
    """Mean power of friction at each temperature, shape (nodes, n_axes), in [W]."""
    wear_loss: np.ndarray
    """What damage adds to it at the axis that fails, shape (2 temperatures, damages), in [W]."""
    axis: int
    """Axis of the gearbox that fails, from 1; 0 where none does."""

    @property
    def period(self) -> float:
        """Duration of a cycle [s]."""
        return len(self.position) * SAMPLE_PERIOD

    def at(
        self, temperature: np.ndarray, payload: float, friction: np.ndarray, damage: float
    ) -> np.ndarray:
        """Torque and position error of a cycle.

        Args:
            temperature: Of each gearbox, shape (n_axes,), in [deg C]; held within `TEMPERATURES`.
            payload: Mass over what the controller is told, less 1.
            friction: Of each axis over what it is in this robot, less 1, shape (n_axes,).
            damage: Of the gearbox that fails; held below the last of `DAMAGES`.

        Returns:
            Shape (2, samples, n_axes).
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
        """Mean power of friction at each temperature.

        Args:
            damage: Of the gearbox that fails on each day, shape (days,).

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
    """Weights of the simulated damages at others, shape (number, damages)."""
    return lagrange((0.0, *DAMAGES), np.clip(damage, 0.0, DAMAGES[-1]))[:, 1:]


@lru_cache(maxsize=16)
def _planned(robot: str, task: str) -> Motion:
    return plan(load_task(robot, task), load_robot(robot))


def program_motion(robot: Robot, program: Program) -> Motion:
    """The motion of a program: less far from its task where the robot could not do it.

    Args:
        robot: The model with its payload.
        program: The program.
    """
    motion = _planned(robot.name, program.task)
    for share in (1.0, 0.7, 0.4, 0.2, 0.0):
        try:
            return shifted(motion, robot, share * program.shift, program.speed)
        except InputError:
            if share == 0:
                raise
    raise AssertionError


def simulate_program(unit: Unit, program: Program) -> Cycles:
    """Simulate all conditions of a program.

    Raises:
        SimulationFailed: A condition diverged.
    """
    robot = unit.robot()
    control = control_signal(program_motion(robot, program), robot.model.opt.timestep)
    healthy = robot.spec()
    every = round(SAMPLE_PERIOD / robot.model.opt.timestep)
    set_points = control[::every, robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]]

    def run(
        temperature: float, payload: float = 0.0, effects: Sequence[Applied] = ()
    ) -> tuple[np.ndarray, Cycle]:
        beside = (*unit.deviations, *effects)
        machine = machine_at(robot, healthy, Condition(temperature, 1 + payload, beside=beside))
        (cycle,) = simulate(robot, control, [machine], sample_period=SAMPLE_PERIOD)
        return np.stack([cycle.motor_torque, cycle.motor_position - set_points]), cycle

    nodes = [run(float(t)) for t in TEMPERATURES]
    base = np.stack([channels for channels, _ in nodes])
    loss = np.stack([_power(cycle) for _, cycle in nodes])
    middle = _WEAR_TEMPERATURES[0]
    warm = float(TEMPERATURES[middle])
    more = [Applied("friction_wear", axis, _FRICTION) for axis in range(1, robot.n_axes + 1)]
    wear = np.zeros((2, len(DAMAGES), *base.shape[1:]))
    wear_loss = np.zeros(wear.shape[:2])
    if unit.life is not None:
        failing = unit.life.axis - 1
        for row, node in enumerate(_WEAR_TEMPERATURES):
            for k, damage in enumerate(DAMAGES):
                worn, cycle = run(float(TEMPERATURES[node]), 0.0, unit.life.effects(damage))
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
        axis=0 if unit.life is None else unit.life.axis,
    )


def _power(cycle: Cycle) -> np.ndarray:
    """Mean power of friction, shape (n_axes,), in [W]."""
    return np.abs(cycle.friction_torque * cycle.motor_velocity).mean(axis=0)
