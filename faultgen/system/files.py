"""Writing files so that they are either complete or absent.

A file is first written under a temporary name. It is then synced to the disk, read back and
compared with what should have been written. Only after that does it get its final name. A failed
write therefore never leaves a damaged file behind, and it is never silent.

    write_text(Path("out/notes.txt"), "text")
    publish(temporary, Path("out/run.h5"), checksum)   # also writes out/run.h5.sha256
    verify(Path("out/run.h5"))                         # raises if the file has changed
"""

from __future__ import annotations

import errno
import hashlib
import itertools
import os
import platform
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from faultgen.errors import InputError, StorageFailed, one_line

# errors of a file system that cannot sync folders, which is no failure of the disk
_NO_FOLDER_SYNC = {errno.EINVAL, errno.ENOTSUP, errno.EBADF, errno.EACCES, errno.EISDIR}


_DIGITS = 64  # of a checksum
_MACHINE = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
"""This machine, for names of files."""


def temporary_name(path: Path) -> Path:
    """The name under which this process writes a file until the file is complete.

    It contains the machine and the process, because machines may share a folder.
    """
    return path.with_name(f".{path.name}.{_MACHINE}.{os.getpid()}.tmp")


def writer_of(temporary: Path) -> int | None:
    """The process id in a temporary name; None if there is none, or if it is another machine's."""
    parts = temporary.name.split(".")
    if len(parts) < 4 or parts[-3] != _MACHINE or not parts[-2].isdigit():
        return None
    return int(parts[-2])


def unfinished(folder: Path, stems: Collection[str]) -> list[Path]:
    """Find the files of a folder that are being written, or that a killed process left behind.

    Args:
        folder: The folder.
        stems: Their final names without endings.

    Returns:
        Their temporary names.
    """
    return [path for path in folder.glob(".*.tmp") if path.name.split(".")[1] in stems]


BINARY = getattr(os, "O_BINARY", 0)
"""Flag of files that are opened for writing: Windows would otherwise change line ends."""


def create(path: Path, access: int = os.O_WRONLY) -> int:
    """Create a file under its temporary name. A link of that name is replaced, and never followed.

    Args:
        path: The file. What a killed process has left there is removed.
        access: How it is opened, such as ``os.O_RDWR``.

    Returns:
        Handle of the file.

    Raises:
        OSError: The file cannot be created.
    """
    path.unlink(missing_ok=True)
    flags = os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | BINARY  # Windows lacks one
    return os.open(path, access | flags, 0o666)


def write_all(handle: int, content: memoryview) -> None:
    """Write all bytes to an open file.

    Args:
        handle: Handle of the file.
        content: The bytes.

    Raises:
        OSError: The system refused a write.
    """
    while len(content):
        content = content[os.write(handle, content) :]


def forget_cached(handle: int) -> None:
    """Let the next read of a file come from the disk, if the operating system supports this."""
    if hasattr(os, "posix_fadvise"):
        with suppress(OSError):
            os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)


@contextmanager
def named_failures(path: Path) -> Iterator[None]:
    """Turn errors of the operating system into one line that names the file.

    Raises:
        InputError: The path is a folder, or a file is in the place of one of its folders.
        StorageFailed: The code in the context raised another OSError.
    """
    try:
        yield
    except StorageFailed:
        raise
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; give the name of a file") from None
    except (FileExistsError, NotADirectoryError):
        raise InputError(
            f"{path}: a file is where a folder has to be; choose another name"
        ) from None
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise StorageFailed(f"{path}: cannot be written ({reason})") from None


def publish(temporary: Path, path: Path, checksum: str) -> None:
    """Give a synced file its final name and write ``<path>.sha256`` beside it.

    Args:
        temporary: The file under its temporary name.
        path: The final name.
        checksum: Its checksum, from reading it back when it was compared with what was written.

    Raises:
        StorageFailed: A step failed. The temporary file has then been removed, and an older file of
            that name and its checksum are as before.
    """
    note = checksum_path(path)
    with removed_on_failure(temporary), named_failures(path), _restored(note, "before"):
        write_text(note, checksum + "\n")
        rename(temporary, path)


@contextmanager
def removed_on_failure(temporary: Path) -> Iterator[None]:
    """Remove a temporary file if the code in the context fails.

    Args:
        temporary: The file, which need not exist.
    """
    try:
        yield
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


@contextmanager
def _restored(path: Path, name: str) -> Iterator[None]:
    """Give a file its old content again if the code in the context fails.

    A file that did not exist before is removed then. Where the file system knows no hard links, the
    new content of an old file stays.
    """
    backup = temporary_name(path.with_name(f"{path.name}.{name}"))
    existed = path.exists()
    kept = False
    if existed:
        with suppress(OSError):
            backup.unlink(missing_ok=True)
            os.link(path, backup)
            kept = True
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if kept:
                os.replace(backup, path)
            elif not existed:
                path.unlink(missing_ok=True)
        raise
    finally:
        if kept:
            with suppress(OSError):
                backup.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a small text file as UTF-8, completely or not at all; see `write_bytes`.

    Args:
        path: The file.
        text: Its content.

    Raises:
        StorageFailed: The file cannot be written. An older file of that name is unchanged.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a small file, completely or not at all.

    Args:
        path: The file.
        content: Its content.

    Raises:
        StorageFailed: The file cannot be written. An older file of that name is unchanged.
    """
    with _written(path, content) as (temporary, _), named_failures(path):
        rename(temporary, path)


def write_checked(path: Path, content: bytes) -> None:
    """Write a file, completely or not at all, with a checksum beside it.

    Args:
        path: The file.
        content: Its content.

    Raises:
        StorageFailed: The file cannot be written. An older file of that name is unchanged.
    """
    with _written(path, content) as (temporary, checksum):
        publish(temporary, path, checksum)


@contextmanager
def _written(path: Path, content: bytes) -> Iterator[tuple[Path, str]]:
    """Write a file under its temporary name, sync it and compare it; that name and its checksum."""
    temporary, checksum = temporary_name(path), hashlib.sha256(content).hexdigest()
    with removed_on_failure(temporary):
        with named_failures(path):
            handle = create(temporary)
            try:
                write_all(handle, memoryview(content))
                os.fsync(handle)
            finally:
                os.close(handle)
            if file_sha256(temporary) != checksum:
                raise StorageFailed(f"{path}: differs from what was written")
        yield temporary, checksum


def rename(temporary: Path, path: Path) -> None:
    """Give a synced file its final name.

    Args:
        temporary: The file under its temporary name.
        path: The final name.

    Raises:
        OSError: Renaming the file failed, or the new name could not be synced to the disk. An older
            file of that name is then as before.
    """
    with _restored(path, "old"):
        os.replace(temporary, path)
        _sync_folder(path.parent)


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


def file_sha256(path: str | Path) -> str:
    """Compute the SHA-256 checksum of a file.

    The file is read from the disk and not from the cache, if the operating system supports this.

    Args:
        path: The file.
    """
    with open(path, "rb", buffering=0) as file:
        forget_cached(file.fileno())
        if os.fstat(file.fileno()).st_size <= _AT_ONCE:  # most are small: `file_digest` is slow
            return hashlib.sha256(file.readall()).hexdigest()
        return hashlib.file_digest(file, "sha256").hexdigest()


_AT_ONCE = 2**20  # bytes
_BATCH = 100  # files that a thread reads one after another

READERS = 8
"""Number of threads that read files: a disk answers many questions at once."""

_verified: dict[str, tuple[int, int, str]] = {}
"""Size [bytes], date [ns] and checksum of files that were found intact."""


def damage(path: Path) -> str | None:
    """Compare a file with the checksum that is stored beside it. The whole file is read.

    Args:
        path: The file.

    Returns:
        What is wrong with the file, or None if it is intact.
    """
    place = os.path.abspath(path)
    note = f"{place}.sha256"
    _verified.pop(place, None)
    try:
        state = os.stat(place)
        with open(note, "rb", buffering=0) as file:
            text = file.read(2 * _DIGITS).decode("ascii", errors="replace")
        found = file_sha256(place)
    except FileNotFoundError as error:
        return "its checksum is missing" if error.filename == note else "it is missing"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    wanted, end = text[:_DIGITS], text[_DIGITS:]
    if len(wanted) < _DIGITS or end != "\n":
        return "its checksum is damaged"
    if found != wanted:
        return "differs from its checksum"
    _verified[place] = (state.st_size, state.st_mtime_ns, found)
    return None


def damages(paths: Sequence[Path]) -> dict[Path, str]:
    """Compare many files with their checksums; see `damage`.

    Args:
        paths: The files. If one is much larger than the others, it should be the first.

    Returns:
        What is wrong with each damaged file.
    """
    from concurrent.futures import ThreadPoolExecutor

    # some hundred at a time: to hand over each file would take longer than to read it
    batches = [paths[:1], *(paths[at : at + _BATCH] for at in range(1, len(paths), _BATCH))]
    with ThreadPoolExecutor(READERS) as pool:
        every = itertools.chain(*pool.map(lambda batch: [damage(one) for one in batch], batches))
        return {path: reason for path, reason in zip(paths, every, strict=True) if reason}


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
    key = os.path.abspath(path)
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
