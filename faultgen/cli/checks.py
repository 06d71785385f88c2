"""Checks of arguments before a command imports what it needs, which takes seconds.

existing_robot("puma560")
"""

from __future__ import annotations

from pathlib import Path

from faultgen.errors import InputError


def existing_robot(name: str) -> None:
    """Refuse an unknown robot."""
    from faultgen.robot_names import check_robot

    check_robot(name)


def existing_dataset(folder: Path) -> None:
    """Refuse a dataset that does not exist."""
    from faultgen.dataset.manifest import check_exists

    check_exists(folder)


def existing_detector(folder: Path) -> None:
    """Refuse a detector that does not exist."""
    if not folder.exists():
        raise InputError(f"{folder}: no such folder; give one that 'faultgen train' has written")


def existing_study(name: str) -> None:
    """Refuse an unknown study."""
    from faultgen.studies.names import STUDIES

    if name not in STUDIES:
        raise InputError(f"unknown study '{name}': choose {', '.join(STUDIES)}")


def readable_text(path: Path | None, what: str) -> None:
    """Refuse what is no text file.

    Args:
        path: The file, or None.
        what: What the file is, for the message, such as "experiment file".
    """
    if path is not None:
        from faultgen.system.reading import read_text

        read_text(path, what)


def readable_recordings(given: Path | list[Path] | None) -> None:
    """Refuse files that are no recordings."""
    from faultgen.system.reading import check_file

    paths: list[Path] = [given] if isinstance(given, Path) else given or []
    for path in paths:
        check_file(path)
    if paths:
        from faultgen.recordings.read import read_recording

        for path in paths:
            read_recording(path)
