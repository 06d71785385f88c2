"""How far a long piece of work is: a bar on a terminal, and otherwise a line now and then.

Both go to stderr, and state the rate and the time left. Work of less than five seconds shows no
lines. TQDM_DISABLE=1 in the environment turns both off.

    with Progress("simulating", 200, "cycle") as progress:
        results = in_parallel([delayed(work)(k, progress.counter) for k in range(9)], workers=2)

    for result in follow(results, "fitting", 9, "model"):
        print(result)
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from tqdm import tqdm

from faultgen.system.files import BINARY
from faultgen.system.interrupts import raise_if_interrupted
from faultgen.system.terminal import tell_progress, visible

FIRST_LINE = 5.0
"""Time after which the first line is printed [s]."""

_NEXT_LINE = 10.0  # s between lines; after 100 s, a tenth of the time so far
_SHARE = 0.1
_LOOK_EVERY = 0.5  # s; how often the counts of the workers are read

T = TypeVar("T")


@dataclass(frozen=True)
class Counter:
    """Counts steps of work, in any process. Calling it with a number counts that many steps."""

    file: str
    """File that gets one byte for each step; the system appends bytes of all processes whole."""

    def __call__(self, steps: int = 1) -> None:
        """Count steps.

        Args:
            steps: Number of steps that have been done.
        """
        with suppress(OSError):  # work goes on if its progress cannot be shown
            handle = os.open(self.file, os.O_WRONLY | os.O_APPEND | BINARY)
            try:
                os.write(handle, b"." * steps)
            finally:
                os.close(handle)


class Progress:
    """Shows how many steps of work have been done, counted in this process or in its workers.

    It is a context manager. Counts within it are shown by a thread, so that the display goes on
    while this process waits for its workers.
    """

    def __init__(self, what: str, total: int | None, unit: str = "", shown: bool = True) -> None:
        """Prepare the display. It begins when the context does.

        Args:
            what: What is being done, such as "simulating".
            total: Number of steps; None if it is not known.
            unit: Name of a step in the singular, such as "cycle".
            shown: Whether anything is shown.
        """
        self._what, self._total, self._unit = visible(what), total, unit
        off = os.environ.get("TQDM_DISABLE", "0") not in ("", "0")
        self._shown = shown and not off and total != 0
        self._on_terminal = sys.stderr.isatty()
        self._ended = threading.Event()

    def __enter__(self) -> Progress:
        """Begin to show the progress, unless Ctrl-C was pressed and has been lost since."""
        raise_if_interrupted()
        try:
            handle, name = tempfile.mkstemp(prefix="faultgen-progress-")
            os.close(handle)
        except OSError:  # nothing can be counted; the work goes on
            name, self._shown = os.devnull, False
        self._file = Path(name)
        self.counter = Counter(name)
        """Counts steps. It can be given to other processes."""
        self._started = time.monotonic()
        if self._shown:
            self._bar = tqdm(
                total=self._total,
                desc=self._what,
                unit=self._unit or "it",
                leave=False,
                disable=not self._on_terminal,
            )
            self._thread = threading.Thread(target=self._watch, name="progress", daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the display."""
        self._ended.set()
        if self._shown:
            self._thread.join()
            self._bar.close()
            elapsed = time.monotonic() - self._started
            if not self._on_terminal and kind is None and elapsed >= FIRST_LINE:
                done = self._done()
                steps = f", {done} {plural(self._unit, done)}" if done else ""
                _print(f"{self._what}: done{steps} in {clock(elapsed)}")
        if self._file != Path(os.devnull):
            self._file.unlink(missing_ok=True)

    def _done(self) -> int:
        """Number of steps that have been counted."""
        try:
            return self._file.stat().st_size
        except OSError:
            return 0

    def _watch(self) -> None:
        due = FIRST_LINE
        while not self._ended.wait(_LOOK_EVERY):
            done, elapsed = self._done(), time.monotonic() - self._started
            if self._on_terminal:
                self._bar.update(done - self._bar.n)
                self._bar.refresh()
            elif elapsed >= due:
                _print(line(self._what, done, self._total, self._unit, elapsed))
                due = elapsed + max(_NEXT_LINE, _SHARE * elapsed)


def follow(
    items: Iterable[T], what: str, total: int | None, unit: str = "", shown: bool = True
) -> Iterator[T]:
    """Pass items on, and show how many have come.

    Args:
        items: The items.
        what: What is being done, such as "fitting".
        total: Number of items; None if it is not known.
        unit: Name of an item in the singular.
        shown: Whether anything is shown.

    Yields:
        The items.
    """
    with Progress(what, total, unit, shown) as progress:
        for item in items:
            progress.counter()
            raise_if_interrupted()
            yield item


def line(what: str, done: int, total: int | None, unit: str, elapsed: float) -> str:
    """Describe the progress in one line.

    Args:
        what: What is being done.
        done: Number of steps done.
        total: Number of all steps; None if it is not known.
        unit: Name of a step in the singular.
        elapsed: Time since the start [s].

    Returns:
        The steps, the rate and the time left, or the time so far as long as nothing is done.
    """
    steps = plural(unit, total or done)
    if total is None:
        return f"{what}: {f'{done} {steps}, ' if done else ''}{clock(elapsed)} so far"
    told = f"{what}: {done} of {total} {steps} ({100 * done / total:.0f} %)"
    if not done:
        return f"{told}, {clock(elapsed)} so far"
    rate = done / elapsed
    shown = f"{rate:.3g} {steps}/s" if rate >= 1 else f"{1 / rate:.3g} s/{unit or 'step'}"
    return f"{told}, {shown}, {clock(max(total - done, 0) / rate)} left"


def _print(text: str) -> None:
    with suppress(OSError, ValueError):  # stderr may be closed
        tell_progress(text)


def plural(unit: str, count: int) -> str:
    """Return the name of steps.

    Args:
        unit: Name of one step; without it, it is "step".
        count: Number of steps.
    """
    return f"{unit or 'step'}{'' if count == 1 else 's'}"


def clock(seconds: float) -> str:
    """Return a time as minutes and seconds, 1:05, or with hours, 2:01:05."""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    head = f"{hours}:{minutes:02d}" if hours else f"{minutes}"
    return f"{head}:{whole % 60:02d}"
