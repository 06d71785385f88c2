"""From the columns of a log to the arrays of a recording, in SI units.

made = arranged(table, column_map)
made.named["joint_position"]  # [rad], shape (samples, n_axes)
made.rows[0]                  # what was read as position of axis 1, and how it was converted
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.clocks import at_times, check_one_clock
from faultgen.importing.column_map import AXIS, QUANTITIES, ColumnMap, Quantity
from faultgen.importing.long_format import widened
from faultgen.importing.quantity import Read, columns_of, each, read_quantity
from faultgen.importing.rows import (
    complete_rows,
    rows_of_program,
    segments_of,
    without_equal_times,
)
from faultgen.importing.table import Table
from faultgen.importing.times import clock_of, times_of


@dataclass(frozen=True)
class Row:
    """How one column was understood."""

    quantity: str
    """Name of the array in the recording."""
    axis: int | None
    """Axis, from 1; None for a quantity of the whole robot."""
    column: str
    """Name in the log."""
    unit: str
    """Unit in the log."""
    factor: float
    """SI units in one unit of the log, with signs, gear ratio and torque constant."""
    lowest: float
    """Smallest value [SI]."""
    highest: float
    """Largest value [SI]."""
    si: str
    """SI unit."""


@dataclass(frozen=True, eq=False)
class Arranged:
    """A log as named arrays."""

    named: dict[str, np.ndarray]
    """Arrays by the names that recordings have, and `time` [s]."""
    attributes: dict[str, Any]
    """Attributes by the names that recordings have."""
    rows: tuple[Row, ...]
    """How each column was understood."""
    notes: tuple[str, ...]
    """One line for each decision that the map did not state."""


def arranged(table: Table, column_map: ColumnMap, program: str | None = None) -> Arranged:
    """Read the quantities of a recording from a table.

    Args:
        table: The columns.
        column_map: What they mean.
        program: Name of the program whose rows are taken. None: all rows.

    Returns:
        The arrays.

    Raises:
        InputError: A column is missing or holds no numbers, a unit is unknown, or an entry is
            missing. The message is one line that names it and the remedy.
    """
    if not len(table):
        raise InputError(f"{table.source}: has no rows of numbers")
    table, column_map = widened(table, column_map)
    notes = list(table.notes)
    axes = _axes(table, column_map)
    column_map = _with_clock(table, column_map, axes)
    found: dict[str, Read] = {}
    for name in ("position", "velocity", "torque", "reference_position", "temperature"):
        one = read_quantity(table, column_map, name, axes, notes)
        if one is not None:
            found[name] = one
    if "torque" not in found:
        one = read_quantity(table, column_map, "current", axes, notes)
        if one is None:
            raise InputError(
                f"{table.source}: has neither torque nor current; name the columns of one of them "
                "under [torque] or [current] in the map"
            )
        found["current"] = one
    elif column_map.current and set(columns_of(column_map.current, axes)) <= table.columns.keys():
        notes.append("the torque was read; currents were left out")
    time, attributes = times_of(table, column_map, notes)
    _check_clocks(table, column_map, axes)
    for name, one in found.items():
        _at_one_time(table, column_map, name, one, time, notes)
    kept = complete_rows(table, found, time, notes)
    kept = rows_of_program(table, column_map, kept, program, notes)
    starts = segments_of(table, column_map, time, kept, notes)
    kept, starts = without_equal_times(table, time, kept, starts, notes)
    side = column_map.position.side or column_map.side
    named, rows = {}, []
    for name, one in found.items():
        target, factor, si = _target(name, one, column_map, side, axes)
        values = one.values[kept] * factor
        for k, column in enumerate(one.columns):
            rows.append(
                Row(
                    quantity=target,
                    axis=k + 1 if len(one.columns) > 1 or len(axes) == 1 else None,
                    column=column,
                    unit=str(one.units[k]),
                    factor=float(one.factors[k] * factor[k]),
                    lowest=float(values[:, k].min()),
                    highest=float(values[:, k].max()),
                    si=si[k],
                )
            )
        named[target] = values[:, 0] if name == "temperature" and values.shape[1] == 1 else values
    if "sample_period" not in attributes or len(kept) < len(table):
        attributes.pop("sample_period", None)
        named["time"] = time[kept]
    attributes["robot"] = column_map.robot
    attributes["torque_sensor"] = column_map.torque_sensor
    if len(starts) > 1:
        attributes["segments"] = starts
    if column_map.payload_mass is not None:
        attributes["payload_mass"] = column_map.payload_mass
    return Arranged(named, attributes, tuple(rows), tuple(notes))


def _axes(table: Table, column_map: ColumnMap) -> list[str]:
    """What stands for {axis} in patterns; numbers of columns for a list of names."""
    if column_map.axes.names is not None:
        return [str(name) for name in column_map.axes.names]
    if isinstance(column_map.position.columns, list):
        return [str(k + 1) for k in range(len(column_map.position.columns))]
    if table.axes:
        return list(table.axes)
    pattern = column_map.position.columns
    before, after = pattern.split(AXIS, 1)
    wanted = re.compile(re.escape(before) + r"(\d+)" + re.escape(after.replace(AXIS, "\0")))
    numbers = sorted(int(m[1]) for name in table.columns if (m := wanted.fullmatch(name)))
    if not numbers:
        raise table.missing(pattern, "position")
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))) or numbers[0] > 1:
        has = ", ".join(map(str, numbers))
        raise InputError(
            f"{table.source}: columns '{pattern}' have the numbers {has}; they must begin with 0 "
            "or 1 and have no gap, or state axes.names"
        )
    return [str(number) for number in numbers]


def _with_clock(table: Table, column_map: ColumnMap, axes: Sequence[str]) -> ColumnMap:
    """A map whose time is the clock of the position, for a log with a clock for each channel."""
    if not table.clock or column_map.time.column != table.clock or table.clock in table.columns:
        return column_map
    first = columns_of(column_map.position, axes)[0]
    if first not in table.clocks:
        raise table.missing(first, "position")
    time = column_map.time.model_copy(update={"column": table.clocks[first]})
    return column_map.model_copy(update={"time": time})


def _check_clocks(table: Table, column_map: ColumnMap, axes: Sequence[str]) -> None:
    """Refuse a log whose channels seem to have clocks of their own that the map does not name."""
    name = column_map.time.column
    if name is None or column_map.time.columns is not None or name not in table.columns:
        return
    if table.axes or table.clocks:  # a bag holds all at one time; other clocks are known
        return
    quantities = [getattr(column_map, one) for one in QUANTITIES]
    used = [column for one in quantities if one is not None for column in columns_of(one, axes)]
    check_one_clock(table, name, [*used, *([column_map.segment] if column_map.segment else [])])


def _at_one_time(
    table: Table,
    column_map: ColumnMap,
    name: str,
    one: Read,
    time: np.ndarray,
    notes: list[str],
) -> None:
    """Interpolate a quantity with times of its own at the times of the rows."""
    base = column_map.time.column
    if base is None:  # the rows are evenly spaced
        return
    stated: Any = (column_map.time.columns or {}).get(name)  # type: ignore[call-overload]
    if stated is None:  # the log itself may say so
        of_axis = [table.clocks.get(column, base) for column in one.columns]
    else:
        of_axis = each(f"time.columns.{name}", stated, len(one.columns))
    other = False
    for k, clock in enumerate(of_axis):
        if clock == base:
            continue
        own = clock_of(table, column_map, clock, time)
        if stated is None and np.array_equal(own, time, equal_nan=True):
            continue
        one.values[:, k] = at_times(time, own, one.values[:, k])
        other = True
    if not other:
        return
    notes.append(
        f"{name} has times of its own ({', '.join(dict.fromkeys(of_axis))}), and was interpolated "
        f"at those of '{column_map.time.column}'"
    )


def _target(
    name: str, one: Read, column_map: ColumnMap, side: str, axes: Sequence[str]
) -> tuple[str, np.ndarray, list[str]]:
    """Name in the recording, factor of each column for signs, gears and constants, SI units."""
    count = len(one.columns)
    if name == "temperature":
        return name, np.ones(count), one.si
    quantity: Quantity = getattr(column_map, name)
    own = quantity.side or column_map.side
    factor = np.array(each(f"{name}.sign", quantity.sign, count), float)
    factor = factor * np.array(each("axes.sign", column_map.axes.sign, count), float)
    si = one.si
    if name == "current":
        constants = each("axes.torque_constant", column_map.axes.torque_constant, count)
        if constants[0] is None:
            return "motor_current", factor, si
        factor = factor * np.array(constants, float)
        si = ["N m"] * count
    wanted = "joint" if name == "reference_position" else side
    if own != wanted:
        ratio = each("axes.gear_ratio", column_map.axes.gear_ratio, count)
        if ratio[0] is None or 0 in ratio:
            raise InputError(
                f"map: {name} is on the {own} side, but the recording needs it on the {wanted} "
                f'side; state axes.gear_ratio, not 0, or {name}.side = "{wanted}" if the log has '
                "it there"
            )
        to_motor = (wanted == "motor") != (name in ("torque", "current"))
        factor = factor * np.array(ratio, float) ** (1 if to_motor else -1)
    if name == "reference_position":
        return name, factor, si
    return f"{side}_{'torque' if name == 'current' else name}", factor, si
