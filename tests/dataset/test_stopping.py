"""Programs that are terminated or killed leave no process behind that still writes."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from conftest import HANG

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.system.files import temporary_name

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX systems")


def start(tiny_robot_path, tiny_task_path, out):
    """A sweep whose two workers would simulate for hours."""
    command = [sys.executable, "-m", "faultgen.cli", "generate", "--robot", tiny_robot_path]
    command += ["--task", tiny_task_path, "--axis", "1,2", "--cycles", "1000000"]
    return subprocess.Popen(
        [*command, "--workers", "2", "-o", str(out)],
        start_new_session=True,
        # tests that run in the background ignore Ctrl-C, and the program would inherit this
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(condition):
    deadline = time.monotonic() + HANG
    while not condition():
        assert time.monotonic() < deadline, "it hangs"
        time.sleep(0.05)


def has_ended(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    state = Path(f"/proc/{process}/stat")
    # ended, but the process that adopted it has not yet asked how
    return state.is_file() and state.read_text().rpartition(")")[2].split()[0] == "Z"


def writers(out):
    return {path.name.split(".")[-2] for path in out.glob("runs/.*.tmp")}


@pytest.mark.parametrize(
    ("how", "status"),
    [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGKILL, -9)],
)
@pytest.mark.slow
def test_workers_end_with_the_program(tiny_robot_path, tiny_task_path, tmp_path, how, status):
    """Only the program gets the signal; its workers end too, release stdout and stop writing."""
    process = start(tiny_robot_path, tiny_task_path, tmp_path / "out")
    wait_for(lambda: len(writers(tmp_path / "out")) == 2 or process.poll() is not None)
    workers = [int(number) for number in writers(tmp_path / "out")]
    assert len(workers) == 2
    os.kill(process.pid, how)
    # ends only when no process holds the pipes any more
    said, complained = process.communicate(timeout=HANG)
    assert process.returncode == status
    assert "Traceback" not in complained
    for worker in workers:
        wait_for(lambda worker=worker: has_ended(worker))
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1], "cycles": 2}
    if how != signal.SIGKILL:
        assert not list((tmp_path / "out").rglob("*.h5"))
    generate(make_experiment(given), tmp_path / "other", progress=False)
    assert not open_dataset(tmp_path / "other").damaged()


def test_resuming_waits_for_writers_of_a_killed_program(
    tiny_robot_path, tiny_task_path, tmp_path, monkeypatch
):
    """Unfinished files are removed only when the processes that write them have ended."""
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1], "cycles": 2}
    generate(make_experiment(given), tmp_path, progress=False)
    writer = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"])
    unfinished = (
        tmp_path
        / "runs"
        / temporary_name(Path("0" * 16 + ".h5")).name.replace(str(os.getpid()), str(writer.pid))
    )
    unfinished.write_text("being written")
    waits = []

    def wait(seconds):
        assert unfinished.exists()
        waits.append(seconds)
        if len(waits) == 3:
            writer.kill()
            writer.wait()

    monkeypatch.setattr("faultgen.dataset.making.time.sleep", wait)
    generate(make_experiment(given), tmp_path, progress=False)
    assert len(waits) == 3
    assert not unfinished.exists()


SWALLOWED = """
    try:
        os.kill(os.getpid(), NUMBER)
    except BaseException:
        print("caught", flush=True)
"""

FINALISED = """
    class Object:
        def __del__(self):
            print("caught", flush=True)
            os.kill(os.getpid(), NUMBER)
            time.sleep(1)
    Object()
"""

INTERRUPTED = "faultgen: interrupted; run the same command again to continue\n"


@pytest.mark.parametrize(
    ("where", "number", "status", "told"),
    [
        (SWALLOWED, signal.SIGINT, 130, INTERRUPTED),
        pytest.param(FINALISED, signal.SIGTERM, 143, "", marks=pytest.mark.slow),
    ],
)
def test_signals_are_not_lost(
    tiny_robot_path, tiny_task_path, tmp_path, where, number, status, told
):
    """Nor where every exception is caught, as by some modules at their import, or none can be."""
    code = (
        "import os, signal, sys, time\n"
        "import faultgen.cli\n"
        "import faultgen.dataset.sweep as sweep\n"
        "real = sweep.plan_runs\n"
        f"def swallowing(experiment):{where.replace('NUMBER', str(int(number)))}"
        "    return real(experiment)\n"
        "sweep.plan_runs = swallowing\n"
        "faultgen.cli.main()"
    )
    given = ["generate", "--robot", tiny_robot_path, "--task", tiny_task_path, "--cycles", "2"]
    done = subprocess.run(
        [sys.executable, "-c", code, *given, "--workers", "1", "-o", str(tmp_path / "out")],
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.default_int_handler),
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.stdout == "caught\n"
    assert done.returncode == status
    assert done.stderr == told


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, -15)])
def test_signals_after_the_work_is_done_print_nothing(number, status):
    """While Python ends, nothing is left that could be interrupted."""
    program = (
        "import atexit, os, signal, sys\n"
        "from faultgen.cli import main\n"
        "sys.argv = ['faultgen', 'robots']\n"
        f"atexit.register(lambda: os.kill(os.getpid(), {int(number)}))\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (status, "")
    assert "puma560" in done.stdout
