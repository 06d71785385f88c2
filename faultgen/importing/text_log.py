"""Logs that are text: columns with any separator, names, comments and lines before them.

What the map does not state is found out from the lines: the separator and the decimal sign under
which a line has the most numbers, and the names in the line above the first such line.
"""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.column_map import File
from faultgen.importing.lvm import is_lvm, read_lvm
from faultgen.importing.scope import is_scope, read_scope
from faultgen.importing.sizes import LARGEST_LOG, check_size, check_text
from faultgen.importing.structured import (
    check_structured,
    read_structured,
    structure_of,
    without_lists,
)
from faultgen.importing.table import (
    BLANK,
    Table,
    named_with_units,
    parsed_rows,
    split_cells,
    with_units_apart,
)
from faultgen.importing.units import known_unit

_SEPARATORS = {";": ";", "tab": "\t", ",": ",", "blank": " "}
_NUMBER = {
    mark: re.compile(rf"[+-]?(\d+({re.escape(mark)}\d*)?|{re.escape(mark)}\d+)([eE][+-]?\d+)?")
    for mark in (".", ",")
}
# a cell with nothing but several numbers: split by a wrong separator
_SEVERAL = re.compile(r"[+-]?\d[\d.,eE+-]*(\s+[+-]?\d[\d.,eE+-]*)+")
_SWITCHES = ("true", "false", "on", "off", "yes", "no")
_LOOKED_AT = 400  # lines in which the first row of numbers is searched for
_MOST_LAST = 20  # lines after the rows of numbers that are left out, such as a summary


def read_text_log(path: Path, file: File) -> Table:
    """Read a log that is text, also if it is compressed with gzip.

    Args:
        path: The file.
        file: What the map says about it.

    Returns:
        Its columns.

    Raises:
        InputError: The file is no such text. The message is one line that states where it is wrong
            and what would be right.
    """
    lines, notes = _lines(path, file.encoding)
    for recognised, read in ((is_lvm, read_lvm), (is_scope, read_scope)):
        if recognised(lines):
            return with_units_apart(read(path, lines))
    kind = structure_of(lines)
    if kind is not None:
        check_structured(path, lines, kind)
    if kind in ("xml", "json"):
        return with_units_apart(read_structured(path, lines, kind))
    if kind == "lists":
        lines = without_lists(path, lines)
        notes.append("cells hold lists: their numbers were written into columns NAME_1, NAME_2, …")
    comments = (file.comment,) if isinstance(file.comment, str) else tuple(file.comment)
    comments = tuple(mark for mark in comments if mark)
    kept = [
        k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(comments)
    ]
    separator, decimal, first = _layout(path, [lines[k] for k in kept[:_LOOKED_AT]], file)
    if file.first is not None:
        first = int(np.searchsorted(kept, file.first - 1))
        if first == len(kept):
            raise InputError(f"{path}: file.first is {file.first}, but no row stands there")
    names, units = _names(path, lines, kept, first, separator, file, comments)
    above = {lines[k].strip() for k in kept[:first]}  # again where a logger was restarted
    rows = kept[first:]
    if above:
        rows = [k for k in rows if lines[k].strip() not in above]
    again = len(kept) - first - len(rows)
    if again:
        often = "once" if again == 1 else f"{again} times"
        notes.append(f"the line of the names is repeated {often}, and was left out")
    behind = 0  # lines that are no rows of numbers
    while behind < min(len(rows) - 1, _MOST_LAST) and not _score(
        _cells(lines[rows[-1 - behind]], separator), decimal, strict=False
    ):
        behind += 1
    if behind:
        ended = lines[rows[-behind]].strip()[:40]
        notes.append(f"lines after the rows of numbers were left out: {behind}, '{ended}'")
        rows = rows[:-behind]
    check_size(path, np.dtype(float).itemsize * len(rows) * len(names))
    texts = [lines[k] for k in rows]
    columns = _Columns(names, lambda: _parsed(path, texts, rows, len(names), separator, decimal))
    if not all(columns.is_empty(k) for k, name in enumerate(names) if not name):
        raise InputError(
            f"{path}: column {names.index('') + 1} has no name; state all names under [file] names"
        )
    shown = {"\t": "tabs", " ": "blanks"}.get(separator, f"'{separator}'")
    notes.append(f"columns are separated by {shown}, fractions by '{decimal}'")
    return Table(
        source=str(path),
        columns=columns,
        units=units,
        lists=kind == "lists",
        lines=np.array(rows) + 1,
        notes=tuple(notes),
    )


class _Columns(Mapping[str, np.ndarray]):
    """Columns that are parsed when the first of them is read. A refusal needs their names only."""

    def __init__(self, names: Sequence[str], parse: Callable[[], list[np.ndarray]]) -> None:
        # lines may end with a separator: a column without a name is none
        self._places = {name: k for k, name in enumerate(names) if name}
        self._parse = parse

    @cached_property
    def _all(self) -> list[np.ndarray]:
        return self._parse()

    def is_empty(self, k: int) -> bool:
        """Whether no row has anything in column k, from 0."""
        column = self._all[k]
        return column.dtype.kind == "f" and bool(np.isnan(column).all())

    def __getitem__(self, name: str) -> np.ndarray:
        return self._all[self._places[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def _lines(path: Path, encoding: str) -> tuple[list[str], list[str]]:
    """The lines of a file, and a note if its encoding was guessed."""
    try:
        with path.open("rb") as file:
            zipped = file.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if zipped else path.open("rb") as file:
            content = file.read(LARGEST_LOG + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    check_text(path, content)
    if encoding != "auto":
        try:
            return _decoded(content, encoding, "strict"), []
        except LookupError:
            raise InputError(
                f"file.encoding: '{encoding}' is unknown; give utf-8 or cp1252"
            ) from None
        except UnicodeError as error:
            row = content.count(b"\n", 0, getattr(error, "start", 0)) + 1
            raise InputError(
                f"{path}: line {row} is not {encoding}; correct file.encoding in the map"
            ) from None
    marks = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
    for mark, name in marks.items():
        if content.startswith(mark):
            return _decoded(content, name, "replace"), [f"the text is {name}"]
    if b"\0" in content[:1000]:
        raise InputError(
            f"{path}: is not text; state file.format in the map, or export the log as text"
        )
    try:
        return _decoded(content, "utf-8-sig", "strict"), []
    except UnicodeDecodeError:
        note = "the text is not UTF-8, read as cp1252"
        return _decoded(content, "cp1252", "replace"), [note]


def _decoded(content: bytes, encoding: str, errors: str) -> list[str]:
    """The lines of a text, decoded bit by bit: a single wide character would widen all others."""
    with io.TextIOWrapper(io.BytesIO(content), encoding, errors) as text:
        return [line.rstrip("\n") for line in text]


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in split_cells(line.rstrip(), separator)]


def _is_number(cell: str, decimal: str) -> bool:
    return bool(_NUMBER[decimal].fullmatch(cell))


def _score(cells: Sequence[str], decimal: str, strict: bool = True) -> int:
    """How many numbers a row has; 0 if it is no row of numbers."""
    numbers = sum(_is_number(cell, decimal) for cell in cells)
    if any(_SEVERAL.fullmatch(cell) for cell in cells):
        return 0
    # names of columns and lines of text have few numbers, or none
    plain = (cell.lower() for cell in cells if not _is_number(cell, decimal))
    others = sum(cell not in BLANK and cell not in _SWITCHES for cell in plain)
    return numbers if numbers >= 2 and (numbers > others or not strict) else 0


def _layout(path: Path, lines: Sequence[str], file: File) -> tuple[str, str, int]:
    """Separator, decimal sign and number of the first row of numbers."""
    if not lines:
        raise InputError(f"{path}: is empty")
    separators = list(_SEPARATORS) if file.separator == "auto" else [file.separator]
    decimals = [".", ","] if file.decimal == "auto" else [file.decimal]
    quoted = any('"' in line for line in lines)
    options = [(_SEPARATORS[name], decimal) for name in separators for decimal in decimals]
    # only where no line is mostly numbers, lines with more texts than numbers count
    for strict in (True, False):
        scores = {
            (separator, decimal): [
                _score(_cells(line, separator), decimal, strict) for line in lines
            ]
            for separator, decimal in options
            if separator != decimal or quoted
        }
        best = max(scores, key=lambda option: sum(scores[option]), default=None)
        if best is not None and any(scores[best]):
            return *best, next(k for k, score in enumerate(scores[best]) if score)
    raise InputError(
        f"{path}: no line with two or more numbers among the first {len(lines)}; state the "
        "separator and the decimal sign under [file] in the map"
    )


def _names(
    path: Path,
    lines: Sequence[str],
    kept: Sequence[int],
    first: int,
    separator: str,
    file: File,
    comments: tuple[str, ...],
) -> tuple[list[str], dict[str, str]]:
    """Names of the columns, and the units that stand with them or in a line below."""
    count = len(_cells(lines[kept[first]], separator))
    if file.names is not None:
        if len(file.names) != count:
            raise InputError(
                f"{path}: file.names lists {len(file.names)} names, but line {kept[first] + 1} has "
                f"{count} columns"
            )
        return _unique(*named_with_units(file.names))
    if file.header is not None:
        if file.header > len(lines):
            raise InputError(f"{path}: file.header is {file.header}, but it has {len(lines)} lines")
        above = [_uncommented(lines[file.header - 1], comments)]
    else:
        above = [lines[k] for k in kept[:first]][::-1]
        if not above:  # the names may be in a comment
            above = [_uncommented(line, comments) for line in lines[: kept[first]] if line.strip()]
            above = above[::-1]
    rows = [_cells(line, separator) for line in above]
    if not _cells(lines[kept[first]], separator)[-1]:  # rows of numbers end with a separator
        rows = [[*cells, ""] if len(cells) == count - 1 else cells for cells in rows]
    rows = [cells for cells in rows if len(cells) == count]
    if not rows:
        near = len(_cells(above[0], separator)) if above else 0
        told = f"the line above has {near} cells" if near else "there is no line above"
        raise InputError(
            f"{path}: line {kept[first] + 1} has {count} numbers, but {told}; state the line with "
            "the names as file.header, or the names as file.names"
        )
    below: dict[str, str] = {}
    names = rows[0]
    if len(rows) > 1 and all(known_unit(cell.strip("[]()")) or not cell for cell in names):
        names, marks = rows[1], [known_unit(cell.strip("[]()")) for cell in names]
        below = {name: mark for name, mark in zip(names, marks, strict=True) if mark}
    bare, units = named_with_units(names)
    return _unique(bare, {**below, **units})


def _uncommented(line: str, comments: Iterable[str]) -> str:
    line = line.lstrip()
    mark = next((mark for mark in comments if line.startswith(mark)), "")
    return line[len(mark) :].lstrip(" ")


def _unique(names: list[str], units: dict[str, str]) -> tuple[list[str], dict[str, str]]:
    """Number the columns whose name appears more than once."""
    seen: dict[str, int] = {}
    unique = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        several = name and names.count(name) > 1
        unique.append(f"{name} ({seen[name]})" if several else name)
        if several and name in units:
            units = {**units, unique[-1]: units[name]}
    return unique, units


def _parsed(
    path: Path, lines: list[str], rows: Sequence[int], count: int, separator: str, decimal: str
) -> list[np.ndarray]:
    """The columns of the rows."""
    try:
        cells = parsed_rows(
            (line.rstrip() for line in lines),
            count,
            r"\s+" if separator == " " else separator,
            decimal,
        )
    except ValueError as error:  # also of pandas
        found = re.search(r"line (\d+)", str(error))
        row = min(int(found[1]) - 1, len(rows) - 1) if found else 0
        has = len(_cells(lines[row], separator))
        raise InputError(
            f"{path}: line {rows[row] + 1} has {has} columns, but there are {count} names; remove "
            "the line, or state what begins such lines as file.comment, or the line of the first "
            "row of numbers as file.first"
        ) from None
    lines.clear()  # a long log is not kept twice
    return [cells[k].to_numpy() for k in range(count)]
