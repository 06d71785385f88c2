"""What a judge has answered so far: a file that several processes may share.

with State(Path("detector/state.json"), key, size).held() as state:
state.answers, state.memory
state.keep(answer, memory)
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from faultgen.errors import InputError, StorageFailed, one_line
from faultgen.system.files import write_text
from faultgen.system.reading import LARGEST_TEXT, read_bytes
from faultgen.system.sealed_json import damage, sealed, unsealed
from faultgen.twin.detector import Memory

PATIENCE = 60.0
"""How long another process may hold the file [s]. It needs less than a second for a recording."""

_OLDER = ("detector_sha256", "count", "mean", "answers")  # entries before there was a checksum


class StateFailed(InputError):
    """The state cannot be used now. The message is one line that says what to do."""


class State:
    """The answers of a detector and its running mean, in a file."""

    def __init__(self, path: Path, detector: str, size: int) -> None:
        """Name the file, which need not exist.

        Args:
            path: The file.
            detector: Checksum of the detector.
            size: Number of values in its running mean.
        """
        self.path = path
        self._detector = detector
        self._size = size
        self._known: tuple[int, ...] | None = None
        self.memory = Memory.empty()
        """The running mean."""
        self.answers: list[dict[str, Any]] = []
        """All answers, oldest first."""
        self.is_older = False
        """Whether the file has no checksum, because an older version of faultgen wrote it."""

    @contextmanager
    def held(self) -> Iterator[State]:
        """Hold the file for this process alone, and read what others have written to it.

        Raises:
            StateFailed: Another process holds it for too long, or it is damaged, or that of another
                detector.
            StorageFailed: The lock beside it cannot be written.
        """
        lock = FileLock(self.path.with_name(f".{self.path.name}.lock"), timeout=PATIENCE)
        try:
            lock.acquire()
        except Timeout:
            raise StateFailed(
                f"state file {self.path}: another process has held it for {PATIENCE:g} s; end "
                "that one, or give another --state"
            ) from None
        except OSError as error:
            reason = error.strerror or one_line(error)
            raise StorageFailed(f"{self.path}: cannot be locked ({reason})") from None
        try:
            self.read()
            yield self
        finally:
            lock.release()

    def read(self) -> None:
        """Read the file, unless it is as it was. If there is none, nothing has been judged.

        Raises:
            StateFailed: It is damaged, or that of another detector.
        """
        found = self._stamp()
        if found == self._known:
            return
        self.memory, self.answers, self.is_older = Memory.empty(), [], False
        if found is not None:
            try:
                text = read_bytes(self.path, "state file", LARGEST_TEXT)
            except InputError as error:
                raise StateFailed(str(error)) from None
            self._parse(text)
        self._known = found

    def keep(self, answer: dict[str, Any], memory: Memory) -> None:
        """Add an answer to the file.

        Args:
            answer: The answer.
            memory: The running mean after it.

        Raises:
            StorageFailed: The file cannot be written. Then everything is as before.
        """
        answers = [*self.answers, answer]
        told = {"detector_sha256": self._detector, **asdict(memory), "answers": answers}
        write_text(self.path, sealed(told))
        self.memory, self.answers, self.is_older = memory, answers, False
        self._known = self._stamp()

    def _stamp(self) -> tuple[int, ...] | None:
        """What changes with the file; None if there is none."""
        try:
            state = self.path.stat()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StorageFailed(f"{self.path}: cannot be read ({error.strerror})") from None
        return state.st_ino, state.st_size, state.st_mtime_ns

    def _parse(self, text: bytes) -> None:
        try:
            # first, because the usual reason deserves its own line
            if json.loads(text)["detector_sha256"] != self._detector:
                raise StateFailed(
                    f"state file {self.path}: belongs to another detector, or is damaged; give "
                    "another --state, or delete the file to begin anew"
                )
            told, is_sealed = unsealed(text, _OLDER)
            memory = Memory(int(told["count"]), tuple(float(x) for x in told["mean"]))
            if memory.count and len(memory.mean) != self._size:
                raise ValueError(f"'mean' has {len(memory.mean)} values, not {self._size}")
            if not np.isfinite(memory.mean).all():
                raise ValueError("'mean' is not finite")
            for answer in told["answers"]:
                if not isinstance(answer["sha256"], str):
                    raise ValueError("an answer has no checksum of its recording")
        except StateFailed:
            raise
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise StateFailed(
                f"state file {self.path}: damaged ({damage(error)}); delete it to begin anew"
            ) from None
        self.memory, self.answers, self.is_older = memory, list(told["answers"]), not is_sealed
