"""Including files in an MJCF file: the text becomes one, within bounds.

root = expanded(parse_xml(text, where), path, reach, where)
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from faultgen.errors import InputError
from faultgen.mjcf.parsing import check_extent, parse_xml
from faultgen.mjcf.reach import Reach
from faultgen.system.reading import LARGEST_TEXT, read_text

MOST_INCLUDES = 200
"""Largest number of files that a model may include, each counted as often as it is included. The
largest public models include some dozens; reading so many takes some 50 ms."""


@dataclass
class _Total:
    """What a model has become so far."""

    files: int = 0
    size: int = 0  # of the included texts, in characters
    elements: int = 0


def expanded(
    root: ElementTree.Element, path: Path, reach: Reach, where: str
) -> ElementTree.Element:
    """Replace the `include` elements of a model by the content of the files, in place.

    Args:
        root: The model.
        path: Its file.
        reach: The folders from which it may include files.
        where: What the model is, for messages.

    Returns:
        The model.

    Raises:
        InputError: A file cannot be read, lies outside of the reach, or includes itself; or the
            model includes too much.
    """
    _expand(root, path.parent, (path.resolve(),), 1, reach, where, _Total())
    return root


def _expand(
    element: ElementTree.Element,
    folder: Path,
    above: tuple[Path, ...],
    depth: int,
    reach: Reach,
    where: str,
    total: _Total,
) -> None:
    total.elements += 1
    check_extent(depth + len(above) - 1, total.elements, where)
    for index in reversed(range(len(element))):
        child = element[index]
        if child.tag != "include":
            _expand(child, folder, above, depth + 1, reach, where, total)
            continue
        named = folder / child.get("file", "")
        file = reach.check(named, f"{where}: included file")
        if file in above:
            raise InputError(f"{where}: {named.name} includes itself")
        text = read_text(file, f"{where}: included file")
        total.files, total.size = total.files + 1, total.size + len(text)
        if total.files > MOST_INCLUDES:
            raise InputError(
                f"{where}: includes more than {MOST_INCLUDES} files, each counted as often as it "
                "is included; include each of them once, or put them together"
            )
        if total.size > LARGEST_TEXT:
            raise InputError(f"{where}: includes more than {LARGEST_TEXT / 2**20:g} MiB of text")
        included = parse_xml(text, f"{where}: included file {named}")
        _expand(included, folder, (*above, file), depth, reach, where, total)
        element[index : index + 1] = list(included)
