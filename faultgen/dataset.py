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

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.errors import InputError
from faultgen.storage import file_sha256


@dataclass(frozen=True)
class StoredRun:
    """One run of a dataset."""

    id: str
    path: Path

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Root attributes of the run file."""
        with self._open() as file:
            return {name: plain_value(value) for name, value in file.attrs.items()}

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


def plain_value(value: Any) -> Any:
    """An attribute as Python has it: scalars of numpy become numbers."""
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
            reason = damage(path)
            if reason:
                found[str(path.relative_to(self.path))] = reason
        return found


def damage(path: Path) -> str | None:
    """What is wrong with a file that has a checksum beside it, or None."""
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
        for parameters in dataset.planned.values():
            _ = parameters["robot"], parameters["task"], parameters["seed"]
    except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
        raise InputError(f"{path / 'runs.json'}: damaged ({error})") from None
    return dataset
