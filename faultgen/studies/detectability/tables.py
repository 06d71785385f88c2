"""Tables of the study `detectability`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from faultgen.effects import EFFECTS
from faultgen.evaluation.markdown import goals_answer, goals_table, table
from faultgen.studies.detectability.ideal import BASELINE, LOGGED
from faultgen.studies.detectability.study import REFERENCE, SCHEDULES
from faultgen.studies.detectability.units import shown

Row = dict[str, Any]


def goals(result: dict[str, Any]) -> list[dict[str, Any]]:
    """Compare the results with what the map should show.

    Args:
        result: Result of `run_detectability`.

    Returns:
        Rows with "name", "thesis", "goal", "measured" and "reached".
    """
    wear = [row for row in result["rows"] if row["effect"] == "friction_wear"]
    turning = [row for row in wear if row["ideal"] is not None]
    seen = [row for row in turning if row["ideal"] <= 0.05]
    ratios = [best(row) / row["ideal"] for row in turning if best(row) is not None]
    return [
        {
            "name": "turning axes on which the ideal detector sees 5 % friction wear",
            "thesis": "-",
            "goal": f"{len(turning)} of {len(turning)}",
            "measured": f"{len(seen)} of {len(turning)}",
            "reached": len(seen) == len(turning),
        },
        {
            "name": "friction wear that the best detector needs, over the ideal one (median)",
            "thesis": "-",
            "goal": "at most 3",
            "measured": f"{np.median(ratios):.1f}" if ratios else "none sees it",
            "reached": bool(ratios) and float(np.median(ratios)) <= 3,
        },
    ]


def best(row: Row) -> Any:
    """Return the smallest severity that any detector of the package sees; None if none does."""
    return min((x for x in row["detectors"].values() if x is not None), default=None)


def tables(result: dict[str, Any]) -> str:
    """Write all tables as Markdown.

    Args:
        result: Result of `run_detectability`.

    Returns:
        The page.
    """
    rows: list[Row] = result["rows"]
    places = list(dict.fromkeys((row["robot"], row["task"]) for row in rows))
    parts = [
        "# Results of study detectability",
        "Which faults can be seen in a log, on which axis and in which task? This page lists the "
        "smallest severities that are detected on 95 % of the days at one false alarm a month. "
        f"{LOGGED} cycles a day are logged (assumed), and compared with {BASELINE} healthy ones. "
        f"Noise: {result['sensors']}. Severities are in % of the nominal value, arcmin at the "
        "joint, ms, mm or N m at the motor.",
        goals_answer(result["goals"]),
        goals_table(result["goals"]),
        "## The ideal detector, by axis",
        "It knows how each effect changes the torque (a matched filter on the motors' torques). No "
        "detector that gets the same log can see less.",
    ]
    for robot, task in places:
        own = [row for row in rows if (row["robot"], row["task"]) == (robot, task)]
        parts += [f"### {robot}, {task}", _by_axis(own, lambda row: row["ideal"])]
    parts += [
        "## The best detector of the package, by axis",
        "The smallest severity that any of the detectors sees, each with its own threshold.",
    ]
    for robot, task in places:
        own = [row for row in rows if (row["robot"], row["task"]) == (robot, task)]
        parts += [f"### {robot}, {task}", _by_axis(own, best)]
    parts += [
        "## Each detector, over the ideal one",
        "Median over all axes and tasks of the severity that a detector needs, divided by that of "
        "the ideal detector; in brackets, the share of the places at which it sees the effect at "
        "all.",
        _by_detector(rows),
        *(f"Left out: {name}: {why}" for name, why in result["left_out"].items()),
        "## What better logs contribute",
        "Median over all axes and tasks of the smallest severity, divided by that with the motors' "
        "torques alone. Less than 1 is better.",
        _by_view(rows, result["views"]),
        "## Time to detection",
        "Share of the life after which the ideal detector sees the effect, if its severity grows "
        "to the default of the effect by the wear schedules of the thesis (median over axes and "
        "tasks).",
        _by_schedule(rows),
        "## What cannot be detected",
        _not_seen(rows),
    ]
    return "\n\n".join(parts) + "\n"


def _by_axis(rows: list[Row], value: Callable[[Row], Any]) -> str:
    axes = sorted({row["axis"] for row in rows})
    effects = list(dict.fromkeys(row["effect"] for row in rows))
    cells = {(row["effect"], row["axis"]): shown(value(row), row["unit"]) for row in rows}
    return table(
        ["effect", *(f"axis {axis}" for axis in axes)],
        [[effect, *(cells.get((effect, axis), "") for axis in axes)] for effect in effects],
    )


def _by_detector(rows: list[Row]) -> str:
    names = list(dict.fromkeys(name for row in rows for name in row["detectors"]))
    body = []
    for effect in dict.fromkeys(row["effect"] for row in rows):
        own = [row for row in rows if row["effect"] == effect and row["ideal"] is not None]
        cells = []
        for name in names:
            found = [
                row["detectors"][name] / row["ideal"]
                for row in own
                if row["detectors"][name] is not None
            ]
            cells.append(
                f"{np.median(found):.1f} ({100 * len(found) / len(own):.0f} %)" if found else "-"
            )
        body.append([effect, *cells])
    return table(["effect", *names], body)


def _by_view(rows: list[Row], names: list[str]) -> str:
    others = [name for name in names if name != REFERENCE]
    body = []
    for effect in dict.fromkeys(row["effect"] for row in rows):
        own = [row for row in rows if row["effect"] == effect and row["views"]]
        if own:
            cells = [
                f"{np.median([row['views'][name] / row['views'][REFERENCE] for row in own]):.2g}"
                for name in others
            ]
            body.append([effect, *cells])
    return table(["effect", *others], body)


def _by_schedule(rows: list[Row]) -> str:
    body = []
    for effect in dict.fromkeys(row["effect"] for row in rows):
        own = [row for row in rows if row["effect"] == effect]
        final = shown(EFFECTS[effect].default, own[0]["unit"])
        cells = []
        for name in SCHEDULES:
            # never seen counts as later than the end
            life = [1.01 if row["life"][name] is None else row["life"][name] for row in own]
            middle = float(np.median(life))
            cells.append("never" if middle > 1 else f"{100 * middle:.0f} %")
        body.append([effect, final, *cells])
    return table(["effect", "final severity", *SCHEDULES], body)


def _not_seen(rows: list[Row]) -> str:
    body: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row["ideal"] is None:
            place = f"{row['robot']} {row['task']} axis {row['axis']}"
            body.setdefault((row["effect"], row["why_not"]), []).append(place)
    if not body:
        return "The ideal detector sees every effect on every axis."
    return table(
        ["effect", "why", "places"],
        [[effect, why, len(places)] for (effect, why), places in body.items()],
    )
