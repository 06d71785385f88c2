"""Generating a dataset: every run of an experiment, in parallel, resumable.

summary = generate(experiment, "out", workers=2)
summary.done, summary.failed
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

from joblib import Parallel, delayed
from tqdm import tqdm

from faultgen.dataset import Dataset, open_dataset
from faultgen.errors import InputError, SimulationFailed
from faultgen.experiment import Experiment, Run, load_experiment, plan_runs, to_toml
from faultgen.merge import merge
from faultgen.run import make_run, nominal
from faultgen.storage import write_text


@dataclass
class Summary:
    """What a sweep did."""

    folder: str
    """Folder of the dataset."""
    planned: int = 0
    """Runs that the experiment has."""
    done: int = 0
    """Runs made now."""
    kept: int = 0
    """Runs that were there before."""
    failed: dict[str, str] = field(default_factory=dict)
    """Reason by run id."""


def generate(
    experiment: Experiment | str | Path,
    out: str | Path,
    *,
    workers: int = 1,
    progress: bool = True,
) -> Summary:
    """Make a dataset, or finish one that was begun.

    Runs that are there stay; the same experiment gives the same files, bit for bit, whatever the
    number of workers.

    Args:
        experiment: The experiment, or the path of its file.
        out: Folder for the dataset; made if it is not there.
        workers: Processes that simulate.
        progress: Show a progress bar on stderr.

    Returns:
        What was done; failed runs are in it, they do not stop the sweep.

    Raises:
        InputError: The experiment is wrong, the folder cannot be written or holds another dataset.
    """
    if not isinstance(experiment, Experiment):
        experiment = load_experiment(experiment)
    if workers < 1:
        raise InputError(f"workers: must be at least 1, not {workers}")
    runs = plan_runs(experiment)
    for robot, task, sample_period in {(r.robot, r.task, r.sample_period): None for r in runs}:
        nominal(robot, task, sample_period)  # a motion that cannot be is told before anything
    folder = Path(out)
    with _locked(folder):
        dataset = _prepare(folder, experiment, runs)
        summary = Summary(str(folder), planned=len(runs))
        waiting = set(dataset.missing)
        damaged = {Path(name).stem for name in dataset.damaged()}
        todo = [run for run in runs if run.id in waiting or run.id in damaged]
        summary.kept = len(runs) - len(todo)
        for run, reason in _make_all(todo, folder / "runs", workers, progress):
            note = folder / "runs" / f"{run.id}.failed.json"
            if reason is None:
                summary.done += 1
                note.unlink(missing_ok=True)
            else:
                summary.failed[run.id] = f"{run.label}: {reason}"
                write_text(note, json.dumps({"run": asdict(run), "reason": reason}, indent=1))
        merge(open_dataset(folder))
    return summary


def _make_all(
    runs: list[Run], folder: Path, workers: int, progress: bool
) -> Iterator[tuple[Run, str | None]]:
    """Make runs in parallel; yield each with None, or the reason for which it failed."""
    bar = tqdm(
        total=sum(run.cycles for run in runs),
        unit="cycle",
        disable=None if progress and runs else True,
        desc="simulating",
    )
    # within this process the bar moves with every cycle, else with every run
    on_cycle = bar.update if workers == 1 else None
    jobs = Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
    results = jobs(delayed(make_run)(run, folder, on_cycle) for run in runs)
    finished = 0
    with bar:
        try:
            for run, reason in results:
                finished += run.cycles
                bar.update(finished - bar.n)
                yield run, reason
        except BrokenProcessPool:
            raise SimulationFailed(
                "a worker process was killed, perhaps for want of memory; "
                "run the same command again to go on"
            ) from None


def _prepare(folder: Path, experiment: Experiment, runs: list[Run]) -> Dataset:
    """Make the folder, or check that it holds this very experiment."""
    text = to_toml(experiment)
    manifest = {"runs": {run.id: asdict(run) for run in runs}}
    written = folder / "experiment.toml"
    if (folder / "runs.json").is_file():
        if open_dataset(folder).planned.keys() != manifest["runs"].keys():
            raise InputError(
                f"{folder}: holds another dataset (see its experiment.toml); give another folder"
            )
    else:
        if written.is_file() and written.read_text() != text:
            raise InputError(f"{folder}: holds an experiment.toml of its own; give another folder")
        write_text(folder / "runs.json", json.dumps(manifest, indent=1))
    if not written.is_file():
        write_text(written, text)
    (folder / "runs").mkdir(exist_ok=True)
    for leftover in [*folder.glob(".*.tmp"), *(folder / "runs").glob(".*.tmp")]:
        leftover.unlink()
    return open_dataset(folder)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder for this process alone."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / ".lock", os.O_CREAT | os.O_RDWR)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        raise InputError(f"{folder}: another process is writing there") from None
    try:
        yield
    finally:
        os.close(handle)
