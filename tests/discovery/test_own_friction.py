"""Models whose friction is that of another robot: it is identified from the healthy recording."""

import re
from dataclasses import replace

import numpy as np
import pytest

import faultgen
from faultgen.discovery import write_recording
from faultgen.discovery.calibration.own_friction import with_own_friction
from faultgen.discovery.rigid.drives import Drives
from faultgen.robot import load_robot


def with_friction(robot, path, factor):
    """The small robot with another friction on axis 1, in the same proportions."""
    text = robot.xml.replace(
        'lugre="20 0.1 0.2 0.3 5" damping="1e-3"',
        f'lugre="20 0.1 {0.2 * factor:g} {0.3 * factor:g} 5" damping="{1e-3 * factor:g}"',
    )
    assert text != robot.xml
    path.write_text(text)
    return load_robot(path)


@pytest.mark.parametrize("factor", [0.05, 0.4, 4.0])
def test_friction_far_from_that_of_the_recording_is_replaced(
    measured, tiny_robot, tmp_path, factor
):
    """Only on the axis that has it, and only if the recording is known to be healthy."""
    healthy = measured([], 3)
    robot = with_friction(tiny_robot, tmp_path / "other.xml", factor)
    made, lines = with_own_friction(healthy, robot, healthy=True)
    drives = Drives.of(made)
    np.testing.assert_allclose(drives.coulomb[0], 0.2, rtol=0.1)
    np.testing.assert_allclose(drives.viscous[0], 1e-3, rtol=0.1)
    for name, values in drives.named().items():
        np.testing.assert_allclose(values[1], Drives.of(tiny_robot).named()[name][1], rtol=1e-12)
    (line,) = lines
    stated = float(re.search(r"^axis 1: .* is (\S+) times that of the model", line)[1])
    assert stated == pytest.approx(1 / factor, rel=0.15)
    assert with_own_friction(healthy, robot, healthy=False) == (robot, [])


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.5])
def test_usual_errors_of_friction_stay(measured, tiny_robot, tmp_path, factor):
    robot = with_friction(tiny_robot, tmp_path / "other.xml", factor) if factor != 1 else tiny_robot
    assert with_own_friction(measured([], 3), robot, healthy=True) == (robot, [])


def test_a_motion_in_one_direction_does_not_show_friction(measured, tiny_robot, tmp_path):
    """A constant torque looks the same there."""
    healthy = measured([], 3)
    forward = np.all(np.gradient(healthy.reference_position, axis=0) > 0, axis=1)
    edges = np.flatnonzero(np.diff(np.r_[0, forward, 0]))
    first, last = max(edges.reshape(-1, 2).tolist(), key=lambda pair: pair[1] - pair[0])
    assert last - first > 100
    part = slice(first, last)
    one_way = replace(
        healthy,
        position=healthy.position[part],
        torque=healthy.torque[part],
        reference_position=healthy.reference_position[part],
    )
    robot = with_friction(tiny_robot, tmp_path / "other.xml", 0.05)
    assert with_own_friction(one_way, robot, healthy=True) == (robot, [])


@pytest.mark.slow
def test_severities_are_relative_to_the_healthy_recording(measured, tiny_robot, tmp_path):
    """20 % wear is 20 %, although the model has a twentieth of the friction."""
    with_friction(tiny_robot, tmp_path / "other.xml", 0.05)
    files = tmp_path / "healthy.h5", tmp_path / "worn.h5"
    write_recording(measured([], 3), files[0])
    write_recording(measured([("friction_wear", 1, 0.2)], 4), files[1])
    found = faultgen.discover(
        files[1],
        tmp_path / "other.xml",
        files[0],
        exclude=("torque_ripple", "transmission_error", "backlash", "gear_stiffness"),
    )
    first = found["effects"][0]
    assert (first["axis"], first["effect"] in ("friction_wear", "coulomb_friction")) == (1, True)
    assert first["parameters"]["severity"] == pytest.approx(0.2, rel=0.15)
    assert any("times that of the model" in line for line in found["warnings"])
