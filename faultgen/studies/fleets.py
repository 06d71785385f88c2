"""Default fleets of the studies."""

from __future__ import annotations

from faultgen.fleet import FleetPlan
from faultgen.fleet.plan import Production

_DAILY = Production(samples_a_day=(1, 1))


def study_fleet(name: str, seed: int, quick: bool) -> FleetPlan | None:
    """Return the plan of a study's fleet; None for a study that simulates its own data.

    Args:
        name: Name of the study.
        seed: Root seed of all random draws.
        quick: Whether to use a small fleet.

    Returns:
        The plan, or None.
    """
    if name == "events":
        robots, failing = (12, 6) if quick else (48, 24)
        return FleetPlan(seed=seed, robots=robots, failing=failing, days=210, production=_DAILY)
    if name == "training-data":
        return FleetPlan(seed=seed, robots=10, failing=7, days=150, production=_DAILY)
    if name == "classifiers":
        return FleetPlan(seed=seed, robots=26, failing=13, days=60)
    return None
