"""Lines for the terminal, in which no name of a file or of a robot can forge anything.

A name may hold a line break, which would begin a line of its own, or control characters, which move
the cursor or colour the text. Everything that faultgen prints goes through these functions, which
show such characters as Python writes them in a string.

    say("new1.h5: healthy")         # a line on stdout
    note("the disk is full")        # a line on stderr, after "faultgen: "
    tell("one file is damaged")     # a warning of the logger "faultgen"
    tell_progress("done")           # the same, for its level INFO

Functions of the library use the logger, so that a program decides what becomes of their messages;
the commands print them by `print_messages`.
"""

from __future__ import annotations

import logging
import sys

LOGGER = logging.getLogger("faultgen")
"""Logger of all messages of the library."""


def visible(text: object) -> str:
    """Write a text in one line, and characters that cannot be printed as escapes.

    These are control characters, line breaks of any kind, marks that change the direction of
    writing, and bytes of a file name that are no text.

    Args:
        text: The text.
    """
    told = str(text)
    if told.isprintable():
        return told
    return "".join(
        one if one.isprintable() else one.encode("unicode_escape", "surrogatepass").decode()
        for one in told
    )


def say(*lines: object, flush: bool = False) -> None:
    """Print lines on stdout.

    Args:
        lines: The lines, each without its end.
        flush: Whether they are written at once, for readers that wait for them.
    """
    print(*map(visible, lines), sep="\n", flush=flush)


def note(line: object) -> None:
    """Print a message on stderr.

    Args:
        line: The message, which is one line.
    """
    print(f"faultgen: {visible(line)}", file=sys.stderr, flush=True)


def tell(line: object) -> None:
    """Log a message that the user should see.

    Args:
        line: The message, which is one line.
    """
    LOGGER.warning("%s", visible(line))


def tell_progress(line: object) -> None:
    """Log how far some work is.

    Args:
        line: The message, which is one line.
    """
    LOGGER.info("%s", visible(line))


class _Notes(logging.Handler):
    """Prints messages of the logger as `note` does."""

    def emit(self, record: logging.LogRecord) -> None:
        note(record.getMessage())


def print_messages() -> None:
    """Print the messages of the library on stderr, as commands do."""
    if not any(isinstance(one, _Notes) for one in LOGGER.handlers):
        LOGGER.addHandler(_Notes())
    LOGGER.setLevel(logging.INFO)
    LOGGER.propagate = False
