"""Effects of sensors: each against its definition; the robot does not feel them."""

import numpy as np
import pytest

from faultgen import open_dataset
from faultgen.effects import Applied
from faultgen.experiment import make_experiment
from faultgen.machine import assemble
from faultgen.sensors import Measured
from faultgen.sweep import generate

PERIOD = 0.004


@pytest.fixture
def measured():
    """A cycle of two axes, and nothing in it twice."""
    time = np.arange(2000) * PERIOD
    position = np.column_stack([20 * np.sin(time), 30 * np.cos(1.3 * time)])
    velocity = np.column_stack([20 * np.cos(time), -39 * np.sin(1.3 * time)])
    torque = np.random.default_rng(0).normal(size=position.shape)
    return Measured(position, velocity, torque)


def sense(robot, measured, *effects, seed=1):
    """What faulty sensors make of a cycle."""
    machine = assemble(robot, [Applied(*effect) for effect in effects])
    return machine.sense(measured, PERIOD, np.random.default_rng(seed))


def test_torque_sensor_gain(tiny_robot, measured):
    """1 + severity times the torque of the axis; two gains multiply; nothing else changes."""
    effects = [("torque_sensor_gain", 2, 0.1), ("torque_sensor_gain", 2, -0.3)]
    seen = sense(tiny_robot, measured, *effects)
    np.testing.assert_allclose(
        seen.motor_torque, measured.motor_torque * [1.0, 1.1 * 0.7], rtol=1e-12
    )
    np.testing.assert_array_equal(seen.motor_position, measured.motor_position)
    np.testing.assert_array_equal(seen.motor_velocity, measured.motor_velocity)


def dataset(out, robot, task, effect, **more):
    """Runs of a healthy robot and of one with an effect on axis 2, last cycle."""
    entries = {"robot": robot, "task": task, "effect": effect, "axis": 2, "cycles": 3, "seed": 7}
    experiment = make_experiment(entries | {"sensors": "thesis", "schedule": "linear"} | more)
    generate(experiment, out, progress=False)
    healthy, faulty = sorted(open_dataset(out).runs, key=lambda run: int(run["axis"]))
    return healthy, faulty


@pytest.mark.parametrize(("effect", "severity"), [("torque_sensor_gain", 0.2)])
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
