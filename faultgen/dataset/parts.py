"""Making a dataset in parts, each of which is a dataset of its own with one file of all its runs.

A dataset can have a million runs, but a folder with a million files is of little use. Each part
therefore has its own folder and keeps only its file ``dataset.h5``, with some thousand runs. A part
has its own repetitions of all runs of the experiment, so that no two parts share a seed.

    generate(experiment, "out", part=(3, 500), keep="merged")   # writes out/part-003-of-500
    merge_parts("out")                                          # writes out/index.h5
"""

from __future__ import annotations

import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from faultgen.dataset.experiment import Experiment, make_experiment, to_toml
from faultgen.dataset.manifest import EXPERIMENT, FILE, SCHEMA_VERSION, part_names
from faultgen.dataset.merged_file import MERGED, values_of
from faultgen.dataset.parted import PARTS_INDEX, Part, open_parts
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.tables import INDEX
from faultgen.errors import InputError
from faultgen.system.files import (
    READERS,
    named_failures,
    publish,
    temporary_name,
    verify,
    write_text,
)
from faultgen.system.hdf5 import new_hdf5, open_verified
from faultgen.system.progress import follow

_COMPRESSED = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
_COLUMNS = {**INDEX, "part": ("1", "number of the part that holds the run, from 1")}
_FILES = ("model_sha256", "task_sha256", "sensors_sha256")


def part_of(experiment: Experiment, part: tuple[int, int]) -> Experiment:
    """Return the experiment of one part.

    Args:
        experiment: The experiment of all parts.
        part: Number of the part, from 1, and number of all parts.

    Returns:
        The experiment with the repetitions of that part.

    Raises:
        InputError: The experiment is that of a part, or has fewer repetitions than parts.
    """
    if experiment.part is not None:
        raise InputError("part: the experiment is that of a part already; leave out --part")
    return make_experiment({**tomllib.loads(to_toml(experiment)), "part": list(part)})


def part_at(folder: Path, part: tuple[int, int]) -> Path:
    """The folder of a part.

    Args:
        folder: The folder of the dataset.
        part: Number of the part, from 1, and number of all parts.
    """
    number, count = part
    return folder / f"part-{number:0{len(str(count))}}-of-{count}"


def keep_whole(experiment: Experiment, own: Path) -> None:
    """Write the experiment of all parts, or check that the folder holds parts of the same one.

    Machines may do so at the same time, because they write the same bytes.

    Args:
        experiment: The experiment of all parts.
        own: The folder of a part.

    Raises:
        InputError: The folder holds another dataset, or was divided into another number of parts.
        StorageFailed: The experiment cannot be written.
    """
    folder, text = own.parent, to_toml(experiment)
    if (folder / FILE).exists() or (folder / MERGED).exists():
        raise InputError(f"{folder}: holds a dataset that has no parts; give another folder")
    count = own.name.rpartition("-")[2]
    for name in part_names(folder):
        if name.rpartition("-")[2] != count:
            raise InputError(f"{folder}: holds {name}, so a part cannot be one of {count}")
    written = folder / EXPERIMENT
    if written.is_file():
        if written.read_bytes() != text.encode():
            raise InputError(f"{folder}: holds parts of another experiment; give another folder")
        return
    with named_failures(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_text(written, text)


def planned_parts(folder: Path) -> dict[str, bool]:
    """Names of all parts that a dataset should have, and whether each has its file of all runs.

    Args:
        folder: The folder of the dataset, which has at least one part.
    """
    count = int(part_names(folder)[0].rpartition("-")[2])
    places = [part_at(folder, (number, count)) for number in range(1, count + 1)]
    return {place.name: (place / MERGED).is_file() for place in places}


def merge_index(folder: Path, *, progress: bool = True) -> tuple[int, dict[str, str]]:
    """Write the table of all runs of a dataset in parts.

    A part whose file has not changed since the last call is not read again.

    Args:
        folder: The folder of the dataset.
        progress: Whether to show on stderr how many parts were read.

    Returns:
        The number of runs, and the reasons why runs failed, by their ids.

    Raises:
        InputError: A part is missing, unfinished or damaged, or was made from other files.
        StorageFailed: The table cannot be written.
    """
    expected = planned_parts(folder)
    lacking = [name for name, is_there in expected.items() if not is_there]
    if lacking:
        number = list(expected).index(lacking[0]) + 1
        raise InputError(
            f"{folder}: {len(lacking)} of {len(expected)} parts are missing or unfinished, such as "
            f"{lacking[0]}; make them with 'faultgen generate --keep merged --part "
            f"{number}/{len(expected)}' and so on"
        )
    known = _known(folder)
    with ThreadPoolExecutor(READERS) as pool:
        reading = pool.map(lambda name: _read(folder, name, known), expected)
        read = list(follow(reading, "reading", len(expected), "part", progress))
    for one in read[1:]:
        if one.made_from != read[0].made_from:
            raise InputError(
                f"{folder / one.part.name}: was made from another robot, task or sensors file than "
                f"{read[0].part.name}; make one of them again in an empty folder"
            )
    failed = {run_id: reason for one in read for run_id, reason in one.failed.items()}
    runs = sum(one.part.runs for one in read)
    if not runs:
        raise InputError(
            f"{folder}: every run failed, such as {': '.join(next(iter(failed.items())))}"
        )
    _write(folder, read)
    return runs, failed


@dataclass(frozen=True)
class _Read:
    """A part that was read."""

    part: Part
    table: pd.DataFrame
    failed: dict[str, str]
    made_from: set[tuple[str, ...]]


def _known(folder: Path) -> dict[str, tuple[Part, pd.DataFrame]]:
    """Parts that the present table holds, with their rows."""
    with suppress(InputError):  # a missing or damaged table is written anew
        old = open_parts(folder)
        rows = {number: of for number, of in old.index.groupby("part")}
        return {
            part.name: (part, rows[number].drop(columns="part"))
            for number, part in enumerate(old.parts, start=1)
            if part.runs
        }
    return {}


def _read(folder: Path, name: str, known: dict[str, tuple[Part, pd.DataFrame]]) -> _Read:
    path = folder / name / MERGED
    dataset = open_dataset(folder / name)
    made_from = {tuple(run.get(key, "") for key in _FILES) for run in dataset.planned.values()}
    part, table = known.get(name, (None, pd.DataFrame()))
    if part is not None and part.change(folder) is None:
        return _Read(part, table, dataset.failed if part.failed else {}, made_from)
    checksum, failed = verify(path), dataset.failed
    with open_verified(path) as file:
        complete = int(file.attrs["n_runs"]) + len(failed) == len(dataset.planned)
        table = _table_of(file)
    if not complete:
        raise InputError(f"{folder / name}: is unfinished; run its generate command again")
    cycles = int(table["cycles"].sum()) if len(table) else 0
    part = Part(name, len(table), cycles, len(failed), path.stat().st_size, checksum)
    return _Read(part, table, failed, made_from)


def _table_of(file: h5py.File) -> pd.DataFrame:
    """The table of runs of a part, without the checksums of files that no longer exist."""
    names = [name for name in file["index"] if name not in ("file_sha256", "run_number")]
    return pd.DataFrame({name: values_of(file["index"][name]) for name in names})


def _write(folder: Path, read: list[_Read]) -> None:
    path = folder / PARTS_INDEX
    frames = [one.table.assign(part=np.int32(k)) for k, one in enumerate(read, start=1)]
    table = pd.concat([frame for frame in frames if len(frame)], ignore_index=True)
    table = table[sorted(table.columns, key=_place)]
    with new_hdf5(path) as (file, sink):
        file.attrs["schema_version"] = SCHEMA_VERSION
        file.attrs["n_runs"] = len(table)
        file[EXPERIMENT] = (folder / EXPERIMENT).read_text(encoding="utf-8")
        parts = file.create_group("parts")
        for field in fields(Part):
            values = [asdict(one.part)[field.name] for one in read]
            parts.create_dataset(field.name, data=values)
        index, categories = file.create_group("index"), file.create_group("categories")
        index.attrs["columns"] = list(table.columns)
        for name in table:
            column = table[name]
            if name == "run":
                values = column.to_numpy().astype("S16")
            elif column.dtype.kind in "iuf":
                values = column.to_numpy()
            else:
                values, names = pd.factorize(column.astype(object).fillna(""))
                categories.create_dataset(name, data=names, dtype=h5py.string_dtype())
                values = values.astype(np.min_scalar_type(max(len(names), 1)))
            stored = index.create_dataset(name, data=values, chunks=True, **_COMPRESSED)
            units, text = _COLUMNS.get(name, ("", "part of the run in this division"))
            stored.attrs.update({"units": units, "long_name": text})
        sink.check()
    publish(temporary_name(path), path, sink.checksum)


def _place(column: str) -> tuple[int, str]:
    """Where a column of the table goes: those of `INDEX` first, then the divisions."""
    order = ["run", "part", *INDEX]
    return (order.index(column) if column in order else len(order), column)
