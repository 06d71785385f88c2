"""The calendar of a robot: when it runs, what it runs, and what happens to it.

Times are divided into rows of five minutes, and into days.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.fleet.plan import FleetPlan
from faultgen.fleet.robot_instance import WORKED, RobotInstance

ROWS = 288
"""Number of rows in a day."""

STEP = 24.0 / ROWS
"""Time between rows [h]."""

_SHIFT = 8.0  # [h]
_BREAK = _SHIFT - WORKED  # in the middle of a shift [h]
_FIRST = {1: 6.0, 2: 6.0, 3: 0.0}  # start of production, by shifts [h]
HALL_DAY = 2.0  # amplitude of the hall's temperature over the day [K]: assumed
HALL_DAYS = 2.0  # spread from day to day [K]: assumed
_MEMORY = 0.8  # of the hall, from day to day
_LUBRICANT_MEMORY = 0.7  # of friction, from day to day
_DUTY_SPREAD = 0.08  # of a day's duty: assumed


@dataclass(frozen=True, eq=False)
class Calendar:
    """What happens to one robot over the days of the record."""

    duty: np.ndarray
    """Share of each row in which the robot runs, shape (days * ROWS,)."""
    ambient: np.ndarray
    """Temperature of the hall in each row, shape (days * ROWS,), in [deg C]."""
    mix: np.ndarray
    """Share of the running time of each day that each program takes, shape (days, programs)."""
    payload: np.ndarray
    """Relative difference of the payload's mass from the mass that the controller assumes, shape
    (days,)."""
    friction: np.ndarray
    """Relative difference of the friction of each axis from the usual friction of this robot, shape
    (days, n_axes)."""
    services: np.ndarray
    """Numbers of the days that begin with a service, shape (services,)."""
    changes: np.ndarray
    """Numbers of the days from which the programs have other shares, shape (changes,)."""


def draw_calendar(
    plan: FleetPlan, instance: RobotInstance, n_axes: int, rng: np.random.Generator
) -> Calendar:
    """Draw the calendar of a robot.

    Args:
        plan: The plan of the fleet.
        instance: The robot.
        n_axes: Number of its axes.
        rng: Random number generator.

    Returns:
        The calendar.
    """
    days = plan.days
    rng_duty, rng_hall, rng_mix, rng_parts, rng_friction = rng.spawn(5)
    services = _occasions(days, plan.scatter.service, rng_friction)
    changes = _occasions(days, plan.programs.change, rng_mix)
    return Calendar(
        duty=_duty(instance, days, rng_duty),
        ambient=_hall(instance, days, rng_hall),
        mix=_mix(len(instance.programs), days, changes, plan.programs.mix, rng_mix),
        payload=plan.programs.parts * rng_parts.standard_normal(days).clip(-3, 3),
        friction=_friction(plan, days, n_axes, services, rng_friction),
        services=services,
        changes=changes,
    )


def _occasions(days: int, mean: float, rng: np.random.Generator) -> np.ndarray:
    """Days on which something happens that happens every `mean` days on average."""
    if mean == 0:
        return np.zeros(0, int)
    return np.flatnonzero(rng.random(days) < 1 / mean)


def _duty(instance: RobotInstance, days: int, rng: np.random.Generator) -> np.ndarray:
    hour = np.arange(ROWS) * STEP
    since = hour - _FIRST[instance.shifts]
    works = (since >= 0) & (since < instance.shifts * _SHIFT)
    middle = np.mod(since, _SHIFT)
    works &= ~((middle >= _SHIFT / 2) & (middle < _SHIFT / 2 + _BREAK))
    weekday = np.mod(instance.first_weekday + np.arange(days), 7)
    level = instance.duty * np.where(weekday >= 5, instance.weekend, 1.0)
    level = level * (1 + _DUTY_SPREAD * rng.standard_normal(days))
    return (level.clip(0.02, 1.0)[:, None] * works).ravel()


def _hall(instance: RobotInstance, days: int, rng: np.random.Generator) -> np.ndarray:
    by_day = _walk(days, 1, _MEMORY, rng)[:, 0] * HALL_DAYS
    rows = np.arange(days * ROWS) / ROWS
    day = np.interp(rows, np.arange(days) + 0.5, by_day)
    return instance.ambient + day - HALL_DAY * np.cos(2 * np.pi * (rows - 0.15))


def _mix(
    programs: int, days: int, changes: np.ndarray, constancy: float, rng: np.random.Generator
) -> np.ndarray:
    share = rng.dirichlet(np.full(programs, 2.0))
    out = np.empty((days, programs))
    for day in range(days):
        if day in changes:
            share = rng.dirichlet(np.full(programs, 2.0))
        out[day] = rng.dirichlet(constancy * share + 1e-3)
    return out


def _friction(
    plan: FleetPlan, days: int, n_axes: int, services: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Relative change of friction from day to day and with the age of the lubricant."""
    scatter = plan.scatter
    spread = scatter.lubricant * _walk(days, n_axes, _LUBRICANT_MEMORY, rng)
    if scatter.service == 0:
        return spread
    age = rng.exponential(scatter.service)
    ages = np.empty(days)
    for day in range(days):
        age = 0.0 if day in services else age + 1.0
        ages[day] = age
    gained = scatter.ageing * np.minimum(ages / scatter.service, 2.0)
    return spread + gained[:, None]


def _walk(days: int, columns: int, memory: float, rng: np.random.Generator) -> np.ndarray:
    """Draw first-order autoregressive series with variance 1, shape (days, columns)."""
    out = np.empty((days, columns))
    now = rng.standard_normal(columns)
    for day in range(days):
        out[day] = now
        now = memory * now + np.sqrt(1 - memory**2) * rng.standard_normal(columns)
    return out
