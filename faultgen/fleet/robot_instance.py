"""The properties in which the robots of a fleet differ.

They are drawn once for each robot, from the seed of the fleet and the number of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from faultgen.effects import Applied
from faultgen.fleet.damage import GearboxLife, draw_life
from faultgen.fleet.plan import FleetPlan
from faultgen.robot import Robot, load_robot

WORKED = 7.5
"""Duration of a shift without its break [h]."""


@dataclass(frozen=True, eq=False)
class Program:
    """A task that is moved to another place and done at another speed."""

    task: str
    """Name of the task."""
    shift: np.ndarray
    """Angles that are added to the joint angles, shape (n_axes,), in [rad]."""
    speed: float
    """Speed override, above 0 and up to 1."""


@dataclass(frozen=True, eq=False)
class RobotInstance:
    """One robot of a fleet."""

    model: str
    """Name of its model."""
    payload: float
    """Mass of the payload divided by its nominal mass. The controller knows it."""
    programs: tuple[Program, ...]
    """Programs that it runs."""
    shifts: int
    """Number of shifts of 8 h on each day."""
    duty: float
    """Share of a shift in which programs run."""
    weekend: float
    """Duty at the weekend divided by that of other days."""
    first_weekday: int
    """Weekday of the first day of the record, from 0; 5 and 6 are the weekend."""
    ambient: float
    """Mean temperature of the hall [deg C]."""
    samples_a_day: int
    """Number of samples that the monitoring stores on each day."""
    deviations: tuple[Applied, ...]
    """Deviations of this robot from its model. The controller does not know them."""
    cooling: np.ndarray
    """Thermal resistance of each axis divided by that of its model, shape (n_axes,)."""
    fails: bool
    """Whether a gearbox fails at the end of the record."""
    life: GearboxLife | None
    """Life of the gearbox that fails or, in a robot that does not fail, of the one that ages."""

    @property
    def hours_a_day(self) -> float:
        """Mean running time of the robot [h/d]."""
        return self.shifts * WORKED * self.duty * (5 + 2 * self.weekend) / 7

    def robot(self) -> Robot:
        """Return the model with the payload that the controller assumes."""
        nominal = load_robot(self.model)
        spec = nominal.spec()
        spec.body("payload").mass *= self.payload
        spec.body("payload").inertia *= self.payload
        return nominal.edited(spec)


def draw_instance(plan: FleetPlan, number: int) -> RobotInstance:
    """Draw a robot of a fleet.

    Args:
        plan: The plan of the fleet.
        number: Number of the robot, from 0.

    Returns:
        The robot.
    """
    chosen = np.random.default_rng([plan.seed, 0]).permutation(plan.robots)[: plan.failing]
    rng = np.random.default_rng([plan.seed, 1, number])
    made, does, scatter = plan.production, plan.programs, plan.scatter
    robot = load_robot(plan.models[int(rng.integers(len(plan.models)))])
    programs = tuple(
        Program(
            task=does.tasks[int(rng.integers(len(does.tasks)))],
            shift=np.radians(does.shift) * rng.standard_normal(robot.n_axes),
            speed=float(rng.uniform(*does.speed)),
        )
        for _ in range(int(rng.integers(does.number[0], does.number[1] + 1)))
    )
    deviations = [
        Applied(name, axis, float(np.clip(spread * rng.standard_normal(), -0.6, 2.0)))
        for name, spread in (
            ("coulomb_friction", scatter.coulomb),
            ("viscous_friction", scatter.viscous),
            ("rotor_inertia", scatter.rotor_inertia),
        )
        for axis in range(1, robot.n_axes + 1)
    ]
    payload, duty, weekend, ambient = (
        float(rng.uniform(*one)) for one in (does.payload, made.duty, made.weekend, made.ambient)
    )
    shifts, samples = (
        int(rng.integers(low, high + 1)) for low, high in (made.shifts, made.samples_a_day)
    )
    first_weekday = int(rng.integers(7))
    cooling = np.exp(0.2 * rng.standard_normal(robot.n_axes))
    life = draw_life(
        robot,
        failure=float(plan.days),
        ranges=plan.damage.model_dump(exclude={"unsteadiness"}),
        unsteadiness=plan.damage.unsteadiness,
        rng=rng,
    )
    fails = bool(number in chosen)
    instance = RobotInstance(
        model=robot.name,
        payload=payload,
        programs=programs,
        shifts=shifts,
        duty=duty,
        weekend=weekend,
        first_weekday=first_weekday,
        ambient=ambient,
        samples_a_day=samples,
        deviations=tuple(deviations),
        cooling=cooling,
        fails=fails,
        life=life,
    )
    if fails:
        return instance
    if plan.ageing.hours == 0:
        return replace(instance, life=None)
    age = float(rng.uniform(*plan.ageing.age))
    return replace(
        instance, life=life.ageing(plan.days, plan.ageing.hours / instance.hours_a_day, age)
    )
