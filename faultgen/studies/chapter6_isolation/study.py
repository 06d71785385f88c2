"""Study `isolation`, thesis chapter 6: which axis is worn, according to each method and noise?

Both robots perform three tasks while one axis or two wear by up to 20 %. Cycles are interpolated
between simulated ones (`faultgen.simulation.surrogate`). Every seed can then have its own
temperatures, payloads and noise at little cost.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed
from threadpoolctl import threadpool_limits

from faultgen.analysis import net_transfer_entropy
from faultgen.analysis.isolation import Answer
from faultgen.analysis.te_bins import CANDIDATES, choose_bins
from faultgen.errors import InputError
from faultgen.evaluation.calls import axis_of, create, fit, isolate
from faultgen.evaluation.features import Features
from faultgen.evaluation.isolate import LEVELS
from faultgen.evaluation.isolators import ISOLATORS
from faultgen.evaluation.methods import Isolator, Setting
from faultgen.evaluation.places import TASKS, place_name
from faultgen.evaluation.shares import share
from faultgen.monitoring.reductions import SPEED_WINDOW
from faultgen.simulation.nominal import nominal
from faultgen.simulation.surrogate import SAMPLE_PERIOD as SURROGATE_PERIOD
from faultgen.simulation.surrogate import surrogate_file
from faultgen.studies.chapter6_isolation.series import (
    HEALTHY,
    NOISES,
    PAIR,
    REFERENCE,
    WORN,
    Block,
    Series,
    growth,
    make_series,
    monitored,
)
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import follow

ROBOTS = ("irb6700", "puma560")
PAIR_LEVEL = 0.10
CONTROLS = ("as measured", "cycles shuffled", "time reversed", "noise with a trend on one axis")


@dataclass(frozen=True)
class Size:
    """Amount of random data for each robot, task and noise."""

    reference: int
    """Healthy runs to learn from, of 100 cycles."""
    healthy: int
    """Healthy runs to test on, at `realistic` noise; as many as `worn` at others."""
    worn: int
    """Number of runs for each worn axis, which are the seeds of the study."""
    pairs: int
    """Number of runs for each pair of worn axes, at `realistic` noise."""


FULL = Size(reference=20, healthy=100, worn=20, pairs=7)
QUICK = Size(reference=20, healthy=20, worn=3, pairs=1)


def run_isolation(
    out: Path,
    *,
    size: Size = FULL,
    seed: int = 2026,
    workers: int = 1,
    robots: Sequence[str] = ROBOTS,
    tasks: Sequence[str] = TASKS,
) -> dict[str, Any]:
    """Run the study.

    Args:
        out: Folder for simulated cycles and series, which the next call uses again.
        size: Amount of random data.
        seed: Root seed of all random draws.
        workers: Number of processes. It has no effect on the results.
        robots: Names of robots, or paths of MJCF files.
        tasks: Names of tasks, or paths of task files. Every robot performs each of them.

    Returns:
        Results for JSON: rows of outcomes by robot, task, noise, level and method.

    Raises:
        InputError: A robot or task is unknown or lacks something, or two have the same name.
    """
    places = {place_name(robot, task): (robot, task) for robot in robots for task in tasks}
    if len(places) < len(robots) * len(tasks):
        raise InputError("study isolation: two robots or two tasks have the same name")
    for robot, task in places.values():
        _check(robot, task)
    files = {
        name: surrogate_file(out / "cycles", robot, task, workers=workers)
        for name, (robot, task) in places.items()
    }
    blocks = [
        Block(
            robot=robot,
            task=task,
            noise=noise,
            seed=seed,
            reference=size.reference,
            healthy=size.healthy if noise == "realistic" else size.worn,
            worn=size.worn,
            pairs=size.pairs if noise == "realistic" else 0,
        )
        for noise in reversed(NOISES)  # the longest first
        for robot, task in files
    ]
    calls = (
        delayed(_judge)(block, files[block.robot, block.task], out / "series") for block in blocks
    )
    parts = list(follow(in_parallel(calls, workers), "isolating", len(blocks), "block"))
    result: dict[str, Any] = {"seed": seed, "seeds": size.worn, "size": vars(size)}
    for name in parts[0]:
        result[name] = [row for part in parts for row in part[name]]
    with threadpool_limits(1):
        result["table_6_1"] = [
            row for key, path in files.items() for row in _mean_torques(key, path)
        ]
    return result


def _check(robot: str, task: str) -> None:
    """Refuse a robot or task with which axes cannot be compared."""
    shared = nominal(robot, task, SURROGATE_PERIOD)
    if shared.robot.n_axes < 2:
        raise InputError(
            f"study isolation: compares axes, and robot {shared.robot.name} has only one"
        )
    low, high = SPEED_WINDOW
    if not ((shared.speed >= low) & (shared.speed <= high)).any():
        raise InputError(
            f"study isolation: no motor of robot {shared.robot.name} turns at {low:g} to {high:g} "
            f"rad/s in task {task}, where the thesis' isolators look at the torque"
        )


def _judge(block: Block, surrogate: Path, folder: Path) -> dict[str, list[dict[str, Any]]]:
    """All counts of one block."""
    with threadpool_limits(1):  # sums in another order would differ in their last digits
        return _judge_block(block, surrogate, folder)


def _judge_block(block: Block, surrogate: Path, folder: Path) -> dict[str, list[dict[str, Any]]]:
    series = make_series(block, surrogate, folder)
    place = {"robot": block.robot, "task": block.task, "noise": block.noise}
    cuts = [(level, _cycles_to(level)) for level in LEVELS]
    parts = {
        **_methods(block, series, surrogate, cuts),
        "bins": _bins(series, cuts),
        "controls": _controls(series, block),
        "net_transfer_entropy": _heat_maps(series),
    }
    return {name: [place | row for row in rows] for name, rows in parts.items()}


def _cycles_to(level: float) -> int:
    """Number of cycles up to the first with that wear."""
    return int(np.argmax(growth() >= level * (1 - 1e-9))) + 1


def _truth(series: Series, role: int) -> list[tuple[int, int]]:
    """(run, worn axis from 0) of runs with one worn axis or, with -1, none."""
    runs = np.flatnonzero(series.role == role)
    return [(int(r), int(series.worn[r].argmax()) if series.worn[r].any() else -1) for r in runs]


def _isolation_row(level: float, answers: list[tuple[int, int]], **more: Any) -> dict[str, Any]:
    """Answers (axis named, worn axis) as a row."""
    n_axes = max(axis for _, axis in answers) + 1
    by_axis = [[int(a == axis) for a, axis in answers if axis == k] for k in range(n_axes)]
    right = sum(sum(hits) for hits in by_axis)
    return {
        "level": level,
        **share(right, len(answers)),
        "none": sum(named < 0 for named, _ in answers) / len(answers),
        "by_axis": [sum(hits) / len(hits) for hits in by_axis],
        **more,
    }


def _methods(
    block: Block, series: Series, surrogate: Path, cuts: list[tuple[float, int]]
) -> dict[str, list[dict]]:
    """What every isolator answers on worn and healthy robots.

    Of those that estimate severities also: the error of the severity, two axes at once, and what
    can be observed.
    """
    setting = monitored(surrogate).setting(temperature_varies=NOISES[block.noise].changes_motion)
    rows: dict[str, list[dict]] = {
        name: [] for name in ("isolation", "healthy", "severity", "pairs", "observable")
    }
    for method in ISOLATORS.values():
        if method.supervised:  # these series have no labelled runs to learn from
            continue
        isolator = create(method, setting)
        judged = _Judged(isolator, series)
        fit(isolator, [judged.seen(r) for r in series.of(REFERENCE)] if method.learns else [])
        for name, told in _told(judged, cuts).items():
            rows[name] += [{"method": method.name, **row} for row in told]
    return rows


@dataclass(frozen=True, eq=False)
class _Judged:
    """An isolator that is asked about the runs of a block."""

    isolator: Isolator
    series: Series

    def seen(self, run: int) -> Features:
        return self.series.seen(run, self.isolator.features)

    def answers(self, runs: Iterable[int], ends: Sequence[int]) -> list[list[int | Answer]]:
        """Answers after so many cycles, by run and number of cycles."""
        return [[isolate(self.isolator, seen, n) for n in ends] for seen in map(self.seen, runs)]


def _told(judged: _Judged, cuts: list[tuple[float, int]]) -> dict[str, list[dict]]:
    """Rows of one isolator, see `_methods`."""
    series, wear = judged.series, growth()
    truth = _truth(series, WORN)
    worn = judged.answers([run for run, _ in truth], [n for _, n in cuts])
    graded = all(isinstance(answer, Answer) for answers in worn for answer in answers)
    rows: dict[str, list[dict]] = {"healthy": [_false_alarms(judged, cuts, graded)]}
    smallest = judged.isolator.smallest()
    if smallest is not None:
        rows["observable"] = [{"smallest": [x if np.isfinite(x) else None for x in smallest]}]
    rows["isolation"], rows["severity"] = [], []
    for k, (level, n) in enumerate(cuts):
        answers = [answer[k] for answer in worn]
        named = [(axis_of(a), axis) for a, (_, axis) in zip(answers, truth, strict=True)]
        full = [answer for answer in answers if isinstance(answer, Answer)]
        if not graded:
            rows["isolation"].append(_isolation_row(level, named))
            continue
        alone = sum(
            bool(a.worn[axis] and a.worn.sum() == 1)
            for a, (_, axis) in zip(full, truth, strict=True)
        )
        rows["isolation"].append(_isolation_row(level, named, no_other=alone / len(full)))
        rows["severity"].append({"level": level, **_severity(full, truth, wear[n - 1])})
    both = series.of(PAIR)
    if len(both) and graded:
        rows["pairs"] = [_both_named(judged, both)]
    return rows


def _false_alarms(judged: _Judged, cuts: list[tuple[float, int]], graded: bool) -> dict:
    """How often a healthy robot is called worn: after all cycles and, if graded, at any level."""
    healthy, length = judged.series.of(HEALTHY), len(growth())
    ends = [*(n for _, n in cuts), length] if graded else [length]
    alarms = [[axis_of(a) >= 0 for a in answers] for answers in judged.answers(healthy, ends)]
    row = share(sum(a[-1] for a in alarms), len(healthy))
    if graded:
        row["at_any_level"] = share(sum(map(sum, alarms)), len(healthy) * len(ends))
    return row


def _both_named(judged: _Judged, runs: np.ndarray) -> dict:
    """How often two worn axes are named, and no other."""
    series = judged.series
    answers = [answer for (answer,) in judged.answers(runs, [_cycles_to(PAIR_LEVEL)])]
    sets = [answer.worn for answer in answers if isinstance(answer, Answer)]
    exact = sum(np.array_equal(s, series.worn[r]) for s, r in zip(sets, runs, strict=True))
    found = sum(bool(s[series.worn[r]].all()) for s, r in zip(sets, runs, strict=True))
    return {**share(exact, len(runs)), "both_among": found / len(runs)}


def _severity(answers: list[Answer], truth: list[tuple[int, int]], wear: float) -> dict[str, Any]:
    """Error of the severity of the worn axis, and how often its interval contains the truth."""
    errors = [a.severity[axis] - wear for a, (_, axis) in zip(answers, truth, strict=True)]
    inside = [
        a.interval[axis, 0] <= wear <= a.interval[axis, 1]
        for a, (_, axis) in zip(answers, truth, strict=True)
    ]
    known = np.array([e for e in errors if np.isfinite(e)])
    if not len(known):
        return {"severity": wear, "count": 0, "rms_error": None, "bias": None, "covered": None}
    return {
        "severity": wear,
        "count": len(known),
        "rms_error": float(np.sqrt(np.mean(known**2))),
        "bias": float(known.mean()),
        "covered": float(np.mean(inside)),
    }


def _bins(series: Series, cuts: list[tuple[float, int]]) -> list[dict]:
    """Accuracy of transfer entropy against the number of bins, and of a rule that chooses it."""
    torque = np.nan_to_num(series.stored["mean_abs_torque"])
    truth = _truth(series, WORN)
    reference = torque[series.role == REFERENCE]
    rows = []
    for level, n in cuts:
        cut = torque[[r for r, _ in truth], :n]
        worn = np.array([axis for _, axis in truth])
        chosen = choose_bins(reference[:, :n])
        for bins in CANDIDATES:
            named = net_transfer_entropy(cut, bins).sum(axis=-1).argmax(axis=-1)
            rows.append(
                {
                    "level": level,
                    "cycles": n,
                    "bins": bins,
                    "chosen": bins == chosen,
                    **share(int(np.sum(named == worn)), len(worn)),
                }
            )
    return rows


def _controls(series: Series, block: Block) -> list[dict]:
    """Answers of isolators that learn nothing, without cause or without the order of cycles."""
    setting = Setting(n_axes=series.worn.shape[1])
    by_order = [
        create(method, setting)
        for method in ISOLATORS.values()
        if not (method.learns or method.supervised) and method.features == ("mean_abs_torque",)
    ]
    n = _cycles_to(0.10)
    torque = np.nan_to_num(series.stored["mean_abs_torque"])[:, :n]
    rng = np.random.default_rng([block.seed, 99])
    slope = np.linspace(0, 1, n)
    rows = []
    for control in CONTROLS:
        cases = []
        for run, axis in _truth(series, WORN):
            x = torque[run]
            if control == "cycles shuffled":
                x = rng.permutation(x)
            elif control == "time reversed":
                x = x[::-1]
            elif control == "noise with a trend on one axis":
                x = rng.standard_normal(x.shape)
                x[:, axis] += 4 * slope
            cases.append((x, axis))
        for isolator in by_order:
            right = sum(
                axis_of(isolate(isolator, {"mean_abs_torque": x})) == axis for x, axis in cases
            )
            rows.append({"control": control, "method": isolator.name, **share(right, len(cases))})
    return rows


def _heat_maps(series: Series) -> list[dict]:
    """Net transfer entropy as in figure 6-4: healthy, and axis 1 worn by 10 and 20 %."""
    torque = np.nan_to_num(series.stored["mean_abs_torque"])
    healthy = int(np.flatnonzero(series.role == HEALTHY)[0])
    worn = next(r for r, axis in _truth(series, WORN) if axis == 0)
    n = _cycles_to(0.10)
    cases = [("healthy", torque[healthy]), ("10 %", torque[worn, :n]), ("20 %", torque[worn])]
    return [{"case": name, "net": net_transfer_entropy(x, 10).tolist()} for name, x in cases]


def _mean_torques(key: tuple[str, str], path: Path) -> list[dict]:
    """Table 6.1: mean and standard deviation of |torque| in the speed window, without noise."""
    robot, task = key
    here = monitored(path)
    rows = []
    for axis in range(here.surrogate.n_axes + 1):
        wear = np.zeros((1, here.surrogate.n_axes))
        if axis:
            wear[0, axis - 1] = growth()[-1]
        _, velocity, torque = here.surrogate.cycles(np.array([here.reference]), np.ones(1), wear)[0]
        speed = np.abs(velocity)
        masked = np.ma.masked_where(
            (speed < SPEED_WINDOW[0]) | (speed > SPEED_WINDOW[1]), np.abs(torque)
        )
        rows.append(
            {
                "robot": robot,
                "task": task,
                "worn": axis,
                # none for an axis that is never in the speed window
                "mean": masked.mean(axis=0).tolist(),
                "sd": masked.std(axis=0).tolist(),
            }
        )
    return rows
