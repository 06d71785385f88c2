"""Which property of a fleet decides whether preprocessing helps? One at a time is varied.

    python benchmarks/fleet_properties.py --seed 501 --seed 502 -o DIR --workers 2

The cycles of a robot are simulated once for each seed and kept in DIR; a property changes only what
befalls robots from day to day, so that they serve for all its values.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import typer
from joblib import Memory, Parallel, delayed
from threadpoolctl import threadpool_limits

from analysis.classification import leave_pair_out, make_classifier
from analysis.own_history import make_history_classifier
from analysis.preprocessing import Combination
from faultgen.fleet import FleetPlan
from faultgen.fleet.data import Fleet
from faultgen.fleet.events import event_names
from faultgen.fleet.record import record_robot, simulate_robot
from faultgen.storage import write_text
from faultgen.studies.classifiers_study import HORIZON, OWN, horizon_rows
from faultgen.studies.fleets import study_fleet
from faultgen.studies.thesis_classifiers import AUC, HEADLINE

PROPERTIES: dict[str, tuple[str, str, tuple[float, ...]]] = {
    "unsteadiness": ("damage", "unsteadiness", (0.0, 0.25, 0.5, 1.0)),
    "constancy of the mix": ("programs", "mix", (15.0, 60.0, 1000.0, 100000.0)),
    "day-to-day friction": ("scatter", "lubricant", (0.0, 0.03, 0.1)),
}
"""Section and entry of the plan, and values."""

CLASSIFIER = "LR"
NAMES = list(
    dict.fromkeys(["control", "+diff", *(name for pair in HEADLINE.values() for name in pair)])
)

app = typer.Typer(add_completion=False, help=__doc__)


def simulated(plan: FleetPlan, number: int, memory: Memory) -> list[Any]:
    """Cycles of a robot, from the disk where they are there."""
    return list(memory.cache(_simulated)(plan.model_dump_json(), number))


def _simulated(plan: str, number: int) -> list[Any]:
    return simulate_robot(FleetPlan.model_validate_json(plan), number)


def look(plan: FleetPlan, section: str, entry: str, value: float, folder: Path) -> dict[str, float]:
    """Mean AUC of each preprocessing on a fleet with one entry changed."""
    parts = getattr(plan, section).model_copy(update={entry: value})
    changed = plan.model_copy(update={section: parts})
    memory = Memory(folder, verbose=0)
    with threadpool_limits(1):
        robots = tuple(
            record_robot(changed, k, simulated(plan, k, memory)) for k in range(plan.robots)
        )
    fleet = Fleet(robots, event_names(), plan.days, plan.seed, {})
    failed = [robot.failed for robot in robots]
    mean = {}
    for name in NAMES:
        make = partial(make_classifier, CLASSIFIER, Combination.of(name))
        found = leave_pair_out(horizon_rows(fleet, name, HORIZON), failed, make, seed=plan.seed)
        mean[name] = float(found.auc.mean())
    rows = horizon_rows(fleet, OWN, HORIZON)
    mean[OWN] = float(leave_pair_out(rows, failed, make_history_classifier).auc.mean())
    return mean


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Means over seeds: AUC above, gain of each step in the thesis' pair below."""
    figure, panels = plt.subplots(2, len(PROPERTIES), figsize=(11, 6), sharey="row", squeeze=False)
    for column, name in zip(panels.T, PROPERTIES, strict=True):
        own = [row for row in rows if row["property"] == name]
        values = sorted({row["value"] for row in own})
        places = range(len(values))

        mean = {
            key: np.array(
                [np.mean([row["auc"][key] for row in own if row["value"] == v]) for v in values]
            )
            for key in own[0]["auc"]
        }
        for key in ("control", "+diff", "+estM+diff+var3+pca", OWN):
            column[0].plot(places, mean[key], marker="o", label=key)
        for step, (without, with_step) in HEADLINE.items():
            column[1].plot(places, mean[with_step] - mean[without], marker="o", label=f"+{step}")
        column[0].axhline(0.5, color="0.4", lw=0.8, ls=":")
        column[1].axhline(0.0, color="0.4", lw=0.8, ls=":")
        column[1].set_xticks(places, [f"{v:g}" for v in values])
        column[0].set_xticks(places, [])
        column[1].set(xlabel=name)
    panels[0, 0].set(ylabel=f"mean AUC, {CLASSIFIER}")
    panels[1, 0].set(ylabel="gain of the step, thesis' pair")
    panels[0, 0].legend(fontsize=7)
    panels[1, 0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


@app.command()
def main(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for cycles and results.")],
    seed: Annotated[list[int], typer.Option(help="Of a fleet; repeat for several.")],
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
) -> None:
    """Run all values of all properties: `properties.json` and `properties.png`."""
    known = (study_fleet("classifiers", one, quick=False) for one in seed)
    plans = [plan for plan in known if plan is not None]
    memory = Memory(out / "cycles", verbose=0)
    Parallel(n_jobs=workers)(
        delayed(simulated)(plan, k, memory) for plan in plans for k in range(plan.robots)
    )
    jobs = [
        (plan, name, value)
        for name, (_, _, values) in PROPERTIES.items()
        for value in values
        for plan in plans
    ]
    found = Parallel(n_jobs=workers, verbose=5)(
        delayed(look)(plan, *PROPERTIES[name][:2], value, out / "cycles")
        for plan, name, value in jobs
    )
    rows = [
        {"property": name, "value": value, "seed": plan.seed, "auc": auc}
        for (plan, name, value), auc in zip(jobs, found, strict=True)
    ]
    told = {"thesis": {key: AUC[key, CLASSIFIER][0] for key in NAMES}, "rows": rows}
    write_text(out / "properties.json", json.dumps(told, indent=1) + "\n")
    draw(rows, out / "properties.png")


if __name__ == "__main__":
    matplotlib.use("Agg")
    app()
