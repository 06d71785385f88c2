"""The command that makes fleets."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from faultgen.cli.app import (
    Json,
    Out,
    Workers,
    app,
    print_estimate,
    print_json,
    print_table,
    worker_count,
)
from faultgen.cli.checks import readable_text
from faultgen.system.terminal import say

if TYPE_CHECKING:
    from faultgen.fleet import FleetPlan


@app.command()
def fleet(
    plan: Annotated[
        Path | None,
        typer.Argument(help="Plan of the fleet (TOML). Default: 26 robots, recorded for 60 days."),
    ] = None,
    out: Out = Path("fleet"),
    workers: Workers = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Simulate only the first robot, write nothing, and print the estimated time and "
            "size of the fleet.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Simulate robots that work for weeks, some of which fail.

    The command writes what the monitoring system of such a fleet would store. Each robot has its
    own payload, programs, shifts, hall temperature and deviations from its model. In a robot that
    fails, friction, backlash and torque ripple of one gearbox grow until the failure. If the
    command was interrupted, run it again to resume. Every entry of the plan has a default.
    docs/fleet.md lists the entries, and explains what is simulated and what is interpolated.
    """
    readable_text(plan, "fleet file")
    from faultgen.fleet import FleetPlan, generate_fleet, load_fleet

    chosen = FleetPlan() if plan is None else load_fleet(plan)
    if dry_run:
        _dry_run(chosen, worker_count(workers), as_json)
        return
    made = generate_fleet(chosen, out, workers=worker_count(workers), progress=True)
    rows = [
        {
            "name": one.name,
            "robot": one.robot,
            "failed": one.failed,
            "axis": one.axis,
            "samples": len(one.day),
            "production": round(float(one.production.mean()), 3),
            "events_a_day": round(float(one.events.sum(axis=1).mean()), 1),
        }
        for one in made.robots
    ]
    if as_json:
        told = {"out": str(out), "days": made.days, "seed": made.seed, "robots": rows}
        print_json(told)
        return
    print_table(rows)
    say(f"{len(rows)} robots, {made.days} days: {out}")


def _dry_run(plan: FleetPlan, workers: int, as_json: bool) -> None:
    """Print what a fleet would take."""
    from faultgen.fleet.generate import estimate_fleet

    seconds, size = estimate_fleet(plan, workers=workers)
    if as_json:
        print_json({"robots": plan.robots, "seconds": seconds, "bytes": size, "workers": workers})
        return
    print_estimate(f"{plan.robots} robots, {plan.days} days", seconds, size, workers)
