"""JSON files that begin with a checksum of their content.

text = sealed({"count": 3})
unsealed(text)  # {"count": 3}; raises ValueError if anything has changed
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from typing import Any

from faultgen.errors import one_line

SUM = "sha256"
"""Entry with the checksum."""


def sealed(content: Mapping[str, Any]) -> str:
    """Return the text of a JSON file that begins with the checksum of its content.

    Args:
        content: What the file should hold.
    """
    return json.dumps({SUM: _sum(content), **content}, indent=1) + "\n"


def unsealed(text: str | bytes, older: Collection[str] = ()) -> tuple[dict[str, Any], bool]:
    """Read the text of such a file.

    Args:
        text: The text.
        older: Entries of files of older versions, which had no checksum. A text without checksum is
            accepted only if it has exactly these entries: a file whose entry ``sha256`` has got
            another name has one entry more.

    Returns:
        The content without the checksum, and whether there was one.

    Raises:
        ValueError: The text is no such file, or differs from its checksum.
    """
    try:
        content = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(content, dict):
        raise ValueError("it is not a JSON object")
    if SUM not in content:
        if not older or set(content) != set(older):
            raise ValueError(f"it has no checksum '{SUM}'")
        return content, False
    if content.pop(SUM) != _sum(content):
        raise ValueError("it differs from its checksum")
    return content, True


def damage(error: Exception) -> str:
    """Say in one line what is wrong with the content of a file: which entry it lacks, or the error.

    Args:
        error: What was raised while the content was used.
    """
    return f"it has no {error}" if isinstance(error, KeyError) else one_line(error)


def _sum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
