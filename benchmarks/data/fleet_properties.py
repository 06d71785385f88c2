"""Which property of a fleet decides the signs of a study? One at a time is varied.

    python -m benchmarks.data.fleet_properties classifiers --seed 501 --seed 502 -o DIR --workers 2
    python -m benchmarks.data.fleet_properties training-data --seed 501 -o DIR --workers 2
    python -m benchmarks.data.fleet_properties events --seed 501 -o DIR --workers 2
    python -m benchmarks.data.fleet_properties history --seed 601 --vary age --vary size -o DIR

`history` is the part of `classifiers` that concerns robots' own histories, at all horizons.

The cycles of a robot are simulated once for each seed and kept in DIR; a property changes only what
befalls robots from day to day, so that they serve for all its values.
"""

from __future__ import annotations

import json
from dataclasses import replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import joblib
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import typer
from faultgen.analysis.classification import leave_pair_out, make_classifier
from faultgen.analysis.plots import COLOURS
from faultgen.analysis.preprocessing import Combination
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from faultgen.fleet import FleetPlan
from faultgen.fleet.cycles import DAMAGES, Cycles, by_damage
from faultgen.fleet.data import Fleet
from faultgen.fleet.events import event_names
from faultgen.fleet.record import record_robot, simulate_robot
from faultgen.studies.chapter2_events.study import run_events
from faultgen.studies.chapter4_training_data.signals import TEST
from faultgen.studies.chapter4_training_data.study import run_training
from faultgen.studies.chapter4_training_data.tables import NAMES as NAMES_OF_DESCRIPTORS
from faultgen.studies.chapter5_classifiers.findings import FULL_CHAIN
from faultgen.studies.chapter5_classifiers.study import HORIZON, horizon_rows
from faultgen.studies.chapter5_classifiers.thesis import HEADLINE
from faultgen.studies.classifiers_ahead import OWN, UNTRAINED, days_ahead
from faultgen.studies.fleets import study_fleet
from faultgen.system.files import write_text

Value = float | tuple[float, float]

PROPERTIES: dict[str, tuple[str, str, tuple[Value, ...]]] = {
    "unsteadiness": ("damage", "unsteadiness", (0.0, 0.25, 0.5, 1.0, 2.0)),
    "life": ("damage", "life", ((20.0, 60.0), (60.0, 200.0), (120.0, 600.0))),
    "mix": ("programs", "mix", (15.0, 60.0, 1000.0, 100000.0)),
    "lubricant": ("scatter", "lubricant", (0.0, 0.03, 0.1)),
    "age": ("ageing", "age", ((0.0, 0.0), (0.0, 0.8), (0.6, 0.95))),
    "size": ("damage", "size", (0.5, 1.0)),
}
"""Section and entry of the plan, and values. The size is no entry: it is that of all damage, over
what the entries `friction`, `backlash` and `ripple` say."""

Study = StrEnum("Study", ["classifiers", "events", "history", "training-data"])
Property = StrEnum("Property", ["unsteadiness", "life", "mix", "lubricant", "age", "size"])

CLASSIFIER = "LR"
NAMES = list(
    dict.fromkeys(["control", "+diff", *(name for pair in HEADLINE.values() for name in pair)])
)

app = typer.Typer(add_completion=False, help=__doc__)


def simulated(plan: FleetPlan, number: int, folder: Path) -> Path:
    """Return the file with the cycles of a robot. They are simulated if the file does not exist.

    Args:
        plan: Plan of the fleet.
        number: Number of the robot.
        folder: Folder in which cycles are kept.

    Returns:
        The file.
    """
    path = folder / f"{plan.sha256[:16]}_{number:03d}.joblib"
    if not path.is_file():
        part = path.with_suffix(".part")
        joblib.dump(simulate_robot(plan, number), part)
        part.replace(path)
    return path


def scaled(cycles: Cycles, size: float) -> Cycles:
    """Return the same cycles with less damage.

    Args:
        cycles: The cycles.
        size: Factor of the damage.

    Returns:
        The changed cycles.
    """
    weights = by_damage(size * np.array(DAMAGES))
    return replace(
        cycles,
        wear=np.einsum("nd,td...->tn...", weights, cycles.wear),
        wear_loss=cycles.wear_loss @ weights.T,
    )


def look(
    study: str, plan: FleetPlan, section: str, entry: str, value: Value, folder: Path
) -> dict[str, float]:
    """Run a study on a fleet with one changed entry.

    Args:
        study: Name of the study.
        plan: Plan of the fleet.
        section: Section of the plan in which the entry stands.
        entry: The entry that is changed.
        value: Its new value.
        folder: Folder in which cycles are kept.

    Returns:
        Results by name.
    """
    changed, size = plan, 1.0
    if entry == "size":
        size = float(np.mean(value))
    else:
        parts = getattr(plan, section).model_copy(update={entry: value})
        changed = plan.model_copy(update={section: parts})
    with threadpool_limits(1):
        robots = tuple(
            record_robot(
                changed, k, [scaled(one, size) for one in joblib.load(simulated(plan, k, folder))]
            )
            for k in range(plan.robots)
        )
        return LOOKS[study](Fleet(robots, event_names(), plan.days, plan.seed, {}))


def _classifiers(fleet: Fleet) -> dict[str, float]:
    """Mean AUC of each preprocessing, of our own method, and of its columns without training."""
    failed = [robot.failed for robot in fleet.robots]
    mean = {}
    for name in NAMES:
        make = partial(make_classifier, CLASSIFIER, Combination.of(name))
        found = leave_pair_out(horizon_rows(fleet, name, HORIZON), failed, make, seed=fleet.seed)
        mean[name] = float(found.auc.mean())
    trained, untrained = days_ahead(fleet, (HORIZON,), seed=fleet.seed)
    mean[OWN] = float(trained[HORIZON, OWN].auc.mean())
    mean |= {row["column"]: row["auc"] for row in untrained if row["horizon"] == HORIZON}
    return mean


def _history(fleet: Fleet) -> dict[str, float]:
    """Mean AUC of robots' own histories, trained and column by column, at every horizon."""
    trained, untrained = days_ahead(fleet, (1, HORIZON, 5), seed=fleet.seed)
    mean = {f"{name}, {days} d": float(one.auc.mean()) for (days, name), one in trained.items()}
    return mean | {f"{row['column']}, {row['horizon']} d": row["auc"] for row in untrained}


def _training(fleet: Fleet) -> dict[str, float]:
    """Failing less normal robots, in each descriptor, by source and signal; all days of test."""
    return {
        f"{row['descriptor']}, {row['source']} {row['signal']}": row["failure"] - row["normal"]
        for row in run_training(fleet, quick=True)["cuts"]
        if row["days"] == TEST
    }


def _events(fleet: Fleet) -> dict[str, float]:
    """Share of robots warned by the thesis' T2, and days of warning."""
    one = run_events(fleet)["warnings"]["T2"]
    return {
        "failing": one["warned"]["share"],
        "healthy": one["healthy_warned"]["share"],
        "days": 0.0 if one["days"] is None else one["days"],
    }


LOOKS = {
    "classifiers": _classifiers,
    "events": _events,
    "history": _history,
    "training-data": _training,
}


def curves(study: str, found: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Arrange the results as curves of each panel.

    Args:
        study: Name of the study.
        found: Results by name, shape (values, seeds).

    Returns:
        Curves by panel and name, from the top; shapes (values, seeds).
    """
    if study == "classifiers":
        shown = ("control", FULL_CHAIN, OWN, UNTRAINED[2], *UNTRAINED[-2:])
        gains = {f"+{step}": found[new] - found[old] for step, (old, new) in HEADLINE.items()}
        return {
            f"mean AUC, {CLASSIFIER}": {name: found[name] for name in shown},
            "gain of the step, thesis' pair": gains,
        }
    if study == "history":
        return {
            f"mean AUC, {days} days ahead": {
                key: values for key, values in found.items() if key.endswith(f", {days} d")
            }
            for days in (HORIZON, 25)
        }
    if study == "events":
        shares = {f"{name} robots": found[name] for name in ("failing", "healthy")}
        return {
            "share warned of by T²": shares,
            "days of warning, median": {"failing robots": found["days"]},
        }
    return {
        f"{long}:\nfailing less normal": {
            key.split(", ")[1]: found[key] for key in found if key.startswith(name)
        }
        for name, long in NAMES_OF_DESCRIPTORS.items()
    }


def draw(study: str, rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the mean over seeds, and the range from the least to the largest.

    Args:
        study: Name of the study.
        rows: Results.
        path: Picture to write.
    """
    names = list(dict.fromkeys(row["property"] for row in rows))
    columns = []
    for name in names:
        own = [row for row in rows if row["property"] == name]
        values = list(dict.fromkeys(_label(row["value"]) for row in own))
        found = {
            key: np.array(
                [[r["found"][key] for r in own if _label(r["value"]) == v] for v in values]
            )
            for key in own[0]["found"]
        }
        columns.append((name, values, curves(study, found)))
    height = len(columns[0][2])
    figure, panels = plt.subplots(
        height, len(names), figsize=(3.4 * len(names), 2.8 * height), sharey="row", squeeze=False
    )
    for k, (name, values, by_panel) in enumerate(columns):
        for axes, (label, lines) in zip(panels[:, k], by_panel.items(), strict=True):
            places = range(len(values))
            for colour, (curve, of) in zip(COLOURS, lines.items(), strict=False):
                axes.plot(places, of.mean(axis=1), "o-", ms=4, color=colour, label=curve)
                low, high = of.min(axis=1), of.max(axis=1)
                axes.fill_between(places, low, high, color=colour, alpha=0.1, lw=0)
            axes.axhline(0.5 if "AUC" in label else 0.0, color="0.4", lw=0.8, ls=":")
            axes.set_xticks(places, values)
            if k == 0:
                axes.set(ylabel=label)
            if k == len(names) - 1:
                axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.02, 0.5))
        panels[-1, k].set(xlabel=name)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def _label(value: Any) -> str:
    return " to ".join(f"{v:g}" for v in np.atleast_1d(value))


@app.command()
def main(
    study: Study,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for cycles and results.")],
    seed: Annotated[list[int], typer.Option(help="Of a fleet; repeat for several.")],
    vary: Annotated[list[Property] | None, typer.Option(help="Property; default: all.")] = None,
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
) -> None:
    """Run all values of these properties: `STUDY.json` and `STUDY.png`."""
    names = [one.value for one in vary or Property]
    fleet = "classifiers" if study == "history" else study
    known = (study_fleet(fleet, one, quick=False) for one in seed)
    plans = [plan for plan in known if plan is not None]
    folder = out / "cycles"
    folder.mkdir(parents=True, exist_ok=True)
    Parallel(n_jobs=workers)(
        delayed(simulated)(plan, k, folder) for plan in plans for k in range(plan.robots)
    )
    jobs = [
        (plan, name, value) for name in names for value in PROPERTIES[name][2] for plan in plans
    ]
    found = Parallel(n_jobs=workers, return_as="generator")(
        delayed(look)(study, plan, *PROPERTIES[name][:2], value, folder)
        for plan, name, value in jobs
    )
    rows = [
        {"property": name, "value": value, "seed": plan.seed, "found": one}
        for (plan, name, value), one in zip(jobs, tqdm(found, total=len(jobs)), strict=True)
    ]
    write_text(out / f"{study}.json", json.dumps(rows, indent=1) + "\n")
    draw(study, rows, out / f"{study}.png")


if __name__ == "__main__":
    matplotlib.use("Agg")
    app()
