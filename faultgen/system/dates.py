"""Dates as text (ISO 8601) and as seconds since 1970."""

from __future__ import annotations

from datetime import UTC, datetime

from faultgen.errors import InputError


def in_words(date: float) -> str:
    """Return a date as text (ISO 8601, UTC).

    Args:
        date: In [s since 1970].
    """
    return datetime.fromtimestamp(date, UTC).isoformat(timespec="seconds")


def date_of(text: str, where: str = "") -> float:
    """Read a date.

    Args:
        text: ISO 8601; without a time zone it is UTC.
        where: What states it, for the message.

    Returns:
        In [s since 1970].

    Raises:
        InputError: It is no date.
    """
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        before = f"{where}: " if where else ""
        raise InputError(
            f"{before}'{text}' is no date; write it like 2026-03-12 or 2026-03-12T08:30"
        ) from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
