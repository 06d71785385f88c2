"""Writing run files, each of which is compared with what was written before it gets its name."""

from __future__ import annotations

import sys
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np

from faultgen.system.files import publish, temporary_name
from faultgen.system.hdf5 import new_hdf5

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
    "reference_position": ("rad", "commanded joint position, the same in every cycle"),
    "mean_abs_torque": ("N m", "mean |motor torque| at motor speeds within speed_window [rad/s]"),
    "torque_histogram": ("1", "share of time by motor torque, 12 parts of +- its limit"),
    "speed_histogram": ("1", "share of time by motor speed, 12 parts of +- its limit"),
    "angle_histogram": ("1", "share of time by joint angle, 12 parts of its range"),
    "torque_indicator": ("N m", "mean motor torque weighted by speed, exponent 10/3"),
    "speed_indicator": ("rad/s", "mean |motor speed|"),
    "index": ("1", "cycle, from 1"),
    "severity": ("1", "severity of the effect in the cycle"),
    "fault_severity": ("1", "severity of the effect in the cycle, by axis"),
    "temperature": ("degC", "gearbox temperature as measured"),
    "gearbox_temperature": ("degC", "true gearbox temperature"),
    "payload_mass": ("kg", "true mass of the payload"),
    "cycle_number": ("1", "cycle, from 1"),
    "time": ("s", "time in the cycle"),
    "axis": ("1", "axis, from 1"),
    "bin": ("1", "bin, from 1"),
}
"""Unit and long name of every array, by the last part of its name, or else by its group."""


class RunWriter:
    """Writes one run file, one cycle at a time.

    It is a context manager. The file gets its final name when the context ends without an error.
    Otherwise the file is removed.
    """

    def __init__(self, folder: Path, run_id: str, attributes: dict[str, Any], model: str) -> None:
        """Prepare the file. It is created when the context begins.

        Args:
            folder: The folder ``runs`` of the dataset.
            run_id: Name of the file, without its ending.
            attributes: Root attributes by name.
            model: MJCF text of the healthy robot.
        """
        self.path = folder / f"{run_id}.h5"
        self._context = new_hdf5(self.path)
        self._attributes = dict(attributes)
        self._model = model
        self._arrays: dict[str, h5py.Dataset] = {}
        self._cycles: dict[str, int] = {}

    def __enter__(self) -> RunWriter:
        """Create the file under a temporary name.

        Raises:
            StorageFailed: The file cannot be written.
        """
        self.file, self._sink = self._context.__enter__()
        """The HDF5 file while it is being written."""
        try:
            self.file.attrs.update(self._attributes)
            self.file["model"] = self._model
        except BaseException:
            self._context.__exit__(*sys.exc_info())
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the file, and give it its final name or remove it.

        Args:
            kind: Type of the error that ended the context, or None.
            error: That error, or None.
            trace: Its traceback, or None.

        Raises:
            StorageFailed: The disk refused a write, or does not hold what was written.
        """
        self._context.__exit__(kind, error, trace)
        if kind is None:
            publish(temporary_name(self.path), self.path, self._sink.checksum)

    def scale(self, name: str, values: np.ndarray) -> None:
        """Add a dimension scale.

        It is stored at the root of the file, because netCDF looks for the scales of an array in the
        groups above that array.

        Args:
            name: Name of the scale.
            values: Its values, shape (size of the dimension,), in the unit of `DESCRIPTIONS`.
        """
        values = np.asarray(values)
        self._new(name, (), data=values, chunks=values.shape, fletcher32=True)
        self._arrays[name].make_scale(name)

    def create(self, name: str, shape: tuple[int, ...], dtype: str, dims: tuple[str, ...]) -> None:
        """Create a compressed array, which `put` fills cycle by cycle.

        Args:
            name: Path of the array in the file.
            shape: Its shape, beginning with the number of cycles. Each cycle is one chunk.
            dtype: Type of its numbers, such as "f4".
            dims: Names of the dimension scales, one for each dimension.
        """
        chunks = (1, *shape[1:])
        self._new(name, dims, shape=shape, dtype=dtype, chunks=chunks, **_COMPRESSION)
        self._cycles[name] = 0

    def put(self, name: str, index: int, values: np.ndarray) -> None:
        """Write one cycle of an array. The cycles must be written in their order.

        Args:
            name: Path of the array in the file.
            index: Number of the cycle, from 0.
            values: Its values, of the array's shape without the dimension of the cycles.

        Raises:
            OSError: The disk refused this write or an earlier one.
            ValueError: The cycle is not the next one.
        """
        if index != self._cycles[name]:
            raise ValueError(f"{name}: cycle {index} cannot follow {self._cycles[name]} cycles")
        data = self._arrays[name]
        data[index] = np.asarray(values, data.dtype)
        self._sink.check()
        self._cycles[name] += 1

    def add(
        self, name: str, values: np.ndarray, dims: tuple[str, ...], units: str | None = None
    ) -> None:
        """Write a small array at once.

        Args:
            name: Path of the array in the file.
            values: Its values, with one dimension for each name in `dims`.
            dims: Names of the dimension scales, one for each dimension.
            units: SI unit of the values, if it differs from that in `DESCRIPTIONS`.
        """
        values = np.asarray(values)
        self._new(name, dims, data=values, fletcher32=True)
        if units is not None:
            self.describe(name, units=units)

    def describe(self, name: str, **attributes: Any) -> None:
        """Add attributes to an array, or replace some.

        Args:
            name: Path of the array in the file.
            **attributes: Values of the attributes by name.
        """
        self._arrays[name].attrs.update(attributes)

    def _new(self, name: str, dims: tuple[str, ...], **how: Any) -> None:
        data = self.file.create_dataset(name, **how)
        parts = name.split("/")
        units, long_name = DESCRIPTIONS[parts[-1] if parts[-1] in DESCRIPTIONS else parts[-2]]
        data.attrs.update({"units": units, "long_name": long_name})
        for axis, scale in enumerate(dims):
            data.dims[axis].label = scale
            data.dims[axis].attach_scale(self._arrays[scale])
        self._arrays[name] = data
