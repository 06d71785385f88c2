"""Sweeps on disks that fail: nothing is lost, nothing is silent, and the same command goes on."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1] / "faults"
ENOSPC, EIO = 28, 5
LINE = r"faultgen: [^\n]*\n"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="faults are injected on Linux only")


@pytest.fixture(scope="session")
def arguments(tiny_robot_path, tiny_task_path):
    """A cheap sweep of two runs."""
    robot = ["--robot", tiny_robot_path, "--task", tiny_task_path]
    return ["generate", *robot, "--axis", "1", "--cycles", "2", "--workers", "1"]


@pytest.fixture(scope="session")
def shim(tmp_path_factory):
    """The library that lets system calls fail."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler for the library that lets system calls fail")
    library = tmp_path_factory.mktemp("shim") / "shim.so"
    options = ["-shared", "-fPIC", "-O1", "-o", str(library), str(HERE / "shim.c"), "-ldl"]
    subprocess.run([compiler, *options], check=True)
    return library


@pytest.fixture(scope="session")
def inject(shim, arguments, tmp_path_factory):
    """Function that runs the sweep with one fault after another."""

    def run(kind, error, start, step, *more):
        where = tmp_path_factory.mktemp(kind)
        told = [str(v) for v in (where, kind, error, start, step)]
        command = [sys.executable, str(HERE / "driver.py"), *told, "--", *arguments, *more]
        environment = {"LD_PRELOAD": str(shim), "PATH": "/usr/bin:/bin"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return [json.loads(line) for line in done.stdout.splitlines()]

    return run


def check(cases):
    """Whatever failed was reported in one line, and resuming gives the bytes of a good disk."""
    intact = cases[-1]["sums_again"]
    assert cases[-1]["status"] == 0, cases[-1]["err"]
    assert sum(case["failed"] for case in cases) >= 2
    for case in cases:
        assert case["status"] in (0, 1 << 8, 2 << 8), (case["number"], case["err"])
        if case["status"]:
            assert re.fullmatch(LINE, case["err"]), (case["number"], case["err"])
        else:  # done: then all of it is there
            assert case["sums"] == intact, case["number"]
        reported = [name for name in case["sums"] if re.fullmatch(r"runs/\w+\.h5", name)]
        assert all(case["sums"][name] == intact[name] for name in reported), case["number"]
        blamed = re.search(r"/((?:runs/)?\w+\.h5): cannot be written", case["err"])
        if blamed:  # a file that is reported as failed is not there
            assert blamed[1] not in case["sums"], case["number"]
        assert case["again"] == 0, (case["number"], case["err"])
        assert case["sums_again"] == intact, case["number"]


FAST = {"write": 311, "sync": 9, "rename": 5, "close": 23, "open": 23, "truncate": 5}
FASTEST = "rename"


@pytest.mark.parametrize(
    "kind",
    [kind if kind == FASTEST else pytest.param(kind, marks=pytest.mark.slow) for kind in FAST],
)
def test_no_failing_call_loses_data(inject, kind):
    """A sample of the calls of each kind fails: what has a name is whole, the rest is resumed."""
    check(inject(kind, ENOSPC if kind in ("write", "truncate") else EIO, 1, FAST[kind]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", FAST)
def test_no_failing_call_loses_a_part(inject, kind):
    """The same for a part that keeps one file of all its runs, and removes their own files."""
    part = ["--repetitions", "2", "--part", "1/2", "--keep", "merged"]
    error = ENOSPC if kind in ("write", "truncate") else EIO
    check(inject(kind, error, 1, FAST[kind] // 2 + 1, *part))


@pytest.mark.slow
def test_a_full_disk_stops_the_sweep_with_one_line(inject):
    """From some write on, all writes fail: exit status 1, and the reason and the file are named."""
    cases = inject("write", ENOSPC, -40, -250)
    check(cases)
    for case in cases[:-1]:
        assert case["status"] == 1 << 8
        assert "cannot be written (No space left on device)" in case["err"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", FAST)
def test_no_failing_call_of_all_loses_data(inject, kind):
    """Every single call of each kind fails once."""
    check(inject(kind, ENOSPC if kind in ("write", "truncate") else EIO, 1, 1))


@pytest.mark.slow
def test_full_disks_are_reported_and_resumed(arguments, tmp_path):
    """On disks that are too small, or that another process fills and frees, nothing is lost."""
    disk = tmp_path / "disk"
    disk.mkdir()
    own_space = ["unshare", "--user", "--map-root-user", "--mount"]
    if shutil.which("unshare") is None or subprocess.run([*own_space, "true"]).returncode:
        pytest.skip("this system does not let a test mount a file system of its own")
    sizes = "8,40,80,160,240,0,0,0"
    command = [sys.executable, str(HERE / "full_disk.py"), str(disk), sizes, "--", *arguments]
    done = subprocess.run([*own_space, *command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    cases = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(cases) == len(sizes.split(","))
    intact = cases[0]["sums_again"]
    assert len(intact) > 5
    for case in cases:
        assert case["status"] in ((1 << 8,) if case["size"] else (0, 1 << 8)), case
        if case["status"]:
            assert re.fullmatch(LINE, case["err"]), case["err"]
            assert "No space left on device" in case["err"]
        else:
            assert case["sums"] == intact
        assert case["again"] == 0
        assert case["sums_again"] == intact
