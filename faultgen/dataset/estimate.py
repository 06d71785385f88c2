"""What a dataset will take, before it is generated: runs, time and bytes.

Short runs of each robot, task and speed are made in a temporary folder: one without a fault, one
with a fault, and one with a fault that acts between steps, if there are such runs. Their time and
the size of their files are measured, and extended to all cycles.

    estimate(load_experiment("experiment.toml"), workers=2).seconds
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from faultgen.dataset.experiment import Experiment
from faultgen.dataset.planning import Run, check_runs, plan_runs
from faultgen.dataset.run import make_run
from faultgen.effects import get_effect
from faultgen.errors import SimulationFailed
from faultgen.system.progress import follow

_SHORT, _LONG = 1, 3  # cycles of the runs that are measured
_FEW, _MANY = 200, 300  # the same if cycles are interpolated: the run has to be long enough for it
_MERGED = 2  # every run is stored twice: in its own file and in dataset.h5


@dataclass(frozen=True)
class Estimate:
    """What a dataset will take."""

    runs: int
    """Number of runs."""
    cycles: int
    """Number of cycles of all runs."""
    seconds: float
    """Estimated time of the generation [s] on this machine, with the given number of workers."""
    bytes: int
    """Estimated size of the dataset, with its merged file."""


def estimate(experiment: Experiment, *, workers: int = 1, progress: bool = True) -> Estimate:
    """Estimate what a dataset will take. Nothing is left on the disk.

    Args:
        experiment: The experiment.
        workers: Number of processes that would simulate.
        progress: Whether to show on stderr how far the measurement is.

    Returns:
        The estimate. The time assumes that each worker has a processor core of its own.

    Raises:
        InputError: The experiment is wrong.
        SimulationFailed: A run that was measured diverges.
    """
    runs = plan_runs(experiment)
    check_runs(runs)
    kinds: dict[tuple[str, str, float | None, bool, bool], list[Run]] = {}
    for run in runs:
        stepped = any(get_effect(one.effect).between is not None for one in run.faults)
        kind = (run.robot, run.task, run.operation.speed, bool(run.axes), stepped)
        kinds.setdefault(kind, []).append(run)
    seconds, size = 0.0, 0.0
    for of in follow(list(kinds.values()), "measuring", len(kinds), "run", progress):
        lengths = _lengths(of[0])
        if of[0].interpolated:
            _measured(of[0], lengths[0])  # later runs use its simulated cycles
        measured = [_measured(of[0], cycles) for cycles in lengths]
        first, rate = _line(lengths, [one[0] for one in measured])
        head, growth = _line(lengths, [one[1] for one in measured])
        seconds += sum(first + rate * run.cycles for run in of)
        size += _MERGED * sum(head + growth * run.cycles for run in of)
    return Estimate(
        runs=len(runs),
        cycles=sum(run.cycles for run in runs),
        seconds=seconds / max(1, min(workers, len(runs))),
        bytes=round(size),
    )


def _lengths(run: Run) -> tuple[int, int]:
    """Cycles of two runs that are measured instead of a run."""
    if not run.interpolated:
        return _SHORT, _LONG
    few = min(_FEW, run.cycles)
    return few, max(few + 1, min(_MANY, run.cycles))


def _measured(run: Run, cycles: int) -> tuple[float, float]:
    """Time [s] and size [bytes] of a run with few cycles, of which each has another severity."""
    growing = isinstance(run.schedule, str)
    schedule = "linear" if growing else (run.schedule * cycles)[:cycles]
    short = replace(run, cycles=cycles, schedule=schedule)
    with tempfile.TemporaryDirectory(prefix="faultgen-estimate-") as folder:
        started = time.monotonic()
        _, reason = make_run(short, Path(folder))
        took = time.monotonic() - started
        if reason is not None:
            raise SimulationFailed(f"{short.label}: {reason}")
        return took, sum(file.stat().st_size for file in Path(folder).iterdir())


def _line(lengths: Sequence[int], measured: Sequence[float]) -> tuple[float, float]:
    """Value at 0 cycles, and growth per cycle, neither below 0."""
    growth = max(0.0, (measured[1] - measured[0]) / (lengths[1] - lengths[0]))
    return max(0.0, measured[0] - lengths[0] * growth), growth
