"""The command that makes fleets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from faultgen.cli.app import Json, Out, Workers, app, print_json, print_table, worker_count


@app.command()
def fleet(
    plan: Annotated[
        Path | None, typer.Argument(help="Plan of the fleet (TOML); default: 26 robots, 60 days.")
    ] = None,
    out: Out = Path("fleet"),
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Make a fleet: robots that work for weeks, of which some fail, as their monitoring sees them.

    Each robot has its own payload, programs, shifts, hall and scatter; gearboxes of failing ones
    wear out by a law of friction, backlash and ripple. Run again to resume. Every entry of the plan
    has a default; docs/fleet.md tells them, and what is simulated and what interpolated.
    """
    from faultgen.fleet import FleetPlan, generate_fleet, load_fleet

    chosen = FleetPlan() if plan is None else load_fleet(plan)
    made = generate_fleet(chosen, out, workers=worker_count(workers), progress=True)
    rows = [
        {
            "name": one.name,
            "robot": one.robot,
            "failed": one.failed,
            "axis": one.axis,
            "samples": len(one.day),
            "production": round(float(np.mean(one.production)), 3),
            "events_a_day": round(float(one.events.sum(axis=1).mean()), 1),
        }
        for one in made.robots
    ]
    if as_json:
        told = {"out": str(out), "days": made.days, "seed": made.seed, "robots": rows}
        print_json(told)
        return
    print_table(rows)
    print(f"{len(rows)} robots, {made.days} days: {out}")
