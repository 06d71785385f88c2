"""Folders of fleets: made, resumed and read, with records that are not simulated."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fake_fleet import fake_robot

from faultgen.dataset.manifest import is_fleet
from faultgen.errors import InputError, SimulationFailed
from faultgen.fleet import FleetPlan, generate_fleet, open_fleet
from faultgen.fleet import generate as module
from faultgen.fleet.data import STORED, fleet_state
from faultgen.fleet.events import event_names

PLAN = FleetPlan(robots=3, failing=1, days=4, models=["puma560"])


@pytest.fixture
def made(monkeypatch):
    """Numbers of the robots that were recorded; records are random, but those of their number."""
    numbers = []

    def record(plan, number):
        numbers.append(number)
        one = fake_robot(
            np.random.default_rng(number), f"robot{number + 1:03d}", number == 1, days=plan.days
        )
        one.truth["damage"] = np.linspace(0, 1, len(one.day))
        return one

    monkeypatch.setattr(module, "record_robot", record)
    return numbers


def test_a_fleet_is_what_was_recorded(made, tmp_path):
    """Names, labels, arrays and hidden truth, in the order of the numbers."""
    fleet = generate_fleet(PLAN, tmp_path)
    assert sorted(made) == [0, 1, 2]
    assert is_fleet(tmp_path)
    written = (tmp_path / "fleet.json").read_text()
    assert FleetPlan.model_validate_json(written) == PLAN and written.endswith("}\n")
    assert sorted(path.name for path in (tmp_path / "robots").iterdir()) == [
        "robot001.h5",
        "robot002.h5",
        "robot003.h5",
    ]
    assert (fleet.days, fleet.seed, fleet.event_names) == (4, PLAN.seed, event_names())
    for number, one in enumerate(fleet.robots):
        want = module.record_robot(PLAN, number)
        assert (one.name, one.robot) == (want.name, "puma560")
        assert (one.failed, one.axis) == (want.failed, want.axis)
        for name in STORED:
            np.testing.assert_array_equal(getattr(one, name), getattr(want, name), err_msg=name)
        assert set(one.truth) == {"damage"}
        np.testing.assert_array_equal(one.truth["damage"], want.truth["damage"])


def test_an_estimate_makes_one_robot_and_keeps_nothing(made, tmp_path, monkeypatch):
    """Two workers make three robots in two rounds."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(module.tempfile, "tempdir", None)
    now = iter([100.0, 107.0])
    monkeypatch.setattr(module.time, "perf_counter", lambda: next(now))
    seconds, size = module.estimate_fleet(PLAN, workers=2)
    assert made == [0] and seconds == 14.0
    assert list(tmp_path.iterdir()) == []
    fleet = tmp_path / "fleet"
    generate_fleet(PLAN, fleet)
    files = sum(path.stat().st_size for path in (fleet / "robots").iterdir())
    assert size == pytest.approx(files, rel=0.1)


def test_an_interrupted_fleet_is_finished(made, tmp_path):
    """Robots that are there and whole are kept, missing and damaged ones are made again."""
    generate_fleet(PLAN, tmp_path)
    first, second, third = sorted((tmp_path / "robots").iterdir())
    kept = first.stat().st_mtime_ns
    second.unlink()
    third.write_bytes(third.read_bytes()[:-100])
    made.clear()
    generate_fleet(PLAN, tmp_path)
    assert sorted(made) == [1, 2] and first.stat().st_mtime_ns == kept
    made.clear()
    assert len(generate_fleet(PLAN, tmp_path).robots) == 3 and made == []


def test_robots_of_an_older_version_are_not_mixed(made, tmp_path, monkeypatch):
    generate_fleet(PLAN, tmp_path)
    (tmp_path / "robots" / "robot003.h5").unlink()
    older = replace(module.provenance("faultgen.fleet.record"), code_sha256="0" * 64)
    monkeypatch.setattr(module, "provenance", lambda name: older)
    with pytest.raises(InputError, match="finish the fleet with that version"):
        generate_fleet(PLAN, tmp_path)


def test_a_robot_that_cannot_be_simulated_is_told(made, tmp_path, monkeypatch):
    """By its number; the files of the others are kept."""
    record = module.record_robot

    def diverging(plan, number):
        if number == 1:
            raise SimulationFailed("axis 3 diverged")
        return record(plan, number)

    monkeypatch.setattr(module, "record_robot", diverging)
    with pytest.raises(SimulationFailed, match="1 of 3 robots failed: robot 2: axis 3 diverged"):
        generate_fleet(PLAN, tmp_path)
    assert [row["state"] for row in fleet_state(tmp_path)] == ["ok", "missing", "ok"]
    with pytest.raises(InputError, match="only 2 of 3 robots are there; run 'faultgen fleet'"):
        open_fleet(tmp_path)
    monkeypatch.setattr(module, "record_robot", record)
    assert len(generate_fleet(PLAN, tmp_path).robots) == 3


def test_the_state_of_a_fleet_names_every_file(made, tmp_path):
    """What an intact robot is, and what is wrong with a damaged one."""
    fleet = generate_fleet(PLAN, tmp_path)
    paths = sorted((tmp_path / "robots").iterdir())
    paths[0].write_bytes(b"half")
    paths[2].unlink()
    damaged, intact, missing = fleet_state(tmp_path)
    assert damaged["name"] == "robot001" and "robot001.h5" in damaged["state"]
    assert (missing["name"], missing["state"]) == ("robot003", "missing")
    one = fleet.robots[1]
    assert intact == {
        "name": "robot002",
        "robot": "puma560",
        "failed": True,
        "axis": one.axis,
        "split": one.split,
        "samples": len(one.day),
        "state": "ok",
    }
    plan = tmp_path / "fleet.json"
    assert json.loads(plan.read_text())["robots"] == 3
    for text in ("{}", "[3]", "{"):
        plan.write_text(text)
        with pytest.raises(InputError, match=r"fleet\.json: damaged"):
            fleet_state(tmp_path)


def test_folders_that_are_no_fleet_are_refused(made, tmp_path):
    """An empty one, one of two plans, and one with the file of something else."""
    with pytest.raises(InputError, match="is not a fleet; make one with 'faultgen fleet"):
        open_fleet(tmp_path)
    assert not is_fleet(tmp_path)
    one, other = tmp_path / "one", tmp_path / "other"
    generate_fleet(PLAN, one)
    generate_fleet(PLAN.model_copy(update={"seed": 8}), other)
    (other / "robots" / "robot001.h5").replace(one / "robots" / "robot001.h5")
    with pytest.raises(InputError, match="made from different plans"):
        open_fleet(one)
    with pytest.raises(InputError, match="holds a fleet with another plan"):
        generate_fleet(PLAN, other)
