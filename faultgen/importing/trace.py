"""Traces of KUKA controllers: DIAdem header files (.dat) with binary data (.r64).

The header lists channels between ``#BEGINCHANNELHEADER`` and ``#ENDCHANNELHEADER``. A line is a
number, a comma and a value: 200 name, 202 unit, 210 IMPLICIT or EXPLICIT, 211 data file, 213 BLOCK
or CHANNEL, 214 type, 220 number of values, 221 place of the first value from 1, 240 first value,
241 step or factor.

Source: National Instruments, DIAdem help, "Header of a DAT file"; that KUKA writes it so, and the
names of its files: xikuibin/KukaTraceHelper and antcsny/Data-collection-app-V2 on GitHub.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.sizes import MOST_BYTES, check_size
from faultgen.importing.table import Table
from faultgen.system.reading import read_bytes

BEGIN, END = "#BEGINCHANNELHEADER", "#ENDCHANNELHEADER"
_TYPES = {"REAL64": "<f8", "REAL32": "<f4", "INT32": "<i4", "INT16": "<i2"}
_NAME, _UNIT, _WAY, _DATA, _ORDER, _TYPE, _COUNT, _PLACE, _START, _STEP = (
    *("200", "202", "210", "211", "213", "214"),
    *("220", "221", "240", "241"),
)
_LARGEST_HEADER = 2**22
_MOST = 100_000_000  # values of a channel
_OF_AXIS = re.compile(r"(.*)#(\d+)")  # NAME_NextGenDrive#1.dat: one file for each axis


def read_trace(path: Path) -> Table:
    """Read a trace, and those of the other axes beside it.

    Args:
        path: The header file, with the data file beside it. If its name ends with # and a number,
            the files of the other axes are read too, and the channels get the same ending.

    Returns:
        Its channels.

    Raises:
        InputError: A file is missing, or is no such trace.
    """
    found = _OF_AXIS.fullmatch(path.stem)
    if not found:
        columns, units, _ = _channels(path)
        return Table(source=str(path), columns=columns, units=units)
    beside = {}
    for other in path.parent.iterdir():
        match = _OF_AXIS.fullmatch(other.stem)
        if match and match[1] == found[1] and other.suffix.lower() == ".dat":
            beside[match[2]] = other
    merged: dict[str, np.ndarray] = {}
    merged_units: dict[str, str] = {}
    lengths = set()
    for axis, file in sorted(beside.items(), key=lambda item: int(item[0])):
        columns, units, implicit = _channels(file)
        lengths.add(len(next(iter(columns.values()))))
        for name, values in columns.items():
            own = name if name in implicit else f"{name}#{axis}"
            merged.setdefault(own, values)
            if name in units:
                merged_units.setdefault(own, units[name])
        check_size(path, sum(values.nbytes for values in merged.values()))
    short = min(lengths)
    notes = [f"{len(beside)} files, one for each axis: {', '.join(sorted(beside))}"]
    if len(lengths) > 1:
        notes.append(f"the files have {short} to {max(lengths)} rows; all were cut to {short}")
    return Table(
        source=str(path),
        columns={name: values[:short] for name, values in merged.items()},
        units=merged_units,
        notes=tuple(notes),
    )


def _channels(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str], set[str]]:
    """Values and units of the channels of one header file, and those computed from the header."""
    text = read_bytes(path, "trace", _LARGEST_HEADER).decode("utf-8", errors="replace")
    if "�" in text:  # the sign of degrees in cp1252
        text = read_bytes(path, "trace", _LARGEST_HEADER).decode("cp1252", errors="replace")
    blocks = [block.split(END)[0] for block in text.split(BEGIN)[1:]]
    headers = [
        dict(line.split(",", 1) for line in map(str.strip, block.splitlines()) if "," in line)
        for block in blocks
    ]
    explicit = [one for one in headers if _explicit(one)]
    if not explicit:
        raise InputError(f"{path}: lists no channel with data; give the .dat file of a trace")
    data = {}
    size = 0
    columns: dict[str, np.ndarray] = {}
    units = {}
    for one in headers:
        name = one.get(_NAME, "").strip()
        if not name:
            raise InputError(f"{path}: a channel has no name (line 200)")
        if name in columns:
            raise InputError(f"{path}: channel '{name}' appears more than once")
        if _explicit(one):
            kind = one.get(_TYPE, "REAL64").strip()
            if kind not in _TYPES:
                raise InputError(
                    f"{path}: channel '{name}' has type {kind}; known are {', '.join(_TYPES)}"
                )
            file = _beside(path, one.get(_DATA, "").strip())
            if (file, kind) not in data:
                content = read_bytes(file, "data of a trace", MOST_BYTES)
                width = np.dtype(_TYPES[kind]).itemsize
                whole = len(content) // width * width
                data[file, kind] = np.frombuffer(content[:whole], _TYPES[kind])
            together = [two for two in explicit if two.get(_DATA) == one.get(_DATA)]
            most = len(data[file, kind])
            count = most // len(together) + 1
            if _by_channel(one):
                count = min(_whole(path, one, _COUNT), most)
            size += np.dtype(float).itemsize * count
            check_size(path, size)
            columns[name] = _values(path, name, one, data[file, kind], len(together))
        else:
            columns[name] = np.zeros(0)  # in its place; it may be longer than all others
        if one.get(_UNIT, "").strip():
            units[name] = one[_UNIT].strip()
    short = min(len(columns[one[_NAME].strip()]) for one in explicit)
    for one in headers:
        if not _explicit(one):
            short = min(short, _whole(path, one, _COUNT))
            steps = _real(path, one, _STEP, 1.0) * np.arange(short)
            columns[one[_NAME].strip()] = _real(path, one, _START, 0.0) + steps
    implicit = {one[_NAME].strip() for one in headers if not _explicit(one)}
    return {name: values[:short] for name, values in columns.items()}, units, implicit


def _explicit(header: Mapping[str, str]) -> bool:
    # German controllers write EXPLIZIT
    return header.get(_WAY, "EXPLICIT").strip().upper().startswith("EXPLI")


def _by_channel(header: Mapping[str, str]) -> bool:
    """Whether the values of a channel stand behind each other."""
    return header.get(_ORDER, "BLOCK").strip().upper() == "CHANNEL"


def _beside(path: Path, named: str) -> Path:
    """The data file. The header may name it with a folder, or in other letters."""
    wanted = {Path(named.replace("\\", "/")).name.lower(), f"{path.stem}.r64".lower()}
    for other in sorted(path.parent.iterdir()):
        if other.name.lower() in wanted and other.suffix.lower() != ".dat":
            return other
    raise InputError(f"{path}: its data file '{named or path.stem + '.r64'}' is not beside it")


def _values(
    path: Path, name: str, header: Mapping[str, str], data: np.ndarray, width: int
) -> np.ndarray:
    place = _whole(path, header, _PLACE, 1) - 1
    if _by_channel(header):
        values = data[place : place + _whole(path, header, _COUNT)]
    else:
        values = data[place::width]
        if _COUNT in header:
            values = values[: _whole(path, header, _COUNT)]
    if not len(values):
        raise InputError(f"{path}: channel '{name}' has no values in its data file")
    factor, start = _real(path, header, _STEP, 1.0) or 1.0, _real(path, header, _START, 0.0)
    return values.astype(float) * factor + start


def _whole(path: Path, header: Mapping[str, str], key: str, default: int = 0) -> int:
    number = _real(path, header, key, default)
    if not (0 <= number <= _MOST and number == int(number)):
        raise InputError(f"{path}: line {key} holds {number:g}; give at most {_MOST:,} values")
    return int(number)


def _real(path: Path, header: Mapping[str, str], key: str, default: float) -> float:
    text = header.get(key, "").strip()
    try:
        return float(text) if text else default
    except ValueError:
        raise InputError(f"{path}: line {key} holds '{text}', which is no number") from None
