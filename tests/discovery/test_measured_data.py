"""Models of real machines, and the public recordings of them where they are at hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from real_robots import measured_data, real_arms
from replayed import replay

from faultgen import discover
from faultgen.discovery import check_recording, settled
from faultgen.discovery.accept import accepted
from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.rigid.base_parameters import identify
from faultgen.discovery.rigid.regression import DRIVE, Coupling, Regression
from faultgen.recordings.recording import write_recording
from faultgen.robot import load_robot

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "measured"
MODELS = {"emps": 1, "xl330": 1, "ur10e": 6}


@pytest.fixture
def data():
    if not DATA.is_dir():
        pytest.skip("needs the public measured data in ../shared/data/measured")
    return DATA


def model(name):
    return load_robot(ROOT / "docs" / "examples" / name / f"{name}.xml")


def gap(recording, robot):
    """RMS torque error over RMS torque of each axis, after settling."""
    inside = settled(recording, robot)
    error = np.where(inside, recording.torque - replay(recording, robot, measured=False), 0.0)
    torque = np.where(inside, recording.torque, 0.0)
    return np.sqrt((error**2).sum(axis=0) / (torque**2).sum(axis=0))


@pytest.mark.parametrize("name", MODELS)
def test_the_models_have_the_names_that_a_robot_needs(name):
    assert model(name).n_axes == MODELS[name]


def test_the_firmware_gain_scales_the_position_gain():
    assert 'controller="4.9288e-06 0 4.4756e-07' in measured_data.xl330_model(200)


def test_the_emps_is_replayed_closed_loop(data):
    """Published for the same symmetric model: 5.85 % and 8.94 % of force."""
    robot = model("emps")
    for name, published in (("identification", 0.0585), ("validation", 0.0894)):
        recording = measured_data.read_emps(data / "emps", name)
        assert gap(recording, robot)[0] < 1.1 * published


@pytest.mark.slow
def test_the_ur10e_is_replayed_with_published_parameters(data):
    robot = model("ur10e")
    recording = measured_data.read_ur10e(data / "ur10e", "train_40s_feb12")
    assert check_recording(recording, robot) == []
    assert gap(recording, robot).max() < 0.15


def test_no_sign_or_unit_of_a_real_machine_is_doubted(data):
    """Not as they are, and each flipped axis is found."""
    recordings = {
        "emps": measured_data.read_emps(data / "emps", "validation"),
        "ur10e": measured_data.read_ur10e(data / "ur10e", "train_40s_feb12"),
        "xl330": measured_data.read_xl330(data / "bam_xl330", "xl330_kp400_sin_time_square"),
    }
    for name, recording in recordings.items():
        (made,), _ = accepted([recording], model(name))
        assert set(made.torque_factor) == {1.0} and made.left_out == (), name
        flipped = replace(recording, torque=-recording.torque)
        (made,), _ = accepted([flipped], model(name))
        assert set(made.torque_factor) == {-1.0} and made.left_out == (), name


def test_the_pendulum_is_replayed_with_published_parameters(data, tmp_path):
    path = tmp_path / "xl330_kp100.xml"
    path.write_text(measured_data.xl330_model(100))
    recording = measured_data.read_xl330(data / "bam_xl330", "xl330_kp100_sin_sin")
    assert gap(recording, load_robot(path))[0] < 0.2


def test_classical_identification_gives_the_published_parameters_of_the_emps(data):
    """Janot, Gautier and Brunot (2019): mass, viscous and Coulomb friction, and offset.

    They used all samples. Here those near reversals are left out, where friction depends on more
    than speed; the parameters differ by as much as friction of this machine is asymmetric.
    """
    robot = model("emps")
    recording = measured_data.read_emps(data / "emps", "identification")
    regression = Regression(recording, robot, cut_off=100.0)
    value, ratio = identify(regression.products), float(robot.gear_ratio[0])
    inertia, coulomb, viscous, offset = (float(value[regression.drive(k)][0]) for k in DRIVE)
    assert value[0] + inertia * ratio**2 == pytest.approx(95.1089, rel=0.01)
    assert viscous * ratio**2 == pytest.approx(203.5, rel=0.03)
    assert coulomb * ratio == pytest.approx(20.39, rel=0.03)
    assert offset * ratio == pytest.approx(-3.165, rel=0.1)


def test_classical_identification_of_a_coupled_wrist_is_as_good_as_published(data):
    """Staubli TX40, judged on the last 40 %: 16.6 % with the coupling; about 100 % without."""
    case = real_arms.tx40(data / "tx40")
    robot = with_friction_law(case.robot, case.fitted)
    total = []
    for couplings in ((), (Coupling(6, 1.0),)):
        value = identify(Regression(case.fitted, robot, couplings=couplings).products)
        predicted = Regression(case.judged, robot, couplings=couplings).torque(value)
        total.append(np.sqrt(np.mean(real_arms.errors(case.judged, predicted) ** 2)))
    assert total[0] > 90
    assert total[1] == pytest.approx(16.6, rel=0.1)


@pytest.mark.slow
def test_discovery_on_the_emps_does_not_make_the_model_worse(data, tmp_path):
    """One axis without gravity: several effects of the catalogue have no torque at all."""
    robot = ROOT / "docs" / "examples" / "emps" / "emps.xml"
    names = ("identification", "validation")
    train, other = (measured_data.read_emps(data / "emps", name) for name in names)
    paths = [tmp_path / f"{name}.h5" for name in ("train", "other")]
    for recording, path in zip((train, other), paths, strict=True):
        write_recording(recording, path)
    told = discover(paths[0], robot, validate=paths[1])
    gap = told["gap"]["validation"]
    assert gap["after"] < 1.02 * gap["before"]
