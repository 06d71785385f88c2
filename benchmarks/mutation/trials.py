"""Running tests on mutants: each in a process of its own, the most telling test first.

A process server imports the libraries once and forks for each mutant, so a trial that ends with the
first test costs little more than this test.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import coverage
import pytest
from joblib.externals.loky import get_reusable_executor
from mutation.mutants import Mutant

HANG = 10.0
"""Tests that take so many times as long as without a change count as hanging."""
LEAST_LIMIT = 600.0
"""The least time after which tests count as hanging [s]."""
LIBRARIES = "numpy scipy.stats scipy.signal h5py mujoco pandas pydantic matplotlib.figure"
"""What the tests import and no mutant changes."""

_CONTEXT = multiprocessing.get_context("forkserver")


def preload() -> None:
    """Let the process server import what no mutant changes. Call this before the first trial."""
    _CONTEXT.set_forkserver_preload(["trials", *LIBRARIES.split()])


@dataclass(frozen=True)
class Lines:
    """Which tests run which lines of a module."""

    tests: dict[int, list[str]]
    """Tests by line, the quickest first."""
    seconds: float
    """How long all tests of the module take."""

    def of(self, line: int) -> list[str]:
        """Tests that run a line; of a statement over several lines, the first line counts."""
        lines = sorted(self.tests)
        before = bisect_right(lines, line)
        return self.tests[lines[before - 1]] if before else []


class _Watch:
    """A pytest plugin: runs some tests first and reports what happens.

    Args:
        sender: Gets the name of each test that fails.
        first: Names of the tests to begin with, in this order.
        traced: Is told which test runs, if any.
    """

    def __init__(
        self, sender: Connection, first: list[str], traced: coverage.Coverage | None
    ) -> None:
        self._sender, self._traced = sender, traced
        self._rank = {name: k for k, name in enumerate(first)}
        self.seconds: dict[str, float] = defaultdict(float)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sort the tests."""
        items.sort(key=lambda item: self._rank.get(item.nodeid, len(self._rank)))

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Note which test is about to run."""
        if self._traced:
            self._traced.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a test's time, and whether it failed."""
        self.seconds[report.nodeid] += report.duration
        if report.failed:
            self._sender.send(report.nodeid)


def _run_tests(
    folder: Path, tests: list[str], first: list[str], traced: str | None, sender: Connection
) -> None:
    """Run tests in a copy of the repository; the exit status is that of pytest.

    Args:
        folder: The copy.
        tests: Arguments of pytest, which choose the tests.
        first: Names of the tests to begin with.
        traced: Path of a module in the copy; which tests run which of its lines is sent, too.
        sender: Gets the names of the tests that fail.
    """
    os.setsid()  # so that whatever the tests start can be ended with them
    os.chdir(folder)
    log = os.open(folder / "mutation.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(log, stream.fileno())
    sys.dont_write_bytecode = True  # Python would not notice a mutant of the same size and second
    os.environ |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    own = Path(__file__).parents[2]  # the copy has all of these, too
    others = [p for p in sys.path if Path(p) not in (own, own / "benchmarks", own / "tests")]
    sys.path[:] = [str(folder), *others]
    tracer = None
    if traced:
        tracer = coverage.Coverage(data_file=None, include=[str(folder / traced)])
        tracer.start()
    watch = _Watch(sender, first, tracer)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow"]
    status = pytest.main([*options, *tests], [watch])
    if tracer and traced:
        tracer.stop()
        lines = tracer.get_data().contexts_by_lineno(str(folder / traced))
        named = {line: [name for name in names if name] for line, names in lines.items()}
        sender.send((named, dict(watch.seconds)))
    # idle workers of the tests would hold up the end of this process for five minutes
    get_reusable_executor().shutdown(kill_workers=True)
    sys.exit(status)


class _Trial:
    """Tests that run in a copy of the repository."""

    def __init__(
        self, folder: Path, tests: list[str], first: list[str], traced: str | None = None
    ) -> None:
        self.folder = folder
        self.started = time.monotonic()
        self._receiver, sender = _CONTEXT.Pipe(duplex=False)
        arguments = (folder, tests, first, traced, sender)
        self._process = _CONTEXT.Process(target=_run_tests, args=arguments)
        self._process.start()
        sender.close()

    @property
    def sentinel(self) -> int:
        """Is ready when the tests have ended."""
        return self._process.sentinel

    @property
    def status(self) -> int | None:
        """Exit status of pytest; None while the tests run."""
        return self._process.exitcode

    def messages(self) -> Iterator[Any]:
        """What the tests reported."""
        try:
            while self._receiver.poll():
                yield self._receiver.recv()
        except EOFError:
            return

    def end(self) -> None:
        """End the tests and all that they started."""
        if self._process.is_alive():
            os.killpg(self._process.pid or 0, signal.SIGKILL)
        self._process.join()


def tests_by_line(folder: Path, module: str, tests: list[str]) -> Lines:
    """Run the tests without any change, and note which of them run which line.

    Args:
        folder: Copy of the repository.
        module: The module.
        tests: Arguments of pytest, which choose the tests.

    Returns:
        Tests by line.

    Raises:
        RuntimeError: A test fails.
    """
    trial = _Trial(folder, tests, [], traced=module)
    received: list[Any] = []
    try:
        while trial.status is None:
            wait([trial.sentinel], timeout=1.0)
            received.extend(trial.messages())  # a full pipe would hold the tests up
        received.extend(trial.messages())
    finally:
        trial.end()
    if trial.status != 0:
        log = (folder / "mutation.log").read_text()[-3000:]
        raise RuntimeError(f"a test fails without any change\n{log}")
    lines, seconds = received[-1]
    by_line = {line: sorted(names, key=seconds.__getitem__) for line, names in lines.items()}
    return Lines(by_line, time.monotonic() - trial.started)


def try_mutants(
    module: str, tests: list[str], mutants: list[Mutant], lines: Lines, folders: list[Path]
) -> list[dict[str, Any]]:
    """Run the tests on each mutant of a module.

    Args:
        module: The module.
        tests: Arguments of pytest, which choose the tests.
        mutants: The mutants.
        lines: Tests by line.
        folders: Copies of the repository, one for each process.

    Returns:
        One result for each mutant, in their order.
    """
    source = (folders[0] / module).read_text()
    limit = max(LEAST_LIMIT, HANG * lines.seconds)
    free = list(folders)
    waiting = list(enumerate(mutants))
    running: dict[int, tuple[int, Mutant, _Trial]] = {}
    outcomes: dict[int, dict[str, Any]] = {}
    try:
        while waiting or running:
            while waiting and free:
                number, mutant = waiting.pop(0)
                folder = free.pop()
                (folder / module).write_text(mutant.source)
                trial = _Trial(folder, tests, lines.of(mutant.line))
                running[trial.sentinel] = number, mutant, trial
            wait(list(running), timeout=1.0)
            for sentinel, (number, mutant, trial) in list(running.items()):
                if trial.status is None and time.monotonic() - trial.started < limit:
                    continue
                outcome = {None: "hung", 0: "survived"}.get(trial.status, "killed")
                outcomes[number] = {
                    "line": mutant.line,
                    "kind": mutant.kind,
                    "before": mutant.before,
                    "after": mutant.after,
                    "outcome": outcome,
                    "killed_by": next(trial.messages(), ""),
                }
                trial.end()
                (trial.folder / module).write_text(source)
                free.append(trial.folder)
                del running[sentinel]
    finally:
        for _, _, trial in running.values():
            trial.end()
            (trial.folder / module).write_text(source)
    return [outcomes[k] for k in range(len(mutants))]
