"""Study `detection`, thesis chapter 3: when is wear detected, and on which axis?

The robot is a PUMA 560 with three one-minute tasks. After 120 healthy hours, one axis wears by
eq. 3.7 for another 120 hours. First the thesis' procedure is followed. Then all detectors are
compared at equal rates of false alarms.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed
from threadpoolctl import threadpool_limits

from faultgen.analysis import cross_correlation_lags, leading_axis
from faultgen.dataset.wear import severities
from faultgen.errors import InputError
from faultgen.evaluation.places import place_name
from faultgen.evaluation.shares import share
from faultgen.monitoring.sensors import SENSORS
from faultgen.simulation.surrogate import surrogate_file
from faultgen.studies.chapter3_detection.alarms import Scored, scores, separate_alarms, threshold
from faultgen.studies.chapter3_detection.detectors import DETECTORS, Divergences
from faultgen.studies.chapter3_detection.hourly_torque import (
    HourlyMonitored,
    HourlyTorque,
    hourly_monitored,
    sample_period,
)
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import follow

ROBOT = "puma560"
TASKS = ("chapter3_task1", "chapter3_task2", "chapter3_task3")
NOISES = ("thesis", "realistic")
WEARS = (0.10, 0.20)
TRAINING = 120
"""Hours of training."""
WORN = 120
"""Hours in which wear grows."""
MONTH = 720
"""Hours of a month."""
RATES = (10.0, 3.0, 1.0, 0.3, 0.1)
"""False alarms per month at which detectors are compared."""
OPERATING = 0.1
"""The rate for which results are reported cell by cell."""
IN_A_ROW = 3
"""Number of successive hours above the 95 % limit after which the thesis' procedure detects:
assumed, because the thesis does not state it."""

_CALIBRATION, _HEALTHY, _WEAR = range(3)


@dataclass(frozen=True)
class Size:
    """Amount of random data for each task and noise."""

    seeds: int
    """Number of runs for each worn axis and wear."""
    months: int
    """Number of healthy months from which thresholds are found, and of other months in which false
    alarms are counted."""


FULL = Size(seeds=10, months=40)
QUICK = Size(seeds=3, months=5)


def run_detection(
    out: Path,
    *,
    size: Size = FULL,
    seed: int = 2026,
    workers: int = 1,
    robots: Sequence[str] = (ROBOT,),
    tasks: Sequence[str] = TASKS,
) -> dict[str, Any]:
    """Run the study.

    Args:
        out: Folder for simulated cycles, which the next call uses again.
        size: Amount of random data.
        seed: Root seed of all random draws.
        workers: Number of processes. It has no effect on the results.
        robots: Name of the robot, or path of its MJCF file; only one.
        tasks: Names of tasks, or paths of task files, of at most one minute.

    Returns:
        Results for JSON.

    Raises:
        InputError: The robot or a task is unknown or lacks something, or there are several robots.
    """
    if len(robots) > 1:
        raise InputError("study detection: takes one robot; call it once for each robot")
    (robot,) = robots
    paths = dict(zip((place_name(robot, task)[1] for task in tasks), tasks, strict=True))
    if len(paths) < len(tasks):
        raise InputError("study detection: two tasks have the same name")
    periods = {task: sample_period(robot, path) for task, path in paths.items()}
    files = {
        task: surrogate_file(
            out / "cycles", robot, path, sample_period=periods[task], workers=workers
        )
        for task, path in paths.items()
    }
    turning = {task: hourly_monitored(path).turning.tolist() for task, path in files.items()}
    for task, turns in turning.items():
        if len(turns) < 2:
            raise InputError("study detection: compares axes, and the robot has only one")
        if not any(turns):
            raise InputError(
                f"study detection: no axis turns at the places at which task {task} is sampled"
            )
    jobs = [
        (task, noise, role, number)
        for task in files
        for noise in NOISES
        for role, count in ((_CALIBRATION, size.months), (_HEALTHY, size.months))
        for number in range(count)
    ]
    jobs += [
        (task, noise, _WEAR, number)
        for task in files
        for noise in NOISES
        for number in range(size.seeds)
    ]
    calls = (
        delayed(_job)(files[task], task, noise, role, number, seed)
        for task, noise, role, number in jobs
    )
    parts = list(follow(in_parallel(calls, workers), "detecting", len(jobs), "record"))
    healthy = {(t, n, r, k): p for (t, n, r, k), p in zip(jobs, parts, strict=True) if r != _WEAR}
    worn = [
        row for (_, _, role, _), p in zip(jobs, parts, strict=True) if role == _WEAR for row in p
    ]
    return {
        "robot": place_name(robot, "")[0],
        "seed": seed,
        "seeds": size.seeds,
        "size": vars(size),
        "turning": turning,
        "thesis_procedure": [row["thesis"] for row in worn],
        "thesis_false_alarms": _thesis_false_alarms(healthy, list(files), size),
        "detectors": _compare(worn, healthy, turning, size),
        "example": _example(*next(iter(files.items())), seed),
    }


def _rng(seed: int, task: str, noise: str, role: int, *numbers: int) -> np.random.Generator:
    where = int.from_bytes(hashlib.sha256(f"{task} {noise}".encode()).digest()[:4])
    return np.random.default_rng([seed, where, role, *numbers])


def _job(path: Path, task: str, noise: str, role: int, number: int, seed: int) -> Any:
    """One healthy record, or one worn record for each axis and wear."""
    with threadpool_limits(1):  # sums in another order would differ in their last digits
        return _scored_records(path, task, noise, role, number, seed)


def _scored_records(path: Path, task: str, noise: str, role: int, number: int, seed: int) -> Any:
    robot = hourly_monitored(path)
    sensors = SENSORS[noise]
    varies = sensors.changes_motion
    n_axes = robot.surrogate.n_axes
    if role != _WEAR:
        rng = _rng(seed, task, noise, role, number)
        record = robot.record(sensors, np.zeros((TRAINING + MONTH, n_axes)), rng)
        scored = scores(robot, record, TRAINING, temperature_varies=varies)
        kl = Divergences.of(record, TRAINING)
        over = kl.monitor.q(kl.divergence[TRAINING:]) > kl.monitor.q_limit_
        return {"scored": scored, "over": over}
    rows = []
    for axis in range(n_axes):
        for wear in WEARS:
            rng = _rng(seed, task, noise, role, number, axis, round(100 * wear))
            record = robot.record(sensors, _severity(n_axes, axis, wear), rng)
            place = {"task": task, "noise": noise, "axis": axis + 1, "wear": wear, "seed": number}
            rows.append(
                {
                    "place": place,
                    "thesis": place | _thesis_procedure(robot, record, axis),
                    "scored": scores(robot, record, TRAINING, temperature_varies=varies),
                }
            )
    return rows


def _severity(n_axes: int, axis: int, wear: float) -> np.ndarray:
    severity = np.zeros((TRAINING + WORN, n_axes))
    severity[TRAINING:, axis] = severities("sigmoid", wear, WORN)
    return severity


def first_run(over: np.ndarray, length: int) -> int | None:
    """Find the first hour that completes a run of hours above a limit.

    Args:
        over: Whether each hour is above the limit, shape (hours,).
        length: Number of successive hours.

    Returns:
        Index of the hour, None if there is no such run.
    """
    runs = np.convolve(over.astype(int), np.ones(length, int), "valid") == length
    return int(np.argmax(runs)) + length - 1 if runs.any() else None


def _thesis_procedure(robot: HourlyMonitored, record: HourlyTorque, axis: int) -> dict[str, Any]:
    """Detection by Q and location by lags, and the torque then, thesis tables 3.5 to 3.7."""
    kl = Divergences.of(record, TRAINING)
    test = kl.divergence[TRAINING:]
    hour_found = first_run(kl.monitor.q(test) > kl.monitor.q_limit_, IN_A_ROW)
    lags = cross_correlation_lags(test)
    hour = TRAINING + (WORN - 1 if hour_found is None else hour_found)
    joint = np.abs(record.torque[hour, :, axis] * robot.surrogate.gear_ratio[axis])
    return {
        "components": int(kl.monitor.n_components_),
        "hours": None if hour_found is None else hour_found + 1,
        "located": bool(leading_axis(lags) == axis),
        "located_by_letter": bool(leading_axis(-lags) == axis),
        "largest_torque": float(joint.max()),
        "variation": float(joint.std() / joint.mean()),
    }


def _thesis_false_alarms(
    healthy: dict[tuple[str, str, int, int], Any], tasks: list[str], size: Size
) -> list[dict[str, Any]]:
    """False alarms of the thesis' procedure in healthy months."""
    rows = []
    for task in tasks:
        for noise in NOISES:
            over = [healthy[task, noise, _HEALTHY, k]["over"] for k in range(size.months)]
            runs = [np.convolve(o, np.ones(IN_A_ROW), "valid") == IN_A_ROW for o in over]
            rows.append(
                {
                    "task": task,
                    "noise": noise,
                    "hours_over": float(np.mean(over)),
                    "alarms_a_month": float(np.mean([separate_alarms(r) for r in runs])),
                }
            )
    return rows


def _compare(
    worn: list[dict[str, Any]],
    healthy: dict[tuple[str, str, int, int], Any],
    turning: dict[str, list[bool]],
    size: Size,
) -> list[dict[str, Any]]:
    """Every detector at every rate of false alarms: what it finds, when, and where."""

    def healthy_scores(task: str, noise: str, role: int, detector: str) -> list[np.ndarray]:
        parts = (healthy[task, noise, role, k]["scored"] for k in range(size.months))
        return [part[detector].score for part in parts]

    rows = []
    for noise in NOISES:
        for detector in DETECTORS:
            for rate in RATES:
                cells, false_alarms = [], 0
                for task in turning:
                    level = threshold(healthy_scores(task, noise, _CALIBRATION, detector), rate)
                    counted = healthy_scores(task, noise, _HEALTHY, detector)
                    false_alarms += sum(separate_alarms(s > level) for s in counted)
                    cells += [
                        row["place"] | found(row["scored"][detector], level, row["place"]["axis"])
                        for row in worn
                        if (row["place"]["task"], row["place"]["noise"]) == (task, noise)
                    ]
                seen = [c for c in cells if turning[c["task"]][c["axis"] - 1]]
                delays = [c["hours"] if c["hours"] else np.inf for c in seen]
                middle = float(np.median(delays))
                rows.append(
                    {
                        "noise": noise,
                        "detector": detector,
                        "rate": rate,
                        "false_alarms_a_month": false_alarms / (size.months * len(turning)),
                        "months": size.months * len(turning),
                        "detected": share(sum(c["hours"] is not None for c in seen), len(seen)),
                        "located": _located(seen),
                        "median_hours": middle if np.isfinite(middle) else None,
                        "cells": _cells(cells) if rate == OPERATING else [],
                    }
                )
    return rows


def found(scored: Scored, level: float, axis: int) -> dict[str, Any]:
    """Find the first alarm of a record, and whether it names the worn axis.

    Args:
        scored: Scores of the record.
        level: Threshold of an alarm.
        axis: The worn axis, from 1.

    Returns:
        "hours" to the alarm, None without one, and "located", None if the detector names no axis.
    """
    over = np.flatnonzero(scored.score > level)
    if not len(over):
        return {"hours": None, "located": None if scored.axis is None else False}
    first = int(over[0])
    if scored.axis is None:
        return {"hours": first + 1, "located": None}
    return {"hours": first + 1, "located": bool(scored.axis[first] == axis - 1)}


def _located(cells: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Share of records whose alarm names the right axis; None if the detector names no axis."""
    if any(cell["located"] is None for cell in cells):
        return None
    return share(sum(cell["located"] for cell in cells), len(cells))


def _cells(cells: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Results of each task, wear and axis over the seeds."""
    keys = dict.fromkeys((c["task"], c["wear"], c["axis"]) for c in cells)
    rows = []
    for task, wear, axis in keys:
        own = [c for c in cells if (c["task"], c["wear"], c["axis"]) == (task, wear, axis)]
        hours = [c["hours"] for c in own if c["hours"] is not None]
        rows.append(
            {
                "task": task,
                "wear": wear,
                "axis": axis,
                "seeds": len(own),
                "detected": len(hours),
                "located": sum(bool(c["located"]) for c in own),
                "median_hours": float(np.median(hours)) if hours else None,
            }
        )
    return rows


def _example(task: str, path: Path, seed: int) -> dict[str, Any]:
    """What figures 3-2, 3-3 and table 3.3 show: 10 % wear of axis 1, task 1, thesis' noise."""
    robot = hourly_monitored(path)
    rng = _rng(seed, task, NOISES[0], _WEAR, 0, 0, 10)
    record = robot.record(SENSORS["thesis"], _severity(robot.surrogate.n_axes, 0, 0.10), rng)
    kl = Divergences.of(record, TRAINING)
    monitor = kl.monitor
    return {
        "divergence": kl.divergence.tolist(),
        "q": monitor.q(kl.divergence).tolist(),
        "t2": monitor.t2(kl.divergence).tolist(),
        "q_limits": {"95 %": monitor.limits(0.95)[1], "99 %": monitor.limits(0.99)[1]},
        "t2_limits": {"95 %": monitor.limits(0.95)[0], "99 %": monitor.limits(0.99)[0]},
        "scores": monitor.transform(kl.divergence)[:, :2].tolist(),
        "eigenvalues": monitor.eigenvalues_[:2].tolist(),
        "contributions": monitor.q_contributions(kl.divergence[-12:]).mean(axis=0).tolist(),
        "lags": cross_correlation_lags(kl.divergence[TRAINING:]).tolist(),
    }
