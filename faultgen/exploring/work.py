"""One thread that simulates: what a visitor waits for first, and otherwise what he may want next.

MuJoCo's warnings are collected in one place of the process, so that only one thread may step.

    work = Work(spare)
    cycle = work.do(lambda: simulate_one(...))    # waits
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")

_AGAIN = 0.2  # time after which it asks again what may be needed later [s]

_Task = tuple[Future[Any], Callable[[], Any]]


class Work:
    """A thread that does tasks one by one."""

    def __init__(self, spare: Callable[[], Callable[[], object] | None]) -> None:
        """Start the thread. It ends with the program, or by `close`.

        Args:
            spare: Returns what may be needed later, or None. What it returns must raise nothing.
        """
        self._spare = spare
        self._urgent: list[_Task] = []
        self._patient: list[_Task] = []
        self._news = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True, name="simulation")
        self._thread.start()

    def do(self, task: Callable[[], T], *, patient: bool = False) -> T:
        """Do a task, and wait for it.

        Args:
            task: A function.
            patient: Whether others go first: tasks that are not patient, and every second time what
                may be needed later.

        Returns:
            What it returns. What it raises is raised here.
        """
        done: Future[T] = Future()
        with self._news:
            (self._patient if patient else self._urgent).append((done, task))
            self._news.notify()
        return done.result()

    def look(self) -> None:
        """Ask again what may be needed later."""
        with self._news:
            self._news.notify()

    def close(self) -> None:
        """End the thread after the task that it is doing. Tasks that wait are cancelled."""
        with self._news:
            self._closed = True
            for done, _ in (*self._urgent, *self._patient):
                done.cancel()
            self._urgent.clear()
            self._patient.clear()
            self._news.notify()
        self._thread.join()

    def _run(self) -> None:
        was_spare = False
        while True:
            with self._news:
                if self._closed:
                    return
                done, task = self._next(was_spare)
                if task is None:
                    self._news.wait(_AGAIN)
                    continue
            was_spare = done is None
            if done is None:
                task()
                continue
            try:
                done.set_result(task())
            except BaseException as error:  # it belongs to whoever waits
                done.set_exception(error)

    def _next(self, was_spare: bool) -> tuple[Future[Any] | None, Callable[[], Any] | None]:
        if self._urgent:
            return self._urgent.pop()  # the last one is what the visitor looks at now
        spare = None if was_spare and self._patient else self._spare()
        if spare is None and self._patient:
            return self._patient.pop(0)
        return None, spare
