"""What other installed packages add: effects, isolators and detectors.

Such a package declares an entry point of one of the groups below. It names an object, or a list of
objects, of the kind that the group is for:

    [project.entry-points."faultgen.isolators"]
    mine = "my_package.isolators:ISOLATORS"
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import entry_points
from typing import TypeVar

from faultgen.errors import InputError

EFFECTS = "faultgen.effects"
ISOLATORS = "faultgen.isolators"
DETECTORS = "faultgen.detectors"

T = TypeVar("T")


def added(group: str, fits: Callable[[object], bool], what: str) -> Iterator[tuple[str, T]]:
    """Load what installed packages add to a group.

    Args:
        group: Group of entry points.
        fits: Whether an object is of the kind that the group is for.
        what: That kind in words, with its article.

    Yields:
        The value of the entry point, for messages, and one object that it names.

    Raises:
        InputError: An entry point cannot be loaded, or names something else.
    """
    for point in entry_points(group=group):
        where = f"entry point {point.value}"
        try:
            loaded = point.load()
            objects = list(loaded) if isinstance(loaded, Iterable) else [loaded]
        except Exception as error:  # whatever the code of another package raises
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{where}: cannot be loaded ({reason})") from None
        for one in objects:
            if not fits(one):
                raise InputError(f"{where}: must be {what} or a list of them")
            yield where, one


def modules(group: str) -> list[str]:
    """Names of the modules that installed packages add to a group."""
    return [point.module for point in entry_points(group=group)]
