"""How much memory the arrays of a file need, found out before they are unpacked.

A compressed file of 3 MB may hold arrays of many GB. Every reader asks here first.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from faultgen.errors import InputError

if TYPE_CHECKING:
    import zipfile

    import h5py

MOST_BYTES = 120_000_000
"""Largest size of all arrays of a log, unpacked [bytes]. The import copies what it uses about four
times (as read, in SI units, at even times, written), and then stays below 1 GB."""

LARGEST_LOG = 150_000_000
"""Largest log of text, unzipped [bytes]. Reading takes about five times as much memory."""

MOST_LINES = 2_500_000
"""Most lines of a text. Each takes about 60 bytes beside its characters."""


def check_size(path: Path, size: float, limit: int = MOST_BYTES) -> None:
    """Refuse arrays that are too large.

    Args:
        path: The file.
        size: Size of its arrays [bytes].
        limit: Largest size [bytes].

    Raises:
        InputError: They are larger. The message states the limit and what to do.
    """
    if size > limit:
        raise InputError(
            f"{path}: its arrays take more than {limit / 1e6:.0f} MB in memory, the most that is "
            "read; cut it into shorter logs, or save only the columns that are needed"
        )


def check_text(path: Path, content: bytes) -> None:
    """Refuse a text that is too long, or has too many lines.

    Args:
        path: The file, for messages.
        content: Its content, unzipped, up to one byte more than `LARGEST_LOG`.

    Raises:
        InputError: It is. The message states the limit and what to do.
    """
    lines = max(content.count(b"\n"), content.count(b"\r"))
    if len(content) > LARGEST_LOG or lines > MOST_LINES:
        raise InputError(
            f"{path}: more than {LARGEST_LOG / 1e6:.0f} MB of text, or more than "
            f"{MOST_LINES / 1e6:g} million lines; cut the log into shorter ones, or export fewer "
            "columns"
        )


def npy_header(file: BinaryIO) -> tuple[tuple[int, ...], np.dtype] | None:
    """Read the header of an array in NumPy's format.

    Args:
        file: The file, at its beginning.

    Returns:
        Shape and type; None if it is no such array.

    Raises:
        ValueError: The header is damaged.
    """
    begin = file.read(8)
    if begin[:6] != b"\x93NUMPY" or len(begin) < 8:
        return None
    readers = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}
    if begin[6] not in readers:
        return None  # version 3 is for names of fields in other than Latin letters
    shape, _, kind = readers[begin[6]](file)
    return shape, kind


def check_npz(path: Path, content: zipfile.ZipFile) -> list[str]:
    """Find the arrays of numbers in an .npz file, from their headers.

    Args:
        path: The file, for messages.
        content: The same, opened.

    Returns:
        Names of the members.

    Raises:
        InputError: They are too large, or a header claims more values than are there.
        ValueError: A header is damaged.
    """
    found, size = [], 0
    for member in content.infolist():
        with content.open(member) as file:
            header = npy_header(file)  # type: ignore[arg-type]
        if header is None or header[1].kind not in "fiu":
            continue
        needed = math.prod(header[0]) * header[1].itemsize
        if needed > member.file_size:
            raise InputError(
                f"{path}: {member.filename} claims shape {header[0]}, but has "
                f"{member.file_size} bytes"
            )
        size += needed
        found.append(member.filename)
    check_size(path, size)
    return found


def check_tree(path: Path, file: h5py.File) -> None:
    """Refuse an HDF5 file whose arrays of numbers are too large.

    Args:
        path: The file, for messages.
        file: The same, opened.

    Raises:
        InputError: They are too large.
    """
    import h5py

    size = 0

    def add(_: str, item: h5py.Group | h5py.Dataset) -> None:
        nonlocal size
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and item.shape is not None:
            # a chunk is unpacked as a whole
            size += max(math.prod(item.shape), math.prod(item.chunks or ())) * item.dtype.itemsize

    file.visititems(add)
    check_size(path, size)
