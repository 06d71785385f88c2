"""Making runs: by processes of this machine, on a graphics card, or on a cluster."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from joblib import delayed

from faultgen.dataset.planning import Run
from faultgen.dataset.run import Stepped, make_run
from faultgen.dataset.run_file import run_provenance
from faultgen.errors import InputError, WorkerKilled
from faultgen.system.files import unfinished, writer_of
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import Progress


def on_device() -> ModuleType:
    """Import the module that needs MuJoCo Warp.

    Returns:
        The module.

    Raises:
        InputError: MuJoCo Warp is not installed.
    """
    try:
        from faultgen.dataset import on_device
    except ModuleNotFoundError as error:
        if error.name not in ("mujoco_warp", "warp"):
            raise
        raise InputError(
            "device: MuJoCo Warp is not installed; pip install 'faultgen[gpu]'"
        ) from None
    return on_device


def made(
    runs: list[Run],
    folder: Path,
    workers: int,
    scheduler: str | None,
    device: str | None,
    progress: bool,
) -> Iterator[tuple[Run, str | None]]:
    """Make runs here, on a graphics card or on a cluster.

    Args:
        runs: The runs.
        folder: The folder of the dataset.
        workers: Number of processes.
        scheduler: Address of a Dask scheduler, whose workers make the runs; or None.
        device: Name of a graphics card that simulates them; or None.
        progress: Whether to show on stderr how far the simulation is.

    Yields:
        Each run with None, or with the reason why it failed.
    """
    if device is not None:
        return _make_on_device(runs, folder / "runs", workers, device, progress)
    if scheduler is None:
        return _make_all(runs, folder / "runs", workers, progress)
    from faultgen.dataset.cluster import make_on_cluster

    return make_on_cluster(runs, folder, scheduler, progress)


def _make_on_device(
    runs: list[Run], folder: Path, workers: int, device: str, progress: bool
) -> Iterator[tuple[Run, str | None]]:
    """Simulate runs on a graphics card, batch by batch, and write their files in parallel."""
    cycles = sum(run.cycles for run in runs)
    with Progress(f"simulating on {device}", cycles, "cycle", progress) as shown:
        for batch in on_device().simulate_on(device, runs, shown.counter):
            yield from batch.failed
            yield from _make_all([run for run, _ in batch.runs], folder, workers, False, batch.runs)


def _make_all(
    runs: list[Run],
    folder: Path,
    workers: int,
    progress: bool,
    stepped: Sequence[tuple[Run, Stepped]] = (),
) -> Iterator[tuple[Run, str | None]]:
    """Make runs in parallel. Yield each run with None, or with the reason why it failed.

    If a worker process is killed, the runs that it may have been making are made again, one by one.
    Some runs may have been simulated before.
    """
    workers = min(workers, max(len(runs), 1))
    left = {run.id: run for run in runs}
    there = {run.id: cycles for run, cycles in stepped}
    cycles, made_by = sum(run.cycles for run in runs), run_provenance()
    with Progress("simulating", cycles, "cycle", progress) as shown:
        while left:
            calls = (
                delayed(make_run)(run, folder, shown.counter, there.get(run.id), made_by)
                for run in [*left.values()]
            )
            try:
                for run, reason in in_parallel(calls, workers, ordered=False):
                    del left[run.id]
                    yield run, reason
            except WorkerKilled:
                # calls begin in their order, so that the killed one is among the first
                for run in list(left.values())[:workers]:
                    del left[run.id]
                    yield _make_alone(run, folder, there.get(run.id))


def _make_alone(run: Run, folder: Path, stepped: Stepped | None) -> tuple[Run, str | None]:
    """Make a run again, whose worker process may have been killed, while no other run is made.

    Its cycles are not counted, because the killed process had counted some of them.
    """
    clear_temporary(unfinished(folder, {run.id}))
    try:
        # with two workers it has a process of its own
        (made,) = in_parallel([delayed(make_run)(run, folder, None, stepped)], 2)
    except WorkerKilled:
        clear_temporary(unfinished(folder, {run.id}))
        return run, "its worker process was killed twice, perhaps because memory ran out"
    return made


def clear_temporary(files: list[Path]) -> None:
    """Remove unfinished files after the processes that write them have ended.

    Args:
        files: The files.
    """
    for _ in range(50):
        if not any(_is_running(writer_of(file)) for file in files):
            break
        time.sleep(0.2)  # workers of a killed program end by themselves
    for file in files:
        file.unlink(missing_ok=True)


def _is_running(process: int | None) -> bool:
    if process is None or process == os.getpid() or os.name == "nt":
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True
