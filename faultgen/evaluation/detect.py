"""Is anything worn? Detectors on a dataset.

Detectors learn from healthy cycles, and their limits are set to about one false alarm in a thousand
cycles. A run counts as detected at a level of wear if there was an alarm in any cycle up to the one
that reaches this level. Early false alarms count too, so that the share of healthy runs with an
alarm is reported as well.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgen import plugins
from faultgen.dataset.reader import Dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.evaluation.calls import alarms
from faultgen.evaluation.detectors import DETECTORS, RUN_LENGTH
from faultgen.evaluation.isolate import LEVELS, cuts, require_cycles
from faultgen.evaluation.measurement_noise import noise_of
from faultgen.evaluation.methods import CYCLES, Detector, needed, with_methods
from faultgen.evaluation.observed_runs import division_of, places
from faultgen.evaluation.outcomes import method_tables, other_effects, tested_on
from faultgen.evaluation.shares import share
from faultgen.provenance import provenance
from faultgen.system.files import write_text
from faultgen.system.progress import follow
from faultgen.system.terminal import visible


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
    made_by: str
    """Versions and code that made the result, with that of detectors of other packages."""
    split: str = ""
    """Division by which the methods were tested; empty if they were asked about all runs."""


def detect(
    dataset: Dataset,
    *,
    sensors: str | None = None,
    seeds: int = 20,
    seed: int = 1000,
    levels: tuple[float, ...] = LEVELS,
    methods: Sequence[type[Detector]] = (),
    split: str | None = None,
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
        methods: Further detectors beside those of the table `DETECTORS`.
        split: Division of the dataset, as for `faultgen.evaluation.isolate.isolate`.
        progress: Whether to show a progress bar on stderr.

    Returns:
        Counts of alarms.

    Raises:
        InputError: The dataset has no runs, or lacks the signals that new noise needs, or no run is
            long enough, or there are no healthy cycles to learn from; a method is none, or there is
            no such division.
    """
    listed = with_methods(DETECTORS, Detector, methods)  # type: ignore[type-abstract]
    split = division_of(listed.values(), split)
    chosen, redraw = noise_of(dataset, sensors)
    if seeds < 1:
        raise InputError(f"seeds: must be at least 1, not {seeds}")
    require_cycles(dataset, levels)
    of_cycles = {name: one for name, one in listed.items() if CYCLES in one.rows}
    outcomes: dict[tuple[str, str, str, float, str], list[bool]] = {}
    left_out: dict[str, str] = {}
    learned: dict[str, int] = {}
    seen_runs: list[StoredRun] = []
    every = [(place, run) for place in places(dataset, sensors, split) for run in place.tested]
    for place, run in follow(every, "detecting", len(every), "run", progress):
        seen_runs.append(run)
        detectors, lacking = place.fitted(of_cycles, run)
        place.note_left_out(left_out, run, lacking)
        names = needed(detectors.values())
        if detectors:
            learned[place.name] = place.healthy_cycles(run)
        ends = list(cuts(run, levels))
        for seen in place.draws(run, names, seeds, seed) if detectors else ():
            for name, detector in detectors.items():
                over = alarms(detector, seen)
                for level, length in ends:
                    row = (run["robot"], run["task"], run["effect"], level, name)
                    outcomes.setdefault(row, []).append(bool(over[:length].any()))
    if not outcomes:
        raise InputError(f"{dataset.path}: {next(iter(left_out.values()))}")
    rows = []
    for (robot, task, effect, level, method), found in outcomes.items():
        told = share(sum(found), len(found))
        row_of = {"robot": robot, "task": task, "effect": effect, "level": level, "method": method}
        rows.append({**row_of, "alarms": told.pop("right"), **told})
    draws = seeds if redraw else len({run["seed"] for run in seen_runs})
    groups = (plugins.ISOLATORS, plugins.DETECTORS)
    more = tuple(method.__module__ for method in methods)
    made_by = str(provenance("faultgen.evaluation.detect", *groups, more=more))
    return Detection(chosen, draws, redraw, rows, learned, left_out, made_by, split or "")


def detection_table(result: Detection) -> str:
    """Return Markdown tables of the alarms: methods by wear."""
    cells, count = {}, {}
    for row in result.results:
        key = (row["robot"], row["task"], row["effect"], row["level"])
        share, low, high = (100 * row[name] for name in ("share", "low", "high"))
        cells[key, row["method"]] = f"{share:.0f} [{low:.0f}, {high:.0f}]"
        count[key] = row["total"]
    names = list(dict.fromkeys(row["method"] for row in result.results))
    said = [
        "Runs with an alarm up to that severity, percent of n runs [95 % Wilson interval]; "
        f"'{visible(result.sensors)}' noise. Healthy: over all cycles. Limits are those of one "
        f"false alarm in {RUN_LENGTH:g} cycles if the healthy spread were known; learned from few "
        "cycles they alarm more often. Learned from: "
        + ", ".join(
            visible(f"{where} {count} cycles") for where, count in result.healthy_cycles.items()
        )
        + "."
        + tested_on(result.split),
    ]
    said += method_tables(cells, names, count)
    said += [visible(f"{place}: {reason}") for place, reason in result.left_out.items()]
    said += other_effects(row["effect"] for row in result.results)
    return "\n\n".join(said)


def save_detection(result: Detection, folder: Path) -> None:
    """Write the result to ``detection.json`` in a dataset's folder.

    Args:
        result: The result.
        folder: Folder of the dataset.
    """
    write_text(folder / "detection.json", json.dumps(vars(result), indent=1) + "\n")
