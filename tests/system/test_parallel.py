"""Calls of functions in several processes."""

import os
import signal
import subprocess
import sys
import time

import pytest
from conftest import HANG
from joblib import delayed

from faultgen.errors import InputError, WorkerKilled
from faultgen.system.parallel import (
    MOST_WORKERS,
    check_workers,
    end_workers,
    in_parallel,
    start_workers,
)


def slow(number):
    """Returns its number, the smaller ones later, and the process in which it ran."""
    time.sleep(0.2 if number == 0 else 0.0)
    return number, os.getpid()


@pytest.mark.parametrize("workers", [1, 2, MOST_WORKERS])
def test_numbers_of_processes_that_can_be(workers):
    assert check_workers(workers) == workers


@pytest.mark.parametrize(
    ("workers", "message"),
    [(0, "must be at least 1, not 0"), (-2, "not -2"), (MOST_WORKERS + 1, "must be at most 1024")],
)
def test_numbers_of_processes_that_cannot_be(workers, message):
    with pytest.raises(InputError, match=message):
        check_workers(workers)


@pytest.mark.parametrize("workers", [1, 2])
def test_results_have_the_order_of_the_calls(workers):
    """Although the first call takes longest; with one worker, all are made in this process."""
    found = list(in_parallel([delayed(slow)(k) for k in range(8)], workers))
    assert [number for number, _ in found] == list(range(8))
    processes = {process for _, process in found}
    assert (processes == {os.getpid()}) == (workers == 1)
    unordered = in_parallel([delayed(slow)(k) for k in range(8)], workers, ordered=False)
    assert {number for number, _ in unordered} == set(range(8))


def handler():
    return signal.getsignal(signal.SIGINT)


def is_blocked():
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX systems")
def test_workers_leave_ctrl_c_to_the_parent():
    """A terminal sends it to all processes; a traceback of a worker would say nothing useful."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        in_workers = list(in_parallel([delayed(handler)() for _ in range(3)], 2))
        assert in_workers == [signal.SIG_IGN] * 3
        assert handler() is signal.default_int_handler
        # from their start, when they have no handler of ours yet
        end_workers()
        assert list(in_parallel([delayed(is_blocked)() for _ in range(3)], 2)) == [True] * 3
        assert not is_blocked()
    finally:
        signal.signal(signal.SIGINT, before)


def die(number):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX systems")
def test_killed_workers_are_told_in_one_line():
    with pytest.raises(WorkerKilled, match="^a worker process was killed, .* again to continue$"):
        list(in_parallel([delayed(die)(k) for k in range(3)], 2))


ENDS_WHILE_A_WORKER_IS_KILLED = """
import os, signal, sys
from joblib import delayed
from joblib.externals.loky import process_executor
from faultgen.system.parallel import end_workers, in_parallel

list(in_parallel([delayed(os.getpid)() for _ in range(8)], workers=2))
manager = process_executor._ExecutorManagerThread
shut_down = manager.shutdown_workers

def kill_one_first(self):
    processes = sorted(self.processes)
    if processes:
        os.kill(processes[int(sys.argv[1])], signal.SIGKILL)
    shut_down(self)

manager.shutdown_workers = kill_one_first
end_workers()
print("done", flush=True)
"""


@pytest.mark.parametrize("which", [0, 1])
def test_a_worker_that_is_killed_at_the_end_does_not_keep_the_program_waiting(which):
    """One of two idle workers waits for calls, and the other one for its turn to do so.

    If the first one is killed, the turn never ends. Without `end_workers`, one of the two cases
    waits forever.
    """
    done = subprocess.run(
        [sys.executable, "-c", ENDS_WHILE_A_WORKER_IS_KILLED, str(which)],
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


def begin(folder):
    """Leaves a mark in the process, and waits until another process has done so."""
    os.environ["FAULTGEN_MARK"] = "set"
    (folder / str(os.getpid())).touch()
    while len(list(folder.iterdir())) < 2:
        time.sleep(0.01)


def mark():
    return os.environ.get("FAULTGEN_MARK")


@pytest.mark.slow
def test_workers_that_were_started_before_take_the_calls(tmp_path):
    """What they did first has changed them, and not this process.

    Each of the two has made one of the first calls, however late it started.
    """
    end_workers()
    start_workers(delayed(begin)(tmp_path), 2)
    assert list(in_parallel([delayed(mark)()] * 4, 2)) == ["set"] * 4
    assert mark() is None
    end_workers()


STARTED_FOR_NOTHING = """
from joblib import delayed
import os, time
from faultgen.system.parallel import end_workers, start_workers

start_workers(delayed(time.sleep)(0.1), 2)
if {end}:
    end_workers()
"""


@pytest.mark.parametrize("end", [True, False])
def test_workers_that_get_no_calls_keep_no_program_waiting(end):
    """As when an experiment is refused after its workers were started."""
    done = subprocess.run(
        [sys.executable, "-c", STARTED_FOR_NOTHING.format(end=end)],
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert (done.returncode, done.stderr) == (0, "")


ENDED_BEFORE_THE_FIRST_CALL = """
import os, time
from joblib import delayed
from joblib.externals.loky import process_executor
from faultgen.system.parallel import end_workers, start_workers

manager = process_executor._ExecutorManagerThread
run, wait = manager.run, manager.wait_result_broken_or_wakeup
workers = []

def run_late(self):
    self.call_queue.full = lambda: not self.executor_flags.shutdown
    run(self)

def wait_late(self):
    told = wait(self)
    while not self.executor_flags.shutdown:
        time.sleep(0.01)
    workers.extend(self.processes.values())
    return told

manager.run, manager.wait_result_broken_or_wakeup = run_late, wait_late
start_workers(delayed(os.getpid)(), 2)
end_workers()
print(len(workers), all(worker.exitcode is not None for worker in workers))
"""


def test_workers_end_although_no_call_was_handed_out():
    """As on a busy machine, where the thread that hands out calls runs when the program ends."""
    done = subprocess.run(
        [sys.executable, "-c", ENDED_BEFORE_THE_FIRST_CALL],
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "2 True\n", "")
