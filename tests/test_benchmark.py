"""The standard comparison: its robots, its leader board and its page."""

import json

import mujoco
import numpy as np
import pytest

from faultgen.applied import Applied
from faultgen.errors import InputError
from faultgen.evaluation import benchmark
from faultgen.evaluation.benchmark import deviating, estimate_benchmark, run_benchmark
from faultgen.evaluation.leader_board import benchmark_page, leaders
from faultgen.robot import load_robot


def rows(method, *cells):
    """Counted answers: (severity, right, total)."""
    return [
        {"robot": "arm", "task": "swing", "effect": "friction_wear" if level else "healthy"}
        | {"level": level, "method": method, "right": right, "total": total}
        for level, right, total in cells
    ]


@pytest.fixture
def result():
    """Two kinds of data; one method was left out of the harder one."""
    standard = [
        *rows("careful", (0.1, 6, 10), (0.15, 10, 10), (0.0, 10, 10)),
        *rows("always", (0.1, 10, 10), (0.15, 10, 10), (0.0, 0, 10)),
        *rows("half", (0.1, 10, 10), (0.15, 10, 10), (0.0, 10, 10)),
    ]
    harder = [
        *rows("careful", (0.1, 5, 10), (0.0, 9, 10)),
        *rows("always", (0.1, 10, 10), (0.0, 0, 10)),
    ]
    shared = {"runs_sha256": "ab", "runs": 9, "cycles": 90, "tested": 3, "left_out": {}}
    shared |= {"made_by": ["faultgen", "faultgen"]}
    sets = [
        {"kind": kind, "name": kind, "split": split, "isolation": found, "detection": found}
        | shared
        for kind, split, found in (("standard", "run", standard), ("harder", "robot", harder))
    ]
    made = {"quick": True, "seed": 2026, "sets": sets}
    made["leaders"] = {what: leaders(made, what) for what in ("isolation", "detection")}
    return made


def test_methods_are_ranked_by_the_mean_of_four_shares(result):
    """One that always names an axis has half; one that was left out has nothing there."""
    found = {row["method"]: row for row in result["leaders"]["isolation"]}
    assert list(found) == ["careful", "always", "half"]
    assert found["careful"]["score"] == pytest.approx((0.8 + 1.0 + 0.5 + 0.9) / 4)
    assert found["always"]["score"] == found["half"]["score"] == pytest.approx(0.5)
    worn = found["careful"]["standard worn"]
    assert (worn["right"], worn["total"]) == (16, 20) and worn["low"] < 0.8 < worn["high"]
    assert found["half"]["harder worn"] is None


def test_the_page_shows_every_method_with_intervals(result):
    page = benchmark_page(result)
    board = page.split("## Leader board: which axis is worn?")[1].split("##")[0]
    for name, shown in (("careful", "| 80.0 "), ("always", "50.0"), ("half", "left out")):
        (line,) = [line for line in board.splitlines() if f"| {name} " in line]
        assert shown in line
    assert "80.0 [58.4, 91.9]" in board
    assert "--quick" in page and "'careful' has the highest score: 80.0" in page


def test_robots_of_one_model_differ_as_they_should():
    """The deviation is in the file: 10 % more Coulomb friction, and no other joint or actuator."""
    text = deviating("puma560", [Applied("rotor_inertia", 2, 0.5)])
    nominal, other = load_robot("puma560").model, mujoco.MjModel.from_xml_string(text)
    assert nominal.nbody == other.nbody
    rotor = mujoco.mj_name2id(nominal, mujoco.mjtObj.mjOBJ_JOINT, "motor2")
    body = nominal.jnt_bodyid[rotor]
    changed = ~np.isclose(nominal.body_inertia, other.body_inertia).all(axis=1)
    dofs = ~np.isclose(nominal.dof_armature, other.dof_armature)
    assert set(np.flatnonzero(changed)) <= {body}
    assert changed.any() or list(np.flatnonzero(dofs)) == [nominal.jnt_dofadr[rotor]]
    assert deviating("puma560", []) == deviating("puma560", [])


def test_what_is_no_method_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(InputError, match="must be a subclass of"):
        run_benchmark(tmp_path / "out", methods=[dict], progress=False)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_small_benchmark_runs_from_end_to_end(tmp_path, monkeypatch):
    """Every isolator and the forest have a row; a second call uses the data again."""
    size = benchmark.Size(
        axes=(2,),
        cycles=14,
        repetitions=4,
        instances=2,
        hard_robots=("puma560",),
        hard_repetitions=4,
        effects={"friction_wear": [0.2], "backlash": [0.002]},
    )
    monkeypatch.setattr(benchmark, "QUICK", size)
    monkeypatch.setattr(benchmark, "ROBOTS", ("puma560",))
    monkeypatch.setattr(benchmark, "TASKS", ("spot_weld",))
    told = estimate_benchmark(quick=True, workers=2, progress=False)
    assert not list(tmp_path.iterdir())
    found = run_benchmark(tmp_path, quick=True, workers=2, progress=False)
    assert (told.runs, told.cycles) == tuple(
        sum(one[what] for one in found["sets"]) for what in ("runs", "cycles")
    )
    assert found == json.loads((tmp_path / "benchmark.json").read_text())
    names = [row["method"] for row in found["leaders"]["isolation"]]
    assert "random forest" in names and "friction residual" in names
    assert {one["split"] for one in found["sets"]} == {"run", "robot"}
    assert "# Benchmark" in (tmp_path / "benchmark.md").read_text()
    assert run_benchmark(tmp_path, quick=True, progress=False) == found
