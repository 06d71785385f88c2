"""Generating a dataset: all runs of an experiment are made in parallel, and can be resumed.

summary = generate(experiment, "out", workers=2)
summary.done, summary.failed
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

from filelock import FileLock, Timeout
from joblib import delayed

from faultgen.dataset.experiment import Experiment, check_part, load_experiment, to_toml
from faultgen.dataset.inputs import INPUTS, keep_inputs
from faultgen.dataset.making import clear_temporary, made, on_device
from faultgen.dataset.manifest import EXPERIMENT, FLEET, Manifest, OtherLayout, part_names
from faultgen.dataset.merged_file import MERGED, only_in
from faultgen.dataset.parts import keep_whole, merge_index, part_at, part_of
from faultgen.dataset.planning import Run, check_runs, plan_runs
from faultgen.dataset.reader import Dataset, open_dataset
from faultgen.dataset.run import get_ready
from faultgen.dataset.run_file import run_provenance
from faultgen.dataset.splits import make_splits
from faultgen.errors import InputError
from faultgen.system import terminal
from faultgen.system.files import unfinished, write_text
from faultgen.system.parallel import check_workers, start_workers

KEEP = ("all", "merged")
"""Which files of the runs can be kept."""


@dataclass
class Summary:
    """What `generate` did."""

    folder: str
    """Folder of the dataset."""
    planned: int = 0
    """Number of runs in the experiment."""
    done: int = 0
    """Number of runs that were made now."""
    kept: int = 0
    """Number of runs that existed before and were kept."""
    failed: dict[str, str] = field(default_factory=dict)
    """Reasons why runs failed, by run id."""


def generate(
    experiment: Experiment | str | Path,
    out: str | Path,
    *,
    workers: int = 1,
    regenerate: bool = False,
    keep: str = "all",
    part: tuple[int, int] | None = None,
    scheduler: str | None = None,
    device: str | None = None,
    progress: bool = True,
) -> Summary:
    """Generate a dataset, or finish one that was interrupted.

    Existing runs are kept unless they are damaged. The same experiment gives the same files, bit
    for bit, for any number of workers, on the same kind of processor. On another kind, torques
    differ by less than 1e-6 of their largest value, because libraries choose other instructions.

    Args:
        experiment: The experiment, or the path of its file.
        out: Folder for the dataset. It is created if it does not exist.
        workers: Number of processes that simulate.
        regenerate: Whether to replace runs that another version of the code has made.
        keep: "all" keeps the run files and the file of all runs. "merged" removes the run files
            when the file of all runs was found intact, which halves the disk space. Run files that
            were removed before are not made again.
        part: Number of a part, from 1, and number of all parts: only the runs of this part are
            made. Parts may be made at the same time by machines that share the folder.
            `merge_parts` ends the work. With keep "all", the runs of all parts are in the same
            folder, and nothing is merged before. With keep "merged", the part has its share of the
            repetitions and is a dataset of its own in a folder such as "part-03-of-10".
        scheduler: Address of a Dask scheduler, whose workers then make the runs instead of local
            processes. They need the folder under the same path.
        device: Name of a graphics card that simulates all runs at once, such as "cuda"; the workers
            then write their files. None: the workers simulate. A dataset is finished with the same
            kind of device, because its single precision changes the last digits of torques.
        progress: Whether to show on stderr how far the simulation is.

    Returns:
        What was done. A run that fails is listed there, and does not stop the other runs. So is a
        run whose worker process was killed twice.

    Raises:
        InputError: The experiment is wrong, the folder cannot be written or holds another dataset,
            or some of its runs were made by another version of the code.
        StorageFailed: A file could not be written. The same call continues the generation.
        SimulationFailed: The scheduler was lost. The same call continues the generation.
    """
    if not isinstance(experiment, Experiment):
        experiment = load_experiment(experiment)
    check_workers(workers)
    _check_keep(keep)
    if part is not None:
        check_part(*part)
    if device is not None and scheduler is not None:
        raise InputError("device: cannot be combined with a scheduler; give one of them")
    folder, whole = Path(out), experiment
    is_own = part is not None and keep == "merged"
    if part is not None and is_own:
        experiment, folder, part = part_of(experiment, part), part_at(folder, part), None
    runs = plan_runs(experiment)
    if device is not None:
        on_device().check_runs_for(device, runs)
    own = runs if part is None else runs[part[0] - 1 :: part[1]]
    if scheduler is None and device is None and not all(_is_made(run, folder) for run in own):
        # they import modules while this process makes its checks
        start_workers(delayed(get_ready)(own[0]), min(workers, len(own)))
    for line in check_runs(runs):  # what cannot be is refused before anything is written
        if progress:
            terminal.tell(line)
    if is_own:
        keep_whole(whole, folder)
    with _locked(folder, part):
        dataset = _prepare(folder, experiment, runs, None if part is None else own)
        summary = Summary(str(folder), planned=len(own))
        again = {*dataset.missing, *(Path(name).stem for name in dataset.damaged())}
        again |= _outdated(dataset, again, regenerate, device)
        todo = [run for run in own if run.id in again]
        summary.kept = len(own) - len(todo)
        for run, reason in made(todo, folder, workers, scheduler, device, progress):
            note = folder / "runs" / f"{run.id}.failed.json"
            if reason is None:
                summary.done += 1
                note.unlink(missing_ok=True)
            else:
                summary.failed[run.id] = f"{run.label}: {reason}"
                write_text(note, json.dumps({"run": asdict(run), "reason": reason}, indent=1))
        if part is None:
            _merge(folder, keep)
    return summary


def merge_parts(out: str | Path, *, keep: str = "all", progress: bool = True) -> Summary:
    """Merge a dataset whose parts were made one by one.

    Parts that are datasets of their own stay where they are, and get a common table of all runs.

    Args:
        out: Folder of the dataset.
        keep: As in `generate`, for parts whose runs are in the same folder.
        progress: Whether to show on stderr how many parts were read.

    Returns:
        The runs that were merged, and those that failed.

    Raises:
        InputError: There is no dataset, or a run is missing or damaged.
        StorageFailed: As in `generate`.
    """
    _check_keep(keep)
    folder = Path(out)
    if part_names(folder):
        with _locked(folder):
            runs, failed = merge_index(folder, progress=progress)
        return Summary(str(folder), runs + len(failed), kept=runs, failed=failed)
    dataset = open_dataset(folder)
    with _locked(folder):
        failed = dataset.failed
        missing = [run_id for run_id in dataset.missing if run_id not in failed]
        if missing:
            raise InputError(
                f"{folder}: {len(missing)} of {len(dataset.planned)} runs are missing, such as "
                f"{missing[0]}; make them with 'faultgen generate --part' first"
            )
        _merge(folder, keep)
    kept = len(dataset.planned) - len(failed)
    return Summary(str(folder), len(dataset.planned), kept=kept, failed=failed)


def _is_made(run: Run, folder: Path) -> bool:
    return (folder / "runs" / f"{run.id}.h5").is_file()


def _check_keep(keep: str) -> None:
    if keep not in KEEP:
        raise InputError(f"keep: must be {' or '.join(KEEP)}, not '{keep}'")


def _merge(folder: Path, keep: str) -> None:
    from faultgen.dataset.merge import merge, remove_run_files  # imports pandas

    dataset = open_dataset(folder)
    merge(dataset, only_copy=keep == "merged")
    if keep == "merged":
        remove_run_files(dataset)


def _outdated(dataset: Dataset, again: set[str], regenerate: bool, device: str | None) -> set[str]:
    """Ids of the intact runs that another version of the code has made.

    Raises:
        InputError: There are such runs, and `regenerate` is false.
    """
    now = run_provenance() if device is None else on_device().device_provenance()
    others = {
        run_id: made_by
        for made_by, ids in dataset.versions().items()
        for run_id in ids
        if run_id not in again and made_by != now
    }
    if others and not regenerate:
        run_id, made_by = next(iter(others.items()))
        raise InputError(
            f"{dataset.path}: {len(others)} of {len(dataset.planned)} runs, such as {run_id}, were "
            f"made by {made_by}, but this is {now}; finish the dataset with that version, or make "
            "these runs again with --regenerate"
        )
    return set(others)


def _prepare(
    folder: Path, experiment: Experiment, runs: list[Run], part: list[Run] | None
) -> Dataset:
    """Create the folder, or check that it holds this same experiment; restore its lists.

    Unfinished files are removed; if only a part of the runs is made, those of its runs.
    """
    if (folder / FLEET).is_file():
        raise InputError(f"{folder}: holds a fleet; give another folder")
    if part_names(folder):
        raise InputError(
            f"{folder}: holds a dataset in parts; give another folder, or both --part and --keep "
            "merged"
        )
    text = to_toml(experiment)
    planned = {run.id: asdict(run) for run in runs}
    written = folder / EXPERIMENT
    old = _manifest_of(folder)
    # divisions that exist stay as they are: results that were published depend on them
    splits = old.splits if old is not None and old.splits else make_splits(planned, experiment.seed)
    manifest = Manifest(planned, hashlib.sha256(text.encode()).hexdigest(), splits)
    if old is None:
        # without a list of runs, the run files show which dataset this is
        there = {path.stem for path in folder.glob("runs/*.h5")} | only_in(folder / MERGED)
        if there - planned.keys():
            raise InputError(f"{folder}: holds runs of another dataset; give another folder")
        if not there and _differs(written, text):
            raise InputError(
                f"{folder}: holds the {EXPERIMENT} of another dataset; give another folder"
            )
    elif old.runs.keys() != planned.keys():
        raise InputError(
            f"{folder}: holds another dataset (see its {EXPERIMENT}); give another folder"
        )
    if old != manifest:
        manifest.write(folder)
    if _differs(written, text) or not written.is_file():
        write_text(written, text)
    (folder / "runs").mkdir(exist_ok=True)
    keep_inputs(folder, runs)
    if part is None:
        left = [*folder.glob(".*.tmp"), *(folder / "runs").glob(".*.tmp")]
        left += (folder / INPUTS).glob("**/.*.tmp")
    else:
        left = unfinished(folder / "runs", {run.id for run in part})
    clear_temporary(left)
    return open_dataset(folder)


def _manifest_of(folder: Path) -> Manifest | None:
    """The list of runs in a folder; None if it is missing or damaged.

    Raises:
        OtherLayout: Its runs have another layout.
    """
    try:
        return Manifest.read(folder)
    except OtherLayout:
        raise
    except InputError:
        return None


def _differs(path: Path, text: str) -> bool:
    """Whether a file exists and holds a different text."""
    return path.is_file() and path.read_bytes() != text.encode()


@contextmanager
def _locked(folder: Path, part: tuple[int, int] | None = None) -> Iterator[None]:
    """Hold the folder, or one part of its runs, for this process alone.

    Raises:
        InputError: The folder cannot be written, or another process holds it.
    """
    name = ".lock" if part is None else f".lock-{part[0]}-of-{part[1]}"
    lock = FileLock(folder / name, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise InputError(f"{folder}: another process is writing there") from None
    except OSError as error:
        if folder.is_file():
            raise InputError(f"{folder}: is a file, not a folder") from None
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        yield
    finally:
        lock.release()
