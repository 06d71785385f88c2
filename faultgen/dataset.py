"""Datasets on disk: run files, their merger, and how to read them.

A dataset is a folder: ``experiment.toml``, ``runs.json`` (the runs it should hold),
``runs/<id>.h5`` with a checksum beside each, and ``dataset.h5`` with all runs merged. A file is
written under another name, synced and renamed: one that exists is whole. Reading needs no
simulator.

    dataset = open_dataset("out")
    for run in dataset.runs:
        run["axis"], run["severity"], run.read("monitoring/mean_abs_torque").shape
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.errors import InputError

_COMPRESSION: dict[str, Any] = {
    "compression": "gzip",
    "compression_opts": 1,
    "shuffle": True,
    "fletcher32": True,
}

DESCRIPTIONS = {
    "motor_position": ("rad", "motor position"),
    "motor_velocity": ("rad/s", "motor velocity"),
    "motor_torque": ("N m", "motor torque"),
    "friction_torque": ("N m", "friction torque on the rotor"),
    "gear_torque": ("N m", "gearbox torque on the joint, arm side"),
    "joint_position": ("rad", "joint position, arm side"),
    "joint_velocity": ("rad/s", "joint velocity, arm side"),
    "mean_abs_torque": ("N m", "mean |motor torque| at motor speeds of 50 to 120 rad/s"),
    "torque_histogram": ("1", "share of time by motor torque, 12 parts of +- its limit"),
    "speed_histogram": ("1", "share of time by motor speed, 12 parts of +- its limit"),
    "angle_histogram": ("1", "share of time by joint angle, 12 parts of its range"),
    "torque_indicator": ("N m", "mean motor torque weighted by speed, exponent 10/3"),
    "speed_indicator": ("rad/s", "mean |motor speed|"),
    "index": ("1", "cycle, from 1"),
    "severity": ("1", "severity of the effect in the cycle"),
    "axis_severity": ("1", "severity of the effect in the cycle, by axis"),
    "temperature": ("degC", "gearbox temperature as measured"),
    "gearbox_temperature": ("degC", "true gearbox temperature"),
    "payload_mass": ("kg", "true mass of the payload"),
    "cycle": ("1", "cycle, from 1"),
    "sample": ("s", "time in the cycle"),
    "axis": ("1", "axis, from 1"),
    "bin": ("1", "bin, from 1"),
}
"""Unit and long name of every array, by the last part of its name."""


class RunWriter:
    """Writes one run file, a cycle at a time; it gets its name when it is whole."""

    def __init__(self, folder: Path, run_id: str, attributes: dict[str, Any], model: str) -> None:
        """Open a file under a temporary name.

        Args:
            folder: The folder ``runs``.
            run_id: Name of the file, without ending.
            attributes: Root attributes.
            model: MJCF text of the healthy robot.
        """
        self.path = folder / f"{run_id}.h5"
        self._temporary = folder / f".{run_id}.{os.getpid()}.tmp"
        self._file = h5py.File(self._temporary, "w")
        for name, value in attributes.items():
            self._file.attrs[name] = value
        self._file["model"] = model
        self._scales: dict[str, h5py.Dataset] = {}

    def scale(self, name: str, values: np.ndarray) -> None:
        """Add a dimension scale."""
        data = self._file.create_dataset(f"dimensions/{name}", data=values)
        _describe(data, name)
        data.make_scale(name)
        self._scales[name] = data

    def create(self, name: str, shape: tuple[int, ...], dtype: str, dims: tuple[str, ...]) -> None:
        """Create a compressed array, one chunk a cycle."""
        data = self._file.create_dataset(
            name, shape=shape, dtype=dtype, chunks=(1, *shape[1:]), **_COMPRESSION
        )
        self._label(data, name, dims)

    def put(self, name: str, index: int, values: np.ndarray) -> None:
        """Write one cycle of an array."""
        self._file[name][index] = values

    def add(self, name: str, values: np.ndarray, dims: tuple[str, ...]) -> None:
        """Write a whole small array."""
        self._label(self._file.create_dataset(name, data=values, fletcher32=True), name, dims)

    def close(self) -> str:
        """Sync the file, write its checksum beside it, and give it its name.

        Returns:
            The checksum.
        """
        self._file.close()
        return publish(self._temporary, self.path)

    def discard(self) -> None:
        """Remove the unfinished file."""
        self._file.close()
        self._temporary.unlink(missing_ok=True)

    def _label(self, data: h5py.Dataset, name: str, dims: tuple[str, ...]) -> None:
        _describe(data, name.split("/")[-1])
        for axis, scale in enumerate(dims):
            data.dims[axis].label = scale
            data.dims[axis].attach_scale(self._scales[scale])


def _describe(data: h5py.Dataset, name: str) -> None:
    data.attrs["units"], data.attrs["long_name"] = DESCRIPTIONS[name]


def publish(temporary: Path, path: Path) -> str:
    """Sync a file, write ``<path>.sha256``, rename the file to its name. Returns the checksum."""
    _sync(temporary)
    checksum = file_sha256(temporary)
    write_text(path.with_suffix(path.suffix + ".sha256"), checksum + "\n")
    os.replace(temporary, path)
    _sync(path.parent)
    return checksum


def write_text(path: Path, text: str) -> None:
    """Write a small file under another name, sync it, rename it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.write_text(text)
    _sync(temporary)
    os.replace(temporary, path)


def file_sha256(path: Path) -> str:
    """Checksum of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@dataclass(frozen=True)
class StoredRun:
    """One run of a dataset."""

    id: str
    path: Path

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Root attributes of the run file."""
        with self._open() as file:
            return {name: _plain(value) for name, value in file.attrs.items()}

    def __getitem__(self, name: str) -> Any:
        return self.attributes[name]

    def read(self, name: str, select: Any = ()) -> np.ndarray:
        """Read an array, such as 'monitoring/mean_abs_torque', whole or in part.

        Args:
            name: Path of the array in the file.
            select: What to take of it, as h5py takes it.

        Raises:
            InputError: There is no such array in this run.
        """
        with self._open() as file:
            if name not in file:
                raise InputError(f"{self.path}: holds no '{name}'")
            return file[name][select]

    def __contains__(self, name: str) -> bool:
        with self._open() as file:
            return name in file

    @contextmanager
    def _open(self) -> Iterator[h5py.File]:
        try:
            file = h5py.File(self.path, "r")
        except OSError as error:
            raise InputError(f"{self.path}: damaged or not an HDF5 file ({error})") from None
        with file:
            yield file


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


@dataclass(frozen=True)
class Dataset:
    """A dataset folder."""

    path: Path

    @cached_property
    def planned(self) -> dict[str, dict[str, Any]]:
        """Parameters of every run that belongs to the dataset, by id."""
        return json.loads((self.path / "runs.json").read_text())["runs"]

    @cached_property
    def runs(self) -> list[StoredRun]:
        """The runs that are there, in planned order."""
        every = [StoredRun(i, self.path / "runs" / f"{i}.h5") for i in self.planned]
        return [run for run in every if run.path.is_file()]

    @property
    def missing(self) -> list[str]:
        """Ids of planned runs that are not there."""
        return [i for i in self.planned if not (self.path / "runs" / f"{i}.h5").is_file()]

    @property
    def failed(self) -> dict[str, str]:
        """Why runs failed, by id."""
        reasons = {}
        for i in self.missing:
            note = self.path / "runs" / f"{i}.failed.json"
            if note.is_file():
                reasons[i] = json.loads(note.read_text())["reason"]
        return reasons

    def damaged(self) -> dict[str, str]:
        """What is wrong with files that are there, by name; reads everything.

        Returns:
            File name relative to the folder, and the reason. Empty if all is well.
        """
        found = {}
        files = [run.path for run in self.runs]
        merged = self.path / "dataset.h5"
        if merged.is_file():
            files.append(merged)
        for path in files:
            reason = _damage(path)
            if reason:
                found[str(path.relative_to(self.path))] = reason
        return found


def _damage(path: Path) -> str | None:
    note = path.with_suffix(path.suffix + ".sha256")
    if not note.is_file():
        return "its checksum is missing"
    if file_sha256(path) != note.read_text().strip():
        return "differs from its checksum"
    return None


def open_dataset(folder: str | Path) -> Dataset:
    """Open a dataset.

    Args:
        folder: Folder that `faultgen generate` wrote.

    Raises:
        InputError: The folder is no dataset.
    """
    path = Path(folder)
    if not (path / "runs.json").is_file():
        raise InputError(f"{folder}: no dataset there (no runs.json); make one: faultgen generate")
    dataset = Dataset(path)
    try:
        _ = dataset.planned
    except (ValueError, KeyError, OSError) as error:
        raise InputError(f"{path / 'runs.json'}: damaged ({error})") from None
    return dataset


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
    if path.is_file() and not _damage(path):
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
    scales = group["dimensions"]
    for name in scales:
        scales[name].make_scale(name)
    for name in names:
        for dimension in group[name].dims:
            if dimension.label:
                dimension.attach_scale(scales[dimension.label])


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
