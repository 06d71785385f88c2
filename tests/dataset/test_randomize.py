"""Datasets whose runs are made by robots of one type that differ."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import faultgen_here

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.instance import draw_instance
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.mjcf.dcmotor import COULOMB, POSITION_GAIN
from faultgen.robot import load_robot

ENTRIES = {
    "robot": "puma560",
    "task": "pick_and_place",
    "axis": 2,
    "severity": 0.2,
    "cycles": 2,
    "schedule": "constant",
    "repetitions": 2,
    "signals": ["signals/motor_torque"],
}


@pytest.fixture(scope="module")
def robot():
    """The model."""
    return load_robot("puma560")


def test_a_spread_of_zero_is_the_model_itself(robot):
    instance = draw_instance(robot, {}, np.random.default_rng(1))
    model = instance.edit(robot.spec()).compile()
    for name in ("body_mass", "body_inertia", "dof_armature", "tendon_stiffness"):
        assert np.array_equal(getattr(model, name), getattr(robot.model, name)), name
    assert np.array_equal(model.actuator_gainprm, robot.model.actuator_gainprm)
    assert (instance.noise, instance.payload, instance.temperature) == (1.0, 1.0, 0.0)


def test_factors_have_the_stated_spread_and_reach_the_model(robot):
    found = [
        draw_instance(robot, {"parameters": 0.1, "servo": 0.2}, np.random.default_rng(seed))
        for seed in range(100)
    ]
    friction = np.log([one.parameters["friction_wear"] for one in found])
    gains = np.log([one.servo for one in found])
    assert friction.std() == pytest.approx(0.1, rel=0.1)
    assert gains.std() == pytest.approx(0.2, rel=0.1)
    assert all(one.noise == 1.0 and set(one.masses.values()) == {1.0} for one in found)
    model = found[0].edit(robot.spec()).compile()
    ratio = model.actuator_biasprm / np.where(robot.model.actuator_biasprm, 1, np.inf)
    for axis in range(robot.n_axes):
        element = robot.ids("actuator", "friction")[axis]
        drive = robot.ids("actuator", "drive")[axis]
        expected = found[0].parameters["friction_wear"][axis]
        own = model.actuator_biasprm[element, COULOMB]
        assert own / robot.model.actuator_biasprm[element, COULOMB] == pytest.approx(expected)
        gain = model.actuator_gainprm[drive, POSITION_GAIN]
        nominal = robot.model.actuator_gainprm[drive, POSITION_GAIN]
        assert gain / nominal == pytest.approx(found[0].servo[axis])
    stiffness = model.tendon_stiffness / robot.model.tendon_stiffness
    assert stiffness == pytest.approx(found[0].parameters["gear_stiffness"])
    assert np.isfinite(ratio).all()


def test_masses_and_inertias_grow_together(robot):
    instance = draw_instance(robot, {"masses": 0.1}, np.random.default_rng(3))
    model = instance.edit(robot.spec()).compile()
    rotors = list(robot.motors)
    assert np.array_equal(model.dof_M0[rotors], robot.model.dof_M0[rotors])
    for name, factor in instance.masses.items():
        body = robot.model.body(name).id
        assert model.body_mass[body] == pytest.approx(factor * robot.model.body_mass[body])
        assert model.body_inertia[body] == pytest.approx(factor * robot.model.body_inertia[body])


def test_another_spread_does_not_change_the_draws_of_the_others(robot):
    one, other = (
        draw_instance(robot, spreads, np.random.default_rng(5))
        for spreads in ({"parameters": 0.1}, {"parameters": 0.1, "masses": 0.1, "noise": 0.5})
    )
    assert one.parameters == other.parameters and one.noise != other.noise


def test_each_run_has_its_own_robot_which_its_file_states(tmp_path):
    spreads = {"parameters": 0.05, "noise": 0.3, "payload": 0.1, "temperature": 2.0}
    experiment = make_experiment(ENTRIES | {"randomize": spreads, "sensors": "thesis"})
    generate(experiment, tmp_path / "data", progress=False)
    generate(experiment, tmp_path / "again", progress=False, workers=2)
    data = open_dataset(tmp_path / "data")
    told = [json.loads(run["instance"]) for run in data.runs]
    assert len(told) == 4 and len({one["noise"] for one in told}) == 4
    assert all(json.loads(run["randomize"]) == spreads for run in data.runs)
    again = open_dataset(tmp_path / "again")
    for run, same in zip(data.runs, again.runs, strict=True):
        torque = run.read("signals/motor_torque")
        assert np.array_equal(torque, same.read("signals/motor_torque"))
        temperature = run.read("cycle/temperature")
        stated = float(run["mean_temperature"]) + json.loads(run["instance"])["temperature"]
        assert temperature == pytest.approx(stated)
    nominal = make_experiment(ENTRIES | {"sensors": "thesis"})
    assert {run.id for run in _runs(nominal)}.isdisjoint({str(run["run_id"]) for run in data.runs})


def _runs(experiment):
    from faultgen.dataset.planning import plan_runs

    return plan_runs(experiment)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"size": 0.1}, "unknown 'size'"),
        ({"parameters": 0.9}, "at most 0.5"),
        ({"parameters": -0.1}, "greater than or equal to 0"),
    ],
)
def test_spreads_that_cannot_be_are_refused(given, words):
    with pytest.raises(InputError, match=words):
        make_experiment(ENTRIES | {"randomize": given})


def test_the_command_takes_spreads(tmp_path):
    flags = ("--robot", "puma560", "--task", "pick_and_place", "--axis", "2", "--cycles", "1")
    done = faultgen_here(
        "generate", *flags, "--randomize", "parameters=0.03", "-o", tmp_path / "data"
    )
    assert done.returncode == 0, done.stderr
    run = open_dataset(tmp_path / "data").runs[0]
    assert json.loads(run["randomize"]) == {"parameters": 0.03}
    wrong = faultgen_here("generate", *flags, "--randomize", "parameters", "-o", tmp_path / "no")
    assert wrong.returncode == 2 and "parameters=0.03,servo=0.1" in wrong.stderr
    assert not (tmp_path / "no").exists()
