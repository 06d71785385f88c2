"""JSON files that begin with a checksum of their content.

text = sealed({"count": 3})
unsealed(text)  # {"count": 3}; raises ValueError if anything has changed
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
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


def unsealed(text: str | bytes) -> dict[str, Any]:
    """Read the text of such a file.

    Args:
        text: The text.

    Returns:
        The content without the checksum.

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
        raise ValueError(f"it has no checksum '{SUM}'")
    if content.pop(SUM) != _sum(content):
        raise ValueError("it differs from its checksum")
    return content


def damage(error: Exception) -> str:
    """Say in one line what is wrong with the content of a file: which entry it lacks, or the error.

    Args:
        error: What was raised while the content was used.
    """
    return f"it has no {error}" if isinstance(error, KeyError) else one_line(error)


def _sum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
