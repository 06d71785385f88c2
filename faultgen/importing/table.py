"""The columns of a log, before their meaning is known."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.units import split_unit

if TYPE_CHECKING:
    import pandas as pd

BLANK = (
    *("", "nan", "-nan", "null", "none", "na", "n/a", "#n/a", "#nv", "#wert!", "#value!"),
    *("-", "--", "?", "missing"),
)
"""What a cell without a value holds, in small letters."""

_MOST_LISTED = 12  # names that a message lists


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """A log as columns of the same length."""

    source: str
    """Name of the file or other origin, for messages."""
    columns: Mapping[str, np.ndarray]
    """Columns by name; numbers, texts (of type object) or dates. Shape (rows,) each."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the log itself states, by column."""
    axes: tuple[str, ...] = ()
    """Names of the axes, if the log has such."""
    lists: bool = False
    """Whether cells hold lists of numbers, which have become columns NAME_1, NAME_2 and so on."""
    clocks: Mapping[str, str] = field(default_factory=dict)
    """Column with the times of each channel, for logs that have a clock for each."""
    clock: str = ""
    """What maps call the clock of such a log: that of the position of the first axis."""
    lines: np.ndarray | None = None
    """Line of the file in which each row stands, from 1. Shape (rows,)."""
    notes: tuple[str, ...] = ()
    """One line for each decision that was taken while reading."""

    def __len__(self) -> int:
        if self.lines is not None:
            return len(self.lines)
        return len(next(iter(self.columns.values()), ()))

    def place(self, row: int) -> str:
        """Say where a row is, for messages.

        Args:
            row: Number of the row, from 0.
        """
        return f"row {row + 1}" if self.lines is None else f"line {self.lines[row]}"

    def numbers(self, name: str) -> np.ndarray:
        """Return a column as numbers.

        Args:
            name: Its name.

        Returns:
            Shape (rows,). Blank cells are NaN.

        Raises:
            InputError: A cell holds something else.
        """
        column = self.columns[name]
        values = as_numbers(column).astype(float)
        wrong = np.flatnonzero(np.isnan(values) & ~is_blank(column))
        if len(wrong):
            row = int(wrong[0])
            raise InputError(
                f"{self.source}: column '{name}' holds {str(column[row])[:30]!r} in "
                f"{self.place(row)}, which is no number; name another column in the map, or state "
                "the separator and the decimal sign, or the beginnings of lines to leave out "
                "(comment) or the line of the first row of numbers (first), under [file]"
            )
        return values

    def missing(self, wanted: str, what: str) -> InputError:
        """Make the error for a column that is not there.

        Args:
            wanted: Name or pattern that the map has.
            what: Entry of the map, such as "position".

        Returns:
            The error. Its message lists names that are similar in capitals or small letters, and
            the names that the log has.
        """
        plain = wanted.replace("{axis}", "1").lower()
        bracket = re.compile(re.escape(plain) + r"\s*[\[(](?!\d+\))", re.IGNORECASE)
        with_unit = next((name for name in self.columns if bracket.match(name)), None)
        if with_unit is not None:
            return InputError(
                f"{self.source}: no column '{wanted}' for [{what}], but '{with_unit}', whose unit "
                f"is not known; write the whole name, and {what}.unit, in the map"
            )
        by_lower: dict[str, list[str]] = {}
        for name in self.columns:
            by_lower.setdefault(name.lower(), []).append(name)
        near = get_close_matches(plain, by_lower, n=4, cutoff=0.5)
        if self.lists:
            return InputError(
                f"{self.source}: no column '{wanted}' for [{what}]; it has cells that hold lists "
                "of numbers; write one column for each axis, or name their numbers in the map: the "
                f"log has {listed(self.columns)}"
            )
        told = f"the log has {len(self.columns)} columns: {listed(self.columns)}"
        if near:
            similar = [name for lower in near for name in by_lower[lower]]
            told = f"similar columns are {listed(similar)}; {told}"
        return InputError(
            f"{self.source}: no column '{wanted}' for [{what}]; {told}; correct the map"
        )


def as_numbers(column: np.ndarray) -> np.ndarray:
    """Return a column as numbers; NaN where a cell is none.

    Args:
        column: The column.

    Returns:
        Whole numbers as such, unless cells are blank. Shape (rows,).
    """
    if column.dtype.kind in "fiu":
        return column
    import pandas as pd

    return pd.to_numeric(pd.Series(column), errors="coerce").to_numpy()


def as_texts(column: np.ndarray) -> np.ndarray:
    """Return a column as texts, such as names of programs; whole numbers without a point.

    Args:
        column: The column.

    Returns:
        Shape (rows,), of type object.
    """
    whole = column.dtype.kind == "f" and np.isfinite(column).all() and (column % 1 == 0).all()
    values = (column.astype(np.int64) if whole else column).tolist()
    return np.array([str(one).strip() for one in values], object)


def is_blank(column: np.ndarray) -> np.ndarray:
    """Find blank cells of a column.

    Args:
        column: The column.

    Returns:
        Whether each cell is blank or "nan". Shape (rows,).
    """
    if column.dtype.kind in "fiub":
        return np.isnan(column)
    import pandas as pd

    cells = pd.Series(column)
    blank = cells.isna().to_numpy()
    if column.dtype.kind in "OTU":
        text = cells.astype(str).str.strip().str.lower()
        blank = blank | text.isin(BLANK).to_numpy()
    return blank


def split_cells(line: str, separator: str) -> list[str]:
    """Separate the cells of a line, which may be in quotes.

    Args:
        line: The line.
        separator: Sign between cells.
    """
    usual = csv.field_size_limit(len(line) + 1)  # a cell may be as long as its line
    try:
        return next(csv.reader([line], delimiter=separator), [])
    finally:
        csv.field_size_limit(usual)


class _Text(io.RawIOBase):
    """Lines as a file of UTF-8, without a copy of all of them."""

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = iter(lines)
        self._left = b""

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        while len(self._left) < len(buffer):
            some = list(islice(self._lines, 1000))
            if not some:
                break
            self._left += ("\n".join(some) + "\n").encode("utf-8", errors="replace")
        count = min(len(buffer), len(self._left))
        buffer[:count] = self._left[:count]
        self._left = self._left[count:]
        return count


def parsed_rows(
    lines: Iterable[str], count: int, separator: str = ",", decimal: str = "."
) -> pd.DataFrame:
    """Read rows of cells.

    Args:
        lines: The rows, without names.
        count: Number of cells of each row.
        separator: Between cells; may be a regular expression.
        decimal: Decimal sign.

    Returns:
        Columns 0 to count - 1. A row with fewer cells ends in NaN.

    Raises:
        pandas.errors.ParserError: A row has more cells.
    """
    import pandas as pd

    with warnings.catch_warnings():
        # rows that are all too long only cause a warning, and their last values are lost
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            return pd.read_csv(
                io.BufferedReader(_Text(lines)),  # type: ignore[type-var]
                sep=separator,
                decimal=decimal,
                header=None,
                names=range(count),
                index_col=False,
                skipinitialspace=True,
                on_bad_lines="error",
                low_memory=False,
            )
        except (pd.errors.EmptyDataError, pd.errors.ParserWarning) as error:
            raise pd.errors.ParserError(str(error)) from None


def listed(names: Iterable[str]) -> str:
    """Return names for a message; of many, the first ones and the number of the others."""
    found = [f"'{name}'" for name in names]
    more = f" and {len(found) - _MOST_LISTED} more" if len(found) > _MOST_LISTED else ""
    return ", ".join(found[:_MOST_LISTED]) + more


def named_with_units(names: Iterable[str]) -> tuple[list[str], dict[str, str]]:
    """Separate names of columns from units that stand behind them in brackets.

    Args:
        names: Such as "AxisPos_Act1 [°]". Brackets without a unit remain part of the name.

    Returns:
        The names, and the units by name.
    """
    bare, units = [], {}
    for name in names:
        name, unit = split_unit(name)
        if unit:
            units[name] = unit
        bare.append(name)
    return bare, units


def with_units_apart(table: Table) -> Table:
    """Return a table whose names of columns have no units in brackets.

    Args:
        table: The table. Units that it states itself are kept.
    """
    names = list(table.columns)
    bare, units = named_with_units(names)
    if not units or len(set(bare)) < len(bare):
        return table
    of = dict(zip(names, bare, strict=True))
    return replace(
        table,
        columns=dict(zip(bare, table.columns.values(), strict=True)),
        units=units | {of[name]: unit for name, unit in table.units.items()},
        clocks={of[name]: of[clock] for name, clock in table.clocks.items()},
    )
