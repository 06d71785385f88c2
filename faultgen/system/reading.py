"""Reading files that users name. They must be regular files, and not larger than a limit.

A file that `faultgen.system.sums` lists is compared with its checksum.
"""

from __future__ import annotations

import os
from pathlib import Path

from faultgen.errors import InputError
from faultgen.system.sums import check_listed

LARGEST_TEXT = 16 * 2**20
"""Largest text file that is read [bytes]."""


def check_file(path: str | Path) -> None:
    """Refuse what is no file.

    Args:
        path: The path.

    Raises:
        InputError: There is nothing, or no file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")


def read_text(path: str | Path, what: str, *, compared: bool = True) -> str:
    """Read a text file in UTF-8.

    Args:
        path: The file.
        what: What the file is, for error messages, such as "experiment file".
        compared: Whether it is compared with its checksum, if one is listed. Otherwise the caller
            does so.

    Returns:
        Its text.

    Raises:
        InputError: The path is not a regular file, or the file is too large, cannot be read, or is
            not text.
    """
    content = read_bytes(path, what, LARGEST_TEXT, compared=compared)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{what} {path}: cannot be read as text in UTF-8 ({error})") from None


def read_bytes(path: str | Path, what: str, largest: int, *, compared: bool = True) -> bytes:
    """Read a file up to a certain size.

    Args:
        path: The file.
        what: What the file is, for error messages, such as "robot file".
        largest: Largest size that is allowed [bytes].
        compared: Whether it is compared with its checksum, if one is listed.

    Returns:
        Its content.

    Raises:
        InputError: The path is not a regular file, or the file is too large, damaged or cannot be
            read.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(f"{what} {path}: cannot be read (not a regular file)")
    try:
        with open(path, "rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{what} {path}: cannot be read ({reason})") from None
    if len(content) > largest:
        raise InputError(f"{what} {path}: cannot be read (larger than {largest / 2**20:g} MiB)")
    if compared:
        check_listed(path, content)
    return content
