"""Tables that are written to several Parquet files, so that no file gets too large."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from faultgen.system.tables import optional

SHARD = 200 * 2**20
"""Size of the arrays of a file, before compression, from which on a new one is begun [bytes]."""


class Shards:
    """Writes row groups to Parquet files one after another, as a context manager."""

    def __init__(self, place: Callable[[int], Path], limit: int = SHARD) -> None:
        """Prepare to write.

        Args:
            place: The path of each file, from its number, which starts at 0.
            limit: Size of the arrays of a file from which on a new one is begun [bytes].
        """
        self._place, self._limit = place, limit
        self._writer: Any = None
        self._size = 0
        self.paths: list[Path] = []
        """Files that have been begun."""
        self.rows = 0
        """Rows that have been written."""

    def __enter__(self) -> Shards:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the last file."""
        if self._writer is not None:
            self._writer.close()

    @property
    def next_file(self) -> int:
        """Number of the file to which the next table will go."""
        return len(self.paths) - (self._writer is not None and self._size < self._limit)

    def write(self, table: Any) -> int:
        """Write a table as one row group, which is never divided between files.

        Args:
            table: A `pyarrow.Table`. All tables must have the same schema.

        Returns:
            Number of the file.
        """
        parquet = optional("pyarrow.parquet")
        if self.next_file == len(self.paths):
            if self._writer is not None:
                self._writer.close()
            path = self._place(len(self.paths))
            path.parent.mkdir(parents=True, exist_ok=True)
            self.paths.append(path)
            self._writer = parquet.ParquetWriter(path, table.schema, compression="zstd")
            self._size = 0
        self._writer.write_table(table, row_group_size=max(table.num_rows, 1))
        self._size += table.nbytes
        self.rows += table.num_rows
        return len(self.paths) - 1


def vectors(values: np.ndarray) -> Any:
    """Turn a matrix into a column of lists of fixed length.

    Args:
        values: Shape (rows, length).

    Returns:
        A `pyarrow.FixedSizeListArray` with one list for each row.
    """
    arrow = optional("pyarrow")
    flat = arrow.array(np.ascontiguousarray(values).reshape(-1))
    return arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])


def column(values: Any, count: int) -> Any:
    """Repeat a value in all rows of a column, at almost no cost for texts.

    Args:
        values: The value.
        count: Number of rows.

    Returns:
        A `pyarrow.Array`.
    """
    arrow = optional("pyarrow")
    return arrow.repeat(arrow.scalar(values), count)


def table(columns: Mapping[str, Any]) -> Any:
    """Make a table of columns.

    Args:
        columns: Arrays of pyarrow or NumPy, by name.

    Returns:
        A `pyarrow.Table`.
    """
    arrow = optional("pyarrow")
    return arrow.table({name: arrow.array(values) for name, values in columns.items()})
