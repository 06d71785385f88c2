"""Checksums of the files of a folder, in the file ``checksums.txt`` of the folder.

The file has the form that the program `sha256sum` reads. Every file that it lists is compared when
faultgen reads it (`faultgen.system.reading`). A folder without it is read as it is, and so is one
in which other programs have written a file of this name with something else in it.

    add_sums(Path("my_robot"), {"model.xml": content})
    check_listed(Path("my_robot/model.xml"), content)  # raises if it has changed
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from faultgen.errors import InputError
from faultgen.system.files import write_text

SUMS = "checksums.txt"
"""Name of the file."""

_LINE = re.compile(r"([0-9a-f]{64}) [ *](\S.*)")


def add_sums(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Note the checksums of files of a folder, beside those that are noted already.

    Args:
        folder: The folder.
        contents: Content of each file that was written, by its path relative to the folder.

    Raises:
        StorageFailed: The checksums cannot be written.
    """
    path = folder / SUMS
    known = {}
    if path.is_file():  # lines that are damaged are not kept
        lines = path.read_bytes().decode(errors="replace").splitlines()
        known = {found[2]: found[1] for line in lines if (found := _LINE.fullmatch(line))}
    known |= {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    write_text(path, sums_text(dict(sorted(known.items()))))


def write_listed(folder: Path, name: str, text: str) -> None:
    """Write a text file into a folder, and note its checksum.

    Args:
        folder: The folder, which exists.
        name: Name of the file.
        text: Its text.

    Raises:
        StorageFailed: It cannot be written.
    """
    write_text(folder / name, text)
    add_sums(folder, {name: text.encode()})


def sums_text(sums: Mapping[str, str]) -> str:
    """Return checksums by the name of the file in the form of `sha256sum`."""
    return "".join(f"{checksum}  {name}\n" for name, checksum in sums.items())


def check_listed(path: str | Path, content: bytes) -> None:
    """Compare a file with its checksum, if its folder or a folder above it lists one.

    Args:
        path: The file.
        content: Its content.

    Raises:
        InputError: It differs, or the list of checksums is damaged.
    """
    place = os.path.abspath(path)
    folder = place
    while (above := os.path.dirname(folder)) != folder:
        folder = above
        listed = f"{folder}/{SUMS}"
        try:
            state = os.stat(listed)
        except OSError:
            continue
        wanted = _listed(listed, state.st_mtime_ns, state.st_size).get(
            os.path.relpath(place, folder).replace(os.sep, "/")
        )
        if wanted is not None and hashlib.sha256(content).hexdigest() != wanted:
            raise InputError(
                f"{path}: damaged (it differs from its checksum in {listed}); make it again, or "
                "remove its line there if you have changed it on purpose"
            )


@lru_cache(maxsize=64)
def _listed(path: str, _date: int, _size: int) -> dict[str, str]:
    """Checksums in a file by the name of the file that they belong to."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); delete it to go without it") from None
    lines = [_LINE.fullmatch(line) for line in text.splitlines()]
    found = {parts[2]: parts[1] for parts in lines if parts is not None}
    if found and None in lines:
        raise InputError(
            f"{path}: damaged (line {lines.index(None) + 1} is no checksum); make the folder "
            "again, or delete this file to read the folder without comparing it"
        )
    return found  # nothing, if the file is of another program
