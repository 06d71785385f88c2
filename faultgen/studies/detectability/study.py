"""Study `detectability`: which faults can be seen in a log, on which axis, in which task?

For every effect, axis and task it finds the smallest severity that is detected on 95 % of the days
at one false alarm per month: by the ideal detector, and by every detector of the package.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed
from threadpoolctl import threadpool_limits

from faultgen import plugins
from faultgen.dataset.wear import severities
from faultgen.effects import EFFECTS, Effect
from faultgen.evaluation.places import ROBOTS, TASKS, place_name
from faultgen.monitoring.sensors import SENSORS, Sensors
from faultgen.provenance import provenance
from faultgen.simulation.nominal import nominal
from faultgen.simulation.state import Condition
from faultgen.simulation.surrogate import SAMPLE_PERIOD, Surrogate, surrogate_file
from faultgen.studies.chapter6_isolation.monitored import Monitored
from faultgen.studies.detectability.disturbed import Before, disturbances, draw
from faultgen.studies.detectability.ideal import (
    DETECTED,
    NEEDED,
    MatchedFilter,
    View,
    matched_filter,
    of_day,
)
from faultgen.studies.detectability.judged import Judged, judged, smallest
from faultgen.studies.detectability.limits import Bench, find_limit
from faultgen.system.files import write_text
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import follow

REFERENCE = "torque"
"""Name of the view to which the others are compared."""

QUICK_EFFECTS = ("friction_wear", "backlash", "gear_stiffness", "torque_ripple", "delay")
SCHEDULES = ("exponential", "sigmoid")
"""Wear schedules of the thesis (eq. 6.6 and 3.7), for which the time to detection is given."""

_LEVELS = 6  # severities at which detectors are tried, from that of the ideal detector on
_RATIO = 4.0  # of one to the next
_LIFE = 1000  # cycles of a wear schedule, to find the share of the life after which wear is seen


@dataclass(frozen=True)
class Size:
    """Amount of random data for each robot and task."""

    healthy_days: int
    """Days from which the thresholds of the detectors are found."""
    days: int
    """Days for each effect, axis and severity."""
    quick: bool = False
    """Whether to look at few effects only."""


FULL = Size(healthy_days=200, days=20)
QUICK = Size(healthy_days=60, days=20, quick=True)


def effects_to_map(quick: bool) -> list[Effect]:
    """List the effects of the study.

    Those that only change what the sensors show have no place in the robot, and an effect that is
    another one in another unit is left out.
    """
    chosen = [
        effect
        for effect in EFFECTS.values()
        if effect.sense is None and not effect.same_as and effect.name != "learned_law"
    ]
    return [one for one in chosen if one.name in QUICK_EFFECTS] if quick else chosen


def views(sensors: Sensors) -> list[View]:
    """List what may be logged, the reference first.

    Args:
        sensors: Noise and disturbances.
    """
    period = sensors.sample_period or SAMPLE_PERIOD
    found = [View(name=REFERENCE, sensors=sensors, sample_period=period)]
    if sensors.temperature_wander > sensors.temperature_error:
        found.append(
            View(
                name="without thermometer",
                sensors=sensors,
                sample_period=period,
                thermometer=False,
            )
        )
    if not sensors.torque_colour:  # it holds for one sample period only
        found += [
            View(name=f"torque at {1 / p:g} Hz", sensors=sensors, sample_period=p)
            for p in (0.001, 0.04)
        ]
    if sensors.quantised or sensors.position_noise > 0:
        found.append(
            View(name="torque and encoder", sensors=sensors, sample_period=period, encoder=True)
        )
    if sensors.quantised:
        found.append(
            View(
                name="encoder with 10 times the counts",
                sensors=sensors,
                sample_period=period,
                encoder=True,
                finer=10.0,
            )
        )
    if sensors == SENSORS["realistic"]:
        found.append(View(name="noise of the thesis", sensors=SENSORS["thesis"]))
    return found


@dataclass(frozen=True, eq=False)
class Place:
    """What the jobs of one robot and task share."""

    bench: Bench
    """The robot at its task."""
    healthy: np.ndarray
    """A healthy cycle, shape (3, samples, n_axes): position [rad], velocity [rad/s] and torque
    [N m] of the motors."""
    filters: dict[str, MatchedFilter]
    """The ideal detector of each view, by name."""
    judged: Judged
    """The detectors of the package."""


def run_detectability(
    out: Path,
    *,
    size: Size = FULL,
    seed: int = 2026,
    workers: int = 1,
    robots: Sequence[str] = ROBOTS,
    tasks: Sequence[str] = TASKS,
    sensors: Sensors = SENSORS["realistic"],
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

    Returns:
        Results for JSON.

    Raises:
        InputError: A robot or task is unknown, or the sensors have no noise.
    """
    if size.quick:
        robots, tasks = robots[:1], tasks[:1]
    period = sensors.sample_period or SAMPLE_PERIOD
    jobs = []
    for robot in robots:
        for task in tasks:
            surrogate = surrogate_file(
                out / "cycles", robot, task, sample_period=period, workers=workers
            )
            jobs += [(robot, task, surrogate, e.name) for e in effects_to_map(size.quick)]
    calls = (
        delayed(_job)(out / "cells", robot, task, surrogate, effect, sensors, size, seed)
        for robot, task, surrogate, effect in jobs
    )
    found = follow(in_parallel(calls, workers), "mapping", len(jobs), "effect")
    rows = [row for part in found for row in part]
    left_out = {name: why for row in rows for name, why in row.pop("left_out").items()}
    result = {
        "seed": seed,
        "size": asdict(size),
        "needed": NEEDED,
        "sensors": sensors.description,
        "views": [view.name for view in views(sensors)],
        "left_out": left_out,
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
    size: Size,
    seed: int,
) -> list[dict[str, Any]]:
    """The rows of one effect, from a file if they have been computed before."""
    code = provenance("faultgen.studies.detectability.study", plugins.DETECTORS).key
    told = [surrogate.name, effect, repr(sensors), repr(size), str(seed), code]
    key = hashlib.sha256(" ".join(told).encode()).hexdigest()[:16]
    path = cells / f"{effect}_{key}.json"
    if path.is_file():
        rows: list[dict[str, Any]] = json.loads(path.read_text())
        return rows
    with threadpool_limits(1):  # sums in another order would differ in their last digits
        place = place_of(robot, task, surrogate, sensors, size, seed)
        rows = _rows(place, robot, task, EFFECTS[effect], size, seed)
    cells.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(rows) + "\n")
    return rows


_LATEST: dict[tuple[Any, ...], Place] = {}
"""The place of the last job, which the next one usually shares."""


def place_of(
    robot: str, task: str, surrogate: Path, sensors: Sensors, size: Size, seed: int
) -> Place:
    """Prepare a robot and task, or return that of the last call if it is the same.

    Args:
        robot: Name of the robot, or path of its MJCF file or folder.
        task: Name of the task, or path of its file.
        surrogate: File of its interpolated cycles.
        sensors: Noise and disturbances.
        size: Amount of random data.
        seed: Root seed of all random draws.

    Returns:
        What all effects share.
    """
    key = (robot, task, surrogate, repr(sensors), size, seed)
    if key not in _LATEST:
        _LATEST.clear()
        _LATEST[key] = _prepared(robot, task, surrogate, sensors, size, seed)
    return _LATEST[key]


def _prepared(
    robot: str, task: str, surrogate: Path, sensors: Sensors, size: Size, seed: int
) -> Place:
    ways = views(sensors)
    bench = Bench.of(robot, task, ways[0].sample_period)
    period = ways[0].sample_period
    shared = nominal(robot, task, period)
    healthy = bench.cycle(Condition(bench.robot.friction_temperature))
    rng = np.random.default_rng([seed, *_number(*place_name(robot, task))])
    rng_drawn, rng_days = rng.spawn(2)
    drawn = draw(bench, sensors, rng_drawn)
    filters = {
        view.name: matched_filter(
            view,
            bench.robot,
            healthy,
            disturbances(view, drawn),
            shared.mean_torque,
            step=bench.step,
        )
        for view in ways
    }
    cycles = Surrogate.load(surrogate)
    before = Before.of(shared, sensors, cycles.temperatures, period)
    ready = judged(Monitored.of(cycles), sensors, size.healthy_days, rng_days, before)
    return Place(bench, healthy, filters, ready)


def _number(*words: object) -> list[int]:
    """Numbers that depend on some words, for seeds."""
    digest = hashlib.sha256(" ".join(map(str, words)).encode()).digest()
    return [int.from_bytes(digest[:4]), int.from_bytes(digest[4:8])]


def _rows(
    place: Place, robot: str, task: str, effect: Effect, size: Size, seed: int
) -> list[dict[str, Any]]:
    """One row for each axis on which the effect acts if none is named."""
    where = place_name(robot, task)
    rows = []
    for axis in effect.usual_axes_on(place.bench.robot):
        rng = np.random.default_rng([seed, *_number(*where, effect.name, axis)])
        row: dict[str, Any] = {
            "robot": where[0],
            "task": where[1],
            "effect": effect.name,
            "axis": axis,
            "unit": effect.units_on(place.bench.robot, axis),
            "left_out": place.judged.left_out,
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
        "detectors": dict.fromkeys(place.judged.threshold),
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
    told["detectors"] = tried(place, effect, axis, found.severity, size.days, rng)
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
    others = [name for name in result["views"] if name != REFERENCE]
    writer = csv.writer(text, lineterminator="\n")
    ends = [f"share of life, {name}" for name in SCHEDULES]
    writer.writerow(
        [*columns, *(f"ideal, {name}" for name in others), *detectors, *ends, "why not"]
    )
    for row in result["rows"]:
        writer.writerow(
            [
                *(row[name] for name in columns),
                *(row["views"].get(name) for name in others),
                *(row["detectors"].get(name) for name in detectors),
                *(row["life"][name] for name in SCHEDULES),
                row["why_not"],
            ]
        )
    return text.getvalue()
