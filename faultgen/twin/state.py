"""What has been judged so far: an SQLite file that several processes may share.

with State(Path("detector/state.sqlite"), detector).held() as stream:
    stream.known(sha256), stream.since_repair(date)
    stream.keep(sha256, date, scores, answer)

A file holds streams: the recordings of one program of one robot. SQLite writes a change as a whole
or not at all, and holds the file for one process while it is changed.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError, StorageFailed, one_line

PATIENCE = 60.0
"""How long another process may hold the file [s]. It needs less than a second for a recording."""

_TABLES = """
CREATE TABLE IF NOT EXISTS stream (
    number INTEGER PRIMARY KEY, robot TEXT NOT NULL, program TEXT NOT NULL, detector TEXT NOT NULL,
    UNIQUE (robot, program)
);
CREATE TABLE IF NOT EXISTS recording (
    number INTEGER PRIMARY KEY, stream INTEGER NOT NULL, sha256 TEXT NOT NULL, date REAL NOT NULL,
    scores BLOB NOT NULL, answer TEXT NOT NULL, sum TEXT NOT NULL,
    UNIQUE (stream, sha256)
);
CREATE INDEX IF NOT EXISTS by_date ON recording (stream, date);
CREATE TABLE IF NOT EXISTS repair (stream INTEGER NOT NULL, date REAL NOT NULL);
"""


class StateFailed(InputError):
    """The state cannot be used now. The message is one line that says what to do."""


class Stream:
    """Recordings of one program of one robot, while the file is held."""

    def __init__(self, connection: sqlite3.Connection, number: int, size: int) -> None:
        """Name the stream.

        Args:
            connection: To the file.
            number: Of the stream.
            size: Number of scores of a recording.
        """
        self._connection, self._number, self._size = connection, number, size

    def known(self, sha256: str) -> dict[str, Any] | None:
        """Return the answer to a recording that was judged before.

        Args:
            sha256: Checksum of its file.
        """
        rows = self._rows("sha256 = ?", (sha256,))
        return rows[0][3] if rows else None

    def answers(self) -> list[dict[str, Any]]:
        """Return all answers, in the order of the dates of their recordings."""
        return [row[3] for row in self._rows("1")]

    def latest(self) -> dict[str, Any] | None:
        """Return the answer to the recording with the latest date; None if there is none."""
        rows = self._rows(
            "number = (SELECT number FROM recording WHERE stream = ? "
            "ORDER BY date DESC, number DESC LIMIT 1)",
            (self._number,),
        )
        return rows[0][3] if rows else None

    def since_repair(self, until: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what was recorded since the last repair.

        Args:
            until: Latest date [s since 1970].

        Returns:
            Dates, shape (recordings,), and scores, shape (recordings, scores), in their order.
        """
        repaired = self._connection.execute(
            "SELECT MAX(date) FROM repair WHERE stream = ? AND date <= ?", (self._number, until)
        ).fetchone()[0]
        first = -np.inf if repaired is None else repaired
        rows = self._rows("date >= ? AND date <= ?", (max(first, -1e300), until), parsed=False)
        dates = np.array([row[1] for row in rows])
        scores = np.array([row[2] for row in rows]).reshape(len(rows), self._size)
        return dates, scores

    def keep(self, sha256: str, date: float, scores: np.ndarray, answer: dict[str, Any]) -> None:
        """Add a recording.

        Args:
            sha256: Checksum of its file.
            date: When it was recorded [s since 1970].
            scores: Shape (scores,).
            answer: The answer.
        """
        blob, text = np.asarray(scores, "<f8").tobytes(), json.dumps(answer)
        self._connection.execute(
            "INSERT INTO recording (stream, sha256, date, scores, answer, sum) "
            "VALUES (?, ?, ?, ?, ?, ?)",
            (self._number, sha256, date, blob, text, _sum(sha256, date, blob, text)),
        )

    def repaired(self, date: float) -> None:
        """Remember that the robot was repaired: earlier recordings say nothing of it any more.

        Args:
            date: Of the repair [s since 1970].
        """
        self._connection.execute("INSERT INTO repair VALUES (?, ?)", (self._number, date))

    def _rows(self, condition: str, values: tuple = (), *, parsed: bool = True) -> list[tuple]:
        """Checksum, date, scores and answer of recordings, by date."""
        found = []
        for sha256, date, blob, text, total in self._connection.execute(
            "SELECT sha256, date, scores, answer, sum FROM recording "
            f"WHERE stream = ? AND {condition} ORDER BY date, number",
            (self._number, *values),
        ):
            if total != _sum(sha256, date, blob, text) or len(blob) != 8 * self._size:
                raise sqlite3.DatabaseError("a recording differs from its checksum")
            found.append(
                (sha256, date, np.frombuffer(blob, "<f8"), json.loads(text) if parsed else None)
            )
        return found


class State:
    """The file, as one detector uses it."""

    def __init__(
        self, path: Path, detector: str, size: int, robot: str = "", program: str = ""
    ) -> None:
        """Name the file, which need not exist.

        Args:
            path: The file.
            detector: Checksum of the detector.
            size: Number of scores of a recording.
            robot: Name of the robot, if the file holds several.
            program: Name of its program.
        """
        self.path = path
        self._detector, self._size = detector, size
        self._of = (robot, program)

    @contextmanager
    def held(self) -> Iterator[Stream]:
        """Hold the file for this process alone. What is changed is written at the end, as a whole.

        Raises:
            StateFailed: Another process holds it for too long, or it is damaged, or that of another
                detector.
            StorageFailed: It cannot be written. Then nothing has changed.
        """
        try:
            with closing(sqlite3.connect(self.path, PATIENCE, isolation_level=None)) as connection:
                connection.execute("PRAGMA synchronous = FULL")
                connection.execute("BEGIN IMMEDIATE")
                try:
                    yield Stream(connection, self._stream(connection), self._size)
                    connection.execute("COMMIT")
                except BaseException:
                    if connection.in_transaction:
                        connection.execute("ROLLBACK")
                    raise
        except sqlite3.OperationalError as error:
            self._fail(error)
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            raise StateFailed(
                f"state file {self.path}: damaged ({one_line(error)}); delete it to begin anew"
            ) from None

    def _stream(self, connection: sqlite3.Connection) -> int:
        """Number of the stream, which is made if there is none."""
        for statement in _TABLES.split(";"):
            if statement.strip():
                connection.execute(statement)
        found = connection.execute(
            "SELECT number, detector FROM stream WHERE robot = ? AND program = ?", self._of
        ).fetchone()
        if found is None:
            return int(
                connection.execute(
                    "INSERT INTO stream (robot, program, detector) VALUES (?, ?, ?)",
                    (*self._of, self._detector),
                ).lastrowid
                or 0
            )
        if found[1] != self._detector:
            raise StateFailed(
                f"state file {self.path}: belongs to another detector; give another --state, or "
                "delete the file to begin anew"
            )
        return int(found[0])

    def _fail(self, error: sqlite3.OperationalError) -> None:
        told = one_line(error)
        if "locked" in told:
            raise StateFailed(
                f"state file {self.path}: another process has held it for {PATIENCE:g} s; end "
                "that one, or give another --state"
            ) from None
        if "no such column" in told or "has no column" in told or "syntax" in told:
            raise StateFailed(
                f"state file {self.path}: damaged ({told}); delete it to begin anew"
            ) from None
        raise StorageFailed(f"{self.path}: cannot be written ({told})") from None


def _sum(sha256: str, date: float, blob: bytes, text: str) -> str:
    content = f"{sha256} {date!r} ".encode() + blob + text.encode()
    return hashlib.sha256(content).hexdigest()
