"""`generate --dry-run` and the flags of `generate`."""

import json
import re

import pytest
from conftest import faultgen_here

from faultgen.dataset.estimate import estimate
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate


@pytest.fixture
def entries(tiny_robot_path, tiny_task_path):
    return {"robot": tiny_robot_path, "task": tiny_task_path, "cycles": 15}


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"sensors": "realistic", "effect": ["friction_wear", "torque_ripple"]},
        {"signals": "none"},
        {"schedule": [0.1, 0.2], "cycles": 2},
    ],
)
def test_size_and_runs_are_those_of_the_dataset(entries, more, tmp_path):
    """The size to within 15 %: it is extended from runs of one and three cycles."""
    experiment = make_experiment(entries | more)
    told = estimate(experiment, progress=False)
    made = generate(experiment, tmp_path / "out", progress=False)
    files = [path for path in (tmp_path / "out").rglob("*.h5")]
    assert told.runs == made.planned
    assert told.cycles == sum(int(run["cycles"]) for run in open_dataset(tmp_path / "out").runs)
    assert told.bytes == pytest.approx(sum(path.stat().st_size for path in files), rel=0.15)
    assert told.seconds > 0


def test_a_dry_run_writes_nothing(entries, tmp_path):
    flags = [part for name, value in entries.items() for part in (f"--{name}", value)]
    done = faultgen_here("generate", *flags, "--dry-run", "--workers", 1, "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.match(r"3 runs, 45 cycles; about \d+:\d\d", done.stdout), done.stdout
    assert list(tmp_path.iterdir()) == []
    done = faultgen_here("generate", *flags, "--dry-run", "--workers", 2, "--json", cwd=tmp_path)
    told = json.loads(done.stdout)
    assert (told["runs"], told["cycles"], told["workers"]) == (3, 45, 2)


@pytest.mark.slow
def test_flags_say_what_a_file_can_say(entries, tmp_path):
    """--signals and --no-healthy, as the entries signals and healthy."""
    flags = [part for name, value in entries.items() for part in (f"--{name}", value)]
    kept = "signals/motor_torque,truth/friction_torque"
    done = faultgen_here(
        "generate", *flags, "--no-healthy", "--signals", kept, "--paired", "-o", tmp_path / "out"
    )
    assert done.returncode == 0, done.stderr
    runs = open_dataset(tmp_path / "out").runs
    assert [run["axis"] for run in runs] == [1, 2]
    assert len({run["seed"] for run in runs}) == 1
    for run in runs:
        assert all(name in run for name in kept.split(","))
        assert "signals/motor_velocity" not in run
    done = faultgen_here("generate", *flags, "--signals", "torque", "-o", tmp_path / "other")
    assert done.returncode == 2 and "signals: unknown 'torque'" in done.stderr
