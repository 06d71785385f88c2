"""Parsing the XML of models that others wrote: bounded in depth and size, and without entities.

root = parse_xml(text, "robot file arm.urdf")
"""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.parsers import expat

from faultgen.errors import InputError

MOST_NESTED = 256
"""Largest depth of the elements of a model; the bodies of a humanoid are nested some 20 deep."""

MOST_ELEMENTS = 200_000
"""Largest number of elements of a model, with all files that it includes."""


def parse_xml(text: str, where: str, *, comments: bool = False) -> ElementTree.Element:
    """Parse XML.

    Names keep their prefixes, as MuJoCo reads them. Entities are refused, because MuJoCo does not
    expand them, and because a few of them can stand for gigabytes of text.

    Args:
        text: The text.
        where: What it is, for messages, such as "robot file arm.xml".
        comments: Whether the comments are kept, for a text that is edited and written again.

    Returns:
        The outermost element.

    Raises:
        InputError: The text is not XML, declares entities, or has too many or too deeply nested
            elements.
    """
    parser = expat.ParserCreate("utf-8")
    builder = ElementTree.TreeBuilder(insert_comments=comments)
    depth = count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        check_extent(depth, count, where)
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def entity(name: str, *rest: object) -> None:
        raise InputError(
            f"{where}: declares the XML entity '{name}'; entities are not supported, so write "
            "their text where they are used"
        )

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, entity
    if comments:
        parser.CommentHandler = lambda words: depth and builder.comment(words)
    try:
        parser.Parse(text.encode(), True)
        return builder.close()
    except expat.ExpatError as error:
        raise InputError(f"{where}: not valid XML: {error}") from None


def check_extent(depth: int, count: int, where: str) -> None:
    """Refuse a model with too many or too deeply nested elements.

    Args:
        depth: How deep an element is nested.
        count: Number of elements so far.
        where: What the text is, for messages.

    Raises:
        InputError: One of the numbers is too large.
    """
    if depth > MOST_NESTED:
        raise InputError(f"{where}: its elements are nested more than {MOST_NESTED} deep")
    if count > MOST_ELEMENTS:
        raise InputError(f"{where}: has more than {MOST_ELEMENTS} elements")


def whole_number(text: str) -> int:
    """Read a count, such as the attribute ``nrow``.

    Args:
        text: Its text, which may be anything.

    Returns:
        The number, 0 for what is no number, and at most 1e12.
    """
    try:
        value = float(text)
    except ValueError:
        return 0
    return 0 if math.isnan(value) else int(min(max(value, 0.0), 1e12))
