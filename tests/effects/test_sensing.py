"""Effects of sensors: each against its definition; the robot does not feel them."""

import numpy as np
import pytest

from faultgen import open_dataset
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.sweep import generate
from faultgen.effects import Applied
from faultgen.monitoring.sensors import Measured
from faultgen.simulation.plant import assemble

PERIOD = 0.004


@pytest.fixture
def measured():
    """A cycle of two axes, and nothing in it twice."""
    time = 0.5 + np.arange(2000) * PERIOD  # already in motion in the first sample
    position = np.column_stack([20 * np.sin(time), 30 * np.cos(1.3 * time)])
    velocity = np.column_stack([20 * np.cos(time), -39 * np.sin(1.3 * time)])
    torque = np.random.default_rng(0).normal(size=position.shape)
    return Measured(position, velocity, torque)


def sense(robot, measured, *effects, seed=1):
    """What faulty sensors make of a cycle."""
    plant = assemble(robot, [Applied(*effect) for effect in effects])
    return plant.sense(measured, PERIOD, np.random.default_rng(seed))


def test_torque_sensor_gain(tiny_robot, measured):
    """1 + severity times the torque of the axis; two gains multiply; nothing else changes."""
    effects = [("torque_sensor_gain", 2, 0.1), ("torque_sensor_gain", 2, -0.3)]
    seen = sense(tiny_robot, measured, *effects)
    np.testing.assert_allclose(
        seen.motor_torque, measured.motor_torque * [1.0, 1.1 * 0.7], rtol=1e-12
    )
    np.testing.assert_array_equal(seen.motor_position, measured.motor_position)
    np.testing.assert_array_equal(seen.motor_velocity, measured.motor_velocity)


def test_encoder_quantisation(tiny_robot, measured):
    """Whole steps, at most half a one off; the speed is their difference where it was exact."""
    step = 0.05
    # a speed that is the difference of positions, as an encoder tells it
    start = measured.motor_position[:1] - measured.motor_velocity[:1] * PERIOD
    velocity = np.diff(measured.motor_position, axis=0, prepend=start) / PERIOD
    exact = Measured(measured.motor_position, velocity, measured.motor_torque)
    seen = sense(tiny_robot, exact, ("encoder_quantisation", 2, step))
    counts = seen.motor_position[:, 1] / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    error = seen.motor_position[:, 1] - exact.motor_position[:, 1]
    assert np.abs(error).max() <= step / 2 + 1e-12
    # uniform over a step: its deviation is step / sqrt(12)
    assert error.std() == pytest.approx(step / np.sqrt(12), rel=0.05)
    np.testing.assert_allclose(
        seen.motor_velocity[1:, 1], np.diff(seen.motor_position[:, 1]) / PERIOD, atol=1e-9
    )
    # the first speed too is a whole number of steps, from where the motor came from
    steps = seen.motor_velocity[0, 1] * PERIOD / step
    assert steps == pytest.approx(round(steps), abs=1e-9)
    np.testing.assert_array_equal(seen.motor_torque, exact.motor_torque)
    np.testing.assert_array_equal(seen.motor_position[:, 0], exact.motor_position[:, 0])


def repeats(values):
    """Which samples are those before them, shape (samples,)."""
    return np.append(False, values[1:] == values[:-1])


@pytest.mark.parametrize("severity", [0.05, 0.4])
def test_sensor_dropout(tiny_robot, measured, severity):
    """A share of severity, within four deviations, repeats; gaps are geometric; others are whole.

    Independent losses come k in a row (1 - s) s^k times a sample.
    """
    seen = sense(tiny_robot, measured, ("sensor_dropout", 2, severity))
    lost = repeats(seen.motor_torque[:, 1])
    count = len(lost)
    off = 4 * np.sqrt(severity * (1 - severity) * count)
    assert abs(lost.sum() - severity * count) < off
    pairs = (lost[2:] & lost[1:-1]).sum()
    assert abs(pairs - severity**2 * count) < 4 * severity * np.sqrt(3 * count)
    for name in ("motor_position", "motor_velocity", "motor_torque"):
        own, given = getattr(seen, name), getattr(measured, name)
        np.testing.assert_array_equal(own[~lost], given[~lost])
        np.testing.assert_array_equal(own[:, 0], given[:, 0])
        np.testing.assert_array_equal(own[1:][lost[1:], 1], own[:-1][lost[1:], 1])


def test_sensor_stuck(tiny_robot, measured):
    """One stretch of exactly that share, anywhere; a log that is stuck for good is a constant."""
    starts = []
    for seed in range(200):
        seen = sense(tiny_robot, measured, ("sensor_stuck", 2, 0.3), seed=seed)
        lost = np.flatnonzero(repeats(seen.motor_torque[:, 1]))
        first = lost[0] - 1
        np.testing.assert_array_equal(lost, first + np.arange(1, 600))  # of 2000
        for name in ("motor_position", "motor_velocity", "motor_torque"):
            expected = getattr(measured, name).copy()
            expected[first : first + 600, 1] = expected[first, 1]
            np.testing.assert_array_equal(getattr(seen, name), expected)
        starts.append(first)
    # uniform over 0 to 1400: mean 700, deviation 404 / sqrt(200)
    assert np.mean(starts) == pytest.approx(700, abs=4 * 404 / np.sqrt(200))
    assert np.ptp(starts) > 1300
    for seed in range(20):
        seen = sense(tiny_robot, measured, ("sensor_stuck", 1, 1.0), seed=seed)
        assert (seen.motor_position[:, 0] == measured.motor_position[0, 0]).all()


def test_draws_follow_the_seed(tiny_robot, measured):
    """The same seed loses the same samples, more of them with more severity; another one others."""

    def lost(severity, seed):
        seen = sense(tiny_robot, measured, ("sensor_dropout", 1, severity), seed=seed)
        return repeats(seen.motor_torque[:, 0])

    np.testing.assert_array_equal(lost(0.1, 1), lost(0.1, 1))
    assert (lost(0.1, 1) != lost(0.1, 2)).any()
    assert not (lost(0.1, 1) & ~lost(0.2, 1)).any()


def dataset(out, robot, task, effect, **more):
    """Runs of a healthy robot and of one with an effect on axis 2, last cycle."""
    entries = {"robot": robot, "task": task, "effect": effect, "axis": 2, "cycles": 3, "seed": 7}
    experiment = make_experiment(
        entries | {"sensors": "thesis", "schedule": "linear", "paired": True} | more
    )
    generate(experiment, out, progress=False)
    healthy, faulty = sorted(open_dataset(out).runs, key=lambda run: int(run["axis"]))
    return healthy, faulty


@pytest.mark.parametrize(
    ("effect", "severity"),
    [
        ("torque_sensor_gain", 0.2),
        ("encoder_quantisation", 0.1),
        ("sensor_dropout", 0.1),
        ("sensor_stuck", 0.1),
    ],
)
def test_datasets_have_it_in_the_signals_alone(
    tmp_path, tiny_robot_path, tiny_task_path, effect, severity
):
    """Truth, noise and the other axis are those of the healthy robot, bit for bit; also again."""
    where = tiny_robot_path, tiny_task_path, effect
    healthy, faulty = dataset(tmp_path / "a", *where, severity=severity)
    names = ("position", "velocity", "torque")
    before, after = (
        np.stack([run.read(f"signals/motor_{name}") for name in names]) for run in (healthy, faulty)
    )
    np.testing.assert_array_equal(after[..., 0], before[..., 0])
    assert (after[..., 1] != before[..., 1]).any()
    for name in ("motor_torque", "motor_velocity", "friction_torque", "joint_position"):
        truth = [run.read(f"truth/{name}") for run in (healthy, faulty)]
        np.testing.assert_array_equal(*truth)
    _, again = dataset(tmp_path / "b", *where, severity=severity)
    for name in names:
        signal = f"signals/motor_{name}"
        np.testing.assert_array_equal(again.read(signal), faulty.read(signal))
