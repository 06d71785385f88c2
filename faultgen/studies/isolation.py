"""Which axis is worn? Isolators on a dataset, in the form of thesis table 6.2.

Every isolator sees one number a cycle and axis, the mean |torque|, from the first cycle up to the
one in which wear reaches a level. Where the dataset holds the noise-free signals, the noise of the
sensors is drawn anew for each of many seeds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from statsmodels.stats.proportion import proportion_confint
from tqdm import tqdm

from analysis import cross_correlation_lags, isolate_axis, isolate_axis_by_lags, leading_axis
from faultgen.dataset import Dataset, StoredRun
from faultgen.effects import HEALTHY
from faultgen.errors import InputError
from faultgen.monitoring import mean_abs_torque
from faultgen.sensors import get_sensors, measure
from faultgen.storage import write_text

METHODS: dict[str, Callable[[np.ndarray], int]] = {
    "TE 10 bins": lambda x: isolate_axis(x, bins=10),
    "TE 5 bins": lambda x: isolate_axis(x, bins=5),
    "CC": isolate_axis_by_lags,
    "CC, eq. 3.5": lambda x: leading_axis(-cross_correlation_lags(x)),
}
"""Isolators: series of shape (cycles, n_axes) to axis from 0, or -1 for none.

CC takes the axis that leads all others. Thesis eq. 3.5 gives the leading axis a positive lag, and
its rule asks for negative ones: taken by the letter it names the axis that trails. The last method
does that; it comes nearer to the thesis' figures.
"""

LEVELS = (0.01, 0.05, 0.10, 0.15)
"""Wear at which the thesis isolates."""

# Thesis table 6.2, percent right of six axes, one simulation each; columns TE 10, TE 5 and CC
THESIS = {
    ("pick_and_place", 0.01): (50.0, 100.0, 16.7),
    ("pick_and_place", 0.05): (100.0, 83.3, 33.3),
    ("pick_and_place", 0.10): (100.0, 83.3, 33.3),
    ("pick_and_place", 0.15): (100.0, 100.0, 33.3),
    ("spot_weld", 0.01): (83.3, 66.7, 16.7),
    ("spot_weld", 0.05): (83.3, 66.7, 0.0),
    ("spot_weld", 0.10): (100.0, 66.7, 33.3),
    ("spot_weld", 0.15): (100.0, 50.0, 33.3),
    ("arc_weld", 0.01): (100.0, 83.3, 50.0),
    ("arc_weld", 0.05): (100.0, 66.7, 66.7),
    ("arc_weld", 0.10): (100.0, 66.7, 83.3),
    ("arc_weld", 0.15): (100.0, 66.7, 100.0),
}


@dataclass
class Tally:
    """Answers of one method at one robot, task and level of wear."""

    robot: str
    task: str
    effect: str
    level: float
    """Severity at the last cycle seen; 0 for the healthy robot over all of its cycles."""
    method: str
    right: int = 0
    """Answers that named a worn axis; on a healthy robot, answers that named none."""
    named: int = 0
    """Answers that named any axis."""
    total: int = 0
    """Answers."""
    right_by_axis: dict[int, int] = field(default_factory=dict)
    """Right answers, by worn axis."""
    total_by_axis: dict[int, int] = field(default_factory=dict)
    """Answers, by worn axis."""
    answers: dict[int, int] = field(default_factory=dict)
    """How often each axis was named; 0 is none."""

    @property
    def accuracy(self) -> float:
        """Share of right answers."""
        return self.right / self.total

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson interval of the accuracy, 95 %."""
        low, high = proportion_confint(self.right, self.total, method="wilson")
        return float(low), float(high)

    def add(self, answer: int, worn: tuple[int, ...]) -> None:
        """Count one answer (axis from 1, 0 for none)."""
        right = answer in worn if worn else answer == 0
        self.total += 1
        self.right += right
        self.named += answer > 0
        self.answers[answer] = self.answers.get(answer, 0) + 1
        for axis in worn:
            self.total_by_axis[axis] = self.total_by_axis.get(axis, 0) + 1
            self.right_by_axis[axis] = self.right_by_axis.get(axis, 0) + (answer == axis)


@dataclass(frozen=True)
class Isolation:
    """What the isolators answered on a dataset."""

    sensors: str
    """Noise that they saw."""
    seeds: int
    """Draws of the noise for each run."""
    redrawn: bool
    """Whether the noise was drawn anew, or is that of the dataset."""
    tallies: list[Tally]
    """One for each robot, task, level and method."""
    unobservable: dict[str, list[int]]
    """Axes that are never within the speed window, by robot and task."""
    too_short: str
    """Levels of wear that were reached too early to be asked for, in words; empty if none."""


def isolate(
    dataset: Dataset,
    *,
    sensors: str | None = None,
    seeds: int = 20,
    seed: int = 1000,
    levels: tuple[float, ...] = LEVELS,
    progress: bool = True,
) -> Isolation:
    """Run every isolator on a dataset.

    Args:
        dataset: The dataset.
        sensors: Preset of which noise is drawn; default: 'thesis' for a dataset without noise,
            else the noise that the dataset has.
        seeds: Draws of the noise for each run.
        seed: Where the draws start.
        levels: Severities at which an answer is asked for.
        progress: Show a progress bar on stderr.

    Returns:
        Answers, counted.

    Raises:
        InputError: The dataset has no runs, or not the signals that new noise needs.
    """
    if not dataset.runs:
        raise InputError(f"{dataset.path}: no runs in it; finish it with faultgen generate")
    if seeds < 1:
        raise InputError(f"seeds: must be at least 1, not {seeds}")
    stored = {run["sensors"] for run in dataset.runs}
    redraw = sensors is not None or stored == {"none"}
    chosen = "thesis" if stored == {"none"} else "/".join(sorted(stored))
    if sensors is not None:
        chosen = sensors
    if redraw and get_sensors(chosen).changes_motion:
        raise InputError(
            f"sensors '{chosen}' change the motion: generate a dataset with them instead, "
            "with several repetitions"
        )
    tallies: dict[tuple[str, str, str, float, str], Tally] = {}
    unobservable: dict[str, list[int]] = {}
    short: set[float] = set()
    for run in tqdm(dataset.runs, unit="run", disable=None if progress else True, desc="isolating"):
        worn = tuple(int(axis) for axis in run["axes"])
        severity = run.read("cycle/severity")
        for series in _series(run, chosen, seeds, seed) if redraw else _stored(run):
            seen = np.isfinite(series).all(axis=0)
            unobservable[f"{run['robot']}/{run['task']}"] = [
                int(axis) + 1 for axis in np.flatnonzero(~seen)
            ]
            series = np.where(seen, series, 0.0)
            cuts = list(_cuts(severity, worn, levels))
            short |= {a for a in levels if worn and severity.max() >= a} - {a for a, _ in cuts}
            for level, length in cuts:
                for method, isolator in METHODS.items():
                    key = (run["robot"], run["task"], run["effect"], level, method)
                    tally = tallies.setdefault(key, Tally(*key))
                    tally.add(isolator(series[:length]) + 1, worn)
    draws = seeds if redraw else len({run["seed"] for run in dataset.runs})
    too_short = ", ".join(f"{100 * level:g} %" for level in sorted(short))
    return Isolation(chosen, draws, redraw, list(tallies.values()), unobservable, too_short)


def _cuts(
    severity: np.ndarray, worn: tuple[int, ...], levels: tuple[float, ...]
) -> Iterator[tuple[float, int]]:
    """(level, number of cycles up to it) that there is enough of to isolate."""
    shortest = 5
    if not worn:
        if len(severity) >= shortest:
            yield 0.0, len(severity)
        return
    for level in levels:
        reached = np.flatnonzero(severity >= level * (1 - 1e-9))
        if len(reached) and reached[0] + 1 >= shortest:
            yield level, int(reached[0]) + 1


def _stored(run: StoredRun) -> Iterator[np.ndarray]:
    yield run.read("monitoring/mean_abs_torque")


def series(dataset_run: StoredRun, sensors: str | None = None) -> np.ndarray:
    """Mean |torque| of each cycle as an isolator sees it: stored, or with one draw of noise.

    Args:
        dataset_run: The run.
        sensors: Preset of the noise; default: 'thesis' for a run without noise, else as stored.

    Returns:
        Shape (cycles, n_axes), in [N m].
    """
    if sensors is None and dataset_run["sensors"] != "none":
        return next(_stored(dataset_run))
    return next(_series(dataset_run, sensors or "thesis", 1, 1000))


def _series(run: StoredRun, sensors: str, seeds: int, seed: int) -> Iterator[np.ndarray]:
    """Mean |torque| of every cycle under new noise, seed by seed."""
    clean = "signals" if run["sensors"] == "none" else "truth"
    names = [f"{clean}/motor_velocity", f"{clean}/motor_torque"]
    if run["thin"] != 1 or any(name not in run for name in names):
        raise InputError(
            f"{run.path}: new noise needs {' and '.join(names)}, not thinned; generate with "
            f"signals = {names}".replace("'", '"')
        )
    velocity, torque = (run.read(name).astype(float) for name in names)
    preset = get_sensors(sensors)
    for number in range(seed, seed + seeds):
        # a stream of its own for each run and seed, so that answers are independent
        rng = np.random.default_rng([number, int(run.id, 16)])
        series = np.empty((len(torque), torque.shape[2]))
        for k in range(len(torque)):
            seen = measure(
                preset,
                np.zeros_like(velocity[k]),
                velocity[k],
                torque[k],
                gear_ratio=run["gear_ratio"],
                encoder_counts=run["encoder_counts"],
                mean_torque=run["nominal_mean_torque"],
                sample_period=run["sample_period"],
                rng=rng,
            )
            series[k] = mean_abs_torque(seen.motor_velocity, seen.motor_torque)
        yield series


def table(result: Isolation) -> str:
    """Table 6.2's form in Markdown: robot and task x wear x method, thesis figures beside."""
    cells = {(t.robot, t.task, t.effect, t.level, t.method): t for t in result.tallies}
    rows = sorted({key[:4] for key in cells}, key=lambda r: (r[0], r[1], r[3] == 0, r[2], r[3]))
    beside = any(robot == "irb6700" for robot, *_ in rows)
    drawn = f"{result.seeds} draws of" if result.redrawn else "the stored"
    lines = [
        f"Axis isolated, percent [95 % Wilson interval]; {drawn} '{result.sensors}' noise"
        + ("; thesis' figure after the slash." if beside else "."),
        "",
        "| robot | task | effect | wear % | answers | right by axis, TE 10 bins | "
        + " | ".join(METHODS)
        + " |",
        "|" + " --- |" * (6 + len(METHODS)),
    ]
    for robot, task, effect, level in rows:
        first = cells[robot, task, effect, level, next(iter(METHODS))]
        shown = [_cell(cells[robot, task, effect, level, method]) for method in METHODS]
        if level > 0 and robot == "irb6700" and (task, level) in THESIS:
            shown = [
                f"{cell} / {_thesis(task, level, method):g}"
                for cell, method in zip(shown, METHODS, strict=True)
            ]
        by_axis = " ".join(
            f"{axis}:{100 * first.right_by_axis[axis] / count:.0f}"
            for axis, count in sorted(first.total_by_axis.items())
        )
        wear = f"{100 * level:g}" if level else "-"
        lines.append(
            f"| {robot} | {task} | {effect} | {wear} | {first.total} | {by_axis} | "
            + " | ".join(shown)
            + " |"
        )
    if result.too_short:
        lines += ["", "Not asked, since fewer than 5 cycles come before: " + result.too_short]
    if any(level == 0 for *_, level in rows):
        lines += ["", f"In rows '{HEALTHY}': how often an axis was named though none is worn."]
    for place, axes in result.unobservable.items():
        if axes:
            lines += [f"{place}: axes {axes} never turn within the speed window; left out."]
    return "\n".join(lines)


def _thesis(task: str, level: float, method: str) -> float:
    """Figure of thesis table 6.2 [%]; it has one for cross-correlation."""
    return THESIS[task, level][min(list(METHODS).index(method), 2)]


def _cell(tally: Tally) -> str:
    if tally.level == 0:
        most = max(tally.answers, key=lambda axis: tally.answers[axis])
        often = f", mostly axis {most}" if most else ""
        return f"named {100 * tally.named / tally.total:.0f} %{often}"
    low, high = tally.interval
    return f"{100 * tally.accuracy:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def to_dict(result: Isolation) -> dict[str, Any]:
    """The result for JSON."""
    rows = []
    for tally in result.tallies:
        low, high = tally.interval
        known = tally.robot == "irb6700" and (tally.task, tally.level) in THESIS
        figure = _thesis(tally.task, tally.level, tally.method) / 100 if known else None
        rows.append(
            asdict(tally) | {"accuracy": tally.accuracy, "low": low, "high": high, "thesis": figure}
        )
    return {
        "sensors": result.sensors,
        "seeds": result.seeds,
        "redrawn": result.redrawn,
        "results": rows,
        "unobservable": result.unobservable,
    }


def save(result: Isolation, folder: Path) -> None:
    """Write the result to ``isolation.json`` in a dataset's folder."""
    write_text(folder / "isolation.json", json.dumps(to_dict(result), indent=1) + "\n")
