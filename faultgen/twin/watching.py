"""Judging recordings as they appear in a folder.

    watched = Watch(judge.judge, Path("inbox"), tell=print, complain=print)
    watched.look()

A recording is judged as soon as it is complete by its own content, which an HDF5 file with a
checksum shows, and any other one when it has not changed for a while. One that cannot be judged is
tried again when it changes; if a disk failed, it is tried again at every look.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgen.errors import InputError, StorageFailed, one_line
from faultgen.recordings.read import is_complete
from faultgen.twin.state import StateFailed

ENDINGS = (".h5", ".hdf5", ".csv")
"""Endings of the files that are recordings."""

SETTLED = 6.0
"""How long a recording without a checksum must not change before it is judged [s]; assumed. Copies
were seen to pause for two looks, which is 4 s."""

PAUSE = 2.0
"""Time between two looks into the folder [s]."""

Signature = tuple[int, int, int, int]
"""What changes when a file changes: its inode, its size [bytes] and two dates [ns]."""


@dataclass
class _Seen:
    """A file in the folder, as it was at the last look."""

    signature: Signature
    unchanged: float = 0.0
    """For how long it has not changed [s]."""
    is_done: bool = False
    """Whether it was judged, or cannot be judged as it is."""
    is_complete: bool = False
    """Whether its own checksum shows that it is complete."""


class Watch:
    """A folder that is watched."""

    def __init__(
        self,
        judge: Callable[[Path], dict[str, Any]],
        folder: Path,
        tell: Callable[[dict[str, Any]], None],
        complain: Callable[[str], None],
        settled: float = SETTLED,
    ) -> None:
        """Name what is watched.

        Args:
            judge: Judges a recording, and returns the answer.
            folder: The folder.
            tell: Called with each answer to a recording that was not judged before.
            complain: Called with a line for each file that cannot be judged, and for a disk that
                fails.
            settled: How long a file without a checksum must not change before it is judged [s].
        """
        self._judge = judge
        self._folder = folder
        self._tell = tell
        self._complain = complain
        self._settled = settled
        self._seen: dict[Path, _Seen] = {}
        self._failing: set[str] = set()
        self._failed_before: set[str] = set()

    def look(self) -> int:
        """Look into the folder once, and judge what is ready.

        Returns:
            Number of recordings that were judged, without those that were judged before.
        """
        self._failed_before, self._failing = self._failing, set()
        try:
            paths = sorted(self._folder.iterdir(), key=_by_age)
        except OSError as error:
            self._fails(f"{self._folder}: cannot be read ({error.strerror or one_line(error)})")
            return 0
        judged = sum(
            self._look_at(path)
            for path in paths
            if path.suffix.lower() in ENDINGS and not path.name.startswith(".")
        )
        for path in self._seen.keys() - set(paths):
            del self._seen[path]
        return judged

    def _look_at(self, path: Path) -> bool:
        """Judge a file if it is ready; whether that gave a new answer."""
        try:
            state = path.stat()
        except FileNotFoundError:  # removed in between
            return False
        except OSError as error:
            self._fails(f"{path}: cannot be read ({error.strerror or one_line(error)})")
            return False
        signature = (state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)
        seen = self._seen.get(path)
        if seen is None or seen.signature != signature:
            seen = self._seen[path] = _Seen(signature)
            seen.is_complete = is_complete(path)
        else:
            seen.unchanged += PAUSE
        ready = not seen.is_done and (seen.is_complete or seen.unchanged >= self._settled)
        return ready and self._try(path, seen)

    def _try(self, path: Path, seen: _Seen) -> bool:
        try:
            answer = self._judge(path)
        except (StateFailed, StorageFailed) as error:
            self._fails(str(error))
            return False
        except InputError as error:
            seen.is_done = True
            self._complain(str(error))
            return False
        seen.is_done = True
        if answer["again"]:
            return False
        self._tell(answer)
        return True

    def _fails(self, message: str) -> None:
        """Report a failure that may end by itself, unless it was reported at the last look."""
        if message not in self._failing | self._failed_before:
            self._complain(f"{message}; trying again")
        self._failing.add(message)


def check_settled(seconds: float) -> None:
    """Refuse a time that is none.

    Args:
        seconds: How long a file must not change [s].

    Raises:
        InputError: It is negative, or not a number.
    """
    if not 0 <= seconds < math.inf:
        raise InputError(f"settled: must be a number of seconds from 0 on, not {seconds:g}")


def paused(seconds: float = PAUSE) -> bool:
    """Wait, and return that it goes on.

    Args:
        seconds: How long [s].
    """
    time.sleep(seconds)
    return True


def _by_age(path: Path) -> tuple[float, str]:
    try:
        return path.stat().st_mtime, path.name
    except OSError:  # removed in between
        return 0.0, path.name
