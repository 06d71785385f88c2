"""Reading datasets: their list of runs, their run files and the file of all runs.

A dataset is a folder: ``experiment.toml``, ``runs.json`` (the runs it should hold),
``runs/<id>.h5`` with a checksum beside each, and ``dataset.h5`` with all runs merged. A file that
exists is complete, and it is compared with its checksum before it is read. Reading a dataset does
not need the simulator.

    dataset = open_dataset("out")
    for run in dataset.runs:
        run["axis"], run["severity"], run.read("monitoring/mean_abs_torque").shape
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.dataset.manifest import EXPERIMENT, Manifest
from faultgen.errors import InputError
from faultgen.provenance import Provenance
from faultgen.system.arrays import plain_value
from faultgen.system.files import damage, file_sha256
from faultgen.system.hdf5 import open_verified


@dataclass(frozen=True)
class StoredRun:
    """One run of a dataset."""

    id: str
    """Id of the run, 16 hexadecimal digits."""
    path: Path
    """Path of the run file."""

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Root attributes of the run file."""
        with open_verified(self.path) as file:
            return {name: plain_value(value) for name, value in file.attrs.items()}

    @property
    def made_by(self) -> Provenance:
        """The versions and the code that made the run."""
        return Provenance.of(self.attributes)

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
        with open_verified(self.path) as file:
            if name not in file:
                raise InputError(f"{self.path}: holds no '{name}'")
            return file[name][select]

    def __contains__(self, name: str) -> bool:
        with open_verified(self.path) as file:
            return name in file


@dataclass(frozen=True)
class Dataset:
    """A dataset folder."""

    path: Path
    """Path of the folder."""

    @cached_property
    def manifest(self) -> Manifest:
        """The list of runs that the dataset should hold.

        Raises:
            InputError: The list is missing or damaged.
        """
        return Manifest.read(self.path)

    @property
    def planned(self) -> dict[str, dict[str, Any]]:
        """Parameters of every run that belongs to the dataset, by id."""
        return self.manifest.runs

    @cached_property
    def runs(self) -> list[StoredRun]:
        """The runs whose files exist, in the order of the plan."""
        every = [StoredRun(i, self.path / "runs" / f"{i}.h5") for i in self.planned]
        return [run for run in every if run.path.is_file()]

    @property
    def missing(self) -> list[str]:
        """Ids of the planned runs whose files do not exist."""
        return [i for i in self.planned if not (self.path / "runs" / f"{i}.h5").is_file()]

    @property
    def failed(self) -> dict[str, str]:
        """The reasons why runs failed, by id."""
        reasons = {}
        for i in self.missing:
            note = self.path / "runs" / f"{i}.failed.json"
            if note.is_file():
                reasons[i] = _reason(note)
        return reasons

    def versions(self) -> dict[Provenance, list[str]]:
        """Ids of the intact runs, grouped by the versions and code that made them."""
        found: dict[Provenance, list[str]] = {}
        for run in self.runs:
            with suppress(InputError):  # a damaged file is reported by `damaged`
                found.setdefault(run.made_by, []).append(run.id)
        return found

    def damaged(self) -> dict[str, str]:
        """Find damaged files. All files of the dataset are read completely.

        Returns:
            Reasons by file name, relative to the folder; empty if no file is damaged.
        """
        files = [run.path for run in self.runs]
        merged = self.path / "dataset.h5"
        if merged.is_file():
            files.append(merged)
        reasons = {str(path.relative_to(self.path)): damage(path) for path in files}
        reasons[EXPERIMENT] = self._experiment_damage()
        return {name: reason for name, reason in reasons.items() if reason is not None}

    def _experiment_damage(self) -> str | None:
        try:
            found = file_sha256(self.path / EXPERIMENT)
        except OSError as error:
            return f"cannot be read ({error.strerror})"
        if found != self.manifest.experiment_sha256:
            return "is not the experiment that made this dataset"
        return None


def _reason(note: Path) -> str:
    """Why a run failed, from the note beside it."""
    try:
        return str(json.loads(note.read_bytes())["reason"])
    except (OSError, ValueError, KeyError, TypeError):
        return "unknown: the note about it cannot be read"


def open_dataset(folder: str | Path) -> Dataset:
    """Open a dataset.

    Every file is compared with its checksum before it is first read.

    Args:
        folder: Folder that `faultgen generate` wrote.

    Returns:
        The dataset.

    Raises:
        InputError: The folder is not a dataset, or its list of runs is damaged.
    """
    dataset = Dataset(Path(folder))
    _ = dataset.manifest
    return dataset
