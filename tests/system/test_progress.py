"""Progress is counted in any process, and told with rate and time left."""

import os
import re
import subprocess
import sys
import tempfile

import pytest
from conftest import faultgen
from joblib import delayed

from faultgen.system import progress
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import Progress, clock, follow, line
from faultgen.system.terminal import LOGGER, print_messages


@pytest.fixture
def at_once(monkeypatch):
    """Lines begin at once, not after five seconds."""
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.setattr(progress, "FIRST_LINE", 0.0)


@pytest.fixture(autouse=True)
def printed(monkeypatch):
    """Messages are printed, as by a command."""
    monkeypatch.setattr(LOGGER, "handlers", [])
    monkeypatch.setattr(LOGGER, "propagate", True)
    level = LOGGER.level
    print_messages()
    yield
    LOGGER.setLevel(level)


def count(counter, steps):
    for _ in range(steps):
        counter()
    return steps


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_steps_of_all_workers_are_counted(workers, at_once, capsys):
    """The last line states all steps, whoever made them."""
    with Progress("working", 60, "step") as shown:
        calls = [delayed(count)(shown.counter, 20) for _ in range(3)]
        assert sum(in_parallel(calls, workers)) == 60
    told = capsys.readouterr().err
    assert re.search(r"^faultgen: working: done, 60 steps in \d+:\d\d$", told, re.MULTILINE), told


def wait_for_line(capsys, shown):
    """Wait until the thread has printed, however busy the machine is."""
    while not (told := capsys.readouterr().err):
        pass
    print(told, file=sys.stderr, end="")


def test_short_work_is_silent(monkeypatch, capsys):
    """Nothing is printed before the first line is due."""
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.setattr(progress, "FIRST_LINE", 1e9)
    assert list(follow(iter("abc"), "reading", 3, "letter")) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("off", ["argument", "variable"])
def test_it_can_be_turned_off(off, at_once, monkeypatch, capsys):
    if off == "variable":
        monkeypatch.setenv("TQDM_DISABLE", "1")
    with Progress("working", 3, "step", shown=off != "argument") as shown:
        shown.counter(3)
    assert capsys.readouterr().err == ""


def test_a_failure_ends_the_display(at_once, capsys):
    """The error comes through, nothing claims to be done, and no file is left."""
    with pytest.raises(ValueError, match="broken"), Progress("working", 3) as shown:
        wait_for_line(capsys, shown)
        raise ValueError("broken")
    assert "done" not in capsys.readouterr().err
    shown.counter()  # a late worker does no harm


def test_work_goes_on_without_a_place_to_count(at_once, monkeypatch, capsys):
    """A full disk must not stop work whose progress is counted there."""

    def full(**_):
        raise OSError("No space left on device")

    monkeypatch.setattr(tempfile, "mkstemp", full)
    assert list(follow(iter("abc"), "reading", 3, "letter")) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""
    assert os.path.exists(os.devnull)


def test_a_line_tells_rate_and_time_left():
    assert line("simulating", 50, 200, "cycle", 10) == (
        "simulating: 50 of 200 cycles (25 %), 5 cycles/s, 0:30 left"
    )
    assert line("fitting", 2, 10, "model", 60) == (
        "fitting: 2 of 10 models (20 %), 30 s/model, 4:00 left"
    )
    assert line("fitting", 0, 10, "model", 7) == "fitting: 0 of 10 models (0 %), 0:07 so far"
    assert line("choosing", 0, None, "", 65) == "choosing: 1:05 so far"
    assert clock(7265) == "2:01:05"


@pytest.mark.slow
def test_commands_show_it(tiny_robot_path, tiny_task_path, tmp_path):
    """`generate` with two workers, whose first line would come after five seconds."""
    code = "from faultgen.system import progress; progress.FIRST_LINE = 0.0; "
    code += "from faultgen.cli import main; main()"
    flags = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--cycles", "12"]
    variables = {name: v for name, v in os.environ.items() if name != "TQDM_DISABLE"}
    done = subprocess.run(
        [sys.executable, "-c", code, "generate", *flags, "--workers", "2", "-o", tmp_path / "out"],
        env=variables,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "faultgen: simulating: done, 36 cycles in " in done.stderr
    assert faultgen("isolate", tmp_path / "out", "--seeds", "2").stderr == ""
