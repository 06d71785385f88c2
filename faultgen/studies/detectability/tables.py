"""Tables of the study `detectability`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from faultgen.effects import EFFECTS
from faultgen.evaluation.markdown import goals_answer, goals_table, table
from faultgen.evaluation.shares import wilson
from faultgen.studies.detectability.ideal import BASELINE, LOGGED
from faultgen.studies.detectability.study import SCHEDULES
from faultgen.studies.detectability.trained import LONGEST
from faultgen.studies.detectability.units import shown
from faultgen.studies.detectability.views import REFERENCE

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
    ratios = [of_train(row) / row["ideal"] for row in turning if of_train(row) is not None]
    found = [row for row in result["rows"] if row["ideal"] is not None]
    early = [row for row in found if (of_train(row) or np.inf) <= EFFECTS[row["effect"]].default]
    named = [row["train"]["at_limit"]["named"] for row in found if of_train(row) is not None]
    return [
        {
            "name": "turning axes on which the ideal detector sees 5 % friction wear",
            "thesis": "-",
            "goal": f"{len(turning)} of {len(turning)}",
            "measured": f"{len(seen)} of {len(turning)}",
            "reached": len(seen) == len(turning),
        },
        {
            "name": "friction wear that the detector of train needs, over the ideal one (median)",
            "thesis": "-",
            "goal": "at most 3",
            "measured": f"{np.median(ratios):.1f}" if ratios else "none seen",
            "reached": bool(ratios) and float(np.median(ratios)) <= 3,
        },
        {
            "name": "effects and axes that train sees up to the default severity",
            "thesis": "-",
            "goal": f"{len(found)} of {len(found)}",
            "measured": f"{len(early)} of {len(found)}",
            "reached": len(early) == len(found),
        },
        {
            "name": "alarms of train at its limit that name effect and axis (mean)",
            "thesis": "-",
            "goal": "at least 90 %",
            "measured": f"{100 * np.mean(named):.0f} %" if named else "none seen",
            "reached": bool(named) and float(np.mean(named)) >= 0.9,
        },
    ]


def of_train(row: Row) -> Any:
    """Return the smallest severity that the detector of `faultgen train` sees; None if none."""
    return row["detectors"].get("train")


def best(row: Row) -> Any:
    """Return the smallest one that any detector of `faultgen detect` sees; None if none does."""
    others = (x for name, x in row["detectors"].items() if name != "train" and x is not None)
    return min(others, default=None)


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
        "## The detector of `faultgen train`, by axis",
        "It has learned from 120 healthy cycles and knows all effects of this page. Each logged "
        "cycle counts as a recording. " + _alarms(result),
    ]
    for robot, task in places:
        own = [row for row in rows if (row["robot"], row["task"]) == (robot, task)]
        parts += [
            f"### {robot}, {task}",
            _by_axis(own, of_train),
            "What its alarms at the end of these days are called: share of the alarms that name "
            "effect and axis / the axis, and the most frequent wrong answer.",
            _by_axis(own, lambda row: row, _called("at_limit")),
            "The same at the default severity of each effect.",
            _by_axis(own, lambda row: row, _called("at_default")),
            "Recordings until the alarm, of an effect that is there from the first one on: median "
            f"and 80 % interval ({LONGEST} recordings are a month).",
            _by_delay(own),
        ]
    parts += [
        "## The best detector of `faultgen detect`, by axis",
        "The smallest severity that any of them sees, each with its own threshold.",
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
        "## Share of the life until detection",
        "Share of the life after which the ideal detector sees the effect, if its severity grows "
        "to the default of the effect by the wear schedules of the thesis (median over axes and "
        "tasks).",
        _by_schedule(rows),
        "## What cannot be detected",
        _not_seen(rows),
    ]
    return "\n\n".join(parts) + "\n"


def _by_axis(
    rows: list[Row],
    value: Callable[[Row], Any],
    text: Callable[[Any, str], str] = shown,
) -> str:
    axes = sorted({row["axis"] for row in rows})
    effects = list(dict.fromkeys(row["effect"] for row in rows))
    cells = {(row["effect"], row["axis"]): text(value(row), row["unit"]) for row in rows}
    return table(
        ["effect", *(f"axis {axis}" for axis in axes)],
        [[effect, *(cells.get((effect, axis), "") for axis in axes)] for effect in effects],
    )


def _called(name: str) -> Callable[[Row, str], str]:
    """Function that says what alarms at a severity are called."""

    def text(row: Row, unit: str) -> str:
        told = row["train"] and row["train"][name]
        if not told or not told["alarms"]:
            return "-"
        wrong = f"; {told['called']}" if told["called"] else ""
        return f"{100 * told['named']:.0f} / {100 * told['axis_named']:.0f} %{wrong}"

    return text


def _alarms(result: dict[str, Any]) -> str:
    """Alarms on healthy days."""
    told = []
    for place, seen in result["false_alarms"].items():
        shares = []
        for count in (seen["stated"], seen["alarms"]):
            low, high = wilson(count, seen["days"])
            shares.append(f"{count} of {seen['days']} [{low:.3f}, {high:.3f}]")
        told.append(f"{place}: {shares[0]}; with the raised limit: {shares[1]}.")
    return (
        "One healthy day in 30 may raise an alarm. At the limit that the detector states itself, "
        "the days with an alarm are as follows. All limits of this page are those with a limit of "
        f"the statistic that was raised until it kept the promise. {' '.join(told)}"
    )


def _by_delay(rows: list[Row]) -> str:
    names = list(
        dict.fromkeys(name for row in rows for name in (row["train"] or {"delays": ()})["delays"])
    )
    body = []
    for row in rows:
        if row["train"] is not None:
            delays = row["train"]["delays"]
            cells = [_recordings(delays[name]) if name in delays else "" for name in names]
            default = shown(EFFECTS[row["effect"]].default, row["unit"])
            body.append([row["effect"], row["axis"], default, *cells])
    return table(["effect", "axis", "default", *(f"at {name}" for name in names)], body)


def _recordings(delay: list[float | None] | None) -> str:
    """A time to detection."""
    if delay is None:
        return "cannot be simulated"
    low, middle, high = (f"> {LONGEST}" if x is None else f"{x:.0f}" for x in delay)
    return middle if low == high else f"{middle} [{low}, {high}]"


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
    body: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        place = f"{row['robot']} {row['task']} axis {row['axis']}"
        if row["ideal"] is None:
            body.setdefault(("all", row["effect"], row["why_not"]), []).append(place)
        elif of_train(row) is None:
            largest = shown(row["train"]["largest"], row["unit"])
            why = f"tried up to {largest}"
            body.setdefault(("train", row["effect"], why), []).append(place)
    if not body:
        return "The ideal detector and that of train see every effect on every axis."
    return table(
        ["detector", "effect", "why", "places"],
        [[*told, ", ".join(places)] for told, places in body.items()],
    )
