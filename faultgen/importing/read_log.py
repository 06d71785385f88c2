"""Any log as a table of columns.

table = read_log("log.csv", column_map.file)
table.columns["actual_q_0"]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.column_map import Axes, File
from faultgen.importing.table import Table, named_with_units

if TYPE_CHECKING:
    import pandas as pd

_ARRAYS = (".mat", ".npz")
_TABLES = (".parquet", ".pq", ".feather", ".arrow")
_BAGS = (".db3", ".mcap", ".bag")


def read_log(path: str | Path, file: File, axes: Axes | None = None) -> Table:
    """Read a log.

    Args:
        path: The file, or the folder of a ROS 2 bag or of a LeRobot dataset.
        file: What the map says about it.
        axes: What the map says about the axes.

    Returns:
        Its columns.

    Raises:
        InputError: The log cannot be read. The message is one line with the remedy.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file")
    kind = _kind(path, file)
    if path.is_dir() and kind not in ("bag", "arrow"):
        raise InputError(
            f"{path}: is a folder; give a file, or the folder of a ROS 2 bag or LeRobot dataset"
        )
    # only the reader of this kind is imported: a refusal must not wait for the others
    if kind == "bag":
        from faultgen.importing.bag import read_bag

        return read_bag(path, file, axes)
    if kind == "arrow":
        from faultgen.importing.arrow_file import read_arrow

        return read_arrow(path)
    if not path.is_file():
        raise InputError(f"{path}: is not a regular file")
    if kind == "arrays":
        from faultgen.importing.array_file import read_arrays_of

        return read_arrays_of(path)
    if kind == "trace":
        from faultgen.importing.trace import read_trace

        return read_trace(path)
    from faultgen.importing.text_log import read_text_log

    return read_text_log(path, file)


def is_bag(path: Path, file: File) -> bool:
    """Whether a log is read as a ROS bag.

    Args:
        path: The log.
        file: What the map says about it.
    """
    return _kind(path, file) == "bag"


def _kind(path: Path, file: File) -> str:
    kind = file.format if file.format != "auto" else _format(path)
    return "bag" if kind == "ros2" else kind


def _format(path: Path) -> str:
    """What a log is, from its name and beginning."""
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return "bag"
        return "arrow" if (path / "meta" / "info.json").is_file() else "text"
    if path.suffix.lower() in _BAGS:
        return "bag"
    if path.suffix.lower() in _TABLES:
        return "arrow"
    if path.suffix.lower() in _ARRAYS:
        return "arrays"
    if path.suffix.lower() == ".dat" and path.is_file():
        from faultgen.importing.trace import BEGIN

        with path.open("rb") as file:
            if BEGIN.encode() in file.read(65536):
                return "trace"
    return "text"


def table_of_frame(frame: pd.DataFrame, source: str) -> Table:
    """Make a table of a data frame.

    Args:
        frame: The data frame. An index that has a name becomes a column.
        source: What it is, for messages.

    Returns:
        Its columns.
    """
    if frame.index.name is not None:
        frame = frame.reset_index()
    names, units = named_with_units(map(str, frame.columns))
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise InputError(f"{source}: column '{min(twice)}' appears more than once; rename one")
    columns = {name: _values(frame.iloc[:, k]) for k, name in enumerate(names)}
    return Table(source=source, columns=columns, units=units)


def _values(column: pd.Series) -> np.ndarray:
    if getattr(column.dtype, "tz", None) is not None:  # numpy has no time zones
        column = column.dt.tz_convert(None)
    return column.to_numpy()
