import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import h5py
import pytest
from conftest import HANG, faultgen, faultgen_here

from faultgen.effects import EFFECTS
from faultgen.robot import load_robot, robot_names
from faultgen.tasks import task_names

COMMANDS = [
    "demo",
    "robots",
    "tasks",
    "effects",
    "generate",
    "info",
    "isolate",
    "report",
    "view",
    "explore",
]


def test_the_package_runs_as_the_command():
    command = [sys.executable, "-m", "faultgen", "--version"]
    own = subprocess.run(command, capture_output=True, text=True, timeout=HANG)
    assert own.returncode == 0 and own.stdout == faultgen("--version").stdout


def flags(tiny_robot_path, tiny_task_path, out, **changes):
    """Flags of a cheap dataset."""
    chosen = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": "1,2", "cycles": 12}
    parts = [
        str(part) for name, value in (chosen | changes).items() for part in (f"--{name}", value)
    ]
    return ["generate", *parts, "--workers", "1", "-o", str(out)]


@pytest.fixture(scope="module")
def dataset(tiny_robot_path, tiny_task_path, tmp_path_factory):
    out = tmp_path_factory.mktemp("cli") / "out"
    done = faultgen(*flags(tiny_robot_path, tiny_task_path, out, severity=0.2), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["done"] == 3
    return out


def test_every_command_teaches():
    """--help lists the commands, and that of each says what it does and takes."""
    overview = faultgen_here("--help").stdout
    for command in COMMANDS:
        assert re.search(rf"^  {command} ", overview, re.MULTILINE), command
        text = faultgen_here(command, "--help").stdout
        assert "--json" in text
        assert len(text.splitlines()) > 5


def test_lists_are_json_too():
    """robots, tasks and effects print the same as a table and as JSON."""
    robots = json.loads(faultgen_here("robots", "--json").stdout)
    axes = [(row["robot"], row["axis"]) for row in robots]
    known = {name: load_robot(name).n_axes for name in robot_names()}
    assert axes == [(name, axis) for name, n in known.items() for axis in range(1, n + 1)]
    effects = json.loads(faultgen_here("effects", "--json").stdout)
    assert [row["effect"] for row in effects] == list(EFFECTS)
    (ripple,) = (row for row in effects if row["effect"] == "torque_ripple")
    assert ripple["parameters"] == {"order": 2.0, "phase": 0.0, "per": "motor"}
    text = faultgen_here("effects").stdout
    assert "friction_wear" in text
    assert "order = 2.0, phase = 0.0, per = motor" in text
    tasks = json.loads(faultgen_here("tasks", "--json").stdout)
    assert [(row["robot"], row["task"]) for row in tasks] == [
        (name, task) for name in known for task in task_names(name)
    ]
    assert "chapter3_task1" in faultgen_here("tasks").stdout


def test_generate_again_keeps_what_is_there(tiny_robot_path, tiny_task_path, dataset):
    """The same command resumes: it makes nothing twice."""
    again = faultgen_here(*flags(tiny_robot_path, tiny_task_path, dataset, severity=0.2))
    assert again.returncode == 0
    assert "3 runs, 0 made now, 3 already present, 0 failed" in again.stdout


def test_severities_and_pairing_by_flags(tiny_robot_path, tiny_task_path, tmp_path):
    """A severity for each effect; one seed for all runs of a repetition where that is asked for."""
    severity = "backlash=0.001,0.002,encoder_offset=0.02"
    chosen = {"effect": "backlash,encoder_offset", "severity": severity, "axis": 1, "cycles": 1}
    arguments = flags(tiny_robot_path, tiny_task_path, tmp_path, **chosen)
    assert faultgen_here(*arguments, "--paired").returncode == 0
    runs = json.loads((tmp_path / "runs.json").read_text())["runs"].values()
    assert [(run["effect"], run["severity"]) for run in runs] == [
        ("healthy", 0.0),
        ("backlash", 0.001),
        ("backlash", 0.002),
        ("encoder_offset", 0.02),
    ]
    assert {run["seed"] for run in runs} == {0}


def test_info_tells_what_is_there(dataset):
    """A whole dataset is complete and intact, in words and in JSON."""
    said = json.loads(faultgen_here("info", dataset, "--json").stdout)
    assert said["complete"]
    assert said["intact"]
    assert [row["axes"] for row in said["runs"]] == ["-", "1", "2"]
    told = faultgen_here("info", dataset)
    assert told.returncode == 0
    assert "complete and intact" in told.stdout


def test_info_puts_many_runs_together(dataset, tmp_path, monkeypatch):
    """Runs that differ in their seeds only are one row; a run that is missing has a row as well."""
    monkeypatch.setattr("faultgen.cli.info.MOST_ROWS", 2)
    told = re.sub(" +", " ", faultgen_here("info", dataset).stdout)
    assert "friction_wear 2 0.2 12 none 1 1 ok" in told
    assert "--json lists every run" in told
    folder = Path(shutil.copytree(dataset, tmp_path / "copy"))
    lost = sorted((folder / "runs").glob("*.h5"))[0]
    lost.unlink()
    told = re.sub(" +", " ", faultgen_here("info", folder).stdout)
    assert "1 1 missing" in told
    assert re.search(rf"{lost.stem}.* missing", told)


def test_info_tells_of_damage(tiny_robot_path, tiny_task_path, tmp_path):
    """A truncated and a missing run are named, and the exit status is 1."""
    faultgen_here(*flags(tiny_robot_path, tiny_task_path, tmp_path, cycles=2))
    lost, cut, _ = sorted((tmp_path / "runs").glob("*.h5"))
    lost.unlink()
    cut.write_bytes(cut.read_bytes()[:-7])
    told = faultgen_here("info", tmp_path)
    assert told.returncode == 1
    assert f"damaged: runs/{cut.name}: differs from its checksum" in told.stdout
    assert re.search(rf"{lost.stem}.*missing", told.stdout)
    isolated = faultgen_here("isolate", tmp_path)
    assert isolated.returncode == 2
    said = (
        r"faultgen: .*: 1 of 3 runs are missing, and the result is about the others; .*\n"
        rf"faultgen: .*{cut.name}: damaged .differs from its checksum.*\n"
    )
    assert re.fullmatch(said, isolated.stderr), isolated.stderr


@pytest.mark.slow
def test_isolate_prints_the_form_of_table_6_2(dataset):
    """A table for a robot and task: method x wear, and what is named on the healthy robot."""
    text = re.sub(" +", " ", faultgen_here("isolate", dataset, "--seeds", "3").stdout)
    assert "**tiny, swing, friction_wear**" in text
    levels = " | ".join(f"{wear} % (n = 6)" for wear in ("1", "5", "10", "15"))
    assert f"| method \\ severity | {levels} | healthy (n = 3) |" in text
    assert "| TE 5 bins |" in text
    rows = json.loads(faultgen_here("isolate", dataset, "--seeds", "3", "--json").stdout)["results"]
    row = next(r for r in rows if r["level"] == 0.15 and r["method"] == "TE 5 bins")
    assert row["total"] == 6  # two worn axes, three draws
    assert 0 <= row["low"] <= row["accuracy"] <= row["high"] <= 1


def test_report_is_one_page(dataset):
    """report.html needs no other file."""
    done = faultgen_here("report", dataset)
    assert done.returncode == 0, done.stderr
    page = Path(done.stdout.strip()).read_text()
    assert len(page) < 5_000_000
    assert page.count('id="library"') == 1
    code = re.sub(r'id="library">[^<]*<', "", page)  # compressed, so any four letters may occur
    assert "http" not in code.replace("http-equiv", "")
    titles = re.findall("<h4>(.*?)</h4>", page)
    assert titles[:5] == [
        "Severity of friction_wear by axis and cycle",
        "Motor torque over a cycle",
        "Friction against speed",
        "Path of the tool",
        "Spectrum of the motor torque",
    ]
    charts = page.count('<figure class="chart"')
    assert page.count('role="img" aria-label="') == charts == len(titles) - 1 > 6
    assert page.count("<figcaption>") == len(titles) + page.count('<figure class="robot"')
    assert page.count('<figure class="robot"') == 1
    assert re.search("<td><abbr title=[^>]*>TE 10 bins</abbr></td>", page)


BAD = {
    "an unknown robot": ({"robot": "r2d2"}, r"unknown robot 'r2d2': choose irb6700, puma560"),
    "axis 7": ({"robot": "puma560", "task": "pick_and_place", "axis": 7}, r"axis 7: .* 1 to 6"),
    "no number": ({"axis": "one"}, r"axis 'one': give numbers"),
    "severity -5": ({"severity": -5}, r"severity: .*greater than or equal to 0, not -5"),
    "severity x": ({"severity": "x"}, r"severity 'x': give numbers"),
    "cycles 0": ({"cycles": 0}, r"cycles: .*greater than or equal to 1, not 0"),
    "cycles x": ({"cycles": "many"}, r".*'--cycles': it must be a whole number"),
    "an unknown schedule": ({"schedule": "sudden"}, r"unknown schedule 'sudden'"),
    "two units": (
        {"effect": "backlash,friction_wear", "severity": 0.01},
        r"severity: effects of different units .*--severity backlash=0.0003,friction_wear=0.2",
    ),
    "0.2 rad of play": (
        {"effect": "backlash", "severity": 0.2},
        r"severity: backlash must be at most",
    ),
    "a nameless severity": ({"severity": "0.1,delay=0.01"}, r"severity '.*': give numbers such as"),
    "a huge seed": ({"seed": 18446744073709551616}, r"seed: must be at most 9223372036854775807"),
    "an unknown option": ({"colour": "red"}, r"No such option: --colour"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_flags_get_one_line(tiny_robot_path, tiny_task_path, tmp_path, case):
    """One clear line on stderr, exit status 2, nothing written."""
    changes, message = BAD[case]
    done = faultgen_here(*flags(tiny_robot_path, tiny_task_path, tmp_path / "out", **changes))
    assert done.returncode == 2, done.stderr
    assert re.fullmatch(rf"faultgen: .*{message}.*\n", done.stderr), done.stderr
    assert done.stdout == ""
    assert not (tmp_path / "out").exists()


def test_bad_files_and_folders_get_one_line(tmp_path):
    """A broken TOML, a missing file, no dataset, an unwritable folder, flags beside a file."""
    broken = tmp_path / "broken.toml"
    broken.write_text("robot = [")
    good = tmp_path / "good.toml"
    good.write_text('robot = "puma560"\ntask = "pick_and_place"\n')
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where a folder should be")
    foreign = tmp_path / "foreign.h5"
    h5py.File(foreign, "w").close()
    out = tmp_path / "out"
    for arguments, message in (
        (["generate", broken, "-o", out], "broken.toml: not valid TOML"),
        (["generate", tmp_path / "no.toml", "-o", out], "no.toml: cannot be read"),
        (["generate", good, "-o", blocked], "blocked: is a file, not a folder"),
        (["generate", good, "--cycles", "3", "-o", out], "file or flags, not both: --cycles"),
        (["generate", "--robot", "puma560", "-o", out], "--task is missing"),
        (["generate", good, "--workers", "0", "-o", out], "workers: must be at least 1, not 0"),
        (["generate", good, "--workers", "99999", "-o", out], "workers: must be at most 1024"),
        (["generate", "/dev/zero", "-o", out], "/dev/zero: cannot be read (not a regular file)"),
        (["generate", good, "--paired", "-o", out], "file or flags, not both: --paired"),
        (["info", tmp_path], "is not a dataset"),
        (["isolate", tmp_path / "nowhere"], "nowhere: no such file or folder"),
        (["report", tmp_path], "is not a dataset"),
        (["info", broken], "broken.toml: is not a file of a dataset, because it is no HDF5 file"),
        (["isolate", foreign], "foreign.h5: has no checksum beside it (foreign.h5.sha256)"),
        (["export", tmp_path / "no.h5", "-o", out], "no.h5: no such file"),
        (["export", tmp_path, "-o", out], "is a folder; give the file"),
        (["fly"], "No such command 'fly'"),
        (["info"], "Missing argument 'folder'"),
    ):
        done = faultgen_here(*arguments)
        assert done.returncode == 2, (arguments, done.stderr)
        assert re.fullmatch(rf"faultgen: .*{re.escape(message)}.*\n", done.stderr), done.stderr


@pytest.mark.parametrize(
    "command",
    ["demo", "robot build arm.urdf", "export x.h5", "import x.csv", "twin x.h5 --robot puma560"],
)
def test_an_empty_path_is_not_the_current_folder(command, tmp_path):
    done = faultgen_here(*command.split(), "-o", "", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.endswith("is empty; give a path, or . for the current folder\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command",
    [
        "generate --robot puma560 --task spot_weld",
        "study isolation",
        "twin x.h5 --robot puma560",
    ],
)
def test_a_negative_seed_is_refused_in_the_same_words(command, tmp_path):
    done = faultgen_here(*command.split(), "--seed", "-1", "-o", "out", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "faultgen: seed: must be at least 0, not -1\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_read_only_folders_are_refused(tmp_path):
    """A folder without write permission is named."""
    tmp_path.chmod(0o500)
    done = faultgen_here(
        "generate", "--robot", "puma560", "--task", "pick_and_place", "-o", tmp_path
    )
    assert done.returncode == 2
    assert "cannot be written" in done.stderr


def test_ctrl_c_stops_cleanly(tmp_path):
    """One line, exit status 130, no half-written run; the same command goes on."""
    command = [sys.executable, "-m", "faultgen.cli", "generate", "--robot", "puma560"]
    command += ["--task", "pick_and_place", "--cycles", "2000", "--workers", "2"]
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "out")],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
        # a shell starts background jobs so that they ignore Ctrl-C, and their children inherit this
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    # However long the start takes, the runs are under way once a file is begun
    while not list(tmp_path.glob("out/runs/.*.tmp")):
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=HANG)
    assert process.returncode == 130
    assert said == "faultgen: interrupted; run the same command again to continue\n"
    assert not list(tmp_path.glob("out/runs/*.h5"))


@pytest.mark.parametrize(
    ("old", "new"), [(["--width", "3"], "--prior-scale"), (["--steady"], "--white-noise")]
)
def test_a_renamed_option_is_refused_with_its_new_name(old, new, tmp_path):
    done = faultgen_here("discover", tmp_path / "x.h5", "--robot", "puma560", *old)
    assert done.returncode == 2
    assert done.stderr.strip().endswith(f"No such option: {old[0]}; it is now called {new}")
