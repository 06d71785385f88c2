"""Study `detectability`: which faults can be seen in a log, on which axis, in which task?

For every effect, axis and task it finds the smallest severity that is detected on 95 % of the days
at one false alarm per month: by the ideal detector, by that of `faultgen train`, which monitors
robots, and by those of `faultgen detect`.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed
from threadpoolctl import threadpool_limits

from faultgen import plugins
from faultgen.dataset.wear import severities
from faultgen.effects import EFFECTS, Effect
from faultgen.errors import InputError
from faultgen.evaluation.places import ROBOTS, TASKS, place_name
from faultgen.monitoring.sensors import SENSORS, Sensors
from faultgen.provenance import provenance
from faultgen.simulation.surrogate import SAMPLE_PERIOD, surrogate_file
from faultgen.studies.detectability.ideal import DETECTED, NEEDED, of_day
from faultgen.studies.detectability.judged import smallest
from faultgen.studies.detectability.limits import find_limit
from faultgen.studies.detectability.place import FULL, Place, Size, number_of, place_of
from faultgen.studies.detectability.views import REFERENCE, views
from faultgen.system.files import write_text
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import follow

QUICK_EFFECTS = ("friction_wear", "backlash", "gear_stiffness", "torque_ripple", "delay")
SCHEDULES = ("exponential", "sigmoid")
"""Wear schedules of the thesis (eq. 6.6 and 3.7), for which the time to detection is given."""

_LEVELS = 6  # severities at which detectors are tried, from that of the ideal detector on
_RATIO = 4.0  # of one to the next
_LIFE = 1000  # cycles of a wear schedule, to find the share of the life after which wear is seen


def effects_to_map(quick: bool, names: Sequence[str] = ()) -> list[Effect]:
    """List the effects of the study.

    Those that only change what the sensors show have no place in the robot, and an effect that is
    another one in another unit is left out.

    Args:
        quick: Whether to look at few effects only.
        names: Names of the effects, if not all are wanted.

    Raises:
        InputError: An effect is not among them.
    """
    chosen = [
        effect
        for effect in EFFECTS.values()
        if effect.sense is None and not effect.same_as and effect.name != "learned_law"
    ]
    known = [one.name for one in chosen]
    for name in names:
        if name not in known:
            raise InputError(
                f"study detectability: maps no effect '{name}'; choose from {', '.join(known)}"
            )
    wanted = names or (QUICK_EFFECTS if quick else known)
    return [one for one in chosen if one.name in wanted]


def run_detectability(
    out: Path,
    *,
    size: Size = FULL,
    seed: int = 2026,
    workers: int = 1,
    robots: Sequence[str] = ROBOTS,
    tasks: Sequence[str] = TASKS,
    sensors: Sensors = SENSORS["realistic"],
    effects: Sequence[str] = (),
) -> dict[str, Any]:
    """Run the study.

    Args:
        out: Folder for intermediate results, which the next call uses again, and for
            ``detectability.csv``.
        size: Amount of random data.
        seed: Root seed of all random draws.
        workers: Number of processes. It has no effect on the results.
        robots: Names of robots, or paths of MJCF files or folders.
        tasks: Names of tasks, or paths of task files.
        sensors: Noise and disturbances.
        effects: Names of the effects that are mapped. Default: all.

    Returns:
        Results for JSON.

    Raises:
        InputError: A robot, task or effect is unknown, or the sensors have no noise.
    """
    if size.quick:
        robots, tasks = robots[:1], tasks[:1]
    mapped = [effect.name for effect in effects_to_map(size.quick, effects)]
    period = sensors.sample_period or SAMPLE_PERIOD
    jobs = []
    for robot in robots:
        for task in tasks:
            surrogate = surrogate_file(
                out / "cycles", robot, task, sample_period=period, workers=workers
            )
            jobs += [(robot, task, surrogate, effect) for effect in mapped]
    calls = (
        delayed(_job)(out / "cells", robot, task, surrogate, effect, sensors, mapped, size, seed)
        for robot, task, surrogate, effect in jobs
    )
    found = follow(in_parallel(calls, workers), "mapping", len(jobs), "effect")
    rows = [row for part in found for row in part]
    left_out = {name: why for row in rows for name, why in row.pop("left_out").items()}
    false_alarms = {f"{r['robot']}, {r['task']}": r.pop("false_alarms") for r in rows}
    result = {
        "seed": seed,
        "size": asdict(size),
        "needed": NEEDED,
        "sensors": sensors.description,
        "views": [view.name for view in views(sensors)],
        "left_out": left_out,
        "false_alarms": false_alarms,
        "rows": rows,
    }
    write_text(out / "detectability.csv", as_csv(result))
    return result


def _job(
    cells: Path,
    robot: str,
    task: str,
    surrogate: Path,
    effect: str,
    sensors: Sensors,
    effects: Sequence[str],
    size: Size,
    seed: int,
) -> list[dict[str, Any]]:
    """The rows of one effect, from a file if they have been computed before."""
    code = provenance("faultgen.studies.detectability.study", plugins.DETECTORS).key
    told = [surrogate.name, effect, repr(sensors), *effects, repr(size), str(seed), code]
    key = hashlib.sha256(" ".join(told).encode()).hexdigest()[:16]
    path = cells / f"{effect}_{key}.json"
    if path.is_file():
        rows: list[dict[str, Any]] = json.loads(path.read_text())
        return rows
    with threadpool_limits(1):  # sums in another order would differ in their last digits
        place = place_of(robot, task, surrogate, sensors, effects, size, seed)
        rows = _rows(place, robot, task, EFFECTS[effect], size, seed)
    cells.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(rows) + "\n")
    return rows


def _rows(
    place: Place, robot: str, task: str, effect: Effect, size: Size, seed: int
) -> list[dict[str, Any]]:
    """One row for each axis on which the effect acts if none is named."""
    where = place_name(robot, task)
    rows = []
    for axis in effect.usual_axes_on(place.bench.robot):
        rng = np.random.default_rng([seed, *number_of(*where, effect.name, axis)])
        row: dict[str, Any] = {
            "robot": where[0],
            "task": where[1],
            "effect": effect.name,
            "axis": axis,
            "unit": effect.units_on(place.bench.robot, axis),
            "left_out": place.judged.left_out,
            "false_alarms": asdict(place.false_alarms),
        }
        rows.append(row | _limits(place, effect, axis, size, rng))
    return rows


def _limits(
    place: Place, effect: Effect, axis: int, size: Size, rng: np.random.Generator
) -> dict[str, Any]:
    reference = place.filters[REFERENCE]
    found = find_limit(
        effect,
        axis,
        place.bench,
        lambda cycle: of_day(reference.distance(cycle - place.healthy)),
    )
    told: dict[str, Any] = {
        "ideal": found.severity,
        "views": {},
        "train": None,
        "detectors": dict.fromkeys(["train", *place.judged.threshold]),
        "life": dict.fromkeys(SCHEDULES),
        "why_not": None,
    }
    if found.severity is None:
        told["why_not"] = _reason(place, axis, found.distance)
        return told
    cycle = place.bench.worn(effect, axis, found.severity)
    assert cycle is not None  # it was simulated before
    change = cycle - place.healthy
    told["views"] = {
        name: found.severity * NEEDED / max(of_day(one.distance(change)), 1e-300)
        for name, one in place.filters.items()
    }
    told["life"] = {name: _life(name, effect.default, found.severity) for name in SCHEDULES}
    told["train"] = place.trained.limit(
        effect, axis, place.bench, first=found.severity, days=size.trained_days, rng=rng.spawn(1)[0]
    )
    told["detectors"] = {"train": told["train"]["severity"]}
    told["detectors"] |= tried(place, effect, axis, found.severity, size.days, rng)
    return told


def tried(
    place: Place, effect: Effect, axis: int, first: float, days: int, rng: np.random.Generator
) -> dict[str, float | None]:
    """Find the smallest severity that each detector sees.

    Args:
        place: The robot and task.
        effect: The effect.
        axis: Axis, from 1.
        first: Smallest severity that is tried, in the unit of the effect.
        days: Number of days for each severity.
        rng: Source of randomness.

    Returns:
        The severities by detector; None if it sees none.
    """
    every = place.filters[REFERENCE].every
    levels: list[float] = []
    shares: dict[str, list[float]] = {name: [] for name in place.judged.threshold}
    asked = list(shares)
    for k in range(_LEVELS):
        cycle = place.bench.worn(effect, axis, first * _RATIO**k)
        if cycle is None or not asked:
            break
        levels.append(first * _RATIO**k)
        change = (cycle - place.healthy)[:, ::every]
        for name, value in place.judged.share(change, days, rng, asked).items():
            shares[name].append(value)
        # what is detected is not asked again about a larger severity
        asked = [name for name in asked if shares[name][-1] < DETECTED]
    return {name: smallest(levels[: len(own)], own) for name, own in shares.items()}


def _reason(place: Place, axis: int, distance: float) -> str:
    """Why the ideal detector sees nothing."""
    if not place.judged.monitored.model.turning[axis - 1]:
        return "the axis does not turn in this task"
    if distance == 0:
        return "it changes nothing in the torque"
    return "even the largest severity is below the noise"


def _life(schedule: str, final: float, limit: float) -> float | None:
    """Share of a wear schedule after which the limit is reached; None if it never is."""
    over = severities(schedule, final, _LIFE) >= limit
    return float((np.argmax(over) + 1) / _LIFE) if over.any() else None


def as_csv(result: dict[str, Any]) -> str:
    """Return the rows as a table of comma-separated values.

    Args:
        result: Result of `run_detectability`.
    """
    text = io.StringIO()
    detectors = list(dict.fromkeys(name for row in result["rows"] for name in row["detectors"]))
    columns = ["robot", "task", "effect", "axis", "unit", "ideal"]
    of_train = ["named", "axis_named", "called"]
    others = [name for name in result["views"] if name != REFERENCE]
    writer = csv.writer(text, lineterminator="\n")
    ends = [f"share of life, {name}" for name in SCHEDULES]
    writer.writerow(
        [*columns, *(f"ideal, {name}" for name in others), *detectors, *of_train, *ends, "why not"]
    )
    for row in result["rows"]:
        writer.writerow(
            [
                *(row[name] for name in columns),
                *(row["views"].get(name) for name in others),
                *(row["detectors"].get(name) for name in detectors),
                *(((row["train"] or {}).get("at_limit") or {}).get(name) for name in of_train),
                *(row["life"][name] for name in SCHEDULES),
                row["why_not"],
            ]
        )
    return text.getvalue()
