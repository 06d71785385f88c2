"""Reading datasets: their list of runs, their run files and the file of all runs.

A dataset is a folder: ``experiment.toml``, ``runs.json`` (the runs it should hold),
``runs/<id>.h5`` with a checksum beside each, and ``dataset.h5`` with all runs merged. A file that
exists is complete, and it is compared with its checksum before it is read. ``dataset.h5`` can be
the only copy of the runs, and can be read without the rest of the folder. Reading a dataset does
not need the simulator.

    dataset = open_dataset("out")               # or "out/dataset.h5"
    cycles = dataset.to_dataframe()
    x, y, groups = dataset.to_xy(split="train", label="axis")
    for run in dataset:                         # a dataset is a sequence of its runs
        run["axis"], run["severity"], run.read("monitoring/mean_abs_torque").shape
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, overload

import numpy as np

from faultgen.dataset.manifest import (
    FILE,
    Manifest,
    check_exists,
    is_in_parts,
    part_names,
)
from faultgen.dataset.merged_file import MERGED, only_in
from faultgen.dataset.remote import is_remote, local_copy
from faultgen.dataset.splits import PARTS, TRAIN, check_division
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.provenance import Provenance
from faultgen.system.hdf5 import open_verified

if TYPE_CHECKING:
    import pandas as pd

    from faultgen.dataset.batches import Batches
    from faultgen.dataset.labels import SeverityLimit
    from faultgen.dataset.torch_windows import TorchWindows
    from faultgen.dataset.window_choice import WindowChoice
    from faultgen.dataset.windows import Windows


@dataclass(frozen=True)
class Dataset:
    """A dataset folder, or a file of all runs by itself."""

    path: Path
    """Path of the folder."""
    file: Path | None = None
    """The file of all runs, if nothing else of the folder is to be read."""
    only: tuple[str, ...] | None = None
    """Ids of the runs, if it is a part of the dataset; see `__getitem__`."""

    def __len__(self) -> int:
        """Number of runs that exist."""
        return len(self.runs)

    def __iter__(self) -> Iterator[StoredRun]:
        """Go through the runs that exist."""
        return iter(self.runs)

    @overload
    def __getitem__(self, index: int) -> StoredRun: ...

    @overload
    def __getitem__(self, index: slice) -> Dataset: ...

    def __getitem__(self, index: int | slice) -> StoredRun | Dataset:
        """Return a run, or a part of the dataset with the runs of a slice.

        Args:
            index: Number of the run in `runs`, from 0; or a slice of such numbers.

        Returns:
            The run; or the dataset with no others than these. A part keeps the divisions of the
            whole dataset, and has all methods of a dataset.

        Raises:
            IndexError: There is no run of this number.
        """
        if isinstance(index, slice):
            return replace(self, only=tuple(run.id for run in self.runs[index]))
        return self.runs[index]

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
        every = self.manifest.runs
        return every if self.only is None else {i: every[i] for i in self.only}

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
        from faultgen.dataset.integrity import failures

        return failures(self.path / "runs", self.missing)

    def versions(self) -> dict[Provenance, list[str]]:
        """Ids of the intact runs, grouped by the versions and code that made them."""
        from faultgen.dataset.integrity import versions_of

        return versions_of(self.runs, self.file or self.path / MERGED)

    def damaged(self) -> dict[str, str]:
        """Find damaged files. All files of the dataset are read completely.

        Returns:
            Reasons by file name, relative to the folder; empty if no file is damaged.
        """
        from faultgen.dataset.integrity import damaged_files

        return damaged_files(self.path, self.file, self.runs, self.manifest.experiment_sha256)

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
        groups: str = "seed",
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
            groups: "seed" for the seed of the run, or "robot" for the instance of the robot.

        Returns:
            The features, shape (cycles, columns), without columns that have no value in the whole
            dataset; the labels, shape (cycles,); and the groups, shape (cycles,), which
            cross-validation must not divide. Units are those of `to_dataframe`.

        Raises:
            InputError: There is no such feature, label or division, or a severity makes no sense.
        """
        from faultgen.dataset.labels import features_and_labels

        check_division(self.manifest.splits, split, by, self.path)
        return features_and_labels(
            self.to_dataframe(features),
            None if split is None else (by, split),
            label,
            smallest_severity,
            failure_severity,
            groups,
        )

    def to_torch(self, **choice: Unpack[WindowChoice]) -> TorchWindows:
        """Return windows of the logged signals as a map-style dataset of PyTorch.

        Items are read from the files when they are asked for, by the process that asks for them,
        so that a DataLoader with several workers works, and nothing is kept in memory.

        Args:
            **choice: Fields of `WindowChoice`: which windows of which signals, and which label.

        Returns:
            The dataset. An item is a tensor of shape (window, channels), float32, in SI units, and
            the label. Its attribute ``channels`` names the channels, and ``classes`` what the
            labels stand for if they are texts. ``y`` and ``groups`` have the label and the group of
            every item.

        Raises:
            InputError: torch is not installed, or something is not there or does not fit together.
        """
        from faultgen.system.tables import optional

        optional("torch")
        from faultgen.dataset.torch_windows import TorchWindows

        return TorchWindows(self._windows(choice))

    def batches(
        self,
        size: int,
        *,
        rng: np.random.Generator | None = None,
        drop_last: bool = False,
        **choice: Unpack[WindowChoice],
    ) -> Batches:
        """Return batches of windows of the logged signals as NumPy arrays, for JAX and others.

        Args:
            size: Number of windows of a batch.
            rng: Draws the order anew for every pass; None for the order of time.
            drop_last: Whether to leave out the last batch if it has fewer windows.
            **choice: Fields of `WindowChoice`: which windows of which signals, and which label.

        Returns:
            The batches, which can be passed through any number of times: windows, shape
            (size, window, channels), float32, in SI units; and labels, shape (size,).

        Raises:
            InputError: Something is not there, or does not fit together.
        """
        from faultgen.dataset.batches import Batches

        return Batches(self._windows(choice), size, rng, drop_last)

    def _windows(self, choice: WindowChoice) -> Windows:
        from faultgen.dataset.windows import Windows

        rest: dict[str, Any] = dict(choice)
        split, by = rest.pop("split", None), rest.pop("by", "run")
        check_division(self.manifest.splits, split, by, self.path)
        part = None if split is None else (by, split)
        where = str(self.file or self.path)
        return Windows.of(self.runs, self.manifest.splits, where=where, part=part, **rest)

    def part_of(self, by: str) -> dict[str, str]:
        """Return the part of every run in a division.

        Args:
            by: Name of the division.

        Returns:
            "train", "validation", "test" or "unused" by id of the run.

        Raises:
            InputError: The dataset has no such division.
        """
        check_division(self.manifest.splits, TRAIN, by, self.path)
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


def open_dataset(folder: str | Path) -> Dataset:
    """Open a dataset.

    Every file is compared with its checksum before it is first read.

    Args:
        folder: Folder that `faultgen generate` wrote, or its file ``dataset.h5``. The file can be
            read without the rest of the folder, except its checksum ``dataset.h5.sha256``. Or an
            address, such as "s3://bucket/out", as in `faultgen.dataset.remote`.

    Returns:
        The dataset.

    Raises:
        InputError: This is not a dataset, or its list of runs is damaged.
    """
    path = local_copy(str(folder)) if is_remote(folder) else Path(folder)
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
