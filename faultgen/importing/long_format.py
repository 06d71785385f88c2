"""Logs with a row for each joint: a time, the name of the joint, and its numbers.

    time,joint,position,effort        time,position/a,position/b,effort/a,effort/b
    0.00,a,0.1,3.0              ->    0.00,0.1,0.2,3.0,4.0
    0.00,b,0.2,4.0

table, column_map = widened(table, column_map)  # columns COLUMN/JOINT, and a map that names them
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.clocks import at_times
from faultgen.importing.column_map import AXIS, QUANTITIES, ColumnMap
from faultgen.importing.table import Table, as_texts, is_blank, listed
from faultgen.importing.times import times_of

_MOST_JOINTS = 100


def widened(table: Table, column_map: ColumnMap) -> tuple[Table, ColumnMap]:
    """Arrange a log with a row for each joint as one with a row for each time.

    If the joints have times of their own, they are interpolated at those of the first joint.

    Args:
        table: The log.
        column_map: What its columns mean. If `axes.column` is None, both are returned unchanged.

    Returns:
        The log with columns COLUMN/JOINT, and a map for it.

    Raises:
        InputError: A column is missing, or a joint has no rows.
    """
    name = column_map.axes.column
    if name is None:
        return table, column_map
    if name not in table.columns:
        raise table.missing(name, "axes.column")
    joints = _names_in(table, name)
    named = column_map.axes.names
    axes = joints if named is None else [str(one) for one in named]
    lacking = [axis for axis in axes if axis not in joints]
    if lacking:
        raise InputError(
            f"{table.source}: no row has the joint {listed(lacking)} in column '{name}'; it has "
            f"{listed(joints)}; correct axes.names in the map"
        )
    if len(axes) > _MOST_JOINTS:
        raise InputError(
            f"{table.source}: column '{name}' has {len(axes)} different values, too many for the "
            "names of joints; correct axes.column in the map"
        )
    text = as_texts(table.columns[name])
    rows = [np.flatnonzero(text == axis) for axis in axes]
    notes = [
        *table.notes,
        f"each joint has a row of its own; the joints are, in this order, {', '.join(axes)}",
    ]
    if len(axes) < len(joints):
        others = listed(one for one in joints if one not in axes)
        notes.append(f"rows of joints that axes.names does not name were left out: {others}")
    if column_map.time.column is not None:
        time, _ = times_of(table, column_map, [])
    else:  # the rows of each joint are evenly spaced
        time = np.zeros(len(table))
        for own in rows:
            time[own] = np.arange(len(own))
    first = rows[0]
    alike = all(np.array_equal(time[own], time[first]) for own in rows[1:])
    if not alike and any((np.diff(time[own]) < 0).any() for own in rows):
        raise InputError(
            f"{table.source}: the joints have different times, which also go back; cut the log "
            "where its clock starts again"
        )
    columns: dict[str, np.ndarray] = {
        one: values[first]
        for one, values in table.columns.items()
        if one in {column_map.time.column, column_map.segment, column_map.program}
    }
    changes: dict[str, Any] = {}
    units = dict(table.units)
    for quantity_name in QUANTITIES:
        quantity = getattr(column_map, quantity_name)
        if quantity is None:
            continue
        one = quantity.columns
        assert isinstance(one, str)  # the map was checked
        changes[quantity_name] = quantity.model_copy(update={"columns": f"{one}/{AXIS}"})
        if one not in table.columns:
            if quantity.optional:
                continue
            raise table.missing(one, quantity_name)
        for axis, own in zip(axes, rows, strict=True):
            if alike:
                values = table.columns[one][own]
            else:
                values = at_times(time[first], time[own], table.numbers(one)[own])
            columns[f"{one}/{axis}"] = values
            if one in table.units:
                units[f"{one}/{axis}"] = table.units[one]
    if not alike:
        notes.append(f"the joints have times of their own; they were interpolated at '{axes[0]}'")
    lines = None if table.lines is None else table.lines[first]
    wide = replace(
        table, columns=columns, units=units, axes=tuple(axes), lines=lines, notes=tuple(notes)
    )
    return wide, column_map.model_copy(update=changes)


def _names_in(table: Table, name: str) -> list[str]:
    """Different values of a column, in the order in which they appear; numbers in theirs."""
    known = table.columns[name][~is_blank(table.columns[name])]
    if known.dtype.kind in "fiu":
        known = np.sort(known)
    return list(dict.fromkeys(as_texts(known).tolist()))
