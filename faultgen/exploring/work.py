"""One thread that simulates: what a visitor waits for first, and otherwise what he may want next.

MuJoCo's warnings are collected in one place of the process, so that only one thread may step.

    work = Work(next_task)
    cycle = work.do(lambda: simulate_one(...))    # waits
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")


class Work:
    """A thread that does tasks one by one, the last given first."""

    def __init__(self, spare: Callable[[], Callable[[], object] | None]) -> None:
        """Start the thread. It ends with the program, or by `close`.

        Args:
            spare: Returns what there is to do while nobody waits, or None. What it returns must
                raise nothing.
        """
        self._spare = spare
        self._tasks: list[tuple[Future[Any], Callable[[], Any]]] = []
        self._news = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True, name="simulation")
        self._thread.start()

    def do(self, task: Callable[[], T]) -> T:
        """Do a task before all others, and wait for it.

        Args:
            task: A function.

        Returns:
            What it returns. What it raises is raised here.
        """
        done: Future[T] = Future()
        with self._news:
            self._tasks.append((done, task))
            self._news.notify()
        return done.result()

    def look(self) -> None:
        """Ask again what there is to do while nobody waits."""
        with self._news:
            self._news.notify()

    def close(self) -> None:
        """End the thread after the task that it is doing. Tasks that wait are cancelled."""
        with self._news:
            self._closed = True
            for done, _ in self._tasks:
                done.cancel()
            self._tasks.clear()
            self._news.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._news:
                if self._closed:
                    return
                done, task = self._tasks.pop() if self._tasks else (None, self._spare())
                if task is None:
                    self._news.wait()
                    continue
            if done is None:
                task()
                continue
            try:
                done.set_result(task())
            except BaseException as error:  # it belongs to whoever waits
                done.set_exception(error)
