"""How much memory the arrays of a file need, found out before they are unpacked.

A compressed file of 3 MB may hold arrays of many GB. Every reader asks here first.
"""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import h5py
import numpy as np

from faultgen.errors import InputError

MOST_BYTES = 120_000_000
"""Largest size of all arrays of a log, unpacked [bytes]. The import copies what it uses about four
times (as read, in SI units, at even times, written), and then stays below 1 GB."""

LARGEST_TEXT = 150_000_000
"""Largest log of text, unzipped [bytes]. Reading takes about five times as much memory."""

MOST_LINES = 2_500_000
"""Most lines of a text. Each takes about 60 bytes beside its characters."""

_COMPRESSED, _MATRIX = 15, 14  # miCOMPRESSED, miMATRIX of MAT-files
_ITEM = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
"""Bytes of one value by data type (miINT8 to miUTF32)."""
_IN_MEMORY = {4: 4, 6: 8, 7: 4, 8: 1, 9: 1, 10: 2, 11: 2, 12: 4, 13: 4, 14: 8, 15: 8}
"""Bytes of one value by class of a matrix (mxCHAR, mxDOUBLE to mxUINT64). Files store whole numbers
of a matrix of doubles in single bytes."""
_DEEPEST = 30  # structs in structs


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
        content: Its content, unzipped, up to one byte more than `LARGEST_TEXT`.

    Raises:
        InputError: It is. The message states the limit and what to do.
    """
    lines = max(content.count(b"\n"), content.count(b"\r"))
    if len(content) > LARGEST_TEXT or lines > MOST_LINES:
        raise InputError(
            f"{path}: more than {LARGEST_TEXT / 1e6:.0f} MB of text, or more than "
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
    size = 0

    def add(_: str, item: h5py.Group | h5py.Dataset) -> None:
        nonlocal size
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and item.shape is not None:
            # a chunk is unpacked as a whole
            size += max(math.prod(item.shape), math.prod(item.chunks or ())) * item.dtype.itemsize

    file.visititems(add)
    check_size(path, size)


def check_mat(path: Path, file: BinaryIO) -> None:
    """Refuse a MATLAB file of version 5 to 7 whose arrays are too large.

    Args:
        path: The file, for messages.
        file: The same, at its beginning. Other versions are not looked at: they are not compressed.

    Raises:
        InputError: They are too large.
        ValueError: It is damaged.
    """
    check_size(path, path.stat().st_size)
    order = {b"IM": "<", b"MI": ">"}.get(file.read(128)[126:128])
    size = 0.0
    while order and len(tag := file.read(8)) == 8:
        kind, count = struct.unpack(f"{order}II", tag)
        content = file.read(count)
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj()
            content = unpacked.decompress(content, MOST_BYTES + 1)
            check_size(path, len(content))
            for kind, inner in _elements(content, order):
                size += _needed(inner, order) if kind == _MATRIX else 0
        elif kind == _MATRIX:
            size += _needed(content, order)
        check_size(path, size)


def _elements(content: bytes | memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of the elements in a part of a MAT-file."""
    view, at = memoryview(content), 0
    while at + 8 <= len(view):
        kind, count = struct.unpack_from(f"{order}II", view, at)
        if kind >> 16:  # a small element has everything in eight bytes
            yield kind & 0xFFFF, view[at + 4 : at + 4 + min(kind >> 16, 4)]
            at += 8
            continue
        yield kind, view[at + 8 : at + 8 + count]
        at += 8 + count + (-count % 8)


def _needed(matrix: memoryview | bytes, order: str, depth: int = 0) -> float:
    """Memory that a matrix and those within it need [bytes]."""
    if depth > _DEEPEST:
        raise ValueError("structs are nested too deeply")
    needed, item = 0.0, 8
    for place, (kind, content) in enumerate(_elements(matrix, order)):
        if place == 0 and len(content) >= 4:  # flags and class
            item = _IN_MEMORY.get(struct.unpack_from(f"{order}I", content)[0] & 0xFF, 8)
        elif kind == _MATRIX:
            needed += _needed(content, order, depth + 1)
        elif kind in _ITEM:
            needed += len(content) / _ITEM[kind] * item
    return needed
