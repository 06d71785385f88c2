"""One run of a dataset, in its own file or in the file of all runs.

run = StoredRun.at(Path("out/runs/0123456789abcdef.h5"))
run["axis"], run.read("monitoring/mean_abs_torque").shape
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from faultgen.dataset.manifest import FILE, check_layout
from faultgen.dataset.merged_file import MERGED, only_in
from faultgen.errors import InputError
from faultgen.provenance import Provenance
from faultgen.system.arrays import plain_value
from faultgen.system.hdf5 import open_verified

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class StoredRun:
    """One run of a dataset."""

    id: str
    """Id of the run, 16 hexadecimal digits."""
    path: Path
    """Path of the run file, or of the file of all runs."""
    group: str = "/"
    """Group of the file that holds the run."""

    @classmethod
    def at(cls, path: Path) -> StoredRun:
        """Return the run of a run file, also if only the file of all runs still holds it.

        Args:
            path: Path that the run file has, or had before only the file of all runs was kept.
        """
        folder, merged = path.parent.parent, path.parent.parent / MERGED
        if not path.is_file() and path.parent.name == "runs":
            is_alone = not (folder / FILE).exists()  # dataset.h5 was copied without its folder
            if path.stem in only_in(merged, whatever_it_says=is_alone):
                return cls(path.stem, merged, f"runs/{path.stem}")
        return cls(path.stem, path)

    @property
    def own_file(self) -> bool:
        """Whether the run has a file of its own."""
        return self.group == "/"

    @contextmanager
    def open(self, *, every_read: bool = False) -> Iterator[h5py.Group]:
        """Open the run for reading.

        Args:
            every_read: As in `faultgen.system.hdf5.open_verified`.

        Yields:
            The group that has the arrays and attributes of the run.

        Raises:
            InputError: The file is damaged, does not hold the run, or has another layout.
        """
        with open_verified(self.path, every_read=every_read) as file:
            if self.group not in file:
                raise InputError(f"{self.path}: does not hold the run {self.id}")
            version = file[self.group].attrs.get("schema_version")
            if version is not None:  # every run has it; other files are refused by what they lack
                check_layout(plain_value(version), self.path)
            yield file[self.group]

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Root attributes of the run."""
        with self.open() as run:
            return {name: plain_value(value) for name, value in run.attrs.items()}

    @cached_property
    def made_by(self) -> Provenance:
        """The versions and the code that made the run."""
        with self.open() as run:  # `attributes` would read all of them
            return Provenance.of(run.attrs)

    def __getitem__(self, name: str) -> Any:
        return self.attributes[name]

    def read(self, name: str, select: Any = ()) -> np.ndarray:
        """Read an array of the run, or a part of it.

        Args:
            name: Path of the array in the file, such as 'monitoring/mean_abs_torque'.
            select: Index of the part to read, as for an h5py dataset; by default all of it is read.

        Returns:
            The array or its part. The shape is that in the file, most often (cycles, n_axes) or
            (cycles, samples, n_axes), and the unit is in the attribute ``units`` of the array in
            the file.

        Raises:
            InputError: There is no such array in this run.
        """
        with self.open() as run:
            if name not in run:
                raise InputError(f"{self.path}: holds no '{name}'")
            return run[name][select]

    def __contains__(self, name: str) -> bool:
        with self.open() as run:
            return name in run

    def to_xarray(self) -> xr.Dataset:
        """Return all arrays of the run as an xarray dataset.

        Returns:
            The arrays, named as in the file, with their units. Their coordinates are the cycle, the
            time in the cycle [s], the axis and the bin, all of them as in the file.

        Raises:
            InputError: xarray is not installed.
        """
        from faultgen.dataset.tables import run_to_xarray

        with self.open() as run:
            return run_to_xarray(run)
