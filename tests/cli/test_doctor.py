"""The command that says whether a machine is fit, and completion in the shell."""

import json
import os
import re
import subprocess
import sys
from collections import namedtuple

import pytest
from conftest import HANG

from faultgen.cli import app
from faultgen.simulation import stepping
from faultgen.system import machine


def told(capsys, *arguments):
    """Exit status of the command and its checks by what they check."""
    status = app(["doctor", "--json", *arguments], standalone_mode=False)
    result = json.loads(capsys.readouterr().out)
    assert result["fit"] == (not status) == all(one["fit"] for one in result["checks"])
    return status or 0, {one["what"]: one for one in result["checks"]}


def test_a_machine_that_runs_the_tests_is_fit(capsys):
    """Versions are those that are installed; a second is simulated and its speed told."""
    status, checks = told(capsys)
    assert status == 0
    assert checks["mujoco"]["found"] == machine.installed("mujoco")
    assert {"numpy", "scipy", "h5py", "typer"} <= checks.keys()
    assert "bibmon" not in checks and "rosbags" not in checks  # extras are optional
    found = checks["one second of simulation"]["found"]
    assert re.fullmatch(r"[\d.]+ s, [\d.]+ times as fast as the robot", found)


def fails(*_, **__):
    raise RuntimeError("no such\nlibrary")


@pytest.mark.parametrize(
    ("place", "name", "value", "what", "remedy"),
    [
        (machine, "memory", lambda: 0.5, "memory", "use a machine with 2 GiB"),
        (machine, "free_disk", lambda folder: 0.1, "free disk here", "free 1 GiB"),
        (
            machine,
            "packages",
            lambda: [machine.Package("numpy", "1.26.4", ">=2.0")],
            "numpy",
            "pip install 'numpy>=2.0'",
        ),
        (
            machine,
            "packages",
            lambda: [machine.Package("nosuch", None, "")],
            "nosuch",
            "pip install 'nosuch'",
        ),
        (machine, "python_is_fit", lambda oldest: False, "Python", "install Python 3.11 or newer"),
        (stepping, "simulate", fails, "one second of simulation", "install faultgen anew"),
    ],
)
def test_what_is_not_fit_is_told_with_its_remedy(
    monkeypatch, capsys, place, name, value, what, remedy
):
    """The exit status is 1, and everything else is still checked."""
    monkeypatch.setattr(place, name, value)
    status, checks = told(capsys)
    assert status == 1
    assert [one["what"] for one in checks.values() if not one["fit"]] == [what]
    assert checks[what]["remedy"] == remedy
    assert "\n" not in checks[what]["found"]


def test_what_the_system_does_not_tell_is_no_failure(monkeypatch, capsys):
    """Memory is unknown on some systems, and a GPU is not needed."""
    monkeypatch.setattr(machine, "memory", lambda: None)
    monkeypatch.setattr(machine, "gpu", lambda: None)
    status, checks = told(capsys)
    assert status == 0
    assert checks["memory"]["found"] == "unknown"
    assert checks["GPU (not needed)"]["found"] == "none"


def test_gpus_are_those_that_the_driver_lists(monkeypatch):
    """A driver that fails, or is not there, means none."""
    done = namedtuple("Done", "stdout returncode")
    monkeypatch.setattr(machine.shutil, "which", lambda name: f"/usr/bin/{name}")
    for answer, wanted in (
        (done("NVIDIA H100\nNVIDIA H100\n", 0), "NVIDIA H100, NVIDIA H100"),
        (done("No devices were found", 6), None),
        (done("\n", 0), None),
    ):
        monkeypatch.setattr(machine.subprocess, "run", lambda *_, answer=answer, **__: answer)
        assert machine.gpu() == wanted
    monkeypatch.setattr(machine.shutil, "which", lambda name: None)
    assert machine.gpu() is None


def test_the_shell_completes_commands():
    """As the shell asks after its completion was installed."""
    asked = {"_FAULTGEN_COMPLETE": "complete_bash", "COMP_WORDS": "faultgen do", "COMP_CWORD": "1"}
    code = "import sys; sys.argv[0] = 'faultgen'; from faultgen.cli import main; main()"
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, env=os.environ | asked, capture_output=True, text=True, timeout=HANG
    )
    assert done.stdout.split() == ["doctor"], done.stderr
