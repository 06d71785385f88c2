"""Calls of functions in several processes, which end when the program ends.

Results are returned one by one. If the program is interrupted or killed, its worker processes stop
at once, so that they never write to a folder that another process may already use.

    for result in in_parallel([delayed(square)(k) for k in range(9)], workers=2):
        print(result)
"""

from __future__ import annotations

import atexit
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing import resource_tracker
from typing import Any

import joblib
from joblib.externals.loky import get_reusable_executor, process_executor

from faultgen.errors import InputError, WorkerKilled

Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
"""A call as `joblib.delayed` represents it: function, arguments and keyword arguments."""

MOST_WORKERS = 1024
"""Largest number of processes."""

# A worker that is idle for long, or that has used much memory, is replaced. That is no problem.
warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)

_LOOK_EVERY = 0.2  # s; how soon a worker notices that the program is gone

_hand_out = process_executor._ExecutorManagerThread.add_call_item_to_queue


def _hand_out_what_is_left(manager: Any) -> None:
    """Give calls to the workers, except for calls that were dropped when workers were ended.

    The numbers of dropped calls can still wait in a queue, if the program ends its workers soon
    after a call. Joblib's thread (loky 3.6) then failed with a KeyError: it printed a traceback and
    did not end the workers. Each try takes one number from the queue.
    """
    while True:
        with suppress(KeyError):
            return _hand_out(manager)


process_executor._ExecutorManagerThread.add_call_item_to_queue = _hand_out_what_is_left


def check_workers(workers: int) -> int:
    """Check a number of processes.

    Args:
        workers: The number of processes.

    Returns:
        The same number.

    Raises:
        InputError: The number is below 1 or above `MOST_WORKERS`.
    """
    if workers < 1:
        raise InputError(f"workers: must be at least 1, not {workers}")
    if workers > MOST_WORKERS:
        raise InputError(f"workers: must be at most {MOST_WORKERS}, not {workers}")
    return workers


def in_parallel(calls: Iterable[Call], workers: int, *, ordered: bool = True) -> Iterator[Any]:
    """Make calls in several processes.

    Args:
        calls: The calls, from `joblib.delayed`.
        workers: Number of processes. With 1, the calls are made in this process.
        ordered: Whether the results have the order of the calls, or that in which they finish.

    Yields:
        The result of each call.

    Raises:
        WorkerKilled: A worker process was killed.
    """
    if workers > 1:
        while _starting:
            _wait_for(_starting.pop())
    results = _begun(calls, workers, ordered)
    try:
        yield from results
    except BrokenProcessPool:
        raise WorkerKilled(
            "a worker process was killed, perhaps because memory ran out; "
            "run the same command again to continue"
        ) from None
    finally:
        _close(results)


def start_workers(call: Call, workers: int) -> None:
    """Start worker processes for later calls, without waiting for them.

    `in_parallel` with the same number of workers then finds them ready.

    Args:
        call: What each worker does first, such as computing what all later calls need.
        workers: Number of processes. With 1, nothing is done.
    """
    if workers > 1:
        if not _starting:
            atexit.register(_forget_started)
        _starting.append(_begun([call] * workers, workers, ordered=False))


def _begun(calls: Iterable[Call], workers: int, ordered: bool) -> Any:
    """Begin to make calls; an iterator over their results."""
    own = os.getpid()
    if workers > 1:
        _started.add(own)
    jobs = joblib.Parallel(
        n_jobs=workers,
        return_as="generator" if ordered else "generator_unordered",
        batch_size=1,
    )
    with _interrupts_held() if workers > 1 else nullcontext():
        return jobs(
            joblib.delayed(_make_call)(own, function, given, named)
            for function, given, named in calls
        )


def _forget_started() -> None:
    """Let go of workers that were started, and of what they do first."""
    atexit.unregister(_forget_started)
    while _starting:
        _close(_starting.pop())


def _close(results: Any) -> None:
    """Stop asking for results."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that not all results were asked for
        results.close()


def _wait_for(results: Any) -> None:
    """Let calls end whose results nobody needs. A killed worker is replaced later."""
    try:
        with suppress(BrokenProcessPool):
            for _ in results:
                pass
    finally:
        _close(results)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait, and keep it from the processes that are started meanwhile.

    It reaches all processes of a terminal, and a worker that is still importing modules would print
    a traceback. A worker inherits the signals that are blocked, and never gets them.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # started later, it would let Ctrl-C through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_workers() -> None:
    """End the worker processes at once, when no calls are left.

    Workers take turns in waiting for calls. If the one whose turn it is were killed while the
    program ends, the others would wait for it, and the program for them.
    """
    _forget_started()
    if os.getpid() in _started:
        get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


def _make_call(
    parent: int, function: Callable[..., Any], given: tuple[Any, ...], named: dict[str, Any]
) -> Any:
    if os.getpid() != parent:
        _end_with(parent)
    return function(*given, **named)


_started: set[int] = set()
_starting: list[Any] = []  # what workers do first
_watching: list[int] = []


def _end_with(parent: int) -> None:
    """Let this worker end as soon as its parent is gone, and only then."""
    if _watching or os.name == "nt":  # on Windows a process keeps the number of a dead parent
        return
    _watching.append(parent)
    # Ctrl-C reaches all processes of a terminal; the parent alone answers it and ends this one
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_EVERY)
        os._exit(1)

    threading.Thread(target=watch, name="watch-parent", daemon=True).start()
