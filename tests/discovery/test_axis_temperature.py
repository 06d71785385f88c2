"""A temperature for each axis: read, and used by everything that depends on temperature."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from replayed import replay

from faultgen.discovery import read_recording, write_recording
from faultgen.discovery.fit.diagnostics import regimes
from faultgen.discovery.fit.problem import Kinematics
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import kept_in, sensitivities
from faultgen.discovery.terms.candidates import Term
from faultgen.effects import Applied
from faultgen.effects.law_course import Course
from faultgen.errors import InputError
from faultgen.simulation.arm import loads


@pytest.fixture(scope="module")
def recording(measured):
    """Axis 1 is as cold as the model assumes, axis 2 becomes warm."""
    recording = measured([], 1)
    count = len(recording.torque)
    temperature = np.stack([np.full(count, 40.0), np.linspace(40.0, 70.0, count)], axis=1)
    return replace(recording, temperature=temperature)


def of_all(recording, axis):
    """The recording with the temperature of one axis for all."""
    return replace(recording, temperature=recording.temperature[:, axis - 1])


def test_files_hold_it(recording, tmp_path):
    """HDF5 and CSV, with a number for each axis, one for all, or none."""
    path = tmp_path / "r.h5"
    for one in (recording, of_all(recording, 2), replace(recording, temperature=None)):
        write_recording(one, path)
        np.testing.assert_array_equal(read_recording(path).temperature, one.temperature)
    wrong = replace(recording, temperature=recording.temperature[:, :1])
    write_recording(wrong, path)
    with pytest.raises(InputError, match=r"temperature has shape \(1875, 1\), expected \(1875,\) "):
        read_recording(path)
    columns = [recording.position, recording.torque, recording.temperature]
    time = np.arange(len(recording.torque))[:, None] * 0.004
    header = "time," + ",".join(
        f"{name}_{k}" for name in ("motor_position", "motor_torque", "temperature") for k in (1, 2)
    )
    path = tmp_path / "r.csv"
    np.savetxt(path, np.hstack([time, *columns]), delimiter=",", header=header, comments="")
    np.testing.assert_allclose(read_recording(path).temperature, recording.temperature)
    np.savetxt(
        path,
        np.hstack([time, *columns, time]),
        delimiter=",",
        header=f"{header},temperature",
        comments="",
    )
    with pytest.raises(InputError, match="has both 'temperature' and 'temperature_1'"):
        read_recording(path)


def test_each_axis_follows_its_own(recording, tiny_robot):
    """Replay with temperature friction on either axis, and its column."""
    for axis in (1, 2):
        effect = [("temperature_friction", axis, 1.0)]
        both = replay(recording, tiny_robot, effect)
        alone = replay(of_all(recording, axis), tiny_robot, effect)
        np.testing.assert_array_equal(both, alone)
    terms = [
        Term(name, axis, 0.1, 0.1)
        for name in ("static_friction", "stribeck_velocity", "viscous_friction")
        for axis in (1, 2)
    ]
    terms += [Term("temperature_friction", axis, 0.1, 0.1) for axis in (1, 2)]
    _, columns = sensitivities(Replay(recording, tiny_robot), terms)
    assert not columns[-2].any()
    assert np.abs(columns[-1]).max() > 0
    _, alone = sensitivities(Replay(of_all(recording, 2), tiny_robot), terms)
    np.testing.assert_array_equal(columns[-1], alone[-1])


def test_laws_use_the_temperature_of_their_axis(recording, tiny_robot):
    times = np.arange(len(recording.torque)) * 0.004
    course = Course(
        tiny_robot,
        recording.position,
        0.004,
        (times, recording.temperature),
        partial(loads, tiny_robot),
    )
    for axis in (1, 2):
        np.testing.assert_allclose(
            course.variable("temperature", axis, 1.0), recording.temperature[:, axis - 1]
        )


def test_regimes_are_told_by_the_temperature_of_their_axis(recording, tiny_robot):
    """Only axis 2 becomes warm: it is warm in half of the samples, and axis 1 in none."""
    motion = Kinematics(*[recording.position] * 3)
    problem = SimpleNamespace(recording=recording, robot=tiny_robot, base=recording.torque)
    named = regimes(problem, motion)
    assert named["warm"].mean(axis=0) == pytest.approx([0.0, 0.5], abs=1e-3)
    assert not np.any(named["warm"] & named["cold"])


def test_what_is_kept_of_a_robot_that_depends_on_temperature(recording, tiny_robot, tmp_path):
    """Its own effects make the torque depend on the temperature; otherwise files are shared."""
    warm = tiny_robot.with_effects([Applied("temperature_friction", 2, 1.0)])
    for robot, shared in ((tiny_robot, True), (warm, False)):
        first, second = (
            kept_in(tmp_path, Replay(one, robot), b"") for one in (recording, of_all(recording, 2))
        )
        assert (first == second) == shared
