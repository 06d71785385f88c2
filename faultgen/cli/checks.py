"""Checks of arguments before a command imports what it needs, which takes seconds.

Each one is the callback of an option or argument, and returns the value.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from faultgen.errors import InputError

_Paths = TypeVar("_Paths", Path, list[Path], None)


def existing_robot(name: str) -> str:
    """Refuse an unknown robot."""
    from faultgen.robot_names import check_robot

    check_robot(name)
    return name


def existing_dataset(folder: Path) -> Path:
    """Refuse a dataset that does not exist."""
    from faultgen.dataset.manifest import check_exists

    check_exists(folder)
    return folder


def existing_detector(folder: Path) -> Path:
    """Refuse a detector that does not exist."""
    if not folder.exists():
        raise InputError(f"{folder}: no such folder; give one that 'faultgen train' has written")
    return folder


def existing_study(name: str) -> str:
    """Refuse an unknown study."""
    from faultgen.studies.names import STUDIES

    if name not in STUDIES:
        raise InputError(f"unknown study '{name}': choose {', '.join(STUDIES)}")
    return name


def readable_text(what: str) -> Callable[[Path | None], Path | None]:
    """Make a check that refuses what is no text file.

    Args:
        what: What the file is, for the message, such as "experiment file".
    """

    def check(path: Path | None) -> Path | None:
        from faultgen.system.reading import read_text

        if path is not None:
            read_text(path, what)
        return path

    return check


def readable_recordings(given: _Paths) -> _Paths:
    """Refuse files that are no recordings."""
    from faultgen.system.reading import check_file

    paths: list[Path] = [given] if isinstance(given, Path) else given or []
    for path in paths:
        check_file(path)
    if paths:
        from faultgen.discovery.read import read_recording

        for path in paths:
            read_recording(path)
    return given
