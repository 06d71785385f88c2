"""Which rows of a log become samples, and where segments begin.

kept = complete_rows(table, found, time, notes)
starts = segments_of(table, column_map, time, kept, notes)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.column_map import ColumnMap
from faultgen.importing.oddities import dropouts
from faultgen.importing.quantity import Read
from faultgen.importing.table import Table, as_texts, listed

_MOST_LOST = 0.5  # share of the rows that may be left out for blank cells
_MOST_EQUAL = 0.2  # share of the rows that may have the time of the row before
_FAR_BACK = 20.0  # usual steps by which a clock goes back that starts again: assumed
_FEWEST_ROWS = 20  # median number of rows between two starts of a clock: assumed


def complete_rows(
    table: Table, found: Mapping[str, Read], time: np.ndarray, notes: list[str]
) -> np.ndarray:
    """Find the rows in which no column that is needed is blank.

    Args:
        table: The log.
        found: The quantities that were read.
        time: Times of the rows, shape (rows,), in [s].
        notes: Gets a line for rows that are left out.

    Returns:
        Their numbers, shape (kept,).

    Raises:
        InputError: Most rows are blank in a column.
    """
    blank = {"time": np.isnan(time)}
    if table.clocks and not blank["time"].all():  # channels with more samples have more rows
        timed = ~blank.pop("time")
    else:
        timed = np.ones(len(time), bool)
    blank |= {
        column: np.isnan(one.values[:, k]) & timed
        for one in found.values()
        for k, column in enumerate(one.columns)
    }
    lost = np.logical_or.reduce(list(blank.values()))
    dropped = timed & dropouts([one.values for name, one in found.items() if name != "temperature"])
    if dropped.any():
        row = int(np.argmax(dropped))
        notes.append(
            f"rows in which every value is 0 were left out: {dropped.sum()}, the first is "
            f"{table.place(row)}"
        )
    if lost.sum() > _MOST_LOST * timed.sum():
        name = max(blank, key=lambda key: blank[key].sum())
        raise InputError(
            f"{table.source}: column '{name}' is blank in {blank[name].sum()} of {timed.sum()} "
            "rows; leave it out of the map, or write all columns in every row of the log"
        )
    if lost.any():
        row = int(np.argmax(lost))
        notes.append(
            f"rows with blank cells were left out: {lost.sum()}, the first is {table.place(row)}"
        )
    return np.flatnonzero(timed & ~(lost | dropped))


def rows_of_program(
    table: Table,
    column_map: ColumnMap,
    kept: np.ndarray,
    program: str | None,
    notes: list[str],
) -> np.ndarray:
    """Find the rows of one program.

    Args:
        table: The log.
        column_map: What its columns mean.
        kept: Numbers of the rows that are used, shape (kept,).
        program: Name of the program. None: all rows.
        notes: Gets a line if there are several programs.

    Returns:
        Those of the rows that belong to it, shape (rows,).

    Raises:
        InputError: The map does not name the column of the program, or no row has this one.
    """
    name = column_map.program
    if name is None:
        if program is not None:
            raise InputError(
                f"--program {program}: state the column with the name of the program as program in "
                "the map"
            )
        return kept
    if name not in table.columns:
        raise table.missing(name, "program")
    text = as_texts(table.columns[name][kept])
    names, counts = np.unique(text.astype(str), return_counts=True)
    rows = ", ".join(f"{one} ({n} rows)" for one, n in zip(names, counts, strict=True))
    if program is None:
        if len(names) > 1:
            notes.append(
                f"the log has {len(names)} programs: {rows}; each change begins a new segment. "
                "'twin', 'train' and 'judge' need recordings of one program: take one with "
                "--program"
            )
        return kept
    chosen = kept[text == program]
    if not len(chosen):
        raise InputError(
            f"{table.source}: no row has the program '{program}'; there are {listed(names)}"
        )
    notes.append(f"only the rows of program '{program}' were taken; there are {rows}")
    return chosen


def segments_of(
    table: Table, column_map: ColumnMap, time: np.ndarray, kept: np.ndarray, notes: list[str]
) -> np.ndarray:
    """Find the first row of each separate recording.

    One begins where the columns `segment` or `program` of the map change, and where the clock
    starts again, as it does when a logger is restarted.

    Args:
        table: The log.
        column_map: What its columns mean.
        time: Times of the rows, shape (rows,), in [s].
        kept: Numbers of the rows that are used, shape (kept,).
        notes: Gets a line if the clock starts again.

    Returns:
        Places in `kept`, ascending from 0, shape (segments,).

    Raises:
        InputError: There is no such column, or the time goes back in another way.
    """
    begins = np.zeros(len(kept), bool)
    begins[:1] = True
    for entry in ("segment", "program"):
        name = getattr(column_map, entry)
        if name is None:
            continue
        if name not in table.columns:
            raise table.missing(name, entry)
        text = as_texts(table.columns[name])
        changed = np.flatnonzero(text[1:] != text[:-1]) + 1
        # rows of another program may lie between two that are kept
        number = np.searchsorted(changed, kept, side="right")
        begins[1:] |= number[1:] != number[:-1]
    step = np.diff(time[kept])
    back = np.flatnonzero((step < 0) & ~begins[1:]) + 1
    if not len(back):
        return np.flatnonzero(begins)
    far = -step[back - 1] > _FAR_BACK * np.median(step[step > 0])
    starts = np.flatnonzero(begins | np.isin(np.arange(len(kept)), back))
    row = int(kept[back[0]])
    if not far.all() or np.median(np.diff([*starts, len(kept)])) < _FEWEST_ROWS:
        raise InputError(
            f"{table.source}: the time goes back in {table.place(row)}; sort the log, or name a "
            "column that differs between separate recordings as segment in the map"
        )
    times = "once" if len(back) == 1 else f"{len(back)} times"
    notes.append(
        f"the clock starts again {times}, first in {table.place(row)}: new segments begin there"
    )
    return starts


def without_equal_times(
    table: Table, time: np.ndarray, kept: np.ndarray, starts: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Leave out rows with the time of the row before, which say nothing about when they were.

    Args:
        table: The log.
        time: Times of the rows, shape (rows,), in [s].
        kept: Numbers of the rows that are used, shape (kept,).
        starts: Places in it at which segments begin.
        notes: Gets a line for rows that are left out.

    Returns:
        The rows and starts that remain, shapes (kept,) and (segments,).

    Raises:
        InputError: Many rows have the time of the row before.
    """
    step = np.diff(time[kept], prepend=-np.inf)
    step[starts] = np.inf
    equal = step == 0
    if equal.mean() > _MOST_EQUAL:
        raise InputError(
            f"{table.source}: {equal.sum()} of {len(kept)} rows have the time of the row before; "
            "correct time.unit; if each joint has a row of its own, state the column that names "
            "the joint as axes.column; if the rows are evenly spaced in time, give "
            "time.sample_period instead of time.column"
        )
    if equal.any():
        row = int(kept[np.argmax(equal)])
        notes.append(
            f"rows with the time of the row before were left out: {equal.sum()}, the first is "
            f"{table.place(row)}"
        )
    return kept[~equal], starts - np.cumsum(equal)[starts]
