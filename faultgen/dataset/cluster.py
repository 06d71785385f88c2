"""Making runs on a Dask cluster: processes on several machines that share a file system.

Dask gives each run to a worker process. If a worker is killed, Dask gives its run to another one.
The workers write the run files themselves. Before a worker makes a run, it compares its version of
faultgen with that of the command, and looks for the folder of the dataset.

Dask is installed by ``pip install distributed``.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from faultgen.dataset.manifest import EXPERIMENT
from faultgen.dataset.planning import Run
from faultgen.dataset.run import make_run
from faultgen.dataset.run_file import run_provenance
from faultgen.errors import InputError, SimulationFailed, one_line
from faultgen.provenance import Provenance
from faultgen.system.files import file_sha256, unfinished
from faultgen.system.progress import Progress

if TYPE_CHECKING:
    from distributed import Client

_TIMEOUT = "20s"  # for the connection to the scheduler
_AHEAD = 1000  # runs that the scheduler knows at once; more would only cost memory


def make_on_cluster(
    runs: list[Run], folder: Path, scheduler: str, progress: bool
) -> Iterator[tuple[Run, str | None]]:
    """Make runs on the workers of a Dask scheduler.

    Args:
        runs: The runs.
        folder: The folder of the dataset, which holds its ``experiment.toml``. Every worker must
            see it under the same path.
        scheduler: Address of the scheduler, such as ``tcp://10.0.0.1:8786``.
        progress: Whether to show on stderr how far the simulation is.

    Yields:
        Each run with None, or with the reason why it failed.

    Raises:
        InputError: Dask is not installed, the scheduler cannot be reached, or a worker has another
            version of faultgen, does not see the folder, or runs several threads.
        SimulationFailed: The connection to the scheduler was lost.
        StorageFailed: A file could not be written.
    """
    try:
        from distributed import CancelledError, KilledWorker, as_completed
        from distributed.comm import CommClosedError
    except ImportError:
        raise InputError("Dask is not installed; pip install distributed") from None
    make = partial(
        _make_there,
        folder=folder.resolve(),
        directory=Path.cwd(),
        experiment=file_sha256(folder / EXPERIMENT),
        made_by=run_provenance(),
    )
    waiting, cycles = iter(runs), sum(run.cycles for run in runs)
    with _client(scheduler) as client, Progress("simulating", cycles, "cycle", progress) as shown:
        given = {client.submit(make, run, pure=False): run for run in islice(waiting, _AHEAD)}
        ended = as_completed(list(given), loop=client.loop)
        for future in ended:
            run = given.pop(future)
            try:
                reason = future.result()
            except KilledWorker:
                reason = "its worker processes were killed, perhaps because memory ran out"
            except (CancelledError, CommClosedError):
                raise SimulationFailed(
                    f"the scheduler {scheduler} was lost; run the same command again to continue"
                ) from None
            shown.counter(run.cycles)
            for following in islice(waiting, 1):
                new = client.submit(make, following, pure=False)
                given[new] = following
                ended.add(new)
            yield run, reason
    for left in unfinished(folder / "runs", {run.id for run in runs}):  # by killed workers
        left.unlink(missing_ok=True)


@contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    """Connect to a scheduler. At the end, it forgets what has not begun."""
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # failures are told in one line
    try:
        client = Client(scheduler, timeout=_TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        told = f"--scheduler {scheduler}: no Dask scheduler ({one_line(error)})"
        raise InputError(told) from None
    try:
        yield client
    finally:
        client.close()


def _make_there(
    run: Run, *, folder: Path, directory: Path, experiment: str, made_by: Provenance
) -> str | None:
    """Make a run, in a worker. Return None, or the reason why it failed.

    Args:
        run: The run.
        folder: The folder of the dataset.
        directory: The folder in which the command was called; paths of the run start there.
        experiment: Checksum of the dataset's ``experiment.toml``.
        made_by: The code that the command has.

    Raises:
        InputError: This worker cannot make runs of this dataset.
        StorageFailed: The file could not be written.
    """
    from distributed import get_worker

    worker = get_worker()
    here = f"the worker {worker.address}"
    if worker.state.nthreads > 1:
        raise InputError(
            f"{here} has {worker.state.nthreads} threads; start workers with --nthreads 1"
        )
    if run_provenance() != made_by:
        raise InputError(f"{here} has {run_provenance()}, but this is {made_by}")
    written = folder / EXPERIMENT
    if not (directory.is_dir() and written.is_file() and file_sha256(written) == experiment):
        raise InputError(f"{here} does not see {folder}; it must be a folder that machines share")
    with chdir(directory):
        return make_run(run, folder / "runs")[1]
