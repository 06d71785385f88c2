"""Files for h5py that keep errors of the disk, and compare what they read with what it should be.

A file is compared in blocks of which checksums are kept, so that no whole file has to be in memory.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from faultgen.errors import StorageFailed
from faultgen.system.files import BINARY, create, forget_cached, write_all

BLOCK = 1 << 16
"""Size of the blocks in which a file is compared with what it should hold [bytes]."""

RECENT = 32
"""Number of blocks whose content is kept in memory."""


def _sum(content: bytes | bytearray) -> bytes:
    """Checksum of a block, which is filled up with zeros, as every gap in a file is."""
    return hashlib.sha256(content + bytes(BLOCK - len(content))).digest()


class _Content:
    """What a file holds or should hold: checksums of its blocks, and some of the blocks."""

    def __init__(self, handle: int, sums: dict[int, bytes], differs: StorageFailed) -> None:
        self._handle = handle
        self._sums = sums
        self._differs = differs
        self._recent: dict[int, bytearray] = {}

    def parts(self, position: int, size: int) -> Iterator[tuple[slice, memoryview]]:
        """Visit bytes of the file.

        Args:
            position: Where they begin [bytes].
            size: How many they are.

        Yields:
            A range of the bytes, and what the file should hold there, which may be changed.

        Raises:
            StorageFailed: The file holds something else.
        """
        done = 0
        while done < size:
            number, inside = divmod(position + done, BLOCK)
            step = min(BLOCK - inside, size - done)
            yield slice(done, done + step), memoryview(self._block(number))[inside : inside + step]
            done += step

    def cut(self, size: int) -> None:
        """Forget all that lies beyond a size of the file; before the file itself is cut.

        Raises:
            StorageFailed: The file does not hold what it should.
        """
        last, inside = divmod(size, BLOCK)
        for number in [one for one in {*self._sums, *self._recent} if one > last]:
            self._sums.pop(number, None)
            self._recent.pop(number, None)
        if last in self._sums or last in self._recent:
            self._block(last)[inside:] = bytes(BLOCK - inside)

    def compare(self, size: int) -> str:
        """Read the whole file from the disk and compare it.

        Args:
            size: The size that it should have [bytes].

        Returns:
            Its SHA-256 checksum.

        Raises:
            StorageFailed: It differs.
            OSError: It cannot be read.
        """
        while self._recent:
            self._forget_oldest()
        if os.fstat(self._handle).st_size != size:
            raise self._differs
        whole = hashlib.sha256()
        for start in range(0, size, BLOCK):
            whole.update(self._read(start // BLOCK)[: size - start])
        return whole.hexdigest()

    def _block(self, number: int) -> bytearray:
        content = self._recent.pop(number, None)
        if content is None:
            content = self._read(number) if number in self._sums else bytearray(BLOCK)
        self._recent[number] = content  # as the newest one
        if len(self._recent) > RECENT:
            self._forget_oldest()
        return content

    def _forget_oldest(self) -> None:
        number = next(iter(self._recent))
        self._sums[number] = _sum(self._recent.pop(number))

    def _read(self, number: int) -> bytearray:
        os.lseek(self._handle, number * BLOCK, os.SEEK_SET)
        content = bytearray()
        while len(content) < BLOCK and (part := os.read(self._handle, BLOCK - len(content))):
            content += part
        content += bytes(BLOCK - len(content))
        wanted = self._sums.get(number, b"")  # nothing was written to a gap
        if _sum(content) != wanted if wanted else any(content):
            raise self._differs
        return content


class _File(io.RawIOBase):
    """A file for h5py of which every read is compared with what the file should hold.

    It reports no error to HDF5, which crashes after some of them. It keeps the first one, and
    `check` raises it.
    """

    def __init__(self, handle: int, size: int, content: _Content) -> None:
        super().__init__()
        self._handle = handle
        self._size = size
        self._content = content
        self._position = 0
        self._error: BaseException | None = None

    def check(self) -> None:
        """Raise the first error that a read or write met, if there was one."""
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:  # noqa: D102
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
        size = max(0, min(len(view), self._size - self._position))
        try:
            for there, content in self._content.parts(self._position, size):
                view[there] = content
        except BaseException as error:  # even an interrupt must not pass through HDF5
            self._error = self._error or error
        self._position += size
        return size

    def close(self) -> None:  # noqa: D102
        if not self.closed:
            super().close()
            os.close(self._handle)


class Source(_File):
    """A file that is read, and every part of which is compared with the checksum of the file."""

    def __init__(self, path: Path, checksum: str) -> None:
        """Open the file and read it once.

        Args:
            path: The file.
            checksum: Its SHA-256 checksum.

        Raises:
            OSError: The file cannot be opened or read.
            StorageFailed: It differs from its checksum.
        """
        differs = StorageFailed(f"{path}: cannot be read (the disk returned wrong bytes)")
        handle = os.open(path, os.O_RDONLY | BINARY)
        try:
            state = os.fstat(handle)
            whole, sums = _sums_of(path, state.st_size, state.st_mtime_ns)
            if whole != checksum:
                raise differs
        except BaseException:
            os.close(handle)
            raise
        super().__init__(handle, state.st_size, _Content(handle, sums, differs))


@lru_cache(maxsize=2)
def _sums_of(path: Path, _size: int, _date: int) -> tuple[str, dict[int, bytes]]:
    """Checksums of a file and of its blocks; those of the newest two files are kept."""
    whole = hashlib.sha256()
    sums: dict[int, bytes] = {}
    with path.open("rb") as file:
        while part := file.read(BLOCK):
            whole.update(part)
            sums[len(sums)] = _sum(part)
    return whole.hexdigest(), sums


class Sink(_File):
    """A file that is written. `sync` compares it with what was written.

    HDF5 hides write errors that happen while objects are released. After an error, this file
    ignores all later writes.
    """

    def __init__(self, path: Path, final: Path | None = None) -> None:
        """Create the file.

        Args:
            path: The file. An older file of that name is replaced.
            final: The name that it gets later, for messages.

        Raises:
            OSError: The file cannot be created.
        """
        differs = StorageFailed(f"{final or path}: differs from what was written")
        handle = create(path, os.O_RDWR)
        super().__init__(handle, 0, _Content(handle, {}, differs))
        self.checksum = ""
        """SHA-256 checksum of the file, once it was synced and compared."""

    def writable(self) -> bool:  # noqa: D102
        return True

    def write(self, content: Any) -> int:  # noqa: D102
        view = memoryview(content).cast("B")
        if self._error is None:
            try:
                for there, part in self._content.parts(self._position, len(view)):
                    part[:] = view[there]
                os.lseek(self._handle, self._position, os.SEEK_SET)
                write_all(self._handle, view)
            except BaseException as error:
                self._error = error
        self._position += len(view)
        if len(view):
            self._size = max(self._size, self._position)
        return len(view)

    def truncate(self, size: int | None = None) -> int:  # noqa: D102
        self._size = self._position if size is None else size
        if self._error is None:
            try:
                self._content.cut(self._size)
                os.ftruncate(self._handle, self._size)
            except BaseException as error:
                self._error = error
        return self._size

    def sync(self) -> None:
        """Write everything to the disk, read it from the disk to compare it, and close the file.

        Raises:
            OSError: This write or an earlier one failed.
            StorageFailed: The file does not hold what was written.
        """
        self.check()
        os.fsync(self._handle)
        forget_cached(self._handle)
        self.checksum = self._content.compare(self._size)
        self.close()
