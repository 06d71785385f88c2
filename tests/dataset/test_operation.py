"""Sweeps over speed, payload and temperature."""

import itertools
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from faultgen.cli import app
from faultgen.dataset.experiment import make_experiment, to_toml
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.effects.temperature import friction_ratios
from faultgen.errors import InputError
from faultgen.evaluation.observed_runs import places
from faultgen.recordings.from_runs import recording_of
from faultgen.report.dataset_report import write_report
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.twin.train import train

SPEEDS, PAYLOADS, TEMPERATURES = (0.5, 1.0), (0.2, 1.0), (40.0, 60.0)


@pytest.fixture(scope="module")
def small(tiny_robot_path, tiny_task_path):
    """Function that makes a cheap experiment on axis 2."""

    def make(**changes):
        base = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": 2, "cycles": 5}
        return make_experiment({**base, "severity": 0.3, **changes})

    return make


@pytest.fixture(scope="module")
def swept(small, tmp_path_factory):
    """A dataset with two values of each, not to be changed."""
    folder = tmp_path_factory.mktemp("swept") / "out"
    experiment = small(speed=list(SPEEDS), payload=list(PAYLOADS), temperature=list(TEMPERATURES))
    assert make_experiment(tomllib.loads(to_toml(experiment))) == experiment
    generate(experiment, folder, progress=False)
    return open_dataset(folder)


def healthy(dataset, speed, payload, temperature):
    """The healthy run of an operation."""
    (found,) = [
        run
        for run in dataset.runs
        if (run["speed"], run["payload_mass"], run["mean_temperature"], run["axis"])
        == (speed, payload, temperature, 0)
    ]
    return found


def test_every_combination_has_a_healthy_and_a_worn_run(swept):
    """Labels and units are in both tables; each run has noise of its own."""
    table = swept.index
    combinations = set(
        itertools.product(SPEEDS, PAYLOADS, TEMPERATURES, ("healthy", "friction_wear"))
    )
    columns = ["speed", "payload_mass", "mean_temperature", "effect"]
    assert set(table[columns].itertuples(index=False, name=None)) == combinations
    assert len(table) == len(combinations) == table["seed"].nunique()
    cycles = swept.to_dataframe(features="torque_indicator")
    assert set(cycles[columns].itertuples(index=False, name=None)) == combinations
    assert cycles.attrs["units"]["payload_mass"] == "kg"
    assert cycles.attrs["units"]["mean_temperature"] == "degC"


def test_an_override_slows_the_whole_motion(swept):
    """At half of the speed, the robot is at time 2 t where it is at t at full speed."""
    slow, fast = (healthy(swept, speed, 1.0, 40.0) for speed in SPEEDS)
    ways = [run.read("command/reference_position") for run in (slow, fast)]
    assert abs(len(ways[0]) - 2 * len(ways[1])) <= 3
    count = min(len(ways[1]), len(ways[0]) // 2)
    np.testing.assert_allclose(ways[0][: 2 * count : 2], ways[1][:count], atol=1e-5)


def test_the_payload_is_that_of_model_and_controller(swept):
    """The torque rises by that of the heavier arm, and the joints follow as well as before."""
    arms, runs = [], []
    for payload in PAYLOADS:
        run = healthy(swept, 1.0, payload, 40.0)
        robot = load_robot(str(swept.planned[run.id]["robot"]))
        spec = robot.spec()
        body = spec.body("payload")
        body.inertia *= payload / body.mass
        body.mass = payload
        arms.append(Arm(robot.edited(spec)))
        runs.append(run)
        assert (
            mujoco.MjModel.from_xml_string(run.read("model").decode()).body("payload").mass
            == payload
        )
    light, heavy = runs
    step = float(light["sample_period"])
    q = light.read("truth/joint_position")[0].astype(float)
    qd = np.gradient(q, step, axis=0)
    qdd = np.gradient(qd, step, axis=0)
    expected = motor_torque(arms[1], q, qd, qdd) - motor_torque(arms[0], q, qd, qdd)
    change = heavy.read("truth/motor_torque")[0] - light.read("truth/motor_torque")[0]
    error = np.sqrt(np.mean((change - expected) ** 2, axis=0))
    assert (error < 0.2 * np.sqrt(np.mean(expected**2, axis=0))).all()
    lags = [
        np.abs(run.read("truth/joint_position")[0] - run.read("command/reference_position")).max()
        for run in runs
    ]
    assert lags[1] < 2 * lags[0]


def test_warm_gearboxes_rub_less(swept):
    """Viscous friction follows the law of temperature; the tables show the temperature."""
    cold, warm = (healthy(swept, 1.0, 1.0, one) for one in TEMPERATURES)
    assert set(warm.read("cycle/temperature")) == {60.0}
    speed = warm.read("truth/motor_velocity")[0][:, 0]
    fast = speed > 100
    assert fast.sum() > 20
    change = (cold.read("truth/friction_torque") - warm.read("truth/friction_torque"))[0][fast, 0]
    _, _, viscous = friction_ratios(60.0, 40.0)
    # friction{1} of the small robot: 1e-3 N m s/rad; friction acts against the motion
    np.testing.assert_allclose(-change, 1e-3 * (1 - viscous) * speed[fast], rtol=0.02)


def test_what_is_not_given_changes_nothing(small):
    """Runs without an operation keep their ids and seeds; one that is given has its own."""
    plain, own = (plan_runs(small(**given)) for given in ({}, {"speed": [1.0, 0.5]}))
    assert not {run.id for run in plain} & {run.id for run in own}
    assert plain[0].seed == own[0].seed == 0
    assert len({run.seed for run in own}) == len(own) == 4
    assert "at speed 0.5" in own[-1].label and "at" not in plain[0].label.split()
    paired = plan_runs(small(speed=[1.0, 0.5], paired=True))
    assert {run.seed for run in paired} == {0}


@pytest.mark.slow
def test_isolators_are_asked_at_each_operation(swept):
    """With directions of wear of their own: a slow robot has less viscous friction."""
    found = places(swept, "thesis")
    assert len(found) == 8 and all(len(place.runs) == 2 for place in found)
    by_speed = {}
    for place in found:
        by_speed.setdefault(place.runs[0]["speed"], place)
    assert by_speed[0.5].setting.samples > 1.9 * by_speed[1.0].setting.samples
    assert {place.setting.reference_temperature for place in found} == set(TEMPERATURES)


@pytest.mark.slow
def test_the_report_names_the_operation(swept, tmp_path):
    page = write_report(swept.path).read_text()
    assert "speed 0.5, payload 0.2 kg, temperature 60 °C" in page


def test_a_detector_is_for_one_operation(swept):
    with pytest.raises(InputError, match=r"several values of speed: 0\.5, 1\.0"):
        train(swept)


def test_temperature_effects_accept_a_temperature(small, tmp_path):
    """Away from the temperature of the friction parameters, the fault shows."""
    experiment = small(effect="temperature_friction", temperature=60, severity=0.5)
    generate(experiment, tmp_path, progress=False)
    first, worn = open_dataset(tmp_path).runs
    change = worn.read("truth/motor_torque")[-1] - first.read("truth/motor_torque")[-1]
    assert np.abs(change[:, 1]).max() > 1e-4


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": 0}, "speed: input should be greater than 0, not 0"),
        ({"speed": [1.5]}, "speed: input should be less than or equal to 1, not 1.5"),
        ({"speed": [0.5, 0.5]}, "speed: give each value once"),
        ({"payload": -1.0}, "payload: input should be greater than or equal to 0, not -1.0"),
        ({"payload": []}, "payload: give each value once, and at least one"),
        ({"temperature": 20}, "temperature: input should be greater than or equal to 30, not 20"),
        (
            {"payload": [0], "robot": "puma560", "task": "spot_weld"},
            "payload: 0 kg is too light for the model of puma560",
        ),
        ({"payload": [400]}, "needs more than"),
    ],
)
def test_what_is_impossible_is_refused(small, tmp_path, changes, message):
    with pytest.raises(InputError, match=message) as error:
        generate(small(**changes), tmp_path / "out", progress=False)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_robot_without_payload_is_told(tiny_robot_path, tiny_task_path, tmp_path):
    path = tmp_path / "bare.xml"
    text = Path(tiny_robot_path).read_text()
    start, end = text.index('<body name="payload"'), text.index("</body>") + len("</body>")
    path.write_text(text[:start] + '<site name="tool"/>' + text[end:])
    given = {"robot": str(path), "task": tiny_task_path, "payload": 1.0, "axis": 1}
    with pytest.raises(InputError, match="robot bare has no body 'payload' with a mass"):
        generate(make_experiment(given), tmp_path / "out", progress=False)


def test_options_are_numbers(tmp_path):
    """Text is refused in one line, and nothing is written."""
    given = ["generate", "--robot", "puma560", "--task", "spot_weld", "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, [*given, "--speed", "fast"])
    assert isinstance(result.exception, InputError)
    assert "--speed: give numbers such as 0.5,1, not 'fast'" in str(
        result.exception or result.output
    )
    assert not (tmp_path / "out").exists()


def test_info_and_data_card_name_the_operations(swept):
    """Columns of `info` and a line of the card, which a dataset without a sweep does not have."""
    result = CliRunner().invoke(app, ["info", str(swept.path)])
    assert (
        result.output.split("\n")[0].split()[-5:] == "speed payload temperature seed state".split()
    )
    card = (swept.path / "DATACARD.md").read_text()
    assert "speed overrides 0.5, 1; payloads [kg] 0.2, 1; temperatures of the gearboxes" in card


def test_a_recording_has_one_payload(swept):
    """Runs with different payloads do not become segments of one recording."""
    light, heavy = (healthy(swept, 1.0, payload, 40.0).path for payload in PAYLOADS)
    with pytest.raises(
        InputError, match=r"runs: must have the same payload_mass, not 0\.2 and 1\.0"
    ):
        recording_of([light, heavy])
    assert recording_of([light]).position.shape[1] == 2
