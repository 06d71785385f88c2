"""All runs of a dataset in one HDF5 file.

The file also holds a table of the runs, their list, the experiment and the data card, so that it
can be read without the rest of the folder. It can be the only copy of the runs: their own files are
removed after the file of all runs was read back and compared with them.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from h5py import h5a, h5d, h5ds, h5o

from faultgen.dataset.card import data_card
from faultgen.dataset.manifest import DATA_CARD, EXPERIMENT
from faultgen.dataset.merged_file import MERGED, ONLY_COPY, index_column
from faultgen.dataset.reader import Dataset
from faultgen.dataset.tables import INDEX
from faultgen.errors import InputError, StorageFailed
from faultgen.system.files import (
    checksum_path,
    damage,
    publish,
    temporary_name,
    verify,
    write_text,
)
from faultgen.system.hdf5 import new_hdf5, open_verified


def merge(dataset: Dataset, *, only_copy: bool = False) -> Path:
    """Merge all runs into ``dataset.h5``.

    Every byte that is read is compared with the checksums of the run files, and the merged file is
    read back and compared with what was written.

    The file has a group ``runs/<id>`` with the content and attributes of each run file, and the
    root attributes ``complete``, ``n_runs`` and ``only_copy``. The group ``index`` is a table of
    the runs. The texts ``manifest``, ``experiment.toml`` and ``DATACARD.md`` are copies of files in
    the folder. A file that already holds exactly these runs is not written again.

    Args:
        dataset: The dataset.
        only_copy: Whether to remove the run files after the merged file was found intact.

    Returns:
        Path of the merged file.

    Raises:
        InputError: A run file is damaged.
        StorageFailed: A file cannot be read or written, or does not hold what was written.
    """
    path = dataset.path / MERGED
    sums = _sums(dataset, path)
    # runs that have no file any more stay in the merged file
    only_copy = only_copy or not all(run.own_file for run in dataset.runs)
    table = dataset.index
    if len(table):
        table["file_sha256"] = [sums[i] for i in table["run"]]
    texts = {
        "manifest": dataset.manifest.text(),
        EXPERIMENT: (dataset.path / EXPERIMENT).read_text(encoding="utf-8"),
        DATA_CARD: data_card(dataset.runs, table, dataset.manifest),
    }
    told = json.dumps([sums, dataset.missing, only_copy, texts])
    content = hashlib.sha256(told.encode()).hexdigest()
    if not _holds(path, content):
        _write(dataset, path, content, only_copy, table, texts)
    card = dataset.path / DATA_CARD
    if not card.is_file() or card.read_bytes() != texts[DATA_CARD].encode():
        write_text(card, texts[DATA_CARD])
    return path


def remove_run_files(dataset: Dataset) -> None:
    """Remove the run files of a dataset whose merged file is the only copy of the runs.

    Nothing is removed before the whole merged file was read from the disk and agreed with its
    checksum, and before every run file was found in it with its checksum.

    Args:
        dataset: The dataset, merged with ``only_copy``.

    Raises:
        StorageFailed: The merged file is damaged, or does not hold a run.
    """
    path = dataset.path / MERGED
    reason = damage(path)
    if reason is not None:
        raise StorageFailed(f"{path}: {reason}; the run files are kept")
    with open_verified(path) as merged:
        held = index_column(merged, "file_sha256") if merged.attrs[ONLY_COPY] else {}
    files = [run for run in dataset.runs if run.own_file]
    for run in files:
        if held.get(run.id) != verify(run.path):
            raise StorageFailed(f"{path}: does not hold run {run.id}; the run files are kept")
    for run_id in held:
        # the checksum goes last: alone it says nothing, and a run without one counts as damaged
        own = dataset.path / "runs" / f"{run_id}.h5"
        own.unlink(missing_ok=True)
        checksum_path(own).unlink(missing_ok=True)


def _sums(dataset: Dataset, path: Path) -> dict[str, str]:
    """The checksum that the file of each run has, or had before it was removed."""
    merged_only = [run.id for run in dataset.runs if not run.own_file]
    held: dict[str, str] = {}
    if merged_only:
        with open_verified(path) as merged:
            held = index_column(merged, "file_sha256")
    return {run.id: verify(run.path) if run.own_file else held[run.id] for run in dataset.runs}


def _holds(path: Path, content: str) -> bool:
    """Whether a merged file is intact and has this content."""
    with suppress(InputError):  # a missing or damaged file is replaced
        with open_verified(path) as file:
            return bool(file.attrs.get("content_sha256") == content)
    return False


def _write(
    dataset: Dataset,
    path: Path,
    content: str,
    only_copy: bool,
    table: pd.DataFrame,
    texts: dict[str, str],
) -> None:
    with new_hdf5(path) as (merged, sink):
        merged.attrs["content_sha256"] = content
        merged.attrs["complete"] = not dataset.missing
        merged.attrs["n_runs"] = len(dataset.runs)
        merged.attrs[ONLY_COPY] = only_copy
        for name, text in texts.items():
            merged[name] = text
        _write_index(merged.create_group("index"), table)
        for run in dataset.runs:
            with run.open(every_read=True) as file:
                copy_run(file, merged.require_group("runs"), run.id)
            sink.check()
    publish(temporary_name(path), path, sink.checksum)


def _write_index(group: h5py.Group, table: pd.DataFrame) -> None:
    """Write each column of the table of runs as an array, with a common dimension scale."""
    scale = group.create_dataset("run_number", data=np.arange(1, len(table) + 1))
    scale.attrs.update({"units": "1", "long_name": "run, from 1"})
    scale.make_scale("run_number")
    for name, column in table.items():
        values = column.to_numpy()
        kind = h5py.string_dtype() if column.dtype.kind not in "iuf" else column.dtype
        data = group.create_dataset(str(name), data=values.astype(kind), dtype=kind)
        units, long_name = INDEX.get(str(name), ("", "part of the run in this division"))
        data.attrs.update({"units": units, "long_name": long_name})
        data.dims[0].label = "run_number"
        data.dims[0].attach_scale(scale)


# attributes in which HDF5 keeps references of dimension scales, which do not survive a copy
_SCALE_REFERENCES = (b"DIMENSION_LIST", b"REFERENCE_LIST")


def copy_run(file: h5py.Group, parent: h5py.Group, name: str) -> None:
    """Copy a run file into a group without unpacking it, and attach the dimension scales again.

    The whole file is copied at once, because copying its arrays and attributes one by one takes ten
    times as long.

    Args:
        file: The run file, or its group in a merged file, open for reading.
        parent: Where the group of the run goes.
        name: Its name.
    """
    file.copy(file, parent, name=name)
    arrays = [parent[name][one].id for one in _array_names(file)]
    for array in arrays:
        for attribute in _SCALE_REFERENCES:
            if h5a.exists(array, attribute):
                h5a.delete(array, attribute)
    group = parent[name].id
    for array in arrays:
        for number in range(array.rank):
            label = h5ds.get_label(array, number)
            if label:
                h5ds.attach_scale(array, h5d.open(group, label), number)


def _array_names(file: h5py.Group) -> list[str]:
    names: list[bytes] = []
    h5o.visit(file.id, names.append)
    return [
        name.decode()
        for name in names
        if h5o.get_info(h5o.open(file.id, name)).type == h5o.TYPE_DATASET
    ]
