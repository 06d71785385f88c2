"""When the rows of a log were recorded: numbers in any unit, dates, clock times, or even times."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.column_map import ColumnMap
from faultgen.importing.table import Table, as_numbers, is_blank
from faultgen.importing.units import ISO, conversion, known_unit

_EXACT = 9  # digits behind the point from which a float holds a time exactly enough
_CLOCK = "hours:minutes:seconds"
_HOURS = re.compile(r"\d{1,2}:\d\d:\d\d(\.\d*)?")
_ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d")


def times_of(
    table: Table, column_map: ColumnMap, notes: list[str]
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the time of each row.

    Args:
        table: The log.
        column_map: What its columns mean.
        notes: Gets a line if the times were read in a form that the map does not state.

    Returns:
        Times in [s], NaN where a cell is blank, shape (rows,); and the attribute ``sample_period``
        if the map gives it instead of a column.

    Raises:
        InputError: There is no such column, its unit is not known, or a cell is no time.
    """
    given = column_map.time
    if given.column is None:
        assert given.sample_period is not None
        even = given.sample_period * np.arange(len(table))
        return even, {"sample_period": given.sample_period}
    name = given.column
    if name not in table.columns:
        raise table.missing(name, "time")
    column = table.columns[name]
    unit = given.unit if given.unit is not None else table.units.get(name)
    if column.dtype.kind == "M" or (isinstance(unit, str) and known_unit(unit) == ISO):
        return _of_dates(table, name, notes), {}
    if unit is None:
        raise InputError(
            f"{table.source}: the unit of column '{name}' is not known; state time.unit in the map"
        )
    try:
        factor = conversion("time", unit).factor
    except InputError as error:
        raise InputError(f"{table.source}: column '{name}', time.{error}") from None
    whole = as_numbers(column)
    if whole.dtype.kind in "iu":  # nanoseconds since 1970 have more digits than a float
        whole = whole.astype(np.int64)
        return (whole - whole[0]).astype(float) * factor, {}
    values = table.numbers(name)
    values = np.where(np.isfinite(values), values, np.nan)  # infinity is no time
    known = values[~np.isnan(values)]
    if not len(known):
        return values * factor, {}
    # a float holds seconds since 1970 to 2e-7: what the log says is found again by rounding
    digits = int(-np.log10(4 * np.spacing(np.abs(known).max())))
    elapsed = values - known[0]
    return (np.round(elapsed, digits) if digits < _EXACT else elapsed) * factor, {}


def clock_of(table: Table, column_map: ColumnMap, name: str, time: np.ndarray) -> np.ndarray:
    """Return the times of a channel that has a clock of its own.

    Args:
        table: The log.
        column_map: What its columns mean.
        name: Column with these times, in the unit of the other times.
        time: Times of the rows from `times_of`, shape (rows,), in [s].

    Returns:
        Times with the same zero, NaN where a cell is blank, shape (rows,), in [s].

    Raises:
        InputError: There is no such column, or a cell is no time.
    """
    if name not in table.columns:
        raise table.missing(name, "time.columns")
    first = column_map.time.column
    assert first is not None
    if table.units.get(name, table.units.get(first)) != table.units.get(first):
        raise InputError(
            f"{table.source}: the times '{first}' and '{name}' have different units; write them in "
            "the same one"
        )
    # both together, so that they have one zero
    joined = Table(
        source=table.source,
        columns={first: np.concatenate([table.columns[first], table.columns[name]])},
        units={first: table.units[first]} if first in table.units else {},
    )
    both, _ = times_of(joined, column_map, [])
    count = len(time)
    return both[count:] - np.nanmedian(both[:count] - time)


def _of_dates(table: Table, name: str, notes: list[str]) -> np.ndarray:
    """Times in [s] after the first one, NaN where a cell is blank."""
    import pandas as pd

    column = table.columns[name]
    if column.dtype.kind != "M":
        blank = is_blank(column)
        text = pd.Series(column).astype(str).str.strip().str.replace(",", ".", regex=False)
        how = _form_of(str(text[~blank].iloc[0])) if not blank.all() else ISO
        if how == _CLOCK:
            since = pd.to_timedelta(text.where(~blank), errors="coerce")
            times = since.dt.total_seconds()
        else:
            form = "ISO8601" if how == ISO else how
            times = pd.to_datetime(text, errors="coerce", utc=True, format=form)
        wrong = np.flatnonzero(times.isna().to_numpy() & ~blank)
        if len(wrong):
            row = int(wrong[0])
            raise InputError(
                f"{table.source}: column '{name}' holds {str(column[row])[:30]!r} in "
                f"{table.place(row)}, which is no time such as 2026-03-01T09:30:00.004 or "
                "09:30:00.004; correct time.unit in the map"
            )
        if how != ISO:
            notes.append(f"the times were read as {how}")
        if how == _CLOCK:
            return (times - times.min()).to_numpy(float)
    else:
        times = pd.Series(column)
    return (times - times.min()).dt.total_seconds().to_numpy(float)


def _form_of(text: str) -> str:
    """How a time is written: as ISO 8601, as hours, or in a form of `strftime`.

    Whether the day or the month comes first does not matter: only the time since the first row is
    used.
    """
    if _HOURS.fullmatch(text):
        return _CLOCK
    if _ISO_DATE.match(text):
        return ISO
    from pandas.tseries.api import guess_datetime_format

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of days and months that could be exchanged
        return guess_datetime_format(text) or ISO
