"""Reading files that users name: text and assets, which are regular files of a sensible size."""

from __future__ import annotations

import os
from pathlib import Path

from faultgen.errors import InputError

LARGEST_TEXT = 16 * 2**20
"""Largest text file that is read [bytes]."""


def read_text(path: str | Path, what: str) -> str:
    """Read a text file in UTF-8.

    Args:
        path: The file.
        what: What the file is, for the message, such as "experiment file".

    Raises:
        InputError: The path is no regular file, the file is too large, or it is no text.
    """
    content = read_bytes(path, what, LARGEST_TEXT)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{what} {path}: cannot be read as text in UTF-8 ({error})") from None


def read_bytes(path: str | Path, what: str, largest: int) -> bytes:
    """Read a file of at most `largest` bytes.

    Raises:
        InputError: The path is no regular file, or the file is too large or cannot be read.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(f"{what} {path}: cannot be read (not a regular file)")
    try:
        with open(path, "rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"{what} {path}: cannot be read ({error})") from None
    if len(content) > largest:
        raise InputError(f"{what} {path}: cannot be read (larger than {largest / 2**20:g} MiB)")
    return content
