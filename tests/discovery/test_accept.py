"""What the commands make of recordings whose log is wrong: corrected, left out, or trusted."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import faultgen_here

import faultgen
from faultgen.discovery import write_recording

COSTLY = (
    "torque_ripple",
    "transmission_error",
    "backlash",
    "gear_stiffness",
    "stiffness_hardening",
    "tooth_damage",
    "seizing_spot",
    "delay",
)
"""Effects that cost the most simulations, and are not looked for here."""


@pytest.fixture(scope="module")
def files(measured, tmp_path_factory):
    """A robot with more friction on axis 1: right, wrong, and with one torque or none."""
    folder = tmp_path_factory.mktemp("accept")
    worn = measured([("viscous_friction", 1, 0.5)], 3)
    copy = worn.torque.copy()
    copy[:, 1] = 0.01 * worn.position[:, 1]
    torques = {
        "worn": worn.torque,
        "wrong": worn.torque * [-1, 1000],
        "copy": copy,
        "nothing": np.ones_like(worn.torque),
    }
    for name, torque in torques.items():
        write_recording(replace(worn, torque=torque), folder / f"{name}.h5")
    return folder


@pytest.mark.parametrize("command", ["discover", "calibrate"])
def test_a_file_without_a_torque_ends_with_one_line(files, tiny_robot_path, command, tmp_path):
    """Exit status 2, the reason of each axis, the way past, and nothing written."""
    out = tmp_path / "out"
    done = faultgen_here(command, files / "nothing.h5", "--robot", tiny_robot_path, "-o", out)
    assert done.returncode == 2 and not done.stdout and not out.exists()
    (line,) = [one for one in done.stderr.splitlines() if "no axis can be used" in one]
    assert line.count("the torque never changes") == 2 and "--trust-log" in line


@pytest.mark.parametrize("command", ["discover", "calibrate", "twin"])
def test_every_command_that_tests_a_log_can_trust_it(command):
    assert "--trust-log" in faultgen_here(command, "--help").stdout


@pytest.mark.slow
def test_corrected_recordings_get_the_answer_of_right_ones(files, tiny_robot_path):
    # numbers that are known well: those of a usual model explain the same friction as well
    asked = {"exclude": COSTLY, "prior_scale": 0.3}
    right = faultgen.discover(files / "worn.h5", tiny_robot_path, **asked)
    wrong = faultgen.discover(files / "wrong.h5", tiny_robot_path, **asked)
    assert right["findings"] == [] and len(wrong["findings"]) == 2
    assert wrong["verdict"] == right["verdict"]
    named = [[(one["effect"], one["axis"]) for one in told["effects"]] for told in (right, wrong)]
    assert named[0] == named[1] == [("viscous_friction", 1)]
    sizes = [told["effects"][0]["parameters"]["severity"] for told in (right, wrong)]
    assert sizes == pytest.approx([0.5, 0.5], abs=0.1)
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-3)


def test_no_effect_is_named_on_an_axis_that_is_left_out(files, tiny_robot_path):
    asked = {"exclude": COSTLY, "prior_scale": 0.3}
    told = faultgen.discover(files / "copy.h5", tiny_robot_path, **asked)
    assert [(one["effect"], one["axis"]) for one in told["effects"]] == [("viscous_friction", 1)]
    assert all(one["axis"] == 1 for one in told["alternatives"])
    (line,) = told["findings"]
    assert "left out: axis 2: the torque is the position of axis 2" in line
    assert line in told["warnings"]
