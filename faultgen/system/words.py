"""Lists in sentences."""

from __future__ import annotations

from collections.abc import Sequence


def in_series(names: Sequence[str], last: str = "and") -> str:
    """Write names as a sentence does.

    Args:
        names: The names, at least one.
        last: Word before the last one.

    Returns:
        For example "a", "a and b" or "a, b and c".
    """
    return f" {last} ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
