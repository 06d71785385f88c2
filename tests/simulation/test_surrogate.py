"""Interpolated cycles against direct simulation."""

import numpy as np
import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.effects import Applied
from faultgen.errors import InputError
from faultgen.monitoring.sensors import get_sensors
from faultgen.robot import COULOMB, load_robot
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.surrogate import Surrogate, build_surrogate, simulate_at, surrogate_file
from faultgen.studies.chapter6_isolation.monitored import Monitored


def worn(*axes):
    """Friction wear of the given severity on each axis."""
    return tuple(Applied("friction_wear", axis, severity) for axis, severity in axes)


@pytest.fixture(scope="module")
def where(tiny_robot_path, tiny_task_path):
    return tiny_robot_path, tiny_task_path, 0.004


@pytest.fixture(scope="module")
def surrogate(where):
    return build_surrogate(*where[:2], progress=False)


@pytest.mark.parametrize(
    "condition",
    [
        Condition(40.0 + 5.0),
        Condition(60.0, 1.03),
        Condition(45.0, 1.0, worn((2, 0.1))),
        Condition(45.0, 1.0, worn((1, 0.2))),
    ],
)
def test_a_node_is_the_simulation(surrogate, where, condition):
    """At the conditions of the grid nothing is interpolated."""
    expected = simulate_at(*where, condition)
    np.testing.assert_allclose(surrogate.at([condition])[0], expected, atol=1e-9)


def test_between_nodes_the_error_is_below_the_noise(surrogate, where):
    """Temperature, payload and wear of both axes at once, as in a run; noise is 1 % of the mean."""
    rng = np.random.default_rng(5)
    for _ in range(6):
        wear = worn((1, rng.uniform(0, 0.2)), (2, rng.uniform(0, 0.2)))
        condition = Condition(40 + rng.uniform(-8, 12), rng.uniform(0.98, 1.02), wear)
        error = surrogate.at([condition])[0, 2] - simulate_at(*where, condition)[2]
        assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.3 * 0.01 * surrogate.mean_torque)
        # the error is no more than a part of what the condition changes
        healthy = surrogate.at([Condition(40.0)])[0, 2]
        change = simulate_at(*where, condition)[2] - healthy
        assert np.linalg.norm(error) < 0.05 * np.linalg.norm(change)


def test_below_the_range_of_the_friction_law_nothing_changes(surrogate):
    """The law of temperature holds from 30 deg C on; colder is taken as 30."""
    cold, limit = surrogate.at([Condition(20.0), Condition(30.0)])
    np.testing.assert_array_equal(cold, limit)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        (Condition(70.0), "temperature must be within"),
        (Condition(40.0, 1.0, worn((1, 0.25))), "severity must be within"),
    ],
)
def test_outside_of_the_grid_is_refused(surrogate, condition, message):
    with pytest.raises(ValueError, match=message):
        surrogate.at([condition])


def test_written_and_read_again(surrogate, tmp_path):
    """A surrogate from a file gives the same cycles."""
    surrogate.save(tmp_path / "cycles" / "s.h5")
    again = Surrogate.load(tmp_path / "cycles" / "s.h5")
    condition = Condition(41.0, 1.01, worn((1, 0.07)))
    np.testing.assert_array_equal(again.at([condition]), surrogate.at([condition]))
    assert again.sample_period == 0.004 and again.task_path == surrogate.task_path
    (tmp_path / "bad.h5").write_text("no")
    with pytest.raises(InputError, match="not a surrogate"):
        Surrogate.load(tmp_path / "bad.h5")


def test_files_are_used_again_and_belong_to_what_made_them(where, tmp_path):
    """The same call simulates once; another sample period is another file."""
    path = surrogate_file(tmp_path, *where[:2])
    before = path.stat().st_mtime_ns
    assert surrogate_file(tmp_path, *where[:2]) == path
    assert path.stat().st_mtime_ns == before
    assert surrogate_file(tmp_path, *where[:2], sample_period=0.008) != path


def test_observed_as_in_a_generated_run(surrogate, where, tmp_path):
    """The same seed gives the reductions of a run of `generate`, but for interpolation."""
    experiment = make_experiment(
        {"robot": where[0], "task": where[1], "axis": [2], "cycles": 12, "severity": 0.15}
        | {"sensors": "realistic", "seed": 4, "paired": True}
    )
    generate(experiment, tmp_path, progress=False)
    monitored = Monitored.of(surrogate)
    for run in open_dataset(tmp_path).runs:
        severity = run.read("cycle/severity")[:, None] * np.isin([1, 2], run["axes"])
        seen = monitored.observe(get_sensors("realistic"), severity, np.random.default_rng(4))
        stored = run.read("monitoring/mean_abs_torque")
        np.testing.assert_array_equal(seen["temperature"], run.read("cycle/temperature"))
        assert np.abs(seen["mean_abs_torque"] - stored).max() < 0.02 * stored.std(axis=0).min()
        features = monitored.model.friction_terms.transform(
            run.read("signals/motor_torque").astype(float)
        )
        spread = features.std(axis=0)
        error = np.sqrt(np.mean((seen["friction_terms"] - features) ** 2, axis=0))
        assert np.all(error < 0.2 * spread)


def test_directions_of_wear_are_those_of_the_simulation(surrogate):
    """Coulomb friction rises with its own axis' wear, and with no other's."""
    model = Monitored.of(surrogate).model
    robot = load_robot(surrogate.robot_path)
    names = model.friction_terms.names_
    coulomb = [names.index(f"axis {axis} coulomb") for axis in (1, 2)]
    own = model.directions["friction_terms"].value[:, coulomb]
    nominal = [robot.model.actuator_biasprm[i] for i in robot.ids("actuator", "friction")]
    expected = np.array([bias[COULOMB] for bias in nominal])
    np.testing.assert_allclose(np.diagonal(own), expected, rtol=0.1)
    assert np.abs(own[0, 1]) + np.abs(own[1, 0]) < 0.02 * expected.min()


def test_another_controller_keeps_the_motion(where, tmp_path):
    """A heavier robot that is driven as if it were nominal needs more torque on the same path."""
    robot = load_robot(where[0])
    spec = robot.spec()
    spec.body("link2").mass *= 5
    spec.compile()
    heavy = tmp_path / "heavy.xml"
    heavy.write_text(spec.to_xml())
    condition = Condition(40.0)
    nominal = simulate_at(*where, condition)
    driven = simulate_at(str(heavy), *where[1:], condition, controller=where[0])
    assert driven.shape == nominal.shape
    assert np.abs(driven[0] - nominal[0]).max() < 0.05 * np.ptp(nominal[0], axis=0).min()
    assert np.abs(driven[2] - nominal[2]).max() > 0.02 * np.abs(nominal[2]).max()


def test_healthy_at_reference_is_the_robot_itself(tiny_robot):
    """No edit at reference temperature, nominal payload and no wear."""
    model = plant_at(tiny_robot, tiny_robot.spec(), Condition(40.0)).model
    np.testing.assert_array_equal(model.actuator_biasprm, tiny_robot.model.actuator_biasprm)
    np.testing.assert_array_equal(model.body_mass, tiny_robot.model.body_mass)
    warm = plant_at(tiny_robot, tiny_robot.spec(), Condition(50.0, 1.1)).model
    assert (warm.actuator_biasprm != tiny_robot.model.actuator_biasprm).any()
    assert warm.body_mass.sum() > tiny_robot.model.body_mass.sum()
