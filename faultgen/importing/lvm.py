"""LabVIEW measurement files (.lvm): text with a header, and blocks that have headers of their own.

Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)". The times of
a block are its date and time plus X_Value, or X0 and Delta_X where X_Columns is No.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.sizes import check_size
from faultgen.importing.table import Table, parsed_rows
from faultgen.importing.units import known_unit

CLOCK = "X_Value"
"""Name of the times, in [s] since the first sample."""

BLOCK = "block"
"""Column with the number of the block, from 1."""

_FIRST = "LabVIEW Measurement"
_END = "***End_of_Header***"
_SPECIAL = ("***Start_Special***", "***End_Special***")
_SEPARATORS = {"tab": "\t", "comma": ","}


def is_lvm(lines: Sequence[str]) -> bool:
    """Whether a text is such a file.

    Args:
        lines: Its lines.
    """
    return bool(lines) and lines[0].strip().startswith(_FIRST)


@dataclass(frozen=True)
class _Block:
    """One block: its header, whose cells stand above those of the channels; names; and rows."""

    header: dict[str, list[str]]
    names: list[str]
    rows: list[str]

    def of(self, key: str, name: str) -> str:
        """What a line of the header says of a channel; '' if nothing."""
        cells, place = self.header.get(key, []), self.names.index(name)
        return cells[place] if place < len(cells) else ""


@dataclass(frozen=True)
class _Form:
    """What the header of the file says."""

    separator: str
    decimal: str
    x_columns: str
    """'one' for all channels, 'multi' for one each, or 'no'."""


def read_lvm(path: Path, lines: Sequence[str]) -> Table:
    """Read such a file.

    Args:
        path: The file, for messages.
        lines: Its lines.

    Returns:
        Its channels, their times, and the number of the block.

    Raises:
        InputError: A header is incomplete, or the blocks have different channels.
    """
    form, blocks = _parts(path, lines)
    channels = [name for name in blocks[0].names if name not in ("", CLOCK, "Comment")]
    if len(set(channels)) < len(channels) or not channels:
        raise InputError(f"{path}: two channels have the same name, or none has one; name them")
    check_size(path, 16.0 * len(lines) * len(channels))
    parts = []
    since = _begin(blocks[0], channels[0])  # as a float, a time since 1970 is exact to 2e-7 s only
    for number, block in enumerate(blocks, start=1):
        if block.names != blocks[0].names:
            raise InputError(
                f"{path}: block {number} has other channels than the first; write a file for each"
            )
        parts.append(_columns(path, form, block, channels, number, since))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    clocks = [name for name in columns if name.startswith(CLOCK)]
    zero = min(float(np.nanmin(columns[name], initial=np.inf)) for name in clocks)
    for name in clocks:
        columns[name] = np.round(columns[name] - zero, 9)
    units = dict.fromkeys(clocks, "s")
    for name in channels:
        if unit := known_unit(blocks[0].of("Y_Unit_Label", name)):
            units[name] = unit
    each = form.x_columns == "multi"
    return Table(
        source=str(path),
        columns=columns,
        units=units,
        clocks={name: f"{CLOCK} of {name}" for name in channels} if each else {},
        clock=CLOCK if each else "",
        notes=(
            f"LabVIEW file, blocks: {len(blocks)}; their dates and times were added to {CLOCK}",
        ),
    )


def _parts(path: Path, lines: Sequence[str]) -> tuple[_Form, list[_Block]]:
    """The form of the file, and its blocks that have rows."""
    kept, special = [], False
    for line in lines:
        special = special or line.startswith(_SPECIAL[0])
        if line.strip() and not special:
            kept.append(line.rstrip("\r\n"))
        special = special and not line.startswith(_SPECIAL[1])
    ends = [k for k, line in enumerate(kept) if line.startswith(_END)]
    if len(ends) < 2:
        raise InputError(
            f"{path}: is a LabVIEW measurement file without the header of a block; is it cut off?"
        )
    told = {}
    for line in kept[1 : ends[0]]:
        name, value = (re.split(r"[\t,]", line, maxsplit=1) + [""])[:2]
        told[name.strip()] = value.strip("\t ") or ","  # the decimal sign may be the separator
    form = _Form(
        separator=_SEPARATORS.get(told.get("Separator", "").rstrip(",").lower(), "\t"),
        decimal=told.get("Decimal_Separator", ".")[0],
        x_columns=told.get("X_Columns", "One").rstrip(",").lower(),
    )
    begins = [k for k, line in enumerate(kept) if line.startswith("Channels")]
    blocks = []
    for begin, end in zip(begins, [*begins[1:], len(kept)], strict=True):
        after = next((k for k in ends if begin < k < end), end)
        if end - after < 3:  # a block without rows
            continue
        header = [line.split(form.separator) for line in kept[begin:after]]
        blocks.append(
            _Block(
                {cells[0]: [cell.strip() for cell in cells] for cells in header},
                [cell.strip() for cell in kept[after + 1].split(form.separator)],
                kept[after + 2 : end],
            )
        )
    if not blocks:
        raise InputError(f"{path}: has no rows of numbers")
    return form, blocks


def _columns(
    path: Path, form: _Form, block: _Block, channels: Sequence[str], number: int, since: float
) -> dict[str, np.ndarray]:
    """The channels of a block, and their times since the first block began."""
    try:
        cells = parsed_rows(block.rows, len(block.names), form.separator, form.decimal)
    except ValueError:  # also of pandas
        raise InputError(f"{path}: block {number} has rows with more cells than names") from None
    count = len(cells)
    clocks: dict[str, np.ndarray] = {}
    values: dict[str, np.ndarray] = {}
    for name in channels:
        place = block.names.index(name)
        if form.x_columns == "no":
            first, step = (_real(path, block, key, name, form.decimal) for key in ("X0", "Delta_X"))
            clock = first + step * np.arange(count)
        else:
            clock = _numbers(path, cells[place - 1 if form.x_columns == "multi" else 0], number)
        own = f"{CLOCK} of {name}" if form.x_columns == "multi" else CLOCK
        clocks.setdefault(own, clock + (_begin(block, name) - since))
        values[name] = _numbers(path, cells[place], number)
    return {**clocks, **values, BLOCK: np.full(count, number)}


def _numbers(path: Path, column: object, number: int) -> np.ndarray:
    try:
        return np.asarray(column, float)
    except ValueError:
        raise InputError(
            f"{path}: block {number} has cells that are no numbers; is Decimal_Separator right?"
        ) from None


def _real(path: Path, block: _Block, key: str, name: str, decimal: str) -> float:
    try:
        return float(block.of(key, name).replace(decimal, "."))
    except ValueError:
        raise InputError(
            f"{path}: the header of a block has no {key} for channel '{name}', and X_Columns is "
            "No; write the file with X values"
        ) from None


def _begin(block: _Block, name: str) -> float:
    """When a block began [s since 1970]; 0 if it does not say so."""
    date, time = (block.of(key, name) for key in ("Date", "Time"))
    clock, _, fraction = time.replace(",", ".").partition(".")
    try:
        day = datetime.strptime(f"{date} {clock} +0000", "%Y/%m/%d %H:%M:%S %z")
    except ValueError:
        return 0.0
    return day.timestamp() + float(f"0.{fraction or 0}")
