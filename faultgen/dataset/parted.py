"""Reading a dataset in parts, each of which is a dataset of its own.

A dataset in parts is a folder: ``experiment.toml``, one folder for each part, such as
``part-003-of-500`` with the file ``dataset.h5``, and ``index.h5``, a table of all runs. The table
opens quickly, because the parts are not read for it. Reading does not need the simulator.

    parts = open_parts("out")
    parts.index.query("effect == 'backlash' and severity > 1e-4")   # one row for each run
    for dataset in parts:                                           # one part at a time
        x, y, groups = dataset.to_xy(split="train")
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from faultgen.dataset.manifest import check_layout, part_names
from faultgen.dataset.merged_file import MERGED, values_of
from faultgen.dataset.reader import Dataset, open_dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.system.arrays import plain_value
from faultgen.system.files import checksum_path
from faultgen.system.hdf5 import open_verified

if TYPE_CHECKING:
    import pandas as pd

PARTS_INDEX = "index.h5"
"""Name of the file with the table of all runs."""


@dataclass(frozen=True)
class Part:
    """What the table of all runs tells of a part."""

    name: str
    """Name of its folder."""
    runs: int
    """Number of its runs."""
    cycles: int
    """Number of cycles of all its runs."""
    failed: int
    """Number of its runs that failed."""
    bytes: int
    """Size of its file."""
    sha256: str
    """Checksum of its file."""

    def change(self, folder: Path) -> str | None:
        """Compare the size and the stored checksum of the part's file with the table.

        Args:
            folder: The folder of the dataset.

        Returns:
            What is wrong, or None if they are the same. The file is not read.
        """
        path = folder / self.name / MERGED
        try:
            found = path.stat().st_size, checksum_path(path).read_text("ascii").strip()
        except (OSError, UnicodeDecodeError):
            return f"has no {MERGED} with its checksum; make the part again, or copy it there"
        if found != (self.bytes, self.sha256):
            return "has changed; run 'faultgen merge' on the folder above it"
        return None


@dataclass(frozen=True)
class PartedDataset:
    """A dataset in parts."""

    path: Path
    """Folder of the dataset."""
    parts: tuple[Part, ...]
    """The parts in their order."""

    def __len__(self) -> int:
        """Number of parts."""
        return len(self.parts)

    def __iter__(self) -> Iterator[Dataset]:
        """Open one part after another."""
        return (self.dataset(number) for number in range(1, len(self) + 1))

    def dataset(self, number: int) -> Dataset:
        """Open a part.

        Args:
            number: Number of the part, from 1.

        Returns:
            The part as a dataset.

        Raises:
            InputError: There is no such part, it is not where it was, or it has changed since the
                parts were merged.
        """
        if not 1 <= number <= len(self):
            raise InputError(f"{self.path}: has parts 1 to {len(self)}, not {number}")
        part = self.parts[number - 1]
        reason = part.change(self.path)
        if reason is not None:
            raise InputError(f"{self.path / part.name}: {reason}")
        return open_dataset(self.path / part.name)

    def run(self, run_id: str) -> StoredRun:
        """Find a run.

        Args:
            run_id: Its id.

        Returns:
            The run.

        Raises:
            InputError: There is no such run, or as in `dataset`.
        """
        place = np.flatnonzero(self._column("run") == run_id.encode())
        if not len(place):
            raise InputError(f"{self.path}: holds no run '{run_id}'")
        number = int(self._column("part")[place[0]])
        path = self.dataset(number).path / MERGED
        return StoredRun(run_id, path, f"runs/{run_id}")

    def changed(self) -> dict[str, str]:
        """Find parts that have changed since they were merged, without reading them.

        The size of a part's file and the checksum beside it are compared with the table. `damaged`
        of the part reads the whole file.

        Returns:
            Reasons by name of the part.
        """
        reasons = {part.name: part.change(self.path) for part in self.parts}
        return {name: reason for name, reason in reasons.items() if reason is not None}

    @cached_property
    def index(self) -> pd.DataFrame:
        """A table with one row for each run, as that of a dataset, with the number of its part.

        Texts other than the id are stored as categories, so that a million runs fit into memory.
        A division that a part does not have is empty there.
        """
        import pandas as pd

        with open_verified(self.path / PARTS_INDEX) as file:
            columns: dict[str, object] = {}
            for name, stored in file["index"].items():
                values = stored[()]
                if name == "run":
                    columns[name] = values.astype(str)
                elif name in file["categories"]:
                    columns[name] = pd.Categorical.from_codes(
                        values, values_of(file["categories"][name])
                    )
                else:
                    columns[name] = values
            order = [str(name) for name in file["index"].attrs["columns"]]
        return pd.DataFrame({name: columns[name] for name in order})

    def _column(self, name: str) -> np.ndarray:
        with open_verified(self.path / PARTS_INDEX) as file:
            values: np.ndarray = file[f"index/{name}"][()]
            return values


def open_parts(folder: str | Path) -> PartedDataset:
    """Open a dataset in parts.

    Args:
        folder: The folder in which the parts were merged, or its file ``index.h5``. The table can
            be read without the parts.

    Returns:
        The dataset.

    Raises:
        InputError: This is not a dataset in parts, the parts were not merged, or the table is
            damaged.
    """
    path = Path(folder)
    path = path.parent if path.name == PARTS_INDEX else path
    if not (path / PARTS_INDEX).is_file():
        if part_names(path):
            raise InputError(f"{path}: its parts are not merged; run 'faultgen merge {path}'")
        raise InputError(f"{path}: is not a dataset in parts (it has no {PARTS_INDEX})")
    with open_verified(path / PARTS_INDEX) as file:
        if "parts" not in file:
            raise InputError(f"{path / PARTS_INDEX}: is not the table of a dataset in parts")
        check_layout(plain_value(file.attrs["schema_version"]), path / PARTS_INDEX)
        return PartedDataset(path, _parts_of(file))


def _parts_of(file: h5py.File) -> tuple[Part, ...]:
    columns = [values_of(file[f"parts/{field.name}"]).tolist() for field in fields(Part)]
    return tuple(Part(*row) for row in zip(*columns, strict=True))
