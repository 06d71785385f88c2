"""Writing run files and small files so that what exists is whole.

A file is written under another name, synced, given a checksum beside it, and renamed.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np

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
    "cycle_number": ("1", "cycle, from 1"),
    "time": ("s", "time in the cycle"),
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
        """Add a dimension scale, at the root: netCDF looks for it in the groups above an array."""
        data = self._file.create_dataset(name, data=values)
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


def write_arrays(path: Path, arrays: dict[str, np.ndarray], attributes: dict[str, Any]) -> None:
    """Write arrays and root attributes as HDF5, whole or not at all; the folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with h5py.File(temporary, "w") as file:
        for name, values in arrays.items():
            file[name] = values
        file.attrs.update(attributes)
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
