"""Models of real machines, and the public recordings of them where they are at hand."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from faultgen.discovery import check_recording, replay, settled
from faultgen.robot import load_robot

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data" / "measured"
MODELS = {"emps": 1, "xl330": 1, "ur10e": 6}


@pytest.fixture(scope="module")
def measured():
    spec = importlib.util.spec_from_file_location(
        "measured_data", ROOT / "benchmarks" / "measured_data.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
    error = np.where(inside, recording.torque - replay(recording, robot), 0.0)
    torque = np.where(inside, recording.torque, 0.0)
    return np.sqrt((error**2).sum(axis=0) / (torque**2).sum(axis=0))


@pytest.mark.parametrize("name", MODELS)
def test_the_models_have_the_names_that_a_robot_needs(name):
    assert model(name).n_axes == MODELS[name]


def test_the_firmware_gain_scales_the_position_gain(measured):
    assert 'controller="4.9288e-06 0 4.4756e-07' in measured.xl330_model(200)


def test_the_emps_is_replayed_closed_loop(measured, data):
    """Published for the same symmetric model: 5.85 % and 8.94 % of force."""
    robot = model("emps")
    for name, published in (("identification", 0.0585), ("validation", 0.0894)):
        recording = measured.read_emps(data / "emps", name)
        assert gap(recording, robot)[0] < 1.1 * published


def test_the_ur10e_is_replayed_with_published_parameters(measured, data):
    robot = model("ur10e")
    recording = measured.read_ur10e(data / "ur10e", "train_40s_feb12")
    assert check_recording(recording, robot) == []
    assert gap(recording, robot).max() < 0.15


def test_the_pendulum_is_replayed_with_published_parameters(measured, data, tmp_path):
    path = tmp_path / "xl330_kp100.xml"
    path.write_text(measured.xl330_model(100))
    recording = measured.read_xl330(data / "bam_xl330", "xl330_kp100_sin_sin")
    assert gap(recording, load_robot(path))[0] < 0.2
