import numpy as np
import pytest

import faultgen.evaluation.isolate as study
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.evaluation import Isolator
from faultgen.evaluation.features import FEATURES
from faultgen.evaluation.observed_runs import places
from faultgen.evaluation.outcomes import Outcomes


@pytest.fixture(scope="module")
def folder(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """A noise-free dataset of the small robot."""
    out = tmp_path_factory.mktemp("isolation") / "out"
    experiment = make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 30}
    )
    generate(experiment, out, progress=False)
    return out


@pytest.fixture
def use(monkeypatch):
    """Makes functions of the mean |torque| the only isolators."""

    def replace(**functions):
        made = {}
        for name, function in functions.items():

            class Made(Isolator):
                features = ("mean_abs_torque",)
                learns = False
                answer = staticmethod(function)

                def fit(self, *healthy):
                    pass

                def isolate(self, torque):
                    return self.answer(torque)

            Made.name = name
            made[name] = Made
        monkeypatch.setattr(study, "ISOLATORS", made)

    return replace


def test_answers_are_counted_against_the_label(folder, use):
    """An oracle is right, its opposite never; always naming axis 1 is wrong on a healthy robot."""
    dataset = open_dataset(folder)
    healthy = dataset.runs[0].read("monitoring/mean_abs_torque")[-1]

    def oracle(x):
        change = np.abs(x[-1] - healthy) / healthy
        return int(np.argmax(change)) if change.max() > 1e-5 else -1

    use(
        oracle=oracle,
        opposite=lambda x: 1 - oracle(x) if oracle(x) >= 0 else 0,
        first=lambda x: 0,
    )
    result = study.isolate(dataset, sensors="none", seeds=1, levels=(0.1, 0.2), progress=False)
    share = {(t.level, t.method): (t.right, t.total, t.named) for t in result.outcomes}
    for level in (0.1, 0.2):
        assert share[level, "oracle"] == (2, 2, 2)
        assert share[level, "opposite"] == (0, 2, 2)
        assert share[level, "first"] == (1, 2, 2)
    assert share[0.0, "oracle"] == (1, 1, 0)
    assert share[0.0, "first"] == (0, 1, 1)


def test_series_end_where_wear_reaches_the_level(folder, use):
    """Isolators see the cycles up to the first one in which wear is at the level."""
    lengths = set()
    use(length=lambda x: lengths.add(len(x)) or 0)
    study.isolate(open_dataset(folder), seeds=1, levels=(0.05, 0.2), progress=False)
    wear = 1.2 ** ((np.arange(1, 31) / 30) ** 4) - 1
    assert lengths == {int(np.argmax(wear >= 0.05)) + 1, 30}


def test_noise_is_drawn_anew_for_each_run_and_seed(folder, use):
    """No two series are the same, and the same call gives the same ones again."""
    dataset = open_dataset(folder)

    def drawn():
        seen = []
        use(keep=lambda x: seen.append(x.copy()) or 0)
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
    (place,) = places(open_dataset(folder), "thesis")
    run = place.runs[0]
    drawn = place.draws(run, ("mean_abs_torque",), seeds=40, seed=0)
    series = np.array([seen["mean_abs_torque"] for seen in drawn])
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
    counted = Outcomes("r", "t", "e", 0.1, "m", right=18, total=20)
    z, n, p = 1.959964, 20, 0.9
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    np.testing.assert_allclose(counted.interval, (centre - half, centre + half), rtol=1e-6)


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


def test_every_feature_is_what_its_description_says(folder):
    """Features have the documented shapes, histograms are shares, and signals are whole."""
    (place,) = places(open_dataset(folder), "thesis")
    names = set(FEATURES)
    (seen,) = place.draws(place.runs[1], names, seeds=1, seed=0)
    assert set(seen) == names
    cycles, samples = 30, place.setting.samples
    for name in ("motor_position", "motor_velocity", "motor_torque"):
        assert seen[name].shape == (cycles, samples, 2)
        assert np.ptp(seen[name]) > 0
    for name in ("torque_histogram", "speed_histogram", "angle_histogram"):
        assert seen[name].shape == (cycles, 2, 12)
        np.testing.assert_allclose(seen[name].sum(axis=2), 1)
    for name in ("mean_abs_torque", "torque_indicator", "speed_indicator"):
        assert seen[name].shape == (cycles, 2)
    assert seen["temperature"].shape == (cycles,)
    assert seen["friction_terms"].shape[0] == cycles
    inside = (np.abs(seen["motor_velocity"]) >= 50) & (np.abs(seen["motor_velocity"]) <= 120)
    mean = (np.abs(seen["motor_torque"]) * inside).sum(axis=1) / inside.sum(axis=1)
    np.testing.assert_allclose(seen["mean_abs_torque"], mean)


def test_a_wrong_answer_names_the_class(folder, use):
    """An axis that the robot does not have, or an array where one number is asked for."""
    for wrong, told in ((lambda x: 2, "not 2"), (lambda x: x[-1], "not an array of shape")):
        use(wrong=wrong)
        with pytest.raises(InputError, match=f"Made: isolate must return an axis .*{told}"):
            study.isolate(open_dataset(folder), seeds=1, progress=False)
