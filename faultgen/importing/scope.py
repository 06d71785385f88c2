"""Text that TwinCAT Scope View exports: a header for each channel, and columns of times.

    Name             Axis1.Pos    Name             Axis1.Torque
    SampleTime[ms]   4            SampleTime[ms]   2
    0                0.10         0                3.1
    4                0.11         2                3.2

A line of the header repeats its title in each column of times. A channel has the times of the next
such column to its left, so that both ways of exporting times (for each channel, and for each sample
time) are read alike.

Source: Beckhoff Information System, TE13xx TwinCAT 3 Scope View, "Export in csv", and TwinCAT 2
Scope, "Scope Settings", which shows such a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.sizes import check_size
from faultgen.importing.table import Table, parsed_rows, split_cells

CLOCK = "Time"
"""Name of the times in maps."""

_NAME, _SYMBOL = "Name", "SymbolName"
_KNOWN = ("SampleTime", "Starttime of export")  # beginnings of lines that no other log has
_LOOKED_AT = 60  # lines of the header
_SEPARATORS = ("\t", ";", ",")
_FILETIME = 1e16  # from which times are in units of 100 ns since 1601, in place of ms


def is_scope(lines: Sequence[str]) -> bool:
    """Whether a text is such an export.

    Args:
        lines: Its lines.
    """
    head = [line.lstrip('"') for line in lines[:_LOOKED_AT]]
    return (
        bool(head)
        and head[0].startswith(_NAME)
        and any(line.startswith(_KNOWN) for line in head)
        and any(line.startswith(_NAME) for line in head[1:])
    )


def read_scope(path: Path, lines: Sequence[str]) -> Table:
    """Read such an export.

    Args:
        path: The file, for messages.
        lines: Its lines.

    Returns:
        Its channels, and columns `Time of CHANNEL` in [ms] since the first sample.

    Raises:
        InputError: It has no columns of times, or no rows.
    """
    named = max(
        k for k in range(1, min(len(lines), _LOOKED_AT)) if lines[k].lstrip('"').startswith(_NAME)
    )
    separator = next((one for one in _SEPARATORS if one in lines[named]), "\t")
    names = _header(lines[named], separator)
    first = next(
        (k for k in range(named, len(lines)) if _is_row(lines[k], separator, len(names))), None
    )
    if first is None:
        raise InputError(
            f"{path}: is an export of TwinCAT Scope without columns of times for its {len(names)} "
            "columns of names; export it with Timelines 'All' or 'For each sampletime'"
        )
    last = first
    while last < len(lines) and _is_row(lines[last], separator, len(names)):
        last += 1
    check_size(path, 8.0 * (last - first) * len(names))
    rows = lines[first:last]
    decimal = "," if separator != "," and any("," in line for line in rows[:_LOOKED_AT]) else "."
    cells = parsed_rows(rows, len(names), separator, decimal)
    clocks = [k for k, name in enumerate(names) if name == names[0]]
    times = {k: cells[k].to_numpy(float) for k in clocks}
    if len(set(names)) < len(names) - len(clocks) + 1:  # the whole names of symbols differ
        whole = next((line for line in lines[named:first] if line.startswith(_SYMBOL)), "")
        found = _header(whole, separator)
        names = found if len(found) == len(names) else names
    zero = min(float(np.nanmin(one)) for one in times.values())
    unit = 1e-4 if zero > _FILETIME else 1.0
    columns: dict[str, np.ndarray] = {}
    of_channels = {}
    clock = ""
    for k, name in enumerate(names):
        if k in times:
            continue
        own = max(one for one in clocks if one < k)
        if name in columns:
            raise InputError(
                f"{path}: two channels have the name '{name}'; rename one in the scope"
            )
        if own == k - 1:
            clock = f"{CLOCK} of {name}"
            columns[clock] = unit * (times[own] - zero)
        columns[name] = cells[k].to_numpy()
        of_channels[name] = clock
    units = {name: "ms" for name in columns if name.startswith(f"{CLOCK} of ")}
    note = f"export of TwinCAT Scope: {len(of_channels)} channels, columns of times: {len(clocks)}"
    return Table(
        source=str(path),
        columns=columns,
        units=units,
        clocks=of_channels,
        clock=CLOCK,
        lines=np.arange(first, last) + 1,
        notes=(note,),
    )


def _header(line: str, separator: str) -> list[str]:
    cells = [cell.strip() for cell in split_cells(line, separator)]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _is_row(line: str, separator: str, count: int) -> bool:
    """Whether a line has numbers, and blanks, in as many cells as there are names."""
    cells = [cell.strip() for cell in line.rstrip("\r\n").split(separator)]
    while len(cells) > count and not cells[-1]:
        cells.pop()
    known = [cell for cell in cells if cell]
    return len(cells) == count and bool(known) and all(map(_is_number, known))


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
