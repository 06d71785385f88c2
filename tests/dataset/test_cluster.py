"""Runs that the workers of a Dask scheduler make, on the loopback interface."""

import os
import signal
import subprocess
import sys
import time

import pytest
from conftest import HANG, contents

from faultgen.dataset.experiment import make_experiment, to_toml
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate

pytest.importorskip("distributed", reason="Dask is not installed")


def command(*words):
    return [sys.executable, "-m", *map(str, words)]


@pytest.fixture
def start(tmp_path):
    """Function that starts a process, which ends with the test."""
    started = []

    def run(*words, **options):
        process = subprocess.Popen(
            command(*words), cwd=tmp_path, start_new_session=True, text=True, **options
        )
        started.append(process)
        return process

    yield run
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture
def scheduler(start, tmp_path):
    """A scheduler on a free port, and its address."""
    with (tmp_path / "scheduler.log").open("w") as log:
        start("dask", "scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard", stderr=log)
    return address(tmp_path / "scheduler.log")


def address(log):
    deadline = time.monotonic() + HANG
    while True:
        for word in log.read_text().split():
            if word.startswith("tcp://"):
                return word
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.1)


def start_worker(start, scheduler, threads=1):
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = ["--nthreads", threads, "--no-nanny", "--no-dashboard"]
    return start("dask", "worker", scheduler, *words, **quiet)


@pytest.fixture
def experiment(tiny_robot_path, tiny_task_path):
    """A cheap sweep of seven runs."""
    base = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 60}
    return make_experiment(base | {"severity": [0.1, 0.2, 0.3], "sensors": "thesis"})


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(start, scheduler, experiment, tmp_path):
    """Its run is made by the other worker, and the dataset is that of one machine, bit for bit."""
    (tmp_path / "experiment.toml").write_text(to_toml(experiment))
    workers = [start_worker(start, scheduler) for _ in range(2)]
    words = ["faultgen.cli", "generate", "experiment.toml", "-o", "out"]
    words += ["--backend", "dask", "--scheduler", scheduler]
    sweep = start(*words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + HANG
    while not any(f".{workers[0].pid}.tmp" in path.name for path in tmp_path.glob("out/runs/.*")):
        assert time.monotonic() < deadline
        assert sweep.poll() is None, sweep.communicate()
        time.sleep(0.01)
    workers[0].kill()
    said, complained = sweep.communicate(timeout=HANG)
    assert sweep.returncode == 0, complained
    assert "7 runs, 7 made now" in said
    generate(experiment, tmp_path / "local", progress=False)
    assert contents(tmp_path / "out") == contents(tmp_path / "local")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("threads", "message"),
    [(0, "no Dask scheduler"), (2, "has 2 threads; start workers with")],
)
def test_clusters_that_cannot_be_used(request, start, experiment, tmp_path, threads, message):
    """One line says why, and nothing is made."""
    (tmp_path / "experiment.toml").write_text(to_toml(experiment))
    where = "tcp://127.0.0.1:1"
    if threads:
        where = request.getfixturevalue("scheduler")
        start_worker(start, where, threads)
    words = ["generate", "experiment.toml", "-o", "out", "--backend", "dask", "--scheduler", where]
    done = subprocess.run(
        command("faultgen.cli", *words), cwd=tmp_path, capture_output=True, text=True, timeout=HANG
    )
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert len(open_dataset(tmp_path / "out").missing) == 7
