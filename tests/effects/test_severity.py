"""Severities: a unit for each effect, a label for each fault, and values that are refused."""

import tomllib

import h5py
import numpy as np
import pytest

from faultgen.dataset.experiment import make_experiment, to_toml
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.run_file import units_with_slides
from faultgen.dataset.sweep import generate
from faultgen.effects import EFFECTS, get_effect
from faultgen.errors import InputError
from faultgen.robot import load_robot

CHEAP = {"cycles": 2, "schedule": "linear", "healthy": False, "signals": "none"}


@pytest.fixture
def small(tiny_robot_path, tiny_task_path):
    """Function that makes a cheap experiment."""
    where = {"robot": tiny_robot_path, "task": tiny_task_path}
    return lambda **entries: make_experiment(where | CHEAP | entries)


@pytest.fixture
def slider_path(tmp_path, tiny_robot):
    """The small robot, whose second axis slides."""
    path = tmp_path / "slider.xml"
    path.write_text(
        tiny_robot.xml.replace('<joint name="joint2"', '<joint name="joint2" type="slide"')
    )
    return str(path)


@pytest.mark.parametrize("effect", EFFECTS)
def test_units_are_those_of_the_description(effect):
    """The unit in files is what the description in words begins with; fractions have none."""
    one = get_effect(effect)
    if one.units == "1":
        assert one.unit.split()[0] in ("fraction", "share")
    else:
        assert one.unit.split(",")[0].split(" of ")[0] == one.units
    assert one.smallest <= 0 < one.default < one.largest


@pytest.mark.parametrize(
    ("effect", "units"), [("torque_offset", "N m"), ("encoder_offset", "rad"), ("backlash", "rad")]
)
def test_files_state_the_unit_of_the_effect(small, tmp_path, effect, units):
    generate(small(effect=effect, axis=2, severity=0.01), tmp_path, progress=False)
    (run,) = open_dataset(tmp_path).runs
    assert run["severity_units"] == units
    with h5py.File(tmp_path / "dataset.h5") as merged:
        cycle = merged[f"runs/{run.id}/cycle"]
        assert cycle["severity"].attrs["units"] == units
        assert cycle["fault_severity"][effect].attrs["units"] == units


def test_units_follow_the_joint(slider_path):
    """The play of a sliding axis is in metres; that of a turning one stays in radians."""
    robot = load_robot(slider_path)
    backlash, offset = get_effect("backlash"), get_effect("torque_offset")
    assert [backlash.units_on(robot, axis) for axis in (1, 2)] == ["rad", "m"]
    assert [offset.units_on(robot, axis) for axis in (1, 2)] == ["N m", "N m"]


def test_arrays_of_the_arm_side_state_both_units(slider_path, tiny_robot):
    """The same array holds angles of axis 1 and ways of axis 2."""
    robot = load_robot(slider_path)
    names = ("signals/motor_position", "truth/joint_position", "truth/gear_torque")
    told = [None, "rad; axis 2: m", "N m; axis 2: N"]
    assert [units_with_slides(name, robot) for name in names] == told
    assert not any(units_with_slides(name, tiny_robot) for name in names)
    lift = load_robot("benchmarks/laboratories/robots/lift1.xml")
    assert units_with_slides("command/reference_position", lift) == "m"


def test_one_run_has_one_unit(slider_path, tiny_task_path):
    both = {"robot": slider_path, "task": tiny_task_path, "effect": "backlash", "axis": [[1, 2]]}
    with pytest.raises(InputError, match="in rad on some axes .* and in m on axis 2"):
        plan_runs(make_experiment(both))


def test_every_fault_has_its_label(small, tmp_path):
    """The main effect and those beside it, each on its own axes and in its own unit."""
    beside = [
        {"effect": "backlash", "severity": 1e-3, "axis": 2},
        {"effect": "friction_wear", "severity": 0.4, "axis": 2},
        {"effect": "torque_ripple", "severity": 0.02, "parameters": {"order": 3.0}},
        {"effect": "torque_ripple", "severity": 0.04, "parameters": {"order": 5.0}},
    ]
    generate(small(axis=1, severity=0.2, beside=beside), tmp_path, progress=False)
    (run,) = open_dataset(tmp_path).runs
    with h5py.File(run.path) as file:
        labels = {name: data[()] for name, data in file["cycle/fault_severity"].items()}
        units = {name: data.attrs["units"] for name, data in file["cycle/fault_severity"].items()}
        assert all(data.dims[1].label == "axis" for data in file["cycle/fault_severity"].values())
    assert units == {
        "backlash": "rad",
        "friction_wear": "1",
        "torque_ripple": "N m",
        "torque_ripple_2": "N m",
    }
    half, full = np.array([0.5]), np.array([1.0])
    growth = np.stack([half, full])
    np.testing.assert_allclose(labels["friction_wear"], growth * [0.2, 0.4])
    np.testing.assert_allclose(labels["backlash"], growth * [0, 1e-3])
    np.testing.assert_allclose(labels["torque_ripple"], growth * [0.02, 0])
    np.testing.assert_allclose(labels["torque_ripple_2"], growth * [0.04, 0])
    np.testing.assert_array_equal(run.read("cycle/severity"), labels["friction_wear"][:, 0])


def test_a_severity_for_each_effect(small):
    given = {"backlash": [1e-3, 2e-3], "encoder_offset": 0.02}
    experiment = small(effect=["backlash", "encoder_offset"], axis=1, severity=given)
    planned = [(run.effect, run.severity) for run in plan_runs(experiment)]
    assert planned == [("backlash", 1e-3), ("backlash", 2e-3), ("encoder_offset", 0.02)]
    assert make_experiment(tomllib.loads(to_toml(experiment))) == experiment


def test_without_severities_each_effect_has_its_default(small):
    experiment = small(effect=["friction_wear", "backlash"], axis=1)
    assert [run.severity for run in plan_runs(experiment)] == [0.2, get_effect("backlash").step]


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"effect": "backlash", "severity": 0.2}, "backlash must be at most 0.05 .rad"),
        (
            {"effect": ["backlash", "friction_wear"], "severity": 0.01},
            "effects of different units .*severities of their own.*severity = {backlash = 0.0003, "
            "friction_wear = 0.2}.*--severity backlash=0.0003,friction_wear=0.2",
        ),
        (
            {"effect": ["backlash", "delay"], "schedule": [0.01, 0.02]},
            "schedule: effects of different units .*severities of their own",
        ),
        ({"effect": "backlash", "severity": {"delay": 0.01}}, "'delay' is not among the effects"),
        (
            {"effect": ["backlash", "delay"], "severity": {"delay": 0.01}},
            "severity: no value is given for the effect backlash",
        ),
        ({"severity": {"friction_wear": -1.0}}, "severity: input should be greater"),
        ({"effect": "torque_offset", "severity": 2.5}, "motor's torque limit of 2 N m, not 2.5"),
        ({"beside": [{"effect": "brake_drag", "severity": 9.0}]}, "brake_drag on axis 2"),
        ({"effect": "seizing_spot", "parameters": {"seizing_spot": {"width": 9}}}, "width: must"),
    ],
)
def test_senseless_severities_are_refused_in_one_line(small, tmp_path, entries, message):
    with pytest.raises(InputError, match=message) as caught:
        generate(small(**({"axis": 2} | entries)), tmp_path / "out", progress=False)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_default_axes_are_those_the_effect_can_act_on(small, tiny_robot):
    """All axes for friction, the last one for the payload, whatever their number."""
    effects = ["friction_wear", "payload_mass", "wrist_coupling_friction"]
    planned = plan_runs(small(effect=effects))
    assert [(run.effect, run.axes) for run in planned] == [
        ("friction_wear", (1,)),
        ("friction_wear", (2,)),
        ("payload_mass", (2,)),
        ("wrist_coupling_friction", (2,)),
    ]
    assert plan_runs(make_experiment({"robot": "puma560", "task": "spot_weld"}))[-1].axes == (6,)


def test_effects_without_an_axis_are_refused(small, tmp_path, tiny_robot):
    """A payload without mass cannot be loose."""
    path = tmp_path / "light.xml"
    light = tiny_robot.xml.replace('mass="0.5" diaginertia="0.001', 'mass="1e-4" diaginertia="1e-6')
    path.write_text(light.replace("1e-6 0.001 0.001", "1e-6 1e-6 1e-6"))
    with pytest.raises(InputError, match="loose_tool cannot act on robot light"):
        plan_runs(small(robot=str(path), effect="loose_tool"))
    (run,) = plan_runs(small(robot=str(path), effect="payload_mass"))
    assert get_effect("payload_mass").units_on(load_robot(path), run.axes[0]) == "kg"


def test_unpaired_runs_of_several_tasks_share_no_seed(small, tmp_path, tiny_task_path):
    """A split at random between runs leaks no noise, temperature or payload."""
    other = tmp_path / "other.toml"
    with open(tiny_task_path) as file:
        other.write_text(file.read().replace("40, 20", "30, 10"))
    runs = plan_runs(small(task=[tiny_task_path, str(other)], healthy=True, seed=3))
    assert len({run.seed for run in runs}) == len(runs) == 6
    assert runs[0].seed == 3
    paired = plan_runs(small(task=[tiny_task_path, str(other)], healthy=True, seed=3, paired=True))
    assert {run.seed for run in paired} == {3}


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"seed": 18446744073709551616}, "seed: must be at most 9223372036854775807"),
        ({"seed": 2**63 - 1, "repetitions": 2}, "seed: must be at most 9223372036854775806"),
        (
            {"thin": 10**30},
            "thin: must be smaller than the number of samples in a cycle, which is [0-9]+",
        ),
        ({"repetitions": 10**12}, "repetitions: input should be less than or equal to"),
        (
            {"repetitions": 99_999},
            "experiment: has 299997 runs, but a dataset can have at most 100000",
        ),
    ],
)
def test_huge_numbers_are_refused_in_one_line(small, tmp_path, entries, message):
    with pytest.raises(InputError, match=message) as caught:
        generate(small(healthy=True, **entries), tmp_path / "out", progress=False)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_the_largest_seed_is_stored(small, tmp_path):
    generate(small(axis=1, cycles=1, seed=2**63 - 1, paired=True), tmp_path, progress=False)
    (run,) = open_dataset(tmp_path).runs
    assert run["seed"] == 2**63 - 1
