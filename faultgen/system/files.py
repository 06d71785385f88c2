"""Writing files so that they are either complete or absent.

A file is first written under a temporary name. It is then synced to the disk, read back and
compared with what should have been written. Only after that does it get its final name. A failed
write therefore never leaves a damaged file behind, and it is never silent.

    write_text(Path("out/notes.txt"), "text")
    checksum = publish(temporary, Path("out/run.h5"))  # also writes out/run.h5.sha256
    verify(Path("out/run.h5"))                         # raises if the file has changed
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py

from faultgen.errors import InputError, StorageFailed

LIBRARY_VERSION = ("v108", "v108")
"""Oldest HDF5 release that can read the files. Its format has checksums of the metadata."""

# errors of a file system that cannot sync folders, which is no failure of the disk
_NO_FOLDER_SYNC = {errno.EINVAL, errno.ENOTSUP, errno.EBADF, errno.EACCES, errno.EISDIR}


def temporary_name(path: Path) -> Path:
    """The name under which this process writes a file until the file is complete."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def writer_of(temporary: Path) -> int | None:
    """The process id in a temporary name; None if there is none."""
    parts = temporary.name.split(".")
    return int(parts[-2]) if len(parts) > 2 and parts[-2].isdigit() else None


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
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | _BINARY, 0o666)
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
                _write_all(self._handle, view)
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
        _forget_cached(self._handle)
        self.close()

    def close(self) -> None:  # noqa: D102
        if not self.closed:
            super().close()
            os.close(self._handle)


_BINARY = getattr(os, "O_BINARY", 0)  # Windows would otherwise change line ends


def _write_all(handle: int, content: memoryview) -> None:
    while len(content):
        content = content[os.write(handle, content) :]


def _forget_cached(handle: int) -> None:
    """Let the next read of a file come from the disk, if the operating system supports this."""
    if hasattr(os, "posix_fadvise"):
        with suppress(OSError):
            os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)


@contextmanager
def named_failures(path: Path) -> Iterator[None]:
    """Turn errors of the operating system into one line that names the file.

    Raises:
        StorageFailed: The code in the context raised an OSError.
    """
    try:
        yield
    except StorageFailed:
        raise
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise StorageFailed(f"{path}: cannot be written ({reason})") from None


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
def _errors_of(sink: Sink) -> Iterator[None]:
    """Raise the error of the disk instead of the error that HDF5 derives from it."""
    try:
        yield
    except Exception:
        sink.check()
        raise
    sink.check()


def publish(temporary: Path, path: Path) -> str:
    """Give a synced file its final name and write ``<path>.sha256`` beside it.

    Args:
        temporary: The file under its temporary name.
        path: The final name.

    Returns:
        The checksum.

    Raises:
        StorageFailed: A step failed. The file and its checksum have then been removed.
    """
    note = checksum_path(path)
    try:
        with named_failures(path):
            checksum = file_sha256(temporary)
            write_text(note, checksum + "\n")
            rename(temporary, path)
    except BaseException:
        for file in (temporary, note):
            with suppress(OSError):
                file.unlink(missing_ok=True)
        raise
    return checksum


def write_text(path: Path, text: str) -> None:
    """Write a small text file. If that fails, no new file is left.

    Args:
        path: The file.
        text: Its content.

    Raises:
        StorageFailed: The file cannot be written. An older file of that name is unchanged.
    """
    content = text.encode()
    temporary = temporary_name(path)
    try:
        with named_failures(path):
            handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | _BINARY, 0o666)
            try:
                _write_all(handle, memoryview(content))
                os.fsync(handle)
            finally:
                os.close(handle)
            if file_sha256(temporary) != hashlib.sha256(content).hexdigest():
                raise StorageFailed(f"{path}: differs from what was written")
            rename(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def rename(temporary: Path, path: Path) -> None:
    """Give a synced file its final name.

    Args:
        temporary: The file under its temporary name.
        path: The final name.

    Raises:
        OSError: Renaming the file failed, or the new name could not be synced to the disk. In the
            second case the file has been removed.
    """
    os.replace(temporary, path)
    try:
        _sync_folder(path.parent)
    except BaseException:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        raise


def _sync_folder(folder: Path) -> None:
    if os.name == "nt":  # Windows has no handle of a folder that could be synced
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _NO_FOLDER_SYNC:
            raise
    finally:
        os.close(handle)


def checksum_path(path: Path) -> Path:
    """The path of the file that holds the checksum of another file."""
    return path.with_name(path.name + ".sha256")


def file_sha256(path: Path) -> str:
    """Compute the SHA-256 checksum of a file.

    The file is read from the disk and not from the cache, if the operating system supports this.

    Args:
        path: The file.
    """
    with path.open("rb") as file:
        _forget_cached(file.fileno())
        return hashlib.file_digest(file, "sha256").hexdigest()


_verified: dict[Path, tuple[int, int, str]] = {}
"""Size [bytes], date [ns] and checksum of files that were found intact."""


def damage(path: Path) -> str | None:
    """Compare a file with the checksum that is stored beside it. The whole file is read.

    Args:
        path: The file.

    Returns:
        What is wrong with the file, or None if it is intact.
    """
    note = checksum_path(path)
    try:
        state = path.stat()
        wanted = note.read_bytes().decode("ascii", errors="replace").strip()
        found = file_sha256(path)
    except FileNotFoundError as error:
        return "its checksum is missing" if Path(error.filename) == note else "it is missing"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if len(wanted) != hashlib.sha256().digest_size * 2:
        return "its checksum is damaged"
    if found != wanted:
        return "differs from its checksum"
    _verified[path.resolve()] = (state.st_size, state.st_mtime_ns, found)
    return None


def verify(path: Path) -> str:
    """Compare a file with its checksum, unless it was intact before and has not changed since.

    A file counts as unchanged if its size and date are the same.

    Args:
        path: The file.

    Returns:
        The checksum.

    Raises:
        InputError: The file is damaged or has no checksum.
    """
    key = path.resolve()
    with suppress(OSError):
        state = path.stat()
        size, date, checksum = _verified.get(key, (0, 0, ""))
        if (size, date) == (state.st_size, state.st_mtime_ns):
            return checksum
    reason = damage(path)
    if reason is not None:
        raise InputError(
            f"{path}: damaged ({reason}); run the generate command again to replace it"
        )
    return _verified[key][2]


@contextmanager
def open_verified(path: Path) -> Iterator[h5py.File]:
    """Verify an HDF5 file with `verify`, and open it for reading.

    Args:
        path: The file.

    Yields:
        The open file.

    Raises:
        InputError: The file is damaged or has no checksum.
        StorageFailed: The file cannot be read.
    """
    verify(path)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError) as error:
        line = " ".join(str(error).split())
        raise StorageFailed(f"{path}: cannot be read ({line})") from None
