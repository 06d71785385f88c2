"""Recordings of motor current: the torque constants are found, and no effect hides in them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import faultgen as faultgen_command

import faultgen
from faultgen.discovery import check_recording, read_recording, write_recording
from faultgen.discovery.calibration.motor_current import constants_of, in_torque
from faultgen.discovery.inputs import read_together
from faultgen.errors import InputError
from faultgen.robot import load_robot

CONSTANT = np.array([0.05, 0.8])
OFFSET = np.array([0.3, -0.02])


@pytest.fixture(scope="module")
def current(measured):
    """Records motor currents of the small robot."""

    def record(effects, seed):
        recording = measured(effects, seed)
        return replace(recording, torque=recording.torque / CONSTANT + OFFSET, current=True)

    return record


@pytest.fixture(scope="module")
def files(current, tmp_path_factory):
    folder = tmp_path_factory.mktemp("current")
    cases = {
        "healthy": ([], 1),
        "clean": ([], 2),
        "worn": ([("viscous_friction", 2, 0.3)], 3),
        "rough": ([("coulomb_friction", 2, 1.0)], 4),
        "rougher": ([("coulomb_friction", 2, 1.4)], 4),
    }
    for name, (effects, seed) in cases.items():
        write_recording(current(effects, seed), folder / f"{name}.h5")
    weak = current([], 5)
    more = (weak.torque - OFFSET) / [0.9, 1.0] + OFFSET
    write_recording(replace(weak, torque=more), folder / "weak.h5")
    return folder


def test_constants_are_found(current, tiny_robot):
    """On either side of the gearbox; an axis that stands still has none."""
    recording = current([], 1)
    found = constants_of(recording, tiny_robot)
    np.testing.assert_allclose(found.constant, CONSTANT, rtol=0.02)
    largest = np.abs(recording.torque - OFFSET).max(axis=0)
    assert np.all(np.abs(found.offset - OFFSET) < 0.01 * largest)
    ratio = tiny_robot.gear_ratio
    joint = replace(recording, side="joint", position=recording.position / ratio)
    again = constants_of(joint, tiny_robot)
    np.testing.assert_allclose(again.constant, found.constant, rtol=1e-6)
    turned = in_torque(joint, tiny_robot, again)
    np.testing.assert_allclose(
        turned.torque, ratio * in_torque(recording, tiny_robot, found).torque, rtol=1e-6
    )
    assert check_recording(turned, tiny_robot) == []
    (finding,) = check_recording(joint, tiny_robot)
    assert finding.level == "refuse" and "is a motor current" in finding.message
    flat = recording.torque.copy()
    flat[:, 1] = 0.4
    assert constants_of(replace(recording, torque=flat), tiny_robot).constant[1] == 1.0


EXCLUDED = ("torque_ripple", "transmission_error", "backlash", "gear_stiffness")
"""Effects that cost the most simulations, and are not looked for here."""


@pytest.fixture(scope="module")
def asked(files, tiny_robot_path):
    """Compares a recording with the model, or with the healthy one; simulates once."""

    def ask(name, baseline):
        return faultgen.discover(
            files / f"{name}.h5",
            tiny_robot_path,
            files / "healthy.h5" if baseline else None,
            exclude=EXCLUDED,
            cache=files / "cache",
        )

    return ask


def named(result):
    return [(one["effect"], one["axis"]) for one in result["effects"]]


def constants_in(result):
    return np.array([[one["constant"], one["offset"]] for one in result["torque_constants"]]).T


@pytest.mark.slow
def test_against_a_healthy_recording(asked):
    """The constants come from the healthy one, and effects are named in N m."""
    result = asked("worn", True)
    assert named(result) == [("viscous_friction", 2)]
    assert result["effects"][0]["parameters"]["severity"] == pytest.approx(0.3, rel=0.1)
    np.testing.assert_allclose(constants_in(result)[0], CONSTANT, rtol=0.02)
    constants, friction = result["warnings"]
    assert "healthy.h5: axis 1 0.0" in constants and "A at no torque, axis 2 0.7" in constants
    assert "how much friction differs from day to day" in friction


@pytest.mark.slow
def test_a_changed_torque_constant_is_named_against_a_healthy_recording(asked):
    """Both recordings have the same unknown constant, so that its change is seen."""
    assert named(asked("weak", True)) == [("torque_constant", 1)]


@pytest.mark.parametrize("name", [pytest.param("clean", marks=pytest.mark.slow), "weak"])
def test_an_unknown_constant_is_no_effect(asked, name):
    """Without a healthy recording, a weak motor is one with another torque constant."""
    result = asked(name, False)
    assert (result["verdict"], result["effects"]) == ("no missing effect", [])
    right = CONSTANT * (np.array([0.9, 1.0]) if name == "weak" else 1.0)
    np.testing.assert_allclose(constants_in(result)[0], right, rtol=0.02)
    found, why, *_ = result["warnings"]
    assert "torque constants found from" in found
    assert why.startswith("torque_constant and torque_offset are not named: ")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rougher", "rough"])
def test_other_effects_are_named_without_a_healthy_recording(asked, name):
    """Twice the friction of axis 2, or a little more, is no other torque constant."""
    result = asked(name, False)
    assert named(result) == [("coulomb_friction", 2)]
    np.testing.assert_allclose(constants_in(result)[0], CONSTANT, rtol=0.02)


def test_files_of_currents(files, current, measured, tiny_robot_path, tmp_path):
    """They are read as they were written; a torque beside a current is the one that is used."""
    again = read_recording(files / "healthy.h5")
    assert again.current and again.side == "motor"
    np.testing.assert_array_equal(again.torque, current([], 1).torque)
    path = tmp_path / "torque.h5"
    write_recording(measured([], 1), path)
    with pytest.raises(InputError, match="only one of them has motor_current; give both as"):
        faultgen.discover(files / "clean.h5", tiny_robot_path, path)
    turned = replace(again, torque=again.torque * [1, -1])
    write_recording(turned, path)
    robot = load_robot(tiny_robot_path)
    right, given = (read_together([one], robot) for one in (files / "healthy.h5", path))
    assert right.findings == ()
    assert any("axis 2: the torque has the opposite sign" in line for line in given.findings)
    largest = np.abs(right.recording.torque).max(axis=0)
    assert np.all(np.abs(given.recording.torque - right.recording.torque) < 0.02 * largest)
    still = replace(
        again, position=0 * again.position, reference_position=0 * again.reference_position
    )
    write_recording(still, path)
    with pytest.raises(InputError, match="too little of it moves to find the torque constants"):
        faultgen.discover(path, tiny_robot_path)


@pytest.mark.slow
def test_calibration_lists_the_constants(files, tiny_robot_path, tmp_path):
    """The command finds them and includes what it calibrates."""
    out, path = tmp_path / "out", tmp_path / "short.h5"
    recording = read_recording(files / "clean.h5")
    names = ("position", "torque", "reference_position")
    write_recording(replace(recording, **{n: getattr(recording, n)[:900] for n in names}), path)
    done = faultgen_command(
        "calibrate", path, "--robot", tiny_robot_path, "--known", "inertia", "-o", out
    )
    assert done.returncode == 0 and "torque constants found from" in done.stderr
    result = json.loads((out / "calibration.json").read_text())
    np.testing.assert_allclose(constants_in(result)[0], CONSTANT, rtol=0.03)
