"""Ctrl-C and SIGTERM that are not lost.

Python raises an exception wherever it happens to be when a signal arrives. Where other code catches
every exception, as some modules do while they are imported, it is lost. Where nothing can catch it,
as in the finaliser of an object, it is printed with a traceback and then lost. It is therefore
remembered here, and raised again by the next step of long work:

    listen()
    raise_if_interrupted()
    close()    # the work is done
"""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import NoReturn

_seen: list[int] = []


def listen() -> None:
    """Answer Ctrl-C with `KeyboardInterrupt`, and SIGTERM with `SystemExit`."""
    signal.signal(signal.SIGTERM, interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored instead
        signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = _hide


def close() -> None:
    """Answer signals no longer. While Python ends, an exception would only print a traceback."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # should Python not end, it can be ended


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Remember the signal, and raise its exception; a signal handler.

    Args:
        number: Number of the signal.
        frame: Where the program was.
    """
    _seen.append(number)
    raise _exception(number)


def raise_if_interrupted() -> None:
    """Raise the exception of the last signal that has come, if one has."""
    if _seen:
        raise _exception(_seen[-1])


def _exception(number: int) -> BaseException:
    return KeyboardInterrupt() if number == signal.SIGINT else SystemExit(128 + number)


def _hide(told: sys.UnraisableHookArgs) -> None:
    """Print an exception that nothing can catch, unless a signal raised it."""
    if not (_seen and issubclass(told.exc_type, KeyboardInterrupt | SystemExit)):
        sys.__unraisablehook__(told)
