"""HDF5 files that are written without losing an error, and read after their checksum was compared.

with new_hdf5(Path("out/run.h5")) as (file, sink):
file["x"] = np.zeros(3)
sink.check()
publish(temporary_name(Path("out/run.h5")), Path("out/run.h5"), sink.checksum)
with open_verified(Path("out/run.h5")) as file:
file["x"][()]

A new file is read back from the disk, and every byte is compared with what HDF5 has written. This
takes much less time than a comparison of all arrays and attributes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import SEEK_CUR
from pathlib import Path
from typing import BinaryIO

import h5py

from faultgen.errors import InputError, StorageFailed, one_line
from faultgen.system.checked_file import Sink, Source
from faultgen.system.files import (
    checksum_path,
    named_failures,
    removed_on_failure,
    temporary_name,
    verify,
)

LIBRARY_VERSION = ("v108", "v108")
"""Oldest HDF5 release that can read the files. Its format has checksums of the metadata."""

_HEAP = b"GCOL\1\0\0\0"  # begin of a global heap, which holds texts of variable length
_HEADER = 16  # bytes of the header of a global heap, and of each object in it
_READ = 1 << 20  # bytes that are read at a time


@contextmanager
def new_hdf5(path: Path) -> Iterator[tuple[h5py.File, Sink]]:
    """Write an HDF5 file under its temporary name, sync it and compare it with what was written.

    If anything fails, the file is removed.

    Args:
        path: The final name, which `publish` or `rename` gives the file afterwards.

    Yields:
        The file, and the sink to which it writes. The method `check` of the sink raises errors of
        the disk, and its `checksum` is there when the context has ended.

    Raises:
        StorageFailed: The file cannot be written, or does not hold what was written.
    """
    temporary = temporary_name(path)
    with removed_on_failure(temporary), named_failures(path):
        sink = Sink(temporary, path)
        try:
            file = h5py.File(sink, "w", libver=LIBRARY_VERSION)
            try:
                yield file, sink
            finally:
                with _errors_of(sink):
                    file.close()
            sink.sync()
        finally:
            with suppress(OSError):
                sink.close()


@contextmanager
def _errors_of(file: Sink | Source) -> Iterator[None]:
    """Raise the error of the disk instead of the error that HDF5 derives from it."""
    try:
        yield
    except Exception:
        file.check()
        raise
    file.check()


@contextmanager
def open_unverified(path: Path) -> Iterator[h5py.File]:
    """Open an HDF5 file that has no checksum beside it, for reading.

    HDF5 2.0 never returns from a damaged file in which an object of a global heap claims to have no
    size: its reader stays at this object. So these heaps are looked through first.

    Args:
        path: The file.

    Yields:
        The open file.

    Raises:
        OSError: The file cannot be read, or is damaged.
    """
    with path.open("rb") as content:
        for position in _positions(content, _HEAP):
            content.seek(position)
            _check_heap(content.read(_HEADER), content)
    with h5py.File(path, "r") as file:
        yield file


def _positions(content: BinaryIO, pattern: bytes) -> list[int]:
    """Where a pattern begins in a file [bytes]."""
    found, at, kept = [], 0, b""
    while part := content.read(_READ):
        block = kept + part
        found += [at - len(kept) + one.start() for one in re.finditer(re.escape(pattern), block)]
        at += len(part)
        kept = block[1 - len(pattern) :]
    return found


def _check_heap(header: bytes, content: BinaryIO) -> None:
    """Follow the objects of a global heap as HDF5 does (file format specification, III.E).

    Raises:
        OSError: One of them leads no further.
    """
    left = int.from_bytes(header[8:16], "little") - _HEADER
    while left >= _HEADER:
        one = content.read(_HEADER)
        size = int.from_bytes(one[8:16], "little")
        # object 0 is the free space at the end, and its size includes its header
        step = size if one[:2] == b"\0\0" else _HEADER + -(-size // 8) * 8
        if not 0 < step < 1 << 63:
            raise OSError("damaged: an object in a global heap has no size")
        if len(one) < _HEADER or step >= left:
            return  # the end, or HDF5 notices it
        content.seek(step - _HEADER, SEEK_CUR)
        left -= step


def _is_recording(path: Path) -> bool:
    """Whether an HDF5 file holds what `import` and `export` write."""
    with suppress(OSError, RuntimeError), open_unverified(path) as file:
        return "motor_torque" in file or "joint_torque" in file or "motor_current" in file
    return False


@contextmanager
def open_verified(path: Path, *, every_read: bool = False) -> Iterator[h5py.File]:
    """Verify an HDF5 file with `verify`, and open it for reading.

    Args:
        path: The file.
        every_read: Whether to compare also all that is read later with the checksum, so that no
            wrong bytes of a failing disk are copied.

    Yields:
        The open file.

    Raises:
        InputError: There is no such file, it is damaged, or it is no file of a dataset.
        StorageFailed: The file cannot be read.
    """
    note = checksum_path(path)
    if not path.is_file():
        raise InputError(
            f"{path}: {'is a folder; give the file' if path.is_dir() else 'no such file'}"
        )
    if not note.is_file() and not h5py.is_hdf5(path):
        raise InputError(f"{path}: is not a file of a dataset, because it is no HDF5 file")
    if not note.is_file() and _is_recording(path):
        raise InputError(
            f"{path}: is a recording and not a dataset; give it to discover, calibrate or twin"
        )
    if not note.is_file():
        raise InputError(
            f"{path}: has no checksum beside it ({note.name}); if it belongs to a dataset, run the "
            "generate command again to replace it"
        )
    checksum = verify(path)
    try:
        if not every_read:
            with h5py.File(path, "r") as file:
                yield file
        else:
            with Source(path, checksum) as source:
                with _errors_of(source), h5py.File(source, "r") as file:
                    yield file
    except (OSError, RuntimeError, KeyError) as error:
        line = one_line(error)
        if isinstance(error, KeyError) and "Unable to" not in line:
            raise  # of other code
        raise StorageFailed(f"{path}: cannot be read ({line})") from None
