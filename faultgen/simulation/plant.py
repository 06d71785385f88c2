"""A robot with effects, ready to be simulated. Datasets and discovery both use `assemble`.

plant = assemble(robot, [Applied("torque_ripple", 2, 0.05, {"order": 6})])
(cycle,) = simulate(robot, control, [plant], sample_period=0.004)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from faultgen.effects import Applied, Effect, Temperature, get_effect
from faultgen.effects.hooks import Place, Update
from faultgen.errors import InputError
from faultgen.robot import Robot
from faultgen.simulation.arm import loads

if TYPE_CHECKING:
    from faultgen.monitoring.sensors import Measured
    from faultgen.simulation.cycle import Cycle


@dataclass(frozen=True, eq=False)
class Plant:
    """A model, and what its effects do outside the model."""

    model: mujoco.MjModel
    """The compiled model, with all effects that MJCF can express."""
    effects: tuple[tuple[Effect, Place], ...] = ()
    """All effects of the plant, without those of severity 0."""
    updates: tuple[Update, ...] = ()
    """Functions that are called between steps, in this order. Most plants have none."""
    interval: float = 0.0
    """Time between two calls of the updates [s]."""

    def command(self, control: np.ndarray, repeats: bool) -> np.ndarray:
        """Apply the effects that change the control signal on its way to the drives.

        Args:
            control: Control signal that the controller of the healthy robot sends, shape
                (steps, n_controls).
            repeats: Whether the signal starts again after its end.

        Returns:
            The control signal that reaches the drives, of the same shape and units.
        """
        for effect, place in self.effects:
            if effect.command is not None:
                control = effect.command(control, place, repeats)
        return control

    def log(self, cycle: Cycle) -> Cycle:
        """Apply the effects that change what the controller logs.

        Args:
            cycle: The cycle as it was simulated.

        Returns:
            The cycle as the controller logs it.
        """
        logged = cycle
        for effect, place in self.effects:
            if effect.log is not None:
                logged = effect.log(cycle, logged, place)
        return logged

    def sense(self, measured: Measured, sample_period: float, rng: np.random.Generator) -> Measured:
        """Apply the effects that are faults of sensors.

        Args:
            measured: One cycle as healthy sensors show it.
            sample_period: Time between samples [s].
            rng: Random number generator.

        Returns:
            The cycle as the faulty sensors show it.
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
) -> Plant:
    """Put effects into a robot, after those that the healthy robot already has (`Robot.effects`).

    Args:
        robot: The healthy robot.
        effects: The effects, in the order in which they act. The same effect may occur several
            times, and several effects may act on one axis. Each acts on the robot as the effects
            before it made it: 20 % more friction and then 10 % more are 32 % more, and two delays
            add up.
        temperature: Gearbox temperature [deg C], or (times [s], temperatures [deg C]), for the
            effects that depend on it. None stands for the temperature at which the robot's
            friction parameters hold.
        spec: Model to which the effects are added, with the same elements as `robot.spec()`. It is
            copied, not changed. Default: `robot.spec()`.

    Returns:
        The plant. If every severity is 0, it is the healthy robot, bit for bit.

    Raises:
        InputError: There is no such effect, axis or parameter, or an effect does not act on its
            axis.
    """
    chosen = []
    for own in (True, False):
        for one in robot.effects if own else effects:
            try:
                effect = get_effect(one.effect)
                parameters = effect.complete(one.parameters)
                check_axis(effect, one.axis, robot)
            except InputError as error:
                where = f"robot {robot.name}: its effects: " if own else ""
                raise InputError(f"{where}{error}") from None
            if "temperature" in parameters and parameters["temperature"] is None:
                parameters["temperature"] = temperature
            if one.severity != 0:
                chosen.append((effect, one, parameters))
    if not chosen and spec is None:
        return Plant(robot.model)
    edited = robot.spec() if spec is None else spec.copy()
    for effect, one, parameters in sorted(chosen, key=lambda item: item[0].last):
        effect.apply(edited, one.axis, one.severity, **parameters)
    model = edited.compile()
    placed = tuple(
        (effect, Place(robot, model, one.axis, one.severity, parameters, partial(loads, robot)))
        for effect, one, parameters in chosen
    )
    updates, intervals = [], []
    for effect in {effect.name: effect for effect, _ in placed}.values():
        if effect.between is not None:
            update = effect.between([place for of, place in placed if of is effect])
            if update is not None:
                updates.append(update)
                intervals.append(effect.interval)
    return Plant(model, placed, tuple(updates), min(intervals, default=0.0))


def check_axis(effect: Effect, axis: int, robot: Robot) -> None:
    """Refuse an axis that the robot does not have, or that the effect does not act on.

    Args:
        effect: The effect.
        axis: Number of the axis, from 1.
        robot: The robot.

    Raises:
        InputError: The axis is refused. The message lists the possible axes.
    """
    if not 1 <= axis <= robot.n_axes:
        raise InputError(f"axis {axis}: robot {robot.name} has axes 1 to {robot.n_axes}")
    allowed = effect.axes(robot.n_axes)
    if axis not in allowed:
        where = ", ".join(map(str, allowed)) or "none"
        raise InputError(f"axis {axis}: {effect.name} acts on axis {where} of robot {robot.name}")
