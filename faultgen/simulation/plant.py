"""A robot with effects, ready to be simulated: the one way in for datasets and for discovery.

machine = assemble(robot, [Applied("torque_ripple", 2, 0.05, {"order": 6})])
(cycle,) = simulate(robot, control, [machine], sample_period=0.004)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from faultgen.effects import Applied, Effect, Temperature, get_effect
from faultgen.effects.base import Place, Update
from faultgen.errors import InputError
from faultgen.robot import Robot

if TYPE_CHECKING:
    from faultgen.monitoring.sensors import Measured
    from faultgen.simulation.cycle import Cycle


@dataclass(frozen=True, eq=False)
class Machine:
    """A model, and what its effects do beside it."""

    model: mujoco.MjModel
    """With all effects that the model can carry."""
    effects: tuple[tuple[Effect, Place], ...] = ()
    """Those in it, severity 0 left out."""
    updates: tuple[Update, ...] = ()
    """What is called between steps, in this order; mostly none."""
    interval: float = 0.0
    """Time between two calls [s]."""

    def command(self, control: np.ndarray, repeats: bool) -> np.ndarray:
        """The control signal as it reaches the drives.

        Args:
            control: As the controller of the healthy robot means it, shape (steps, n_controls).
            repeats: Whether its end is followed by its start.
        """
        for effect, place in self.effects:
            if effect.command is not None:
                control = effect.command(control, place, repeats)
        return control

    def log(self, cycle: Cycle) -> Cycle:
        """The channels as the controller logs them."""
        logged = cycle
        for effect, place in self.effects:
            if effect.log is not None:
                logged = effect.log(cycle, logged, place)
        return logged

    def sense(self, measured: Measured, sample_period: float, rng: np.random.Generator) -> Measured:
        """The channels as faulty sensors show them.

        Args:
            measured: One cycle as healthy sensors show it.
            sample_period: Time between samples [s].
            rng: Source of randomness.
        """
        for effect, place in self.effects:
            if effect.sense is not None:
                measured = effect.sense(measured, place, sample_period, rng)
        return measured


def assemble(
    robot: Robot,
    effects: Sequence[Applied] = (),
    *,
    temperature: Temperature = None,
    spec: mujoco.MjSpec | None = None,
) -> Machine:
    """Put effects into a robot.

    Args:
        robot: The healthy robot.
        effects: Any number, also several of a kind or on one axis; in this order.
        temperature: Gearbox temperature [deg C], or (times [s], values), for the effects that ask
            for it; None for that of the robot's friction parameters.
        spec: The robot to begin with, of the same elements as `robot.spec()`; copied. Default:
            `robot.spec()`.

    Returns:
        The machine; that of the healthy robot, bit for bit, where every severity is 0.

    Raises:
        InputError: No such effect, axis or parameter, or the effect does not act on that axis.
    """
    chosen = []
    for one in effects:
        effect = get_effect(one.effect)
        parameters = effect.complete(one.parameters)
        if "temperature" in parameters and parameters["temperature"] is None:
            parameters["temperature"] = temperature
        check_axis(effect, one.axis, robot)
        if one.severity != 0:
            chosen.append((effect, one, parameters))
    if not chosen and spec is None:
        return Machine(robot.model)
    edited = robot.spec() if spec is None else spec.copy()
    for effect, one, parameters in sorted(chosen, key=lambda item: item[0].last):
        effect.apply(edited, one.axis, one.severity, **parameters)
    model = edited.compile()
    placed = tuple(
        (effect, Place(robot, model, one.axis, one.severity, parameters))
        for effect, one, parameters in chosen
    )
    updates, intervals = [], []
    for effect in {effect.name: effect for effect, _ in placed}.values():
        if effect.between is not None:
            update = effect.between([place for of, place in placed if of is effect])
            if update is not None:
                updates.append(update)
                intervals.append(effect.interval)
    return Machine(model, placed, tuple(updates), min(intervals, default=0.0))


def check_axis(effect: Effect, axis: int, robot: Robot) -> None:
    """Refuse an axis that the robot does not have or the effect does not act on.

    Raises:
        InputError: With the axes to choose from.
    """
    if not 1 <= axis <= robot.n_axes:
        raise InputError(f"axis {axis}: robot {robot.name} has axes 1 to {robot.n_axes}")
    allowed = effect.axes(robot.n_axes)
    if axis not in allowed:
        where = ", ".join(map(str, allowed)) or "none"
        raise InputError(f"axis {axis}: {effect.name} acts on axis {where} of robot {robot.name}")
