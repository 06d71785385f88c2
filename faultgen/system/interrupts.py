"""Ctrl-C that is not lost.

Python raises `KeyboardInterrupt` wherever it happens to be. Where other code catches every
exception, as some modules do while they are imported, it is lost. It is therefore remembered here,
and raised again by the next step of long work:

    signal.signal(signal.SIGINT, interrupt)
    raise_if_interrupted()
"""

from __future__ import annotations

from types import FrameType
from typing import NoReturn

_seen: list[int] = []


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Remember the signal, and raise `KeyboardInterrupt`; a signal handler.

    Args:
        number: Number of the signal.
        frame: Where the program was.
    """
    _seen.append(number)
    raise KeyboardInterrupt


def raise_if_interrupted() -> None:
    """Raise `KeyboardInterrupt` if `interrupt` has been called."""
    if _seen:
        raise KeyboardInterrupt
