"""Which axis is worn? Isolators on a dataset.

The thesis' isolators use one number per cycle and axis, the mean |torque|, from the first cycle up
to the one in which wear reaches a level. Ours also use friction terms and temperature, and learn
from healthy cycles. If the dataset contains the noise-free signals, new sensor noise is drawn for
each of many seeds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from faultgen import plugins
from faultgen.dataset.reader import Dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.effects import HEALTHY, get_effect
from faultgen.errors import InputError
from faultgen.evaluation.calls import axis_of
from faultgen.evaluation.calls import isolate as ask
from faultgen.evaluation.isolators import ISOLATORS
from faultgen.evaluation.measurement_noise import noise_of
from faultgen.evaluation.methods import Isolator, needed, with_methods
from faultgen.evaluation.observed_runs import division_of, places
from faultgen.evaluation.outcomes import Isolation, Outcomes
from faultgen.provenance import provenance
from faultgen.system.progress import follow

LEVELS = (0.01, 0.05, 0.10, 0.15)
"""Levels of wear at which the thesis isolates."""

FEWEST = 5
"""Fewest cycles for which an answer is computed."""


def isolate(
    dataset: Dataset,
    *,
    sensors: str | None = None,
    seeds: int = 20,
    seed: int = 1000,
    levels: tuple[float, ...] = LEVELS,
    methods: Sequence[type[Isolator]] = (),
    split: str | None = None,
    progress: bool = True,
) -> Isolation:
    """Run every isolator on a dataset.

    Args:
        dataset: The dataset.
        sensors: Preset of the noise to draw. Default: 'thesis' for a dataset without noise,
            otherwise the noise that the dataset has.
        seeds: Number of noise draws for each run.
        seed: First seed of the draws.
        levels: Severities at which isolators answer.
        methods: Further isolators beside those of the table `ISOLATORS`.
        split: Division of the dataset: isolators learn from its training part and are asked about
            its test part. Default: they are asked about all runs, unless one learns from labels;
            then the division is "run".
        progress: Whether to show a progress bar on stderr.

    Returns:
        The counted answers.

    Raises:
        InputError: The dataset has no runs, or lacks the signals that new noise needs, or no run is
            long enough; a method is none, or there is no such division.
    """
    table = with_methods(ISOLATORS, Isolator, methods)  # type: ignore[type-abstract]
    split = division_of(table.values(), split)
    chosen, redraw = noise_of(dataset, sensors)
    if seeds < 1:
        raise InputError(f"seeds: must be at least 1, not {seeds}")
    require_cycles(dataset, levels)
    outcomes: dict[tuple[str, str, str, float, str], Outcomes] = {}
    unobservable: dict[str, list[int]] = {}
    left_out: dict[str, str] = {}
    short: set[float] = set()
    seen_runs: list[StoredRun] = []
    every = [(place, run) for place in places(dataset, sensors, split) for run in place.tested]
    for place, run in follow(every, "isolating", len(every), "run", progress):
        seen_runs.append(run)
        worn = tuple(int(axis) for axis in run["axes"])
        severity = run.read("cycle/severity")
        ends = list(cuts(run, levels))
        asked = levels if in_fractions(run) else ()
        short |= {a for a in asked if worn and severity.max() >= a} - {a for a, _ in ends}
        isolators, lacking = place.fitted(table, run)
        place.note_left_out(left_out, run, lacking)
        names = {"mean_abs_torque", *needed(isolators.values())}
        for seen in place.draws(run, names, seeds, seed):
            observed = np.isfinite(seen["mean_abs_torque"]).all(axis=0)
            unobservable[place.name] = [int(axis) + 1 for axis in np.flatnonzero(~observed)]
            for level, length in ends:
                for method, isolator in isolators.items():
                    key = (run["robot"], run["task"], run["effect"], level, method)
                    answer = axis_of(ask(isolator, seen, length)) + 1
                    outcomes.setdefault(key, Outcomes(*key)).add(answer, worn)
    draws = seeds if redraw else len({run["seed"] for run in seen_runs})
    too_short = ", ".join(f"{100 * level:g} %" for level in sorted(short))
    counted = list(outcomes.values())
    more = tuple(method.__module__ for method in methods)
    made_by = str(provenance("faultgen.evaluation.isolate", plugins.ISOLATORS, more=more))
    return Isolation(
        chosen, draws, redraw, counted, unobservable, too_short, left_out, made_by, split or ""
    )


def in_fractions(run: StoredRun) -> bool:
    """Whether the severity of a run is a fraction of nominal, so that levels apply to it."""
    effect = run["effect"]
    return effect == HEALTHY or (get_effect(effect).in_fractions and run["severity_units"] == "1")


class TooFewCycles(InputError):
    """No run of a dataset is long enough for an answer."""


def require_cycles(dataset: Dataset, levels: tuple[float, ...]) -> None:
    """Refuse a dataset in which no run is long enough for an answer.

    Args:
        dataset: The dataset, with at least one run.
        levels: Severities at which isolators answer.

    Raises:
        TooFewCycles: No run reaches a level after enough cycles, see `cuts`.
    """
    if any(True for run in dataset.runs for _ in cuts(run, levels)):
        return
    longest = max(int(run["cycles"]) for run in dataset.runs)
    if longest < FEWEST:
        raise TooFewCycles(
            f"{dataset.path}: every run is too short: an answer needs at least {FEWEST} cycles, "
            f"the longest run has {longest}; generate with more --cycles, in a new folder"
        )
    asked = ", ".join(f"{100 * level:g} %" for level in levels)
    raise TooFewCycles(
        f"{dataset.path}: no run gives an answer: none is healthy, and none reaches a severity of "
        f"{asked} in cycle {FEWEST} or later; generate with more --cycles or a higher --severity, "
        "in a new folder"
    )


def cuts(run: StoredRun, levels: tuple[float, ...]) -> Iterator[tuple[float, int]]:
    """Find where isolators answer: each level, and the number of cycles up to it.

    Levels that are reached after too few cycles are skipped. For a healthy run, level 0 stands for
    all cycles. For an effect whose severity is not a fraction of nominal, its final severity does.

    Args:
        run: The run.
        levels: Severities.

    Yields:
        Level and number of cycles.
    """
    severity = run.read("cycle/severity")
    worn = len(run["axes"]) > 0
    if worn and not in_fractions(run):
        levels = (float(severity.max()),)
    if not worn:
        if len(severity) >= FEWEST:
            yield 0.0, len(severity)
        return
    for level in levels:
        reached = np.flatnonzero(severity >= level * (1 - 1e-9))
        if len(reached) and reached[0] + 1 >= FEWEST:
            yield level, int(reached[0]) + 1
