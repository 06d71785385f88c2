"""Reading one quantity of a log: its columns, units, missing values and signs.

one = read_quantity(table, column_map, "torque", axes, notes)
one.values  # [N m], shape (rows, axes)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.column_map import AXIS, ColumnMap, Quantity
from faultgen.importing.oddities import unwrapped, without_missing
from faultgen.importing.table import Table
from faultgen.importing.units import PERCENT, SHARES, conversion, known_unit
from faultgen.importing.words import Word, words_of

_KINDS = {"reference_position": "position"}
_SIGNED = ("position", "velocity", "torque", "current", "reference_position")


@dataclass(frozen=True, eq=False)
class Read:
    """A quantity as the log has it."""

    columns: list[str]
    """Names of the columns in the log."""
    units: list[str | float]
    """Their units in the log."""
    values: np.ndarray
    """[SI], without signs and gear ratios, shape (rows, columns)."""
    factors: np.ndarray
    """SI units in one unit of the log, shape (columns,)."""
    si: list[str]
    """SI unit of each column."""


def read_quantity(
    table: Table,
    column_map: ColumnMap,
    name: str,
    axes: Sequence[str],
    notes: list[str],
) -> Read | None:
    """Read a quantity.

    Args:
        table: The log.
        column_map: What its columns mean.
        name: Name of the quantity in the map.
        axes: Names of the axes.
        notes: Gets a line for each decision that the map does not state.

    Returns:
        The quantity; None if the map has none, or the log lacks an optional one.

    Raises:
        InputError: A column is missing or holds no numbers, or its unit is unknown.
    """
    quantity: Quantity | None = getattr(column_map, name)
    if quantity is None:
        return None
    columns = columns_of(quantity, axes)
    if len(columns) != len(axes) and not (name == "temperature" and len(columns) == 1):
        raise InputError(
            f"{table.source}: {name}.columns lists {len(columns)} columns, but there are "
            f"{len(axes)} axes; list one for each axis"
        )
    lacking = [column for column in columns if column not in table.columns]
    if lacking and quantity.optional:
        if len(lacking) < len(columns):
            notes.append(f"{name} was left out, because there is no column '{lacking[0]}'")
        return None
    if lacking:
        raise table.missing(lacking[0], name)
    kind = _KINDS.get(name, name)
    given = each(f"{name}.unit", quantity.unit, len(columns))
    zero = each(f"{name}.zero", quantity.zero, len(columns))
    rated = each(f"{name}.rated", quantity.rated, len(columns))
    units, values, factors, si = [], [], [], []
    words: list[Word | None] = [None] * len(columns)
    if quantity.bits is None and quantity.sign_bit is None and name in _SIGNED:
        words = words_of([table.numbers(column) for column in columns])
    for k, column in enumerate(columns):
        stated = table.units.get(column)
        unit = given[k] if given[k] is not None else stated
        if unit is None:
            raise InputError(
                f"{table.source}: the unit of column '{column}' is not known; state {name}.unit in "
                "the map"
            )
        if stated is not None and isinstance(unit, str) and known_unit(unit) != known_unit(stated):
            notes.append(f"column '{column}' states {stated}; it was read as {unit}, as in the map")
        try:
            how = conversion(kind, unit)
        except InputError as error:
            raise InputError(f"{table.source}: column '{column}', {name}.{error}") from None
        factor = how.factor
        if isinstance(unit, str) and known_unit(unit) in SHARES:
            if rated[k] is None:
                raise InputError(
                    f"{table.source}: column '{column}' is in "
                    f"{'percent' if how.factor == SHARES[PERCENT] else 'permille'}; state "
                    f"{name}.rated in the map, which is 100 % in [{how.si}]"
                )
            factor *= rated[k]
        units.append(unit)
        factors.append(factor)
        si.append(how.si)
        cells = _cells(table, column_map, name, column, words[k], notes)
        values.append(factor * (cells - zero[k]) + how.offset)
        turns = kind == "position" and how.si == "rad"
        if turns and (quantity.side or column_map.side) == "joint":
            values[-1] = unwrapped(table, column, values[-1], notes)
    return Read(columns, units, np.stack(values, axis=1), np.array(factors), si)


def _cells(
    table: Table,
    column_map: ColumnMap,
    name: str,
    column: str,
    word: Word | None,
    notes: list[str],
) -> np.ndarray:
    """Numbers of a column in the unit of the log, NaN where they are missing, with their signs."""
    quantity: Quantity = getattr(column_map, name)
    marks = column_map.file.missing
    values = table.numbers(column)
    if word is not None:
        signed = word.signed(without_missing(table, column, values, marks or [], notes))
        notes.append(
            f"column '{column}': {int((signed < 0).sum())} numbers from {2 ** (word.bits - 1)} on "
            f"were read as negative ({word}); if they are not, state {name}.bits = 0"
        )
        return signed
    values = without_missing(table, column, values, marks, notes)
    if quantity.sign_bit is not None:
        return Word(quantity.sign_bit + 1, magnitude=True).signed(values)
    return Word(quantity.bits).signed(values) if quantity.bits else values


def columns_of(quantity: Quantity, axes: Sequence[str]) -> list[str]:
    """Return the names of the columns that hold a quantity.

    Args:
        quantity: The quantity in the map.
        axes: Names of the axes.
    """
    if isinstance(quantity.columns, list):
        return quantity.columns
    if AXIS in quantity.columns:
        return [quantity.columns.replace(AXIS, axis) for axis in axes]
    return [quantity.columns]


def each(entry: str, value: Any, count: int) -> list[Any]:
    """Return a value for each axis.

    Args:
        entry: Name of the entry in the map, for the message.
        value: One value for all axes, or a list.
        count: Number of axes.

    Raises:
        InputError: The list has another length.
    """
    if not isinstance(value, list | tuple):
        return [value] * count
    if len(value) != count:
        raise InputError(f"map: {entry}: lists {len(value)} values for {count} axes")
    return list(value)
