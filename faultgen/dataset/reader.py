"""Reading datasets: their list of runs, their run files and the file of all runs.

A dataset is a folder: ``experiment.toml``, ``runs.json`` (the runs it should hold),
``runs/<id>.h5`` with a checksum beside each, and ``dataset.h5`` with all runs merged. A file that
exists is complete, and it is compared with its checksum before it is read. ``dataset.h5`` can be
the only copy of the runs, and can be read without the rest of the folder. Reading a dataset does
not need the simulator.

    dataset = open_dataset("out")               # or "out/dataset.h5"
    cycles = dataset.to_dataframe()
    x, y, groups = dataset.to_xy(split="train", label="axis")
    for run in dataset.runs:
        run["axis"], run["severity"], run.read("monitoring/mean_abs_torque").shape
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from faultgen.dataset.manifest import (
    DATA_CARD,
    EXPERIMENT,
    FILE,
    Manifest,
    check_exists,
    check_layout,
    is_in_parts,
    part_names,
)
from faultgen.dataset.merged_file import MERGED, made_by_of, only_in
from faultgen.dataset.splits import PARTS, SCHEMES, TEST, TRAIN, VALIDATION
from faultgen.errors import InputError
from faultgen.provenance import Provenance
from faultgen.system.arrays import plain_value
from faultgen.system.files import damages, file_sha256, verify
from faultgen.system.hdf5 import open_verified

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from faultgen.dataset.labels import SeverityLimit


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


@dataclass(frozen=True)
class Dataset:
    """A dataset folder, or a file of all runs by itself."""

    path: Path
    """Path of the folder."""
    file: Path | None = None
    """The file of all runs, if nothing else of the folder is to be read."""

    def __repr__(self) -> str:
        """One line: where it is, and how many of its runs exist."""
        where = self.file or self.path
        try:
            return f"<Dataset {where}: {len(self.runs)} of {len(self.planned)} runs>"
        except (InputError, OSError):
            return f"<Dataset {where}: cannot be read>"

    @cached_property
    def manifest(self) -> Manifest:
        """The list of runs that the dataset should hold.

        Raises:
            InputError: The list is missing or damaged.
        """
        if self.file is None:
            return Manifest.read(self.path)
        with open_verified(self.file) as merged:
            if "manifest" not in merged:
                raise InputError(
                    f"{self.file}: is not the file of a dataset, or is of an older version; give "
                    "the folder of the dataset"
                )
            return Manifest.parse(merged["manifest"][()], self.file)

    @property
    def planned(self) -> dict[str, dict[str, Any]]:
        """Parameters of every run that belongs to the dataset, by id."""
        return self.manifest.runs

    def input_of(self, run: StoredRun, what: str) -> str:
        """Find a file from which a run was made.

        Args:
            run: The run.
            what: "robot", "task" or "sensors".

        Returns:
            Its name or path; that of the copy in the folder, if the file is no longer where it was.
        """
        from faultgen.dataset.inputs import input_path

        return input_path(self.path, self.planned[run.id], what)

    @cached_property
    def runs(self) -> list[StoredRun]:
        """The runs that exist, in the order of the plan.

        A run is read from its own file if it has one.
        """
        if self.file is not None:
            with open_verified(self.file) as merged:
                held = [i for i in self.planned if i in merged["runs"]]
            return [StoredRun(i, self.file, f"runs/{i}") for i in held]
        every = {i: StoredRun(i, self.path / "runs" / f"{i}.h5") for i in self.planned}
        folder = self.path / "runs"  # listed at once: to ask for each file would take longer
        there = set(os.listdir(folder)) if folder.is_dir() else set()
        lost = {i for i in every if f"{i}.h5" not in there}
        merged_path = self.path / MERGED
        merged_only = only_in(merged_path) if lost else set()
        for i in lost:
            every[i] = StoredRun(i, merged_path, f"runs/{i}")
        return [run for i, run in every.items() if i not in lost - merged_only]

    @cached_property
    def missing(self) -> list[str]:
        """Ids of the planned runs that do not exist."""
        there = {run.id for run in self.runs}
        return [i for i in self.planned if i not in there]

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
        told = made_by_of(self.file or self.path / MERGED)
        for run in self.runs:
            with suppress(InputError):  # a damaged file is reported by `damaged`
                made_by, checksum = told.get(run.id, (None, ""))
                if made_by is None or (run.own_file and verify(run.path) != checksum):
                    made_by = run.made_by
                found.setdefault(made_by, []).append(run.id)
        return found

    def damaged(self) -> dict[str, str]:
        """Find damaged files. All files of the dataset are read completely.

        Returns:
            Reasons by file name, relative to the folder; empty if no file is damaged.
        """
        merged = self.path / MERGED if self.file is None else self.file
        files = [merged] if merged.is_file() else []  # the largest one first
        files += [run.path for run in self.runs if run.own_file]
        reasons: dict[str, str | None] = {
            str(path.relative_to(self.path)): reason for path, reason in damages(files).items()
        }
        if self.file is None:
            reasons[EXPERIMENT] = self._experiment_damage()
            reasons |= self._input_damage()
            if merged.is_file() and MERGED not in reasons:
                reasons[DATA_CARD] = self._card_damage()
        return {name: reason for name, reason in reasons.items() if reason is not None}

    def _input_damage(self) -> dict[str, str]:
        """Damaged copies of the user's own files."""
        from faultgen.dataset.inputs import damaged_inputs

        return damaged_inputs(self.path)

    def _card_damage(self) -> str | None:
        """Compare the data card with its copy in the file of all runs."""
        with open_verified(self.path / MERGED) as merged:
            wanted = merged[DATA_CARD][()] if DATA_CARD in merged else None
        try:
            found = (self.path / DATA_CARD).read_bytes()
        except OSError as error:
            found, reason = b"", f"cannot be read ({error.strerror})"
        else:
            reason = f"differs from its copy in {MERGED}"
        return reason if wanted is not None and found != wanted else None

    def _experiment_damage(self) -> str | None:
        try:
            found = file_sha256(self.path / EXPERIMENT)
        except OSError as error:
            return f"cannot be read ({error.strerror})"
        if found != self.manifest.experiment_sha256:
            return "is not the experiment that made this dataset"
        return None

    @property
    def index(self) -> pd.DataFrame:
        """A table with one row for each run: its parameters, and its part in every division."""
        from faultgen.dataset.tables import runs_table

        # each run is read once: what would be kept for a further time is let go
        return runs_table((replace(run) for run in self.runs), self.manifest.splits)

    def to_dataframe(self, features: str | Sequence[str] | None = None) -> pd.DataFrame:
        """Return a table with one row for each cycle of every run.

        Its first columns are labels: the run, its robot, task, effect, axis and seed, its part in
        each division, the cycle, its severity and temperature, and the severity of every fault on
        every axis. The others are features, one column for each axis, or for each axis and bin,
        such as mean_abs_torque_2 or torque_histogram_2_12. A value is nan if the robot has no such
        axis.

        Args:
            features: Names of arrays under ``/monitoring``, or "temperature"; one name need
                not be in a list. Default: all of them.

        Returns:
            The table. ``frame.attrs["units"]`` has the SI unit of each column, and
            ``frame.attrs["features"]`` the names of the feature columns.

        Raises:
            InputError: There is no such feature, or the dataset has no runs.
        """
        from faultgen.dataset.tables import cycles_table

        return cycles_table(self.runs, self.manifest.splits, features, where=str(self.path))

    def to_xy(
        self,
        features: str | Sequence[str] | None = None,
        *,
        split: str | None = None,
        by: str = "run",
        label: str = "axis",
        smallest_severity: SeverityLimit = None,
        failure_severity: SeverityLimit = None,
    ) -> tuple[pd.DataFrame, np.ndarray, np.ndarray]:
        """Return features and labels as scikit-learn wants them.

        Args:
            features: Names of arrays under ``/monitoring``, or "temperature"; one name need
                not be in a list. Default: all of them.
            split: "train", "validation" or "test" for one part of a division; by default all
                cycles.
            by: Name of the division: "run", "axis", "robot" or "task".
            label: What y holds; another column of `to_dataframe`, or:

                - "worn": whether something is worn, that is, whether the severity is at least
                  `smallest_severity`.
                - "axis": the worn axis from 1, or 0 while nothing is worn in this sense.
                - "effect": its name, or "healthy" while nothing is worn in this sense.
                - "severity": the true severity, in the unit of the effect.
                - "remaining_life": number of cycles until the first one whose severity is at least
                  `failure_severity`; 0 in that cycle and later. It is nan (censored) in all cycles
                  of a healthy run, and of a run that does not reach this severity.
                - "remaining_cycles": number of recorded cycles after this one, in every run. Where
                  the life is censored, it is longer than this.
            smallest_severity: Severity from which a cycle counts as worn, in the unit of the
                effect, or one for each effect by its name. Default: 0.01 where severities are
                fractions, else 5 % of the largest severity of the run. With 0, every cycle with a
                severity above 0 is worn.
            failure_severity: Severity at which a robot counts as failed, in the same form.
                Default: faulty runs fail in their last cycle.

        Returns:
            The features, shape (cycles, columns), without columns that have no value in the whole
            dataset; the labels, shape (cycles,); and the groups, shape (cycles,): the seed of the
            run, which cross-validation must not divide. Units are those of `to_dataframe`.

        Raises:
            InputError: There is no such feature, label or division, or a severity makes no sense.
        """
        from faultgen.dataset.labels import features_and_labels

        self._check_division(split, by)
        return features_and_labels(
            self.to_dataframe(features),
            None if split is None else (by, split),
            label,
            smallest_severity,
            failure_severity,
        )

    def _check_division(self, split: str | None, by: str) -> None:
        if split not in (None, TRAIN, VALIDATION, TEST):
            raise InputError(f"split: must be '{TRAIN}', '{VALIDATION}' or '{TEST}', not '{split}'")
        if by not in SCHEMES:
            raise InputError(f"there is no division by '{by}': choose {', '.join(SCHEMES)}")
        if split is not None and by not in self.manifest.splits:
            known = ", ".join(self.manifest.splits) or "none"
            raise InputError(
                f"{self.path}: has no division by {by}, because all of its runs would be on one "
                f"side, or because it is of an older version; it has: {known}"
            )
        if split == VALIDATION and not self.manifest.splits[by].get(VALIDATION):
            raise InputError(
                f"{self.path}: its division by {by} has no validation runs, because it has fewer "
                "than three runs of each fault or is of an older version; hold out some of the "
                f"groups of its '{TRAIN}' part, or generate a dataset with --repetitions 3"
            )

    def part_of(self, by: str) -> dict[str, str]:
        """Return the part of every run in a division.

        Args:
            by: Name of the division.

        Returns:
            "train", "validation", "test" or "unused" by id of the run.

        Raises:
            InputError: The dataset has no such division.
        """
        self._check_division(TRAIN, by)
        parts = self.manifest.splits[by]
        return {i: part for part in PARTS for i in parts.get(part, [])}

    def to_parquet(self, path: str | Path) -> None:
        """Write the table of `to_dataframe` to a Parquet file.

        Args:
            path: The file.

        Raises:
            InputError: pyarrow is not installed.
            StorageFailed: The file cannot be written.
        """
        from faultgen.system.tables import write_parquet

        write_parquet(self.to_dataframe(), Path(path))


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
        folder: Folder that `faultgen generate` wrote, or its file ``dataset.h5``. The file can be
            read without the rest of the folder, except its checksum ``dataset.h5.sha256``.

    Returns:
        The dataset.

    Raises:
        InputError: This is not a dataset, or its list of runs is damaged.
    """
    path = Path(folder)
    check_exists(path)
    if is_in_parts(path):
        raise InputError(
            f"{path}: is a dataset in parts; give one of them, such as "
            f"{path / part_names(path)[0]}, or read all of them with faultgen.open_parts"
        )
    # a folder with nothing else; one with run files has lost its list
    if not any((path / name).exists() for name in (FILE, "runs")) and (path / MERGED).is_file():
        path /= MERGED
    dataset = Dataset(path.parent, path) if path.is_file() else Dataset(path)
    _ = dataset.manifest
    return dataset
