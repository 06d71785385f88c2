"""Several faults in one run, and faults with parameters of their own."""

import json
import tomllib

import numpy as np
import pytest

import faultgen
from faultgen.dataset.experiment import make_experiment, to_toml
from faultgen.dataset.planning import plan_runs
from faultgen.effects import Applied
from faultgen.errors import InputError
from faultgen.simulation.nominal import nominal
from faultgen.simulation.plant import assemble
from faultgen.simulation.stepping import simulate

PLAIN = {
    "robot": "puma560",
    "task": "spot_weld",
    "axis": [2],
    "severity": 0.2,
    "schedule": "linear",
    "cycles": 2,
    "sample_period": 0.02,
}
GEARBOX = PLAIN | {
    "effect": "torque_ripple",
    "parameters": {"torque_ripple": {"order": 4.0}},
    "beside": [
        {"effect": "friction_wear", "severity": 0.5},
        {"effect": "backlash", "severity": 1e-3, "axis": 3},
    ],
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    out = tmp_path_factory.mktemp("gearbox")
    faultgen.generate(make_experiment(GEARBOX), out)
    return faultgen.open_dataset(out).runs


def test_all_faults_grow_by_the_schedule(runs):
    """Both cycles are those of a robot with the three effects at half and full severity."""
    healthy, worn = runs
    shared = nominal("puma560", "spot_weld", 0.02)

    def plant(share):
        ripple = Applied("torque_ripple", 2, 0.2 * share, {"order": 4.0})
        others = [Applied("friction_wear", 2, 0.5 * share), Applied("backlash", 3, 1e-3 * share)]
        return assemble(shared.robot, [ripple, *others])

    cycles = simulate(shared.robot, shared.control, map(plant, (0.5, 1.0)), sample_period=0.02)
    want = np.array([cycle.motor_torque for cycle in cycles])
    assert worn.read("truth/motor_torque") == pytest.approx(want.astype(np.float32), abs=1e-12)
    assert not np.allclose(want[1], healthy.read("truth/motor_torque")[1], atol=0.01)


def test_files_tell_all_faults(runs):
    healthy, worn = runs
    assert json.loads(worn["parameters"]) == {"order": 4.0}
    told = [(one["effect"], one["axis"], one["severity"]) for one in json.loads(worn["beside"])]
    assert told == [("friction_wear", 2, 0.5), ("backlash", 3, 1e-3)]
    assert json.loads(healthy["beside"]) == []


def test_the_healthy_run_stays_what_it_was():
    healthy = plan_runs(make_experiment(GEARBOX))[0]
    assert healthy.id == plan_runs(make_experiment(PLAIN))[0].id


def test_toml_says_it_all():
    experiment = make_experiment(GEARBOX)
    again = make_experiment(tomllib.loads(to_toml(experiment)))
    assert again == experiment
    assert [run.id for run in plan_runs(again)] == [run.id for run in plan_runs(experiment)]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (
            {"parameters": {"backlash": {}}},
            "'backlash' is not among the effects of this experiment",
        ),
        ({"parameters": {"torque_ripple": {"waves": 2}}}, "no parameter 'waves'"),
        ({"beside": [{"effect": "rust", "severity": 1.0}]}, "rust"),
        ({"beside": [{"effect": "friction_wear", "severity": 99.0}]}, "at most 10"),
        ({"beside": [{"effect": "friction_wear", "severity": 0.1, "axis": 7}]}, "axis 7"),
    ],
)
def test_bad_entries_are_told_in_one_line(wrong, told):
    with pytest.raises(InputError) as caught:
        plan_runs(make_experiment(GEARBOX | wrong))
    assert told in str(caught.value) and "\n" not in str(caught.value)
