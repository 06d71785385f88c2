"""The state of a robot in one cycle: gearbox temperature, payload and wear."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from faultgen.effects import Applied, set_temperature
from faultgen.robot import Robot
from faultgen.simulation.plant import Plant, assemble


@dataclass(frozen=True)
class Condition:
    """Temperature, payload and faults with which a cycle is simulated."""

    temperature: float
    """Temperature of all gearboxes [deg C]."""
    payload_factor: float = 1.0
    """Mass of the payload divided by its nominal mass."""
    faults: tuple[Applied, ...] = ()
    """Every effect on every axis, with its severity in this cycle."""


def plant_at(robot: Robot, healthy: mujoco.MjSpec, condition: Condition) -> Plant:
    """Assemble the robot as it is at a condition.

    Args:
        robot: The healthy robot.
        healthy: Its spec, `robot.spec()`. It is not changed.
        condition: The condition.

    Returns:
        The plant. At the reference temperature, nominal payload and severity 0, its model is
        that of the healthy robot, bit for bit.

    Raises:
        InputError: There is no such effect, or it does not act on a worn axis.
    """
    spec = healthy.copy()
    reference = robot.friction_temperature
    if condition.temperature != reference:
        for axis in range(1, robot.n_axes + 1):
            set_temperature(spec, axis, condition.temperature, reference)
    payload = spec.body("payload")
    if payload is not None and condition.payload_factor != 1:
        payload.mass *= condition.payload_factor
        payload.inertia *= condition.payload_factor
    return assemble(robot, condition.faults, temperature=condition.temperature, spec=spec)
