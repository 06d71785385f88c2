"""The speeds in which the mean torque is sampled: of the thesis, of the task, or as asked for."""

import h5py
import numpy as np
import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.monitoring.reductions import SPEED_WINDOW, default_window, mean_abs_torque
from faultgen.simulation.nominal import nominal

# axis 1 turns at up to 28 rad/s, axis 2 not at all
SLOW = """
description = "slow, and on one axis"
[start]
joints = [-40, -30]
[[move]]
joints = [40, -30]
duration = 7.5
[[move]]
joints = [-40, -30]
duration = 7.5
"""


@pytest.fixture
def slow(tiny_robot_path, tmp_path):
    """Function that generates one healthy cycle of a slow task."""
    task = tmp_path / "slow.toml"
    task.write_text(SLOW)
    entries = {"robot": tiny_robot_path, "task": str(task), "effect": "healthy", "cycles": 1}

    def make(**more):
        generate(make_experiment(entries | more), tmp_path / "out")
        (run,) = open_dataset(tmp_path / "out").runs
        return run

    return make


def test_the_window_is_the_thesis_where_the_axis_turns_so_fast():
    speed = np.array([[60.0, -60.0, 10.0, 0.0, 49.0, 400.0], [0.0, 0.0, -20.0, 0.0, 0.0, 200.0]])
    expected = [[50, 120], [50, 120], [10, 24], [50, 120], [24.5, 58.8], [200, 480]]
    np.testing.assert_allclose(default_window(speed), expected)


def test_each_axis_has_its_own_window():
    speed, torque = np.array([[60.0, 15.0], [10.0, 5.0]]), np.array([[1.0, 2.0], [3.0, 4.0]])
    seen = mean_abs_torque(speed, torque, [[50, 120], [10, 24]])
    np.testing.assert_array_equal(seen, [1, 2])


@pytest.mark.parametrize(
    ("robot", "task", "slow"),
    [
        ("puma560", "spot_weld", []),
        ("irb6700", "spot_weld", []),
        pytest.param("puma560", "chapter3_task2", [1, 2, 3, 4, 5], marks=pytest.mark.slow),
    ],
)
def test_tasks_of_chapter_6_keep_the_window_of_the_thesis(robot, task, slow):
    """Only the slow tasks of chapter 3 have others."""
    own = (default_window(nominal(robot, task, 0.004).speed) != SPEED_WINDOW).any(axis=1)
    assert (np.flatnonzero(own) + 1).tolist() == slow


def test_slow_axes_are_named_and_have_a_mean_torque(slow, capsys):
    """One line on stderr says which axes are slow; the file says which window was used."""
    run = slow()
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("faultgen:")]
    assert len(said) == 1
    assert "axis 1 never turns at 50 to 120 rad/s; mean_abs_torque uses" in said[0]
    assert "axis 2 never turns within the speed window; mean_abs_torque is nan there" in said[0]
    torque = run.read("monitoring/mean_abs_torque")[0]
    assert np.isfinite(torque[0]) and np.isnan(torque[1])
    with h5py.File(run.path) as file:
        window = file["monitoring/mean_abs_torque"].attrs["speed_window"]
    np.testing.assert_array_equal(window, run["speed_window"])
    speed = run.read("signals/motor_velocity")[0].astype(float)
    top = np.abs(speed[:, 0]).max()
    np.testing.assert_allclose(window[0], [0.5 * top, 1.2 * top], rtol=0.01)
    again = mean_abs_torque(speed, run.read("signals/motor_torque")[0].astype(float), window)
    np.testing.assert_allclose(torque[0], again[0], rtol=1e-4)


def test_experiments_may_set_the_window(slow, capsys):
    run = slow(speed_window=[[5.0, 10.0], [0.0, 1.0]])
    assert "faultgen:" not in capsys.readouterr().err
    np.testing.assert_array_equal(run["speed_window"], [[5, 10], [0, 1]])
    assert np.isfinite(run.read("monitoring/mean_abs_torque")).all()


def test_fast_tasks_say_nothing(tiny_robot_path, tiny_task_path, tmp_path, capsys):
    entries = {"robot": tiny_robot_path, "task": tiny_task_path, "effect": "healthy", "cycles": 1}
    generate(make_experiment(entries), tmp_path / "out")
    assert "faultgen:" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("window", "message"),
    [
        ([10.0, 5.0], "must be .low, high., not .10, 5."),
        ([10.0], "speed_window: list should have at least 2 items"),
        ([[1.0, 2.0]] * 3, "has 3 pairs, but robot tiny has 2 axes"),
        ([0.0, float("inf")], "speed_window: input should be a finite number"),
        ("fast", "speed_window: input should be a valid list"),
    ],
)
def test_wrong_windows_are_refused(slow, window, message):
    with pytest.raises(InputError, match=message):
        slow(speed_window=window)


def test_robots_without_limits_have_histograms(tiny_robot, tiny_task_path, tmp_path):
    """Where the robot gives no limit, the histograms span what the task needs, and say so."""
    path = tmp_path / "free.xml"
    xml = tiny_robot.xml.replace('name="motor_velocity_limit"', 'name="some_other_number"')
    path.write_text(xml.replace('saturation="3 0 0"', "").replace('saturation="2 0 0"', ""))
    entries = {"robot": str(path), "task": tiny_task_path, "effect": "healthy", "cycles": 1}
    generate(make_experiment(entries), tmp_path / "out")
    (run,) = open_dataset(tmp_path / "out").runs
    shares = run.read("monitoring/torque_histogram")[0]
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    assert (np.count_nonzero(shares, axis=1) > 3).all()
    peak = np.abs(run.read("signals/motor_torque")[0]).max(axis=0)
    np.testing.assert_allclose(run["motor_torque_limit"], 1.2 * peak, rtol=0.2)
