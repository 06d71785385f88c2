"""Delays, gains and offsets of the log, from what the servo makes of the tracking error."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import record_cycle

from faultgen.applied import Applied
from faultgen.discovery.replay.own_servo import nearest_servo
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.servo_faults import find_servo_faults
from faultgen.robot import COULOMB, STICTION


@pytest.fixture(scope="module")
def record(puma):
    """Function that records one cycle of a robot."""

    def run(*effects, seed=1, robot=puma):
        return record_cycle(robot, effects, seed)

    return run


HEAVIER = (Applied("coulomb_friction", 2, 0.4), Applied("payload_mass", 6, 0.5))
"""Changes that a comparison of torques would take for much more than a delay."""


@pytest.mark.parametrize("baseline", [True, False])
def test_a_delay_is_found_whatever_else_has_changed(puma, record, baseline):
    """0.5 ms of axis 3, with 40 % more friction of axis 2 and 50 % more payload."""
    late = Applied("delay", 3, 5e-4)
    measured = record(late, *HEAVIER)
    found = find_servo_faults(measured, puma, [record(seed=2)] if baseline else [])
    (fault,) = found.faults
    assert (fault.effect, fault.axis) == ("delay", 3)
    assert fault.severity == pytest.approx(5e-4, rel=0.1)
    assert fault.interval[0] < fault.severity < fault.interval[1]
    change = Replay(measured, puma.with_effects([late]), measured=False).torque()
    change -= Replay(measured, puma, measured=False).torque()
    assert np.abs(found.change - change).max() < 0.1 * np.abs(change).max()


@pytest.mark.parametrize("baseline", [True, False])
def test_what_is_no_delay_of_one_axis_is_not_named(puma, record, baseline):
    """Other faults, and all axes late together without a baseline: this is the clock of the log."""
    runs = [record(seed=2)] if baseline else []
    assert not find_servo_faults(record(*HEAVIER), puma, runs).faults
    together = [Applied("delay", axis, 2e-3) for axis in range(1, 7)]
    assert len(find_servo_faults(record(*together), puma, runs).faults) == (6 if baseline else 0)


def test_a_delay_that_the_model_has_is_not_found_again(puma, record):
    late = Applied("delay", 3, 5e-4)
    assert not find_servo_faults(record(late), puma.with_effects([late])).faults


def test_another_servo_is_not_judged(puma, record):
    """Without feed-forward, its torque is not what the model's servo would make of the motion."""
    spec = puma.spec()
    spec.add_numeric(name="servo_set_points", data=[1, 0, 0], size=3)
    spec.compile()
    found = find_servo_faults(record(Applied("delay", 3, 2e-3), robot=puma.edited(spec)), puma)
    assert not found.faults and not found.change.any()


def logged(recording, axis, gain=1.0, offset=0.0):
    """The recording with another gain and zero [N m] of the torque log of an axis."""
    torque = recording.torque.copy()
    torque[:, axis - 1] = gain * torque[:, axis - 1] + offset
    return replace(recording, torque=torque)


def told(found):
    return {(one.effect, one.axis): one for one in found.faults}


def assert_is(fault, severity):
    """Within three standard errors, of which the interval has 2.09 on either side."""
    error = (fault.interval[1] - fault.interval[0]) / 2 / 2.09
    assert abs(fault.severity - severity) < 3 * error
    assert error < 0.01 * max(abs(severity), 0.1)


@pytest.fixture(scope="module")
def pair(record):
    """A healthy recording, and one after 40 % more friction of axis 2 and 50 % more payload."""
    return record(seed=2), record(*HEAVIER)


@pytest.mark.parametrize("gain", [1.03, 1.15, 1.2, 0.95, 0.8])
def test_the_gain_of_a_log_is_no_delay(puma, pair, gain):
    healthy, measured = pair
    for axis in (1, 3):
        found = find_servo_faults(logged(measured, axis, gain), puma, [healthy])
        assert set(told(found)) == {("torque_constant", axis)}
        assert_is(found.log[0], 1 - 1 / gain)
        assert not found.change.any() and found.are_all
        right = found.corrected(logged(measured, axis, gain))
        assert np.allclose(right.torque, measured.torque, rtol=5e-3, atol=1e-9)


def test_delay_gain_and_offset_are_told_apart(puma, record, pair):
    """All three on one axis; the offset is 2 % of the torque limit."""
    offset = 0.02 * puma.motor_torque_limit[2]
    measured = logged(record(Applied("delay", 3, 5e-4), *HEAVIER), 3, 1.1, offset)
    found = find_servo_faults(measured, puma, [pair[0]])
    shown = told(found)
    assert set(shown) == {("delay", 3), ("torque_constant", 3), ("torque_offset", 3)}
    assert_is(shown["delay", 3], 5e-4)
    assert_is(shown["torque_constant", 3], 1 - 1 / 1.1)
    assert_is(shown["torque_offset", 3], -offset / 1.1)
    texts = [str(one) for one in found.findings()]
    assert all(one.startswith("corrected: axis 3") for one in texts)
    assert all(one.endswith("--trust-log takes the file as it is") for one in texts)
    trusted = find_servo_faults(measured, puma, [pair[0]], trust_log=True)
    assert set(told(trusted)) == {("delay", 3)}
    assert_is(trusted.delays[0], 5e-4)
    some = find_servo_faults(measured, puma, [pair[0]], exclude=["delay", "torque_offset"])
    assert set(told(some)) == {("torque_constant", 3)} and not some.are_all


@pytest.mark.parametrize("gain", [0.85, 1.2])
def test_a_log_that_is_wrong_on_both_days_has_not_changed(puma, pair, gain):
    """Where friction and payload differ, the logs differ by more than the servo explains."""
    both = []
    for one in pair:
        for axis in range(1, 7):
            one = logged(one, axis, gain)
        both.append(one)
    assert not find_servo_faults(both[1], puma, both[:1]).faults


def test_without_a_baseline_a_gain_is_that_of_one_axis(puma, record):
    """A gain that all axes have is the unit of the log, which is not found here."""
    measured = record(seed=4)
    found = find_servo_faults(logged(measured, 3, 1.1), puma)
    assert set(told(found)) == {("torque_constant", 3)}
    assert_is(found.log[0], 1 - 1 / 1.1)
    assert not find_servo_faults(replace(measured, torque=1.1 * measured.torque), puma).faults


def test_weaker_motors_and_servos_are_no_gain_of_the_log(puma, record, pair):
    """A weaker motor's drive logs what it commands; another kp and kd change a part of that."""
    assert not find_servo_faults(
        record(Applied("torque_constant", 3, 0.15)), puma, [pair[0]]
    ).faults
    # without a feed-forward torque, both explain the same
    robots = []
    for share in (1.0, 0.8):
        spec = puma.spec()
        spec.add_numeric(name="servo_set_points", data=[1, 0, 0], size=3)
        spec.actuator("drive2").gainprm[[4, 6]] *= share
        spec.compile()
        robots.append(puma.edited(spec))
    healthy, weak = (record(seed=5 + k, robot=robot) for k, robot in enumerate(robots))
    assert not find_servo_faults(weak, robots[0], [healthy]).faults


def heavier_links(robot, factor):
    spec = robot.spec()
    for body in spec.bodies:
        if body.name.startswith("link"):
            body.mass *= factor
            body.inertia *= factor
    spec.compile()
    return robot.edited(spec)


def test_masses_that_the_controller_does_not_know(puma, record, pair):
    """With a baseline they cancel; without one they are no gain of single axes."""
    other = heavier_links(puma, 1.05)
    assert not np.allclose(other.model.body_mass, puma.model.body_mass)
    found = find_servo_faults(logged(pair[1], 2, 1.05), other, [pair[0]])
    assert set(told(found)) == {("torque_constant", 2)}
    assert_is(found.log[0], 1 - 1 / 1.05)
    assert not find_servo_faults(record(seed=4), other).faults
    assert nearest_servo(pair[0], puma, other) is puma
    assert nearest_servo(pair[0], other, puma) is puma


@pytest.mark.parametrize("late", [0.0, 2e-3])
def test_friction_that_the_controller_has_learned_is_no_delay(puma, record, late):
    """All axes have 20 % more friction, and the controller knows it; axis 3 may be late."""
    spec = puma.spec()
    for axis in range(1, 7):
        friction = spec.actuator(f"friction{axis}")
        parameters = friction.biasprm
        parameters[[COULOMB, STICTION]] *= 1.2
        friction.biasprm, friction.damping = parameters, 1.2 * friction.damping
    spec.compile()
    worn = puma.edited(spec)
    effects = [Applied("delay", 3, late)] if late else []
    measured = record(*effects, robot=worn)
    delays = find_servo_faults(measured, puma, [record(seed=2)]).delays
    assert [one.axis for one in delays] == ([3] if late else [])
    if late:
        assert delays[0].severity == pytest.approx(late, rel=0.05)
