"""All runs of a dataset in one HDF5 file, verified against the run files."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.dataset.reader import Dataset
from faultgen.errors import InputError, StorageFailed
from faultgen.system.files import publish, temporary_name, verify
from faultgen.system.hdf5 import new_hdf5, open_verified


def merge(dataset: Dataset) -> Path:
    """Merge all runs into ``dataset.h5`` and compare the merged file with the run files.

    The file has a group ``runs/<id>`` with the content and attributes of each run file, and the
    root attributes ``complete`` and ``n_runs``. A file that already holds exactly these runs is not
    written again.

    Args:
        dataset: The dataset.

    Returns:
        Path of the merged file.

    Raises:
        InputError: A run file is damaged.
        StorageFailed: The merged file cannot be written, or differs from the run files when it is
            read back.
    """
    path = dataset.path / "dataset.h5"
    sums = {run.id: verify(run.path) for run in dataset.runs}
    content = hashlib.sha256(json.dumps([sums, dataset.missing]).encode()).hexdigest()
    with suppress(InputError):  # a missing or damaged file is replaced
        with open_verified(path) as file:
            if file.attrs.get("content_sha256") == content:
                return path
    temporary = temporary_name(path)
    with new_hdf5(path) as (merged, sink):
        merged.attrs["content_sha256"] = content
        merged.attrs["complete"] = not dataset.missing
        merged.attrs["n_runs"] = len(dataset.runs)
        for run in dataset.runs:
            with open_verified(run.path) as file:
                copy_run(file, merged.create_group(f"runs/{run.id}"))
            sink.check()
    try:
        _verify(dataset, temporary)
        publish(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


# attributes in which HDF5 keeps dimension scales; their references do not survive a copy
_SCALE_ATTRIBUTES = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST")


def copy_run(file: h5py.File, group: h5py.Group) -> None:
    """Copy a run file into a group without unpacking it, and attach the dimension scales again.

    Args:
        file: The run file, open for reading.
        group: Where its content goes.
    """
    group.attrs.update(file.attrs)
    names = _array_names(file)
    for name in names:
        folder, _, last = name.rpartition("/")
        parent = group.require_group(folder) if folder else group
        file.copy(file[name], parent, name=last, without_attrs=True)
        for key, value in file[name].attrs.items():
            if key not in _SCALE_ATTRIBUTES:
                group[name].attrs[key] = value
    for name in names:
        if file[name].is_scale:
            group[name].make_scale(name)
    for name in names:
        for dimension in group[name].dims:
            if dimension.label:
                dimension.attach_scale(group[dimension.label])


def _array_names(file: h5py.File) -> list[str]:
    names: list[str] = []

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            names.append(name)

    file.visititems(note)
    return names


def _verify(dataset: Dataset, merged_path: Path) -> None:
    """Compare the merged file with the run files, which agree with their own checksums.

    Raises:
        StorageFailed: An array or attribute differs from the run file.
    """
    with h5py.File(merged_path, "r") as merged:
        for run in dataset.runs:
            group = merged[f"runs/{run.id}"]
            with open_verified(run.path) as file:
                names = _array_names(file)
                wrong = [name for name in names if not _same(file[name], group[name])]
                wrong += [name for name in ["/", *names] if not _same_attributes(file, group, name)]
                if wrong:
                    raise StorageFailed(
                        f"{merged_path.parent / 'dataset.h5'}: '{wrong[0]}' of run {run.id} "
                        "differs from what was written"
                    )


def _same_attributes(file: h5py.File, group: h5py.Group, name: str) -> bool:
    one, other = (file, group) if name == "/" else (file[name], group[name])
    return all(
        np.array_equal(value, other.attrs[key])
        for key, value in one.attrs.items()
        if key not in _SCALE_ATTRIBUTES
    )


def _same(one: h5py.Dataset, other: h5py.Dataset) -> bool:
    """Whether two arrays are equal; their stored chunks are compared without unpacking them."""
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    if one.chunks is None:
        return np.array_equal(one[()], other[()])
    if one.id.get_num_chunks() != other.id.get_num_chunks():
        return False
    for number in range(one.id.get_num_chunks()):
        offset = one.id.get_chunk_info(number).chunk_offset
        if one.id.read_direct_chunk(offset) != other.id.read_direct_chunk(offset):
            return False
    return True
