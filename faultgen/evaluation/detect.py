"""Is anything worn? Detectors on a dataset.

Detectors learn from healthy cycles, and their limits are set to about one false alarm in a thousand
cycles. A run counts as detected at a level of wear if there was an alarm in any cycle up to the one
that reaches this level. Early false alarms count too, so that the share of healthy runs with an
alarm is reported as well.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from faultgen.analysis.detection import CUSUMChart, EWMAChart
from faultgen.analysis.divergence import kl_divergence
from faultgen.analysis.isolation import ChangeIsolator
from faultgen.analysis.pca import PCAMonitor
from faultgen.dataset.reader import Dataset
from faultgen.errors import InputError
from faultgen.evaluation.isolate import LEVELS, cuts, require_cycles
from faultgen.evaluation.markdown import percent, table
from faultgen.evaluation.observed_runs import ObservedRun, Place, noise_of, places
from faultgen.evaluation.outcomes import other_effects, shown_level
from faultgen.evaluation.shares import share
from faultgen.evaluation.wear_model import ISOLATORS, isolator_input
from faultgen.system.files import write_text

RUN_LENGTH = 1000.0
"""Mean number of cycles between false alarms for which detectors are set."""

DETECTORS = {
    "KL + PCA, Q": "KL divergence of each axis' torque histogram from the healthy one; Q of a PCA",
    "PCA, T² and Q": "mean |torque| of all axes, and the temperature where it is measured",
    "EWMA": "mean |torque| of each axis, two-sided charts",
    "CUSUM": "mean |torque| of each axis, two-sided charts",
    **ISOLATORS,
}
"""Name and idea of every detector."""

Alarm = Callable[[ObservedRun], np.ndarray]
"""Finds the cycles in alarm, shape (cycles,)."""


@dataclass(frozen=True)
class Detection:
    """Results of the detectors on a dataset."""

    sensors: str
    """Name of the noise in the data."""
    seeds: int
    """Number of noise draws for each run."""
    redrawn: bool
    """Whether new noise was drawn, instead of using the noise of the dataset."""
    results: list[dict[str, Any]]
    """Counts by robot, task, effect, level (0: healthy, over all cycles) and method."""
    healthy_cycles: dict[str, int]
    """Number of cycles from which the detectors learned, by robot and task."""
    left_out: dict[str, str]
    """Why detectors were not used, by robot and task."""


def detect(
    dataset: Dataset,
    *,
    sensors: str | None = None,
    seeds: int = 20,
    seed: int = 1000,
    levels: tuple[float, ...] = LEVELS,
    progress: bool = True,
) -> Detection:
    """Run every detector on a dataset.

    Args:
        dataset: The dataset.
        sensors: Preset of the noise to draw. Default: 'thesis' for a dataset without noise,
            otherwise the noise that the dataset has.
        seeds: Number of noise draws for each run.
        seed: First seed of the draws.
        levels: Severities up to which alarms are counted.
        progress: Whether to show a progress bar on stderr.

    Returns:
        Counts of alarms.

    Raises:
        InputError: The dataset has no runs, or lacks the signals that new noise needs, or no run is
            long enough, or there are no healthy cycles to learn from.
    """
    chosen, redraw = noise_of(dataset, sensors)
    if seeds < 1:
        raise InputError(f"seeds: must be at least 1, not {seeds}")
    require_cycles(dataset, levels)
    counts: dict[tuple[str, str, str, float, str], list[bool]] = {}
    left_out: dict[str, str] = {}
    learned: dict[str, int] = {}
    shown = None if progress else True
    bar = tqdm(total=len(dataset.runs), unit="run", desc="detecting", disable=shown)
    for place in places(dataset, sensors):
        fitted: dict[int, dict[str, Alarm]] = {}
        for run in place.runs:
            key = 0 if redraw else int(run["seed"])
            if key not in fitted:
                isolators = place.isolators(run)
                where = f"{place.robot}/{place.task}"
                if place.lacking(run):
                    left_out[where] = place.lacking(run)
                fitted[key] = {}
                if not isinstance(isolators, str):
                    healthy = place.healthy(run)
                    fitted[key] = _fit(place, healthy, isolators)
                    learned[where] = sum(len(seen.mean_torque) for seen in healthy)
            ends = list(cuts(run, levels))
            for seen in place.draws(run, seeds, seed) if fitted[key] else ():
                for name, alarm in fitted[key].items():
                    over = alarm(seen)
                    for level, length in ends:
                        row = (run["robot"], run["task"], run["effect"], level, name)
                        counts.setdefault(row, []).append(bool(over[:length].any()))
            bar.update()
    bar.close()
    if not counts:
        raise InputError(f"{dataset.path}: {next(iter(left_out.values()))}")
    rows = []
    for (robot, task, effect, level, method), found in counts.items():
        told = share(sum(found), len(found))
        row_of = {"robot": robot, "task": task, "effect": effect, "level": level, "method": method}
        rows.append({**row_of, "alarms": told.pop("right"), **told})
    draws = seeds if redraw else len({run["seed"] for run in dataset.runs})
    return Detection(chosen, draws, redraw, rows, learned, left_out)


def _fit(
    place: Place, healthy: list[ObservedRun], isolators: dict[str, ChangeIsolator]
) -> dict[str, Alarm]:
    """Every detector, fitted."""
    varies = place.temperature_varies
    confidence = 1 - 1 / RUN_LENGTH
    torque = np.nan_to_num(np.vstack([seen.mean_torque for seen in healthy]))
    n_axes = torque.shape[1]
    counted = np.sum([seen.torque_counts.sum(axis=0) for seen in healthy], axis=0)

    def divergence(seen: ObservedRun) -> np.ndarray:
        return kl_divergence(seen.torque_counts, counted, smoothing=0.5)

    def with_temperature(seen: ObservedRun) -> np.ndarray:
        values = np.nan_to_num(seen.mean_torque)
        return np.hstack([values, seen.temperature[:, None]]) if varies else values

    by_kl = PCAMonitor(n_components=0.75, confidence=confidence)
    by_kl.fit(np.vstack([divergence(seen) for seen in healthy]))
    by_torque = PCAMonitor(n_components=0.9, confidence=confidence)
    by_torque.fit(np.vstack([with_temperature(seen) for seen in healthy]))
    moving = np.flatnonzero(np.ptp(torque, axis=0) > 0)
    run_length = RUN_LENGTH * n_axes
    charts = {
        "EWMA": [EWMAChart(in_control_run_length=run_length, two_sided=True) for _ in moving],
        "CUSUM": [CUSUMChart(in_control_run_length=run_length, two_sided=True) for _ in moving],
    }
    for chosen in charts.values():
        for axis, chart in zip(moving, chosen, strict=True):
            chart.fit(torque[:, axis])

    def charted(name: str) -> Alarm:
        def alarm(seen: ObservedRun) -> np.ndarray:
            values = np.nan_to_num(seen.mean_torque)
            by_axis = [
                chart.predict(values[:, axis]) < 0
                for axis, chart in zip(moving, charts[name], strict=True)
            ]
            return np.any(by_axis, axis=0) if by_axis else np.zeros(len(values), bool)

        return alarm

    def isolated(name: str) -> Alarm:
        def alarm(seen: ObservedRun) -> np.ndarray:
            given = isolator_input(name, seen, temperature_varies=varies)
            fitted = isolators[name]
            first = fitted.window  # a full window, as it was in training
            over = [
                bool(fitted.isolate(given[:k]).worn.any()) for k in range(first, len(given) + 1)
            ]
            return np.concatenate([np.zeros(min(first - 1, len(given)), bool), over]).astype(bool)

        return alarm

    return {
        "KL + PCA, Q": lambda seen: by_kl.q(divergence(seen)) > by_kl.q_limit_,
        "PCA, T² and Q": lambda seen: by_torque.predict(with_temperature(seen)) < 0,
        **{name: charted(name) for name in charts},
        **{name: isolated(name) for name in isolators},
    }


def detection_table(result: Detection) -> str:
    """Return alarms by robot, task, effect and wear as a Markdown table."""
    keys = ("robot", "task", "effect", "level", "method")
    cells = {tuple(row[key] for key in keys): row for row in result.results}
    lines = sorted({key[:4] for key in cells}, key=lambda k: (k[0], k[1], k[3] == 0, k[2], k[3]))
    names = list(dict.fromkeys(row["method"] for row in result.results))
    shown = [
        [
            robot,
            task,
            effect,
            shown_level(effect, level),
            *(percent(cells[robot, task, effect, level, name]) for name in names),
        ]
        for robot, task, effect, level in lines
    ]
    said = [
        "Runs with an alarm up to that severity, percent [95 % Wilson interval]; "
        f"'{result.sensors}' noise. Healthy: over all cycles. Limits are those of one false alarm "
        f"in {RUN_LENGTH:g} cycles if the healthy spread were known; learned from few cycles they "
        "alarm more often. Learned from: "
        + ", ".join(f"{where} {count} cycles" for where, count in result.healthy_cycles.items())
        + ".",
    ]
    if shown:
        said.append(table(["robot", "task", "effect", "severity", *names], shown))
    said += [f"{place}: {reason}" for place, reason in result.left_out.items()]
    said += other_effects(row["effect"] for row in result.results)
    return "\n\n".join(said)


def save_detection(result: Detection, folder: Path) -> None:
    """Write the result to ``detection.json`` in a dataset's folder.

    Args:
        result: The result.
        folder: Folder of the dataset.
    """
    write_text(folder / "detection.json", json.dumps(vars(result), indent=1) + "\n")
