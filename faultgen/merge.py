"""All runs of a dataset in one HDF5 file, verified against the run files."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.dataset import Dataset, damage
from faultgen.storage import file_sha256, publish


def merge(dataset: Dataset) -> Path:
    """Merge all runs into ``dataset.h5`` and verify the merger against the run files.

    The file has a group ``runs/<id>`` with the content and attributes of each run file, and the
    root attributes ``complete`` and ``n_runs``. Where it already holds these very runs it stays.

    Returns:
        Path of the file.

    Raises:
        OSError: The merged file does not read back as the run files.
    """
    path = dataset.path / "dataset.h5"
    sums = {run.id: _checksum(run.path) for run in dataset.runs}
    content = hashlib.sha256(json.dumps([sums, dataset.missing]).encode()).hexdigest()
    if path.is_file() and not damage(path):
        with h5py.File(path, "r") as file:
            if file.attrs.get("content_sha256") == content:
                return path
    temporary = path.with_name(f".dataset.{os.getpid()}.tmp")
    try:
        with h5py.File(temporary, "w") as merged:
            merged.attrs["content_sha256"] = content
            merged.attrs["complete"] = not dataset.missing
            merged.attrs["n_runs"] = len(dataset.runs)
            for run in dataset.runs:
                with h5py.File(run.path, "r") as file:
                    group = merged.create_group(f"runs/{run.id}")
                    _copy_run(file, group)
        _verify(dataset, temporary)
        publish(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def _checksum(path: Path) -> str:
    note = path.with_suffix(path.suffix + ".sha256")
    return note.read_text().strip() if note.is_file() else file_sha256(path)


# attributes in which HDF5 keeps dimension scales; their references do not survive a copy
_SCALE_ATTRIBUTES = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST")


def _copy_run(file: h5py.File, group: h5py.Group) -> None:
    """Copy a run file into a group, compressed as it is, and attach the scales anew."""
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
    with h5py.File(merged_path, "r") as merged:
        for run in dataset.runs:
            group = merged[f"runs/{run.id}"]
            with h5py.File(run.path, "r") as file:
                for name in _array_names(file):
                    if not _same(file[name], group[name]):
                        raise OSError(f"dataset.h5: '{name}' of run {run.id} was not merged intact")


def _same(one: h5py.Dataset, other: h5py.Dataset) -> bool:
    """Equality of two arrays, stored chunk by stored chunk, without unpacking them."""
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
