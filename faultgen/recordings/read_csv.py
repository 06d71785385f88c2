"""Arrays and attributes of a CSV file. Errors name the row and the column."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.importing.sizes import LARGEST_LOG, check_size, check_text
from faultgen.importing.table import as_numbers, listed, parsed_rows, split_cells
from faultgen.recordings.read_hdf5 import NAMES


def read_csv(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read the columns of a recording.

    Args:
        path: The file: UTF-8, commas between columns, decimal points, names in the first row.

    Returns:
        Arrays of shape (samples, n_axes) by name, and attributes.

    Raises:
        InputError: The file is not such a table. The message is one line that states where the file
            is wrong and what would be right.
    """
    columns = _columns(path)
    if "time" not in columns:
        raise _missing(path, "'time'", columns)
    named = {"temperature": columns["temperature"]} if "temperature" in columns else {}
    for stem in NAMES:
        values = _axes(path, stem, columns)
        if values is not None:
            if stem in named:
                raise InputError(
                    f"{path}: has both '{stem}' and '{stem}_1'; give one temperature, or one for "
                    "each axis"
                )
            named[stem] = values
    if not {"motor_position", "joint_position"} & named.keys():
        raise _missing(path, "'motor_position_1' or 'joint_position_1'", columns)
    named["time"] = columns["time"]
    attributes: dict[str, Any] = {}
    if "segment" in columns:
        starts = np.concatenate([[0], np.flatnonzero(np.diff(columns["segment"])) + 1])
        attributes["segments"] = starts
    return named, attributes


def _missing(path: Path, wanted: str, columns: Iterable[str]) -> InputError:
    """The error of a file that lacks a column."""
    return InputError(
        f"{path}: no column {wanted}; it has {listed(columns)}; rename its columns, or convert it "
        "with 'faultgen import'"
    )


def _columns(path: Path) -> dict[str, np.ndarray]:
    """Every column by its name."""
    text = _text(path)
    first, _, rows = text.partition("\n")
    header = [name.strip() for name in split_cells(first, ",")]
    if len(header) < 2:
        other = next((mark for mark in (";", "\t") if mark in "".join(header)), None)
        found = f"columns are separated by {other!r}" if other else "the first row names no columns"
        raise InputError(
            f"{path}: {found}; give names in the first row, commas between columns and points "
            "in numbers"
        )
    twice = {name for name in header if header.count(name) > 1}
    if twice:
        raise InputError(f"{path}: column '{min(twice)}' appears more than once")
    check_size(path, np.dtype(float).itemsize * len(header) * rows.count("\n"))
    try:
        table = parsed_rows((line.rstrip("\r\n") for line in io.StringIO(rows)), len(header))
    except ValueError as error:
        line = one_line(error)
        raise InputError(
            f"{path}: header has {len(header)} names, but not every row has {len(header)} values "
            f"({line})"
        ) from None
    return {name: _numbers(path, name, table[k].to_numpy()) for k, name in enumerate(header)}


def _text(path: Path) -> str:
    """The text of a file.

    Raises:
        InputError: It is too large, or not UTF-8.
    """
    with path.open("rb") as file:
        content = file.read(LARGEST_LOG + 1)
    check_text(path, content)
    if content[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in content[:1000]:
        raise InputError(f"{path}: is not UTF-8 text, perhaps UTF-16; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}: row {row} is not UTF-8 text, perhaps Latin-1; save the file as UTF-8"
        ) from None


def _numbers(path: Path, name: str, column: np.ndarray) -> np.ndarray:
    values = as_numbers(column).astype(float)
    wrong = np.flatnonzero(~np.isfinite(values))
    if not len(wrong):
        return values
    cell, row = column[wrong[0]], int(wrong[0]) + 2
    where = f"{path}: not a table of numbers: row {row} of column '{name}'"
    if cell is None or cell != cell:
        raise InputError(f"{where} is blank; fill it in, or leave the column out")
    raise InputError(
        f"{where} holds {str(cell)[:30]!r}; write numbers with a point, or leave the column out"
    )


def _axes(path: Path, stem: str, columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Columns of one quantity, in the order of the axes; None if there are no such columns."""
    pattern = re.compile(re.escape(stem) + r"_(\d+)")
    found = {name: int(match[1]) for name in columns if (match := pattern.fullmatch(name))}
    if not found:
        return None
    numbers = sorted(found.values())
    if numbers != list(range(1, len(numbers) + 1)):
        has = ", ".join(f"_{number}" for number in numbers)
        raise InputError(
            f"{path}: columns of {stem} end in {has}; number the axes from 1 without a gap, "
            f"_1 to _{len(numbers)}"
        )
    return np.stack([columns[name] for name in sorted(found, key=found.__getitem__)], axis=1)
