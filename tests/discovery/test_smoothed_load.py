"""Loads on rotors whose measured positions had to be smoothed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded import logged

from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.smoothed_load import SmoothedLoad
from faultgen.discovery.terms.candidates import Term, effect_terms, periodic_terms
from faultgen.mjcf.dcmotor import INTEGRAL_GAIN, POSITION_GAIN, VELOCITY_GAIN
from faultgen.recordings.recording import Recording
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm

SECONDS, PERIOD = 3.0, 0.002


@pytest.fixture(scope="module")
def robot():
    """The PUMA 560."""
    return load_robot("puma560")


def with_noise(recording: Recording) -> Recording:
    """The recording with an encoder whose noise hides fast motion."""
    noise = np.random.default_rng(1).normal(0.0, 0.01, recording.position.shape)
    return replace(recording, position=recording.position + noise)


def found(robot, term: Term, size: float, *, as_seen: bool) -> float:
    """Size of a term over the true one: a fit of its signature to what the model leaves."""
    healthy, worn = (
        Replay(with_noise(logged(robot, changes, SECONDS, PERIOD)), robot)
        for changes in ([], [(term, size)])
    )
    rows, axis = settled(worn.recording, robot)[:, term.axis - 1], term.axis - 1
    if not as_seen:
        healthy.load = worn.load = None
    left = [(one.recording.torque - one.torque())[rows, axis] for one in (healthy, worn)]
    column = Formulas(worn).columns([term])[term][rows, axis]
    return float(column @ (left[1] - left[0]) / (column @ column)) / size


@pytest.mark.parametrize(("axis", "order"), [(2, 8.0), (4, 4.0), (6, 8.0)])
def test_a_ripple_that_is_too_fast_for_the_smoothed_motion_has_its_size(robot, axis, order):
    term = periodic_terms(robot, "torque_ripple", axis, order)[0]
    assert found(robot, term, 2e-3, as_seen=True) == pytest.approx(1.0, abs=0.1)
    assert found(robot, term, 2e-3, as_seen=False) < 0.8


@pytest.mark.slow
def test_slow_friction_is_seen_as_it_is(robot):
    term = next(t for t in effect_terms(robot) if t.key == ("viscous_friction", 2))
    assert found(robot, term, 0.5, as_seen=True) == pytest.approx(1.0, abs=0.05)
    assert found(robot, term, 0.5, as_seen=False) == pytest.approx(1.0, abs=0.05)


def test_positions_without_noise_change_nothing(robot):
    recording = logged(robot, [], SECONDS, PERIOD)
    load = np.random.default_rng(2).normal(size=recording.torque.shape)
    whole = SmoothedLoad(recording, robot, [[None] * robot.n_axes])
    assert np.array_equal(whole.seen(load), load)


def test_where_nothing_is_left_of_fast_motion_the_answer_of_the_servo_is_seen(robot):
    """A load of one frequency, against the transfer function of servo and rotor."""
    recording, axis = logged(robot, [], SECONDS, PERIOD), 1
    times = np.arange(len(recording.torque)) * PERIOD
    frequency = 2 * np.pi * 40.0
    load = np.zeros(recording.torque.shape)
    load[:, axis] = np.sin(frequency * times)
    seen = SmoothedLoad(recording, robot, [[14.0] * robot.n_axes]).seen(load)[:, axis]
    middle = slice(len(times) // 3, 2 * len(times) // 3)
    waves = np.stack([np.sin(frequency * times), np.cos(frequency * times)], axis=1)[middle]
    size = np.hypot(*np.linalg.lstsq(waves, seen[middle], rcond=None)[0])
    gains = robot.model.actuator_gainprm[robot.ids("actuator", "drive")[axis]]
    s, ratio = 1j * frequency, robot.gear_ratio[axis]
    tendon = robot.ids("tendon", "gearbox")[axis]
    servo = gains[POSITION_GAIN] + gains[INTEGRAL_GAIN] / s + gains[VELOCITY_GAIN] * s
    gear = robot.model.tendon_damping[tendon] * s + robot.model.tendon_stiffness[tendon]
    poses = recording.joint_position(robot)[::100]
    link = np.mean([Arm(robot).inertia(pose)[axis, axis] for pose in poses]) * s**2
    rotor = robot.model.dof_M0[robot.motors[axis]] * s**2
    rotor += 1 / (1 / gear + 1 / link) / ratio**2  # the twist of the gearbox and the turn add up
    assert size == pytest.approx(abs(servo / (servo + rotor)), rel=0.03)
