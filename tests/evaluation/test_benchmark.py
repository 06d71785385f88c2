"""The standard comparison: its robots, its leader board and its page."""

import json

import mujoco
import numpy as np
import pytest
from sklearn.metrics import balanced_accuracy_score

from faultgen.applied import Applied
from faultgen.errors import InputError
from faultgen.evaluation import LabelledRun, Setting, benchmark
from faultgen.evaluation.baselines import (
    DETECTION_BASELINES,
    ISOLATION_BASELINES,
    AlwaysAnAlarm,
    AlwaysNone,
    AlwaysOneAxis,
    NeverAnAlarm,
)
from faultgen.evaluation.benchmark import deviating, estimate_benchmark, run_benchmark
from faultgen.evaluation.leader_board import benchmark_page, leaders
from faultgen.robot import load_robot


def rows(method, *cells):
    """Counted answers: severity, and right and total by worn axis, or of the healthy robots."""
    found = []
    for level, right, total in cells:
        row = {"robot": "arm", "task": "swing", "effect": "friction_wear" if level else "healthy"}
        row |= {"level": level, "method": method}
        if level:
            row |= {"right_by_axis": right, "total_by_axis": total}
            right, total = sum(right.values()), sum(total.values())
        found.append(row | {"right": right, "total": total})
    return found


TWO = {"2": 8, "5": 4}  # the axes that wear have different numbers of answers


@pytest.fixture
def result():
    """Two kinds of data; one method was left out of the harder one."""
    standard = [
        *rows("careful", (0.1, {"2": 4, "5": 3}, TWO), (0.15, {"2": 8, "5": 4}, TWO), (0.0, 9, 10)),
        *rows("none", (0.1, {"2": 0, "5": 0}, TWO), (0.15, {"2": 0, "5": 0}, TWO), (0.0, 10, 10)),
        *rows(
            "always 2", (0.1, {"2": 8, "5": 0}, TWO), (0.15, {"2": 8, "5": 0}, TWO), (0.0, 0, 10)
        ),
        *rows(
            "always 5", (0.1, {"2": 0, "5": 4}, TWO), (0.15, {"2": 0, "5": 4}, TWO), (0.0, 0, 10)
        ),
        *rows("perfect", (0.1, TWO, TWO), (0.15, TWO, TWO), (0.0, 10, 10)),
    ]
    harder = [
        *rows("careful", (0.1, {"2": 4, "5": 1}, TWO), (0.0, 10, 10)),
        *rows("none", (0.1, {"2": 0, "5": 0}, TWO), (0.0, 10, 10)),
        *rows("always 2", (0.1, {"2": 8, "5": 0}, TWO), (0.0, 0, 10)),
        *rows("always 5", (0.1, {"2": 0, "5": 4}, TWO), (0.0, 0, 10)),
    ]
    shared = {"runs_sha256": "ab", "runs": 9, "cycles": 90, "tested": 3, "left_out": {}}
    shared |= {"healthy_cycles": {"arm, swing": 48, "arm, weld": 32}}
    shared |= {"made_by": ["faultgen", "faultgen"]}
    sets = []
    for kind, split, found in (("standard", "run", standard), ("harder", "robot", harder)):
        alarms = [
            {k: v for k, v in row.items() if not k.endswith("_by_axis")}
            for row in found
            if row["method"] in ("careful", "none")
        ]
        sets.append(
            {"kind": kind, "name": kind, "split": split, "isolation": found, "detection": alarms}
            | shared
        )
    made = {"quick": True, "seed": 2026, "sets": sets}
    made["leaders"] = {what: leaders(made, what) for what in ("isolation", "detection")}
    return made


def test_answers_that_do_not_depend_on_the_data_score_nothing(result):
    """Always "none" and always the same axis, whichever it is; also as an alarm."""
    found = {row["method"]: row["score"] for row in result["leaders"]["isolation"]}
    for name in ("none", "always 2", "always 5"):
        assert found[name] == pytest.approx(0, abs=1e-12)
    alarms = {row["method"]: row["score"] for row in result["leaders"]["detection"]}
    assert alarms["none"] == 0


def test_the_score_is_the_balanced_accuracy_above_chance():
    """Of random answers, as scikit-learn computes it from the answers themselves."""
    rng = np.random.default_rng(5)
    truth = rng.choice([0, 2, 3, 6], size=200)
    named = np.where(rng.random(200) < 0.4, truth, rng.choice([0, 1, 2, 3, 6], size=200))
    axes = [str(axis) for axis in (2, 3, 6)]
    right = {a: int(np.sum((truth == int(a)) & (named == int(a)))) for a in axes}
    total = {a: int(np.sum(truth == int(a))) for a in axes}
    healthy = (int(np.sum((truth == 0) & (named == 0))), int(np.sum(truth == 0)))
    told = rows("random", (0.1, right, total), (0.0, *healthy))
    (row,) = leaders({"sets": [{"kind": "standard", "isolation": told}]}, "isolation")
    with pytest.warns(UserWarning, match="y_pred contains classes not in y_true"):
        expected = balanced_accuracy_score(truth, named, adjusted=True)
    assert row["score"] == pytest.approx(expected)


def test_methods_are_ranked_by_the_mean_score_of_the_kinds_of_data(result):
    """Each axis has the same weight; where a method was left out, it counts as "none"."""
    found = {row["method"]: row for row in result["leaders"]["isolation"]}
    assert list(found)[:2] == ["careful", "perfect"]
    standard = (12 / 16 + 7 / 8) / 2 - 0.1 / 2
    assert found["careful"]["score"] == pytest.approx((standard + (4 / 8 + 1 / 4) / 2) / 2)
    assert found["perfect"]["score"] == pytest.approx((1 + 0) / 2)
    worn = found["careful"]["standard worn"]
    assert (worn["right"], worn["total"]) == (19, 24) and worn["low"] < 19 / 24 < worn["high"]
    assert found["perfect"]["harder worn"] is None


def test_detectors_are_ranked_by_youdens_index(result):
    """Share of worn robots with an alarm minus that of healthy ones, mean of both kinds."""
    best = result["leaders"]["detection"][0]
    assert best["method"] == "careful"
    assert best["score"] == pytest.approx((19 / 24 - 1 / 10 + 5 / 12) / 2)


def test_baselines_answer_without_looking():
    """The isolators' answers and the detectors' alarms are the same for any features."""
    setting = Setting(n_axes=6)
    seen = np.random.default_rng(0).normal(size=7)
    assert AlwaysNone(setting).isolate(seen) == -1
    one = AlwaysOneAxis(setting)
    labelled = [
        LabelledRun(features={}, severity=np.ones(3), axes=axes, effect="friction_wear")
        for axes in ((), (4,), (2,))
    ]
    one.learn(labelled)
    assert one.isolate(seen) == 2
    with pytest.raises(ValueError, match="no training run is worn"):
        one.learn(labelled[:1])
    for kind, alarm in ((NeverAnAlarm, False), (AlwaysAnAlarm, True)):
        detector = kind(setting)
        assert (detector.score(seen) > detector.limit_).tolist() == [alarm] * 7


def test_the_page_shows_every_method_with_intervals(result):
    page = benchmark_page(result)
    board = page.split("## Leader board: which axis is worn?")[1].split("##")[0]
    for name, shown in (("careful", "| 56.9 "), ("always 2", "| 0.0 "), ("perfect", "left out")):
        (line,) = [line for line in board.splitlines() if f"| {name} " in line]
        assert shown in line
    assert "79.2 [59.5, 90.8]" in board
    assert "learn from 32 to 48 healthy cycles" in page
    assert "--quick" in page and "'careful' has the highest score: 56.9" in page


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
    for what, baselines in (
        ("isolation", ISOLATION_BASELINES),
        ("detection", DETECTION_BASELINES),
    ):
        scores = {row["method"]: row["score"] for row in found["leaders"][what]}
        assert [scores[one.name] for one in baselines] == [0, 0]
    assert {one["split"] for one in found["sets"]} == {"run", "robot"}
    assert "# Benchmark" in (tmp_path / "benchmark.md").read_text()
    assert run_benchmark(tmp_path, quick=True, progress=False) == found
