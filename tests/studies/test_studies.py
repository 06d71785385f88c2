"""Studies: their parts against cases counted by hand, and as a whole on a small robot."""

import json
import shutil

import numpy as np
import pytest
from faultgen.analysis.pca import PCAMonitor
from faultgen.analysis.run_length import ewma_width

import faultgen.studies.chapter3_detection.study as detection_study
import faultgen.studies.chapter6_isolation.study as isolation_study
from faultgen.cli import main
from faultgen.evaluation.isolators import FRICTION
from faultgen.monitoring.sensors import get_sensors
from faultgen.robot import STRIBECK_VELOCITY, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.surrogate import surrogate_file
from faultgen.studies.chapter3_detection.alarms import Scored, scores, separate_alarms, threshold
from faultgen.studies.chapter3_detection.detectors import (
    DETECTORS,
    ChartOfQ,
    DivergenceEWMA,
    Divergences,
)
from faultgen.studies.chapter3_detection.hourly_torque import hourly_monitored
from faultgen.studies.chapter3_detection.study import first_run, found
from faultgen.studies.chapter6_isolation.series import HEALTHY, PAIR, REFERENCE, WORN, Block, growth
from faultgen.studies.chapter6_isolation.tables import pooled
from faultgen.studies.chapter6_isolation.tables import tables as isolation_tables
from faultgen.studies.runner import STUDIES, run_study
from faultgen.tasks import load_task


def hours(*indices, length=100):
    over = np.zeros(length, bool)
    over[list(indices)] = True
    return over


def test_alarms_are_a_day_apart():
    """Hours over the threshold within a day of an alarm belong to it."""
    assert separate_alarms(hours()) == 0
    assert separate_alarms(hours(3, 4, 20, 26)) == 1
    assert separate_alarms(hours(3, 26, 27)) == 2
    assert separate_alarms(np.ones(100, bool)) == 5


def test_threshold_allows_what_it_says():
    """Just above the threshold there are as many alarms as allowed, below it more."""
    rng = np.random.default_rng(0)
    months = [rng.standard_normal(720) for _ in range(10)]
    for rate in (0.1, 1.0, 5.0):
        level = threshold(months, rate)
        assert sum(separate_alarms(m > level) for m in months) <= 10 * rate
        below = np.unique(np.concatenate(months))
        below = below[np.searchsorted(below, level) - 1]
        assert sum(separate_alarms(m > below) for m in months) > 10 * rate


def test_first_of_three_hours_in_a_row():
    """The hour counts in which the third one is seen."""
    assert first_run(hours(1, 2, 5, 6, 7, length=10), 3) == 7
    assert first_run(hours(1, 2, 4, 5, length=10), 3) is None


def test_an_alarm_counts_with_the_axis_it_blames():
    """Hours count from 1; the axis is the one blamed at the first alarm."""
    scored = Scored(score=np.array([0, 1, 5, 9.0]), axis=np.array([0, 1, 2, 3]))
    assert found(scored, 4.0, axis=3) == {"hours": 3, "located": True}
    assert found(scored, 0.5, axis=3) == {"hours": 2, "located": False}
    assert found(scored, 9.0, axis=3) == {"hours": None, "located": False}


PERIOD = 0.2
"""Between samples of the small robot, whose cycle takes two seconds: ten places [s]."""


@pytest.fixture(scope="module")
def cycles(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """Simulated cycles of the small robot."""
    folder = tmp_path_factory.mktemp("study") / "cycles"
    surrogate_file(folder, tiny_robot_path, tiny_task_path)
    surrogate_file(
        folder,
        tiny_robot_path,
        tiny_task_path,
        sample_period=PERIOD,
    )
    return folder


@pytest.fixture
def small(tiny_robot_path, tiny_task_path):
    """The small robot and its task, as options of a study."""
    return {"robots": (tiny_robot_path,), "tasks": (tiny_task_path,)}


SMALL = isolation_study.Size(reference=10, healthy=3, worn=1, pairs=1)


def isolated(cycles, small, folder, **more):
    shutil.copytree(cycles, folder / "cycles")
    return isolation_study.run_isolation(folder, size=SMALL, **small, **more)


@pytest.mark.slow
def test_isolation_study(cycles, small, tmp_path):
    """Counts add up, the best method names 10 % wear, and a second call gives the same again."""
    result = isolated(cycles, small, tmp_path, seed=1)
    worn = [row for row in result["isolation"] if row["method"] == FRICTION]
    assert {row["total"] for row in worn} == {2}
    assert all(row["share"] == 1 for row in worn if row["level"] >= 0.10)
    pairs = [row for row in result["pairs"] if row["method"] == FRICTION]
    assert [(row["total"], row["noise"]) for row in pairs] == [(1, "realistic")]
    healthy = pooled(result["healthy"], method="TE 10 bins")
    assert healthy["share"] > 0.5, "transfer entropy has no 'none'"
    again = isolation_study.run_isolation(tmp_path, size=SMALL, seed=1, **small)
    assert json.dumps(again) == json.dumps(result)
    assert isolated(cycles, small, tmp_path / "other", seed=2)["severity"] != result["severity"]


@pytest.mark.slow
def test_isolation_study_does_not_depend_on_workers(cycles, small, tmp_path):
    """One process or two: the same results."""
    one, two = (isolated(cycles, small, tmp_path / str(n), seed=3, workers=n) for n in (1, 2))
    assert json.dumps(one) == json.dumps(two)


def test_streams_of_a_block_differ():
    """No two runs share a stream, and a stream does not depend on how many there are."""
    block = Block("r", "t", "thesis", seed=1, reference=2, healthy=2, worn=2, pairs=1)
    runs = block.runs(3)
    roles = [role for role, _, _ in runs]
    counts = {role: roles.count(role) for role in (REFERENCE, HEALTHY, WORN, PAIR)}
    assert counts == {REFERENCE: 2, HEALTHY: 2, WORN: 6, PAIR: 3}
    drawn = {float(block.rng(*run).random()) for run in runs}
    assert len(drawn) == len(runs)
    other = Block("r", "t", "thesis", seed=1, reference=9, healthy=9, worn=9, pairs=9)
    assert other.rng(*runs[-1]).random() == block.rng(*runs[-1]).random()


def test_growth_is_that_of_the_thesis():
    """Eq. 6.6: 1, 5, 10 and 15 % in cycles 49, 72, 86 and 94; 20 % in cycle 100."""
    reached = [int(np.argmax(growth() >= level)) + 1 for level in (0.01, 0.05, 0.10, 0.15)]
    assert reached == [49, 72, 86, 94]
    assert growth()[-1] == pytest.approx(0.2)


def test_hourly_record_is_ten_cycles(cycles, tiny_robot_path, tiny_task_path):
    """Without noise every cycle of a healthy hour is the same; wear changes the worn axis only."""
    path = surrogate_file(
        cycles,
        tiny_robot_path,
        tiny_task_path,
        sample_period=PERIOD,
    )
    robot = hourly_monitored(path)
    severity = np.zeros((2, 2))
    severity[1, 1] = 0.1
    record = robot.record(get_sensors("none"), severity, np.random.default_rng(0))
    places = robot.surrogate.nodes.shape[2]
    assert record.torque.shape == (2, 10 * places, 2)
    minutes = record.torque.reshape(2, 10, places, 2)
    np.testing.assert_allclose(minutes, minutes[:, :1].repeat(10, axis=1), atol=1e-12)
    change = np.diff(record.places, axis=0)[0]
    by_axis = np.abs(change).reshape(places, 2).max(axis=0)
    assert by_axis[0] < 0.1 * by_axis[1]
    np.testing.assert_allclose(change, 0.1 * robot.directions.value[1], atol=1e-9)
    assert robot.turning.all()


def ewma_by_hand(healthy, test):
    """One-sided EWMA chart of the cube root of Q, weight 0.2, step by step, over its limit.

    Residuals are those of the autoregression that `analysis.detection` describes. The width of a
    one-sided chart with weight 0.2 and 500 samples between false alarms is that of `test_ewma`.
    """
    z, new = healthy ** (1 / 3), test ** (1 / 3)
    n, centred = len(z), z - z.mean()
    r = centred[1:] @ centred[:-1] / (centred @ centred)
    r += (1 + 3 * r) / n
    residuals = centred[1:] - r * centred[:-1]
    spread = np.sqrt(residuals @ residuals / (n - 3))
    limit = ewma_width(0.2, 500.0, two_sided=False) * np.sqrt(0.2 / 1.8)
    value, before, out = 0.0, None, []
    for x in new - z.mean():
        residual = x / z.std(ddof=1) if before is None else (x - r * before) / spread
        value = 0.2 * residual + 0.8 * value
        out.append(value / limit)
        before = x
    return np.array(out)


def test_ewma_charts_the_cube_root_of_q_upwards():
    """The chart sees Q to the power 1/3, forgets with the weight 0.2, and ignores small Q."""
    rng = np.random.default_rng(8)
    healthy, test = rng.chisquare(3, 120), 4 * rng.chisquare(3, 40)
    test[20:] = 0.01
    charted = ChartOfQ().fit(healthy).score(test)
    np.testing.assert_allclose(charted, ewma_by_hand(healthy, test), rtol=1e-9)
    assert charted[:20].max() > 1 and charted[-1] < 0


def test_ewma_alarms_as_often_as_it_says():
    """Healthy Q passes the limit once in some 470 hours (chi-squared Q); 400 charts, seed fixed."""
    rng = np.random.default_rng(9)
    healthy = rng.chisquare(3, 5000)
    chart = ChartOfQ().fit(healthy)
    first = [np.argmax(chart.score(rng.chisquare(3, 6000)) > 1) for _ in range(400)]
    assert 380 < np.mean(first) < 600  # standard error 25, and 5 % for what was learned


def test_ewma_of_a_q_that_never_moved():
    """A healthy Q without spread cannot be charted: the hours are ranked by Q itself."""
    test = np.array([0.0, 2.0, 1.0])
    np.testing.assert_array_equal(ChartOfQ().fit(np.zeros(20)).score(test), test)


def test_a_record_is_charted_by_its_q(cycles, tiny_robot_path, tiny_task_path, monkeypatch):
    """The detector charts the Q of the divergences: its root is taken once."""
    path = surrogate_file(
        cycles,
        tiny_robot_path,
        tiny_task_path,
        sample_period=PERIOD,
    )
    robot = hourly_monitored(path)
    severity = np.zeros((80, 2))
    severity[60:, 1] = 0.2
    record = robot.record(get_sensors("realistic"), severity, np.random.default_rng(5))
    of_two = Divergences.of(record, 60).divergence
    # two axes are two components, which leave no Q: one is kept here
    monkeypatch.setattr(DivergenceEWMA, "components", 1)
    scored = scores(robot, record, 60, temperature_varies=True)[DivergenceEWMA.name].score
    q = PCAMonitor(n_components=1).fit(of_two[:60]).q(of_two)
    np.testing.assert_allclose(scored, ewma_by_hand(q[:60], q[60:]), rtol=1e-9)


def test_axes_that_stand_still_are_told_before_the_test():
    """Axis 6 of the PUMA does not turn in task 1 of chapter 3."""
    robot = load_robot("puma560")
    motion = plan(load_task("puma560", "chapter3_task1"), robot)
    speed = np.abs(motion(np.arange(0, 60, 10.0))[1] * robot.gear_ratio).max(axis=0)
    stribeck = robot.model.actuator_biasprm[robot.ids("actuator", "friction"), STRIBECK_VELOCITY]
    assert (speed > 0.3 * stribeck).tolist() == [True] * 5 + [False]


@pytest.mark.slow
def test_detection_study(cycles, small, tmp_path):
    """All detectors are compared; ours finds the wear; tables and lags have the thesis' form."""
    shutil.copytree(cycles, tmp_path / "cycles")
    size = detection_study.Size(seeds=1, months=2)
    result = detection_study.run_detection(tmp_path, size=size, seed=1, **small)
    assert len(result["detectors"]) == 2 * len(DETECTORS) * len(detection_study.RATES)
    assert len(result["thesis_procedure"]) == 2 * 4
    lags = np.array(result["example"]["lags"])
    np.testing.assert_array_equal(lags, -lags.T)
    ours = [row for row in result["detectors"] if row["detector"].startswith("wear")]
    assert all(row["detected"]["share"] == 1 for row in ours)
    json.dumps(result, allow_nan=False)


def test_unknown_study(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("sys.argv", ["faultgen", "study", "magic", "-o", str(tmp_path / "x")])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    error = capsys.readouterr().err.strip()
    assert "unknown study 'magic'" in error and all(name in error for name in STUDIES)
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
def test_files_of_a_study(cycles, small, monkeypatch, tmp_path):
    """results.json, tables and figures, from results as two robots and three tasks would give."""
    rows = {"robot": ("irb6700", "puma560"), "task": ("pick_and_place", "spot_weld", "arc_weld")}
    made = isolation_study.run_isolation

    def spread(out, **options):
        shutil.copytree(cycles, out / "cycles")
        result = made(out, size=SMALL, seed=5, **small)
        for name, value in result.items():
            if isinstance(value, list):
                result[name] = [
                    {**row, "robot": robot, "task": task}
                    for row in value
                    for robot in rows["robot"]
                    for task in rows["task"]
                ]
        return result

    monkeypatch.setattr(isolation_study, "run_isolation", spread)
    result = run_study("isolation", tmp_path, quick=True)
    stored = json.loads((tmp_path / "results.json").read_text())
    assert stored["goals"] == result["goals"] and stored["study"] == "isolation"
    assert (tmp_path / "tables.md").read_text() == isolation_tables(stored)
    assert len(list((tmp_path / "figures").glob("*.png"))) == 4


@pytest.mark.parametrize("name", ["isolation", pytest.param("detection", marks=pytest.mark.slow)])
def test_studies_take_any_robot_and_task(
    name, cycles, tiny_robot_path, tiny_task_path, monkeypatch, capsys, tmp_path
):
    """The whole command on a robot with two axes: results, tables without the thesis, figures."""
    shutil.copytree(cycles, tmp_path / "cycles")
    monkeypatch.setattr(isolation_study, "QUICK", SMALL)
    monkeypatch.setattr(detection_study, "QUICK", detection_study.Size(seeds=1, months=1))
    given = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--quick", "--workers", "1"]
    monkeypatch.setattr("sys.argv", ["faultgen", "study", name, *given, "-o", str(tmp_path)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 0, capsys.readouterr().err
    text = (tmp_path / "tables.md").read_text()
    assert "tiny" in text and "swing" in text
    assert "code " in json.loads((tmp_path / "results.json").read_text())["made_by"]
    assert len(list((tmp_path / "figures").glob("*.png"))) == 4


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("isolation", ["--robot", "magic"], "unknown robot 'magic'"),
        ("isolation", ["--task", "dance"], "unknown task 'dance' for robot irb6700"),
        ("detection", ["--robot", "puma560,irb6700"], "takes one robot"),
        ("detection", ["--robot", "irb6700"], "unknown task 'chapter3_task1' for robot irb6700"),
        ("events", ["--robot", "magic"], "models: unknown 'magic'"),
        ("events", ["--task", "dance"], "programs.tasks: irb6700 has no 'dance'"),
        ("events", ["--task", "arc_weld", "--fleet", "f"], "either --fleet, or --robot and --task"),
    ],
)
def test_robots_and_tasks_that_do_not_do(name, given, message, monkeypatch, capsys, tmp_path):
    """One line that says what is missing, exit status 2, and no folder."""
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["faultgen", "study", name, "--quick", *given, "-o", str(out)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not out.exists()
