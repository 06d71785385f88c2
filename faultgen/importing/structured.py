"""Logs that are text with a structure: XML, JSON, JSON lines, and tables with lists in their cells.

Nested names are joined with points. A list of numbers ``q`` becomes the columns ``q_1``, ``q_2``, …

    <Rob><AIPos A1="0.1"/><IPOC>4000</IPOC></Rob>    AIPos.A1, IPOC
    {"time": 0.1, "q": [0.1, 0.2]}                   time, q_1, q_2
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.importing.sizes import check_size
from faultgen.importing.table import Table, split_cells

if TYPE_CHECKING:
    from xml.etree import ElementTree

_LIST = re.compile(r"\"?[\[(]\s*([^\[\]()]*?)\s*[\])]\"?")
_NUMBERS = re.compile(r"[+-]?[\d.][\d.eE+-]*([,;\s]+[+-]?[\d.][\d.eE+-]*)+")
_DECLARED = re.compile(r"<\?xml[^>]*\?>")
_DEEPEST = 20  # groups in groups
_LARGEST = {"xml": 25e6, "json": 50e6, "lists": 50e6}
"""Largest size of each kind of text [characters]: objects of Python take far more memory."""
_MOST = {"xml": ("<", 2_000_000), "json": (",[{", 6_000_000), "lists": (",[(", 6_000_000)}
"""Signs that begin an object, and how many there may be: each takes 70 to 300 bytes."""
_LOOKED_AT = 400  # lines among which a cell with a list is searched for


def structure_of(lines: Sequence[str]) -> str | None:
    """Tell how a text is structured.

    Args:
        lines: Its lines.

    Returns:
        'xml', 'json' or 'lists'; None for a plain table.
    """
    first = next((line.strip() for line in lines if line.strip()), "")
    if re.match(r"<[?!A-Za-z]", first):
        return "xml"
    if re.match(r"\{\s*(\"|$)|\[\s*([\[{]|$)", first):
        return "json"
    return "lists" if any(_has_list(line) for line in lines[:_LOOKED_AT]) else None


def check_structured(path: Path, lines: Sequence[str], kind: str) -> None:
    """Refuse a text whose objects would need too much memory.

    Args:
        path: The file, for messages.
        lines: Its lines.
        kind: 'xml', 'json' or 'lists'.

    Raises:
        InputError: It is too large. The message states the limit and what to do.
    """
    signs, most = _MOST[kind]
    size = sum(map(len, lines))
    if size > _LARGEST[kind] or sum(line.count(one) for line in lines for one in signs) > most:
        what = {"xml": "XML", "json": "JSON"}.get(kind, "text with lists in its cells")
        raise InputError(
            f"{path}: more than {_LARGEST[kind] / 1e6:.0f} MB of {what}, or more than "
            f"{most / 1e6:g} million values; cut it into shorter logs, or write a table with one "
            "column for each axis, which may be larger"
        )


def _has_list(line: str) -> bool:
    return any(_NUMBERS.fullmatch(one[1]) for one in _LIST.finditer(line))


def read_structured(path: Path, lines: Sequence[str], kind: str) -> Table:
    """Read a log in XML or JSON.

    Args:
        path: The file, for messages.
        lines: Its lines.
        kind: 'xml' or 'json'.

    Returns:
        Its columns: one for each number of a record, blank where a record lacks it.

    Raises:
        InputError: It is not well formed, or has no records of numbers.
    """
    rows = [dict(_flat("", one, 0)) for one in (_xml if kind == "xml" else _json)(path, lines)]
    names = list(dict.fromkeys(name for row in rows for name in row))
    check_size(path, 8.0 * len(rows) * len(names))
    if len(rows) < 2 or not names:
        raise InputError(
            f"{path}: is {kind.upper()} without records that follow each other; write one record "
            "with a time, positions and torques for each sample, or a table with one column each"
        )
    columns = {name: _column([row.get(name) for row in rows]) for name in names}
    note = f"{kind.upper()}: {len(rows)} records with {len(names)} values"
    return Table(source=str(path), columns=columns, notes=(note,))


def _column(values: list[Any]) -> np.ndarray:
    try:
        return np.array([np.nan if one in (None, "") else one for one in values], float)
    except (TypeError, ValueError):
        return np.array(["" if one is None else str(one) for one in values], object)


def _flat(prefix: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Names and values within a record."""
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{prefix}.{key}" if prefix else str(key), inner, depth + 1)
    elif isinstance(value, list):
        for k, inner in enumerate(value, start=1):
            yield from _flat(f"{prefix}_{k}", inner, depth + 1)
    else:
        yield prefix, value


def _json(path: Path, lines: Sequence[str]) -> list[Any]:
    """Records of a text that is one value, or a value a line."""
    try:
        try:
            whole = json.loads("\n".join(lines))
        except json.JSONDecodeError:
            return [_record(path, k, line) for k, line in enumerate(lines, 1) if line.strip()]
    except RecursionError:
        raise InputError(f"{path}: is JSON that is nested too deeply") from None
    while isinstance(whole, dict):
        lists = {key: one for key, one in whole.items() if isinstance(one, list)}
        records = [one for one in lists.values() if one and isinstance(one[0], dict)]
        if records:
            return max(records, key=len)
        if lists:  # one list for each column
            count = Counter(map(len, lists.values())).most_common(1)[0][0]
            alike = {key: one for key, one in lists.items() if len(one) == count}
            return [dict(zip(alike, row, strict=True)) for row in zip(*alike.values(), strict=True)]
        inner = [one for one in whole.values() if isinstance(one, dict)]
        whole = inner[0] if len(inner) == 1 else None
    return whole if isinstance(whole, list) else []


def _record(path: Path, number: int, line: str) -> Any:
    try:
        return json.loads(line.strip().rstrip(","))
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}: line {number} is not JSON ({error}); write one record in each line, or one "
            "list of records"
        ) from None


def _xml(path: Path, lines: Sequence[str]) -> list[dict[str, Any]]:
    """Records of a text of elements, with or without one around all of them."""
    from xml.etree import ElementTree

    text = _DECLARED.sub("", "\n".join(lines))
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path}: XML with a DOCTYPE is not read; remove it")
    try:
        around = ElementTree.fromstring(f"<log>\n{text}\n</log>")  # noqa: S314
    except ElementTree.ParseError as error:
        line, column = error.position
        raise InputError(
            f"{path}: is XML that is not well formed in line {line - 1}, column {column + 1} "
            f"({one_line(error).split(':')[0]}); is it cut off?"
        ) from None
    for _ in range(_DEEPEST):
        if len(around) != 1 or not len(around[0]):
            break
        around = around[0]
    if not len(around):
        return []
    tag = Counter(one.tag for one in around).most_common(1)[0][0]
    return [_element(one) for one in around if one.tag == tag]


def _element(element: ElementTree.Element) -> dict[str, Any]:
    """Attributes, text and children of an element; several children of one name become a list."""
    out: dict[str, Any] = dict(element.attrib)
    for child in element:
        inner: Any = _element(child) if child.attrib or len(child) else (child.text or "").strip()
        if child.tag in out:
            before = out[child.tag]
            out[child.tag] = [*before, inner] if isinstance(before, list) else [before, inner]
        else:
            out[child.tag] = inner
    return out


def without_lists(path: Path, lines: Sequence[str]) -> list[str]:
    """Write each number of lists in cells into a cell of its own, separated by tabs.

    Args:
        path: The file, for messages.
        lines: Its lines: names, and rows whose lists are as long as those in the first row.

    Returns:
        The lines of a plain table.

    Raises:
        InputError: The cells cannot be separated, or a list is shorter or longer than that above.
    """
    plain = [_LIST.sub(lambda found: _joined(found), line) for line in lines]
    first = next(k for k, line in enumerate(lines) if _has_list(line))
    names = next((line for line in reversed(plain[:first]) if line.strip()), "")
    separator = next((one for one in (";", "\t", ",") if one in names), None)
    header = split_cells(names.lstrip("#% "), separator) if separator else []
    counts = [len(cell.split(_MARK)) for cell in split_cells(plain[first], separator or ",")]
    if len(header) != len(counts):
        raise InputError(
            f"{path}: has cells that hold lists of numbers; write one column for each axis"
        )
    wide = [
        f"{name.strip()}_{k}" if count > 1 else name.strip()
        for name, count in zip(header, counts, strict=True)
        for k in range(1, count + 1)
    ]
    out = ["\t".join(wide)]
    for number, line in enumerate(plain[first:], first + 1):
        if not line.strip():
            continue
        cells = [cell.strip().split(_MARK) for cell in split_cells(line, separator or ",")]
        if [len(cell) for cell in cells] != counts:
            raise InputError(
                f"{path}: line {number} has lists of other lengths than line {first + 1}; write "
                "one column for each axis"
            )
        out.append("\t".join(one for cell in cells for one in cell))
    return out


_MARK = "\x1f"  # between numbers of a list


def _joined(found: re.Match[str]) -> str:
    inner = found[1]
    if not _NUMBERS.fullmatch(inner):
        return found[0]
    return _MARK.join(one for one in re.split(r"[,;\s]+", inner) if one)
