"""HDF5 files that are written without losing an error, and read after their checksum was compared.

with new_hdf5(Path("out/run.h5")) as (file, sink):
file["x"] = np.zeros(3)
sink.check()
publish(temporary_name(Path("out/run.h5")), Path("out/run.h5"))
with open_verified(Path("out/run.h5")) as file:
file["x"][()]
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py

from faultgen.errors import InputError, StorageFailed, one_line
from faultgen.system.files import (
    BINARY,
    checksum_path,
    forget_cached,
    named_failures,
    temporary_name,
    verify,
    write_all,
)

LIBRARY_VERSION = ("v108", "v108")
"""Oldest HDF5 release that can read the files. Its format has checksums of the metadata."""


class Sink(io.RawIOBase):
    """A file for h5py that keeps errors of the disk so that none is lost.

    HDF5 hides write errors that happen while objects are released, and crashes after some of them.
    This file never reports an error to HDF5. It keeps the first one, ignores all later writes, and
    `check` raises what was kept.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Args:
            path: The file. An older file of that name is overwritten.

        Raises:
            OSError: The file cannot be created.
        """
        super().__init__()
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | BINARY, 0o666)
        self._position = 0
        self._size = 0
        self._error: BaseException | None = None

    def check(self) -> None:
        """Raise the first error that a write met, if there was one."""
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:  # noqa: D102
        return True

    def writable(self) -> bool:  # noqa: D102
        return True

    def seekable(self) -> bool:  # noqa: D102
        return True

    def tell(self) -> int:  # noqa: D102
        return self._position

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move the position of the next read or write.

        Args:
            offset: Number of bytes by which the position moves.
            whence: Where it moves from: ``os.SEEK_SET``, ``os.SEEK_CUR`` or ``os.SEEK_END``.

        Returns:
            The new position, in bytes from the start of the file.
        """
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        self._position = start + offset
        return self._position

    def readinto(self, buffer: Any) -> int:  # noqa: D102
        view = memoryview(buffer).cast("B")
        done = 0
        try:
            os.lseek(self._handle, self._position, os.SEEK_SET)
            while done < len(view):
                part = os.read(self._handle, len(view) - done)
                if not part:
                    break
                view[done : done + len(part)] = part
                done += len(part)
        except BaseException as error:  # even an interrupt must not pass through HDF5
            self._error = self._error or error
        self._position += done
        return done

    def write(self, content: Any) -> int:  # noqa: D102
        view = memoryview(content).cast("B")
        if self._error is None:
            try:
                os.lseek(self._handle, self._position, os.SEEK_SET)
                write_all(self._handle, view)
            except BaseException as error:
                self._error = error
        self._position += len(view)
        self._size = max(self._size, self._position)
        return len(view)

    def truncate(self, size: int | None = None) -> int:  # noqa: D102
        self._size = self._position if size is None else size
        if self._error is None:
            try:
                os.ftruncate(self._handle, self._size)
            except BaseException as error:
                self._error = error
        return self._size

    def sync(self) -> None:
        """Write everything to the disk and close the file, so that it is next read from the disk.

        Raises:
            OSError: This write or an earlier one failed.
        """
        self.check()
        os.fsync(self._handle)
        forget_cached(self._handle)
        self.close()

    def close(self) -> None:  # noqa: D102
        if not self.closed:
            super().close()
            os.close(self._handle)


@contextmanager
def new_hdf5(path: Path) -> Iterator[tuple[h5py.File, Sink]]:
    """Write an HDF5 file under its temporary name and sync it. If anything fails, remove it.

    Args:
        path: The final name, which `publish` or `rename` gives the file after it was checked.

    Yields:
        The file, and the sink to which it writes. The method `check` of the sink raises errors of
        the disk.

    Raises:
        StorageFailed: The file cannot be written.
    """
    temporary = temporary_name(path)
    try:
        with named_failures(path):
            sink = Sink(temporary)
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
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


@contextmanager
def read_back(path: Path) -> Iterator[h5py.File]:
    """Open a file that `new_hdf5` wrote and that has no final name yet, to compare its content.

    Args:
        path: The final name.

    Yields:
        The open file.

    Raises:
        StorageFailed: The file cannot be read, not even closed.
    """
    try:
        with h5py.File(temporary_name(path), "r") as file:
            yield file
    except (InputError, StorageFailed):
        raise
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        line = one_line(error)
        raise StorageFailed(f"{path}: differs from what was written ({line})") from None


@contextmanager
def _errors_of(sink: Sink) -> Iterator[None]:
    """Raise the error of the disk instead of the error that HDF5 derives from it."""
    try:
        yield
    except Exception:
        sink.check()
        raise
    sink.check()


def _is_recording(path: Path) -> bool:
    """Whether an HDF5 file holds what `import` and `export` write."""
    with suppress(OSError, RuntimeError), h5py.File(path, "r") as file:
        return "motor_torque" in file or "joint_torque" in file or "motor_current" in file
    return False


@contextmanager
def open_verified(path: Path) -> Iterator[h5py.File]:
    """Verify an HDF5 file with `verify`, and open it for reading.

    Args:
        path: The file.

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
    verify(path)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError) as error:
        line = one_line(error)
        raise StorageFailed(f"{path}: cannot be read ({line})") from None
