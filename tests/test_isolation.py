import numpy as np
import pytest

import faultgen.evaluation.isolate as study
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.evaluation.observed_runs import Place, _mean_torque, _measured
from faultgen.evaluation.outcomes import Tally
from faultgen.monitoring.sensors import get_sensors


@pytest.fixture(scope="module")
def folder(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """A noise-free dataset of the small robot."""
    out = tmp_path_factory.mktemp("isolation") / "out"
    experiment = make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 30}
    )
    generate(experiment, out, progress=False)
    return out


def test_answers_are_counted_against_the_label(folder, monkeypatch):
    """An oracle is right, its opposite never; always naming axis 1 is wrong on a healthy robot."""
    dataset = open_dataset(folder)
    healthy = dataset.runs[0].read("monitoring/mean_abs_torque")[-1]

    def oracle(x):
        change = np.abs(x[-1] - healthy) / healthy
        return int(np.argmax(change)) if change.max() > 1e-5 else -1

    methods = {
        "oracle": oracle,
        "opposite": lambda x: 1 - oracle(x) if oracle(x) >= 0 else 0,
        "always 1": lambda x: 0,
    }
    monkeypatch.setattr(study, "METHODS", methods)
    monkeypatch.setattr(Place, "draws", lambda self, run, *rest: [self._stored(run)])
    result = study.isolate(dataset, levels=(0.1, 0.2), progress=False)
    share = {(t.level, t.method): (t.right, t.total, t.named) for t in result.tallies}
    for level in (0.1, 0.2):
        assert share[level, "oracle"] == (2, 2, 2)
        assert share[level, "opposite"] == (0, 2, 2)
        assert share[level, "always 1"] == (1, 2, 2)
    assert share[0.0, "oracle"] == (1, 1, 0)
    assert share[0.0, "always 1"] == (0, 1, 1)


def test_series_end_where_wear_reaches_the_level(folder, monkeypatch):
    """Isolators see the cycles up to the first one in which wear is at the level."""
    lengths = set()
    monkeypatch.setattr(study, "METHODS", {"length": lambda x: lengths.add(len(x)) or 0})
    study.isolate(open_dataset(folder), seeds=1, levels=(0.05, 0.2), progress=False)
    wear = 1.2 ** ((np.arange(1, 31) / 30) ** 4) - 1
    assert lengths == {int(np.argmax(wear >= 0.05)) + 1, 30}


def test_noise_is_drawn_anew_for_each_run_and_seed(folder, monkeypatch):
    """No two series are the same, and the same call gives the same ones again."""
    dataset = open_dataset(folder)

    def drawn():
        seen = []
        monkeypatch.setattr(study, "METHODS", {"keep": lambda x: seen.append(x.copy()) or 0})
        study.isolate(dataset, seeds=3, levels=(0.2,), progress=False)
        return seen

    first, again = drawn(), drawn()
    assert len(first) == 9
    np.testing.assert_array_equal(first, again)
    for i in range(9):
        for j in range(i):
            assert (first[i] != first[j]).any()


def test_noise_scatters_as_it_should(folder):
    """The mean over m samples of a cycle scatters by 1 % of the mean torque over sqrt(m)."""
    run = open_dataset(folder).runs[0]
    noise = get_sensors("thesis")
    series = np.array([_mean_torque(_measured(run, noise, number)) for number in range(40)])
    speed = np.abs(run.read("signals/motor_velocity")[0])
    torque = np.abs(run.read("signals/motor_torque")[0])
    inside = (speed >= 50) & (speed <= 120)
    far = 5 * 0.01 * run["nominal_mean_torque"]
    for axis in range(2):
        # where the torque is near zero, |torque| folds the noise; few samples are
        assert (torque[inside[:, axis], axis] > far[axis]).mean() > 0.9
        expected = 0.01 * run["nominal_mean_torque"][axis] / np.sqrt(inside[:, axis].sum())
        # the velocity noise moves samples at the edge of the window in and out, which adds a little
        assert expected * 0.85 < series[:, :, axis].std() < expected * 2


def test_wilson_intervals():
    """18 right of 20: [0.699, 0.972] by Wilson's formula."""
    tally = Tally("r", "t", "e", 0.1, "m", right=18, total=20)
    z, n, p = 1.959964, 20, 0.9
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    np.testing.assert_allclose(tally.interval, (centre - half, centre + half), rtol=1e-6)


def test_noise_that_moves_the_robot_is_not_redrawn(folder):
    """Temperature and payload need a simulation of their own."""
    with pytest.raises(InputError, match="change the motion: generate a dataset with them"):
        study.isolate(open_dataset(folder), sensors="realistic", progress=False)


def test_missing_signals_are_named(tiny_robot_path, tiny_task_path, tmp_path):
    """Without noise-free signals new noise cannot be drawn; the message says what to keep."""
    experiment = make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "cycles": 6, "effect": "healthy"}
        | {"axis": 1, "signals": "none"}
    )
    generate(experiment, tmp_path, progress=False)
    with pytest.raises(InputError, match="new noise needs signals/motor_velocity"):
        study.isolate(open_dataset(tmp_path), progress=False)
