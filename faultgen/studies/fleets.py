"""Default fleets of the studies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from faultgen.fleet import FleetPlan
from faultgen.fleet.plan import make_fleet_plan

_DAILY = {"samples_a_day": (1, 1)}


def study_fleet(
    name: str, seed: int, quick: bool, robots: Sequence[str] = (), tasks: Sequence[str] = ()
) -> FleetPlan | None:
    """Return the plan of a study's fleet; None for a study that simulates its own data.

    Args:
        name: Name of the study.
        seed: Root seed of all random draws.
        quick: Whether to use a small fleet.
        robots: Names of the models of the robots. Default: those of `FleetPlan`.
        tasks: Names of the tasks from which programs are drawn. Default: those of `Programs`.

    Returns:
        The plan, or None.

    Raises:
        InputError: There is no such model, or it does not have such a task.
    """
    plans: dict[str, dict[str, Any]] = {
        "events": {
            "robots": 12 if quick else 48,
            "failing": 6 if quick else 24,
            "days": 210,
            "production": _DAILY,
        },
        "training-data": {"robots": 10, "failing": 7, "days": 150, "production": _DAILY},
        "classifiers": {"robots": 26, "failing": 13, "days": 60},
    }
    if name not in plans:
        return None
    values = {"seed": seed, **plans[name]}
    if robots:
        values["models"] = list(robots)
    if tasks:
        values["programs"] = {"tasks": list(tasks)}
    return make_fleet_plan(values)
