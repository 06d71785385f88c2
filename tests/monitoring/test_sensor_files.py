"""Sensors as a file: noise for each axis, differences of the runs, and what a model lacks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.run import make_run
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.monitoring.environment import differences
from faultgen.monitoring.sensors import (
    Remainder,
    Sensors,
    get_sensors,
    measure,
    parse_sensors,
    torque_noise,
)
from faultgen.tasks import load_task

MEAN = np.array([2.0, 5.0])


def test_noise_may_differ_by_axis():
    """Each axis has its own level and correlation time."""
    sensors = Sensors(description="", torque_noise=[0.01, 0.02], torque_correlation=[0.0, 0.02])
    noise = torque_noise(sensors, (100_000, 2), MEAN, 0.004, np.random.default_rng(0))
    assert noise.std(axis=0) == pytest.approx([0.02, 0.1], rel=0.03)
    follows = (noise[1:] * noise[:-1]).mean(axis=0) / noise.var(axis=0)
    assert follows == pytest.approx([0, np.exp(-0.2)], abs=0.02)


def test_a_colour_keeps_the_level_and_gives_the_correlation():
    """The autoregression is scaled to the stated deviation."""
    sensors = Sensors(
        description="",
        torque_noise=0.01,
        torque_colour=[[0.5, 0.3], [0.0]],
        sample_period=0.004,
    )
    noise = torque_noise(sensors, (200_000, 2), MEAN, 0.004, np.random.default_rng(0))
    assert noise.std(axis=0) == pytest.approx([0.02, 0.05], rel=0.02)
    follows = float((noise[1:, 0] * noise[:-1, 0]).mean() / noise[:, 0].var())
    assert follows == pytest.approx(0.5 / (1 - 0.3), abs=0.01)  # Yule and Walker
    with pytest.raises(InputError, match="set sample_period = 0.004"):
        torque_noise(sensors, (10, 2), MEAN, 0.002, np.random.default_rng(0))


def test_noise_grows_with_speed():
    """Its mean square over the cycle stays that of the level."""
    sensors = Sensors(description="", torque_noise=0.01, torque_growth=[[4.0, 0.0], [0.0, 0.0]])
    velocity = np.concatenate([np.zeros((50_000, 2)), np.full((50_000, 2), 3.0)])
    nothing = np.zeros_like(velocity)
    seen = measure(
        sensors,
        nothing,
        velocity,
        nothing,
        gear_ratio=np.ones(2),
        encoder_counts=np.zeros(2),
        mean_torque=MEAN,
        sample_period=0.004,
        rng=np.random.default_rng(0),
    ).motor_torque
    assert seen.std(axis=0) == pytest.approx([0.02, 0.05], rel=0.02)
    ratio = seen[50_000:].std(axis=0) / seen[:50_000].std(axis=0)
    assert ratio == pytest.approx([3.0, 1.0], rel=0.03)


def test_a_file_holds_everything(tmp_path):
    """What `to_toml` writes is what is read."""
    sensors = Sensors(
        description="mine",
        torque_noise=[0.01, 0.02],
        torque_colour=[[0.5], [0.1]],
        sample_period=0.004,
        quantised=True,
        run_to_run={"coulomb_friction": [0.01, 0.0]},
        remainder=Remainder(task_sha256="a", sample_period=0.02, torque=[[1.0, 2.0]] * 3),
    )
    path = tmp_path / "sensors.toml"
    path.write_text(sensors.to_toml())
    assert get_sensors(path) == sensors
    assert sensors.changes_motion


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no entry; it may have torque_noise, torque_correlation, torque_colour"),
        ("# torque_noise = 0.1", "has no entry"),
        ("torque_noise = ", "not valid TOML"),
        ("torque_nose = 0.1", "torque_nose"),
        ("torque_noise = -0.1", "torque_noise must be finite and not negative"),
        ("torque_noise = nan", "torque_noise must be finite"),
        ('torque_noise = "much"', "torque_noise"),
        ("torque_colour = [[1.2]]", "no steady noise"),
        ("run_to_run = {coulomb_friction = [-1.0]}", "coulomb_friction must be finite and not"),
    ],
)
def test_wrong_files_are_refused_in_one_line(text, message):
    with pytest.raises(InputError, match=message) as refused:
        parse_sensors(text, "own.toml")
    assert "\n" not in str(refused.value) and "own.toml" in str(refused.value)


def test_sensors_of_another_robot_are_refused():
    with pytest.raises(InputError, match="torque_noise has values for 3 axes"):
        Sensors(description="", torque_noise=[0.1] * 3).check_axes(2, "own.toml")


def test_runs_differ_as_much_as_stated():
    """Draws have the stated deviation, axis by axis, and an axis without one has none."""
    sensors = Sensors(description="", run_to_run={"coulomb_friction": [0.1, 0.0]})
    drawn = differences(sensors, 4000, np.random.default_rng(0))
    assert {(one.effect, one.axis) for cycle in drawn for one in cycle} == {("coulomb_friction", 1)}
    assert np.std([cycle[0].severity for cycle in drawn]) == pytest.approx(0.1, rel=0.05)


@pytest.fixture(scope="module")
def own_robot(tiny_robot, tiny_task_path, tmp_path_factory):
    """A robot's folder with its own sensors and a task."""
    folder = tmp_path_factory.mktemp("own")
    text = Path(tiny_task_path).read_text()
    replace(tiny_robot, tasks={"swing": text}).write(folder)
    digest = load_task("tiny", tiny_task_path).sha256
    return folder, digest


def made(folder, own, tmp_path, **more):
    (folder / "sensors.toml").write_text(own.to_toml())
    given = {"robot": str(folder), "task": "swing", "effect": "healthy", "cycles": 2, **more}
    (run,) = plan_runs(make_experiment(given))
    made_run, reason = make_run(run, tmp_path)
    assert reason is None
    return run, StoredRun(run.id, tmp_path / f"{run.id}.h5")


def test_a_robot_uses_its_own_sensors(own_robot, tmp_path):
    """They are the default, other names still count, and the id of a run depends on them."""
    folder, _ = own_robot
    first, stored = made(folder, Sensors(description="", torque_noise=0.1), tmp_path)
    noise = stored.read("signals/motor_torque") - stored.read("truth/motor_torque")
    assert noise.std() > 0
    second, _ = made(folder, Sensors(description="", torque_noise=0.2), tmp_path)
    assert first.id != second.id
    third, stored = made(folder, Sensors(description=""), tmp_path, sensors="none")
    assert third.sensors == "none"


def test_what_the_model_lacks_is_added_on_its_task_only(own_robot, tmp_path):
    folder, digest = own_robot
    lacks = Remainder(task_sha256=digest, sample_period=0.5, torque=[[0.3, -0.2]] * 9)
    _, stored = made(folder, Sensors(description="", remainder=lacks), tmp_path)
    added = stored.read("signals/motor_torque") - stored.read("truth/motor_torque")
    assert np.allclose(added, [0.3, -0.2], atol=1e-5)
    other = replace(lacks, task_sha256="other")
    _, stored = made(folder, Sensors(description="", remainder=other), tmp_path)
    added = stored.read("signals/motor_torque") - stored.read("truth/motor_torque")
    assert np.all(added == 0)


def test_healthy_cycles_differ_from_each_other(own_robot, tmp_path):
    """Without differences of the runs, cycles repeat; with them, they do not."""
    folder, _ = own_robot
    steady = made(folder, Sensors(description=""), tmp_path, seed=3)[1]
    varied = made(
        folder, Sensors(description="", run_to_run={"coulomb_friction": [0.1, 0.1]}), tmp_path
    )[1]
    apart = [
        float(np.abs(np.diff(one.read("truth/motor_torque"), axis=0)).max())
        for one in (steady, varied)
    ]
    assert apart[1] > 10 * apart[0]


def test_noise_of_a_real_arm_is_steady():
    """Axis 4 of a UR10e, whose sharp colour has coefficients that sum to more than 4."""
    colour = [1.4318, -1.564, 0.80728, -0.45411, 0.0026958, -0.10884, 0.02379, -0.11957]
    text = f"torque_noise = 0.01\ntorque_colour = [{colour}]"
    assert parse_sensors(text, "own.toml").torque_colour == [colour]
