"""Which samples of a recording are used: on motions that are written down."""

from types import SimpleNamespace

import numpy as np
import pytest

from faultgen.discovery.replay.samples import (
    blocks,
    counted,
    divided,
    for_scoring,
    moving,
    rolling,
    samples_of,
)
from faultgen.recordings.recording import Recording

PERIOD = 0.01
STRIBECK = 5.0
ROBOT = SimpleNamespace(
    n_axes=1,
    gear_ratio=np.ones(1),
    stribeck_velocity=np.full(1, STRIBECK),
    set_points=np.ones(3),
)


def recorded(speed, starts=(0,), period=PERIOD):
    """One axis with a speed at each sample, [rad/s]."""
    position = np.concatenate(
        [np.cumsum(part) * period for part in np.split(np.asarray(speed, float), starts[1:])]
    )[:, None]
    return Recording(
        source="written down",
        robot="",
        side="motor",
        sample_period=period,
        position=position,
        torque=np.ones(position.shape),
        segments=starts,
    )


@pytest.mark.parametrize(("starts", "count"), [((0,), 6), ((0, 60), 6), ((0, 10, 70), 3)])
def test_a_recording_has_three_parts_at_least(starts, count):
    """One or two motions are cut into blocks; three or more are left as they are."""
    found = blocks(recorded(np.ones(120), starts), ROBOT)
    assert len(found) == count
    assert [part.start for part in found] == [0, *(part.stop for part in found[:-1])]
    assert found[-1].stop == 120 and set(starts) <= {part.start for part in found}


@pytest.mark.parametrize(("given", "each"), [(1, 6), (2, 3), (4, 2), (5, 2), (6, 1), (7, 1)])
def test_parts_are_divided_evenly_into_six_or_more(given, each):
    parts = [slice(61 * k, 61 * (k + 1)) for k in range(given)]
    found = divided(parts)
    assert len(found) == given * each
    for k, part in enumerate(parts):
        own = found[each * k : each * (k + 1)]
        assert (own[0].start, own[-1].stop) == (part.start, part.stop)
        assert [one.start for one in own[1:]] == [one.stop for one in own[:-1]]
        lengths = [one.stop - one.start for one in own]
        assert max(lengths) - min(lengths) <= 1


@pytest.mark.parametrize(("count", "scoring"), [(3, [2]), (6, [5]), (10, [8, 9]), (14, [12, 13])])
def test_the_last_fifth_is_kept_for_scoring(count, scoring):
    assert for_scoring([slice(0, 1)] * count) == scoring


def test_samples_of_parts():
    assert np.flatnonzero(samples_of([slice(1, 3), slice(5, 6)], 7)).tolist() == [1, 2, 5]


def test_an_axis_moves_above_a_tenth_of_the_stribeck_velocity():
    """Not across the limits of two recordings, however far the pose jumps there."""
    speed = np.repeat([0.0, 0.9, 1.1, 0.0], 50) * 0.1 * STRIBECK
    inner = np.ones(200, bool)
    inner[[49, 50, 99, 100, 149, 150]] = False  # differences over both speeds
    got = moving(recorded(speed), ROBOT)[:, 0]
    expected = np.zeros(200, bool)
    expected[100:150] = True
    assert (got == expected)[inner].all()
    still = recorded(np.zeros(200), (0, 100))
    still.position[100:] = 3.0
    assert not moving(still, ROBOT).any()


def test_rolling_begins_a_tenth_of_a_second_after_rest_and_reversal():
    """In each recording anew; a recording that begins in motion is rolling at once."""
    speed = np.concatenate([np.zeros(30), np.full(40, 10.0), np.full(50, -10.0)])
    found = np.flatnonzero(rolling(recorded(speed), ROBOT)[:, 0])
    first, second = found[found < 70], found[found >= 70]
    assert first[0] == pytest.approx(30 + 10, abs=1) and first[-1] == pytest.approx(69, abs=1)
    assert second[0] == pytest.approx(70 + 10, abs=1) and second[-1] == 119
    assert np.all(np.diff(first) == 1) and np.all(np.diff(second) == 1)
    at_once = rolling(recorded(np.full(60, 10.0), (0, 30)), ROBOT)[:, 0]
    assert at_once.all()


def test_a_baseline_is_compared_at_rest_too():
    """With the model, only what rolls is compared; nothing before the motion has settled."""
    speed = np.concatenate([np.full(100, 10.0), np.zeros(50), np.full(100, 10.0)])
    recording = recorded(speed)
    baseline, alone = (counted(recording, ROBOT, baseline=one)[:, 0] for one in (True, False))
    assert not baseline[:30].any() and baseline[40:].all()
    assert (alone == (baseline & rolling(recording, ROBOT)[:, 0])).all()
    assert not alone[105:150].any() and alone[165:].all()


def test_an_axis_whose_servo_is_not_given_the_torque_creeps_to_rest():
    """It counts as moving from 0.3 times the Stribeck velocity, not from a tenth."""
    robot = SimpleNamespace(**{**vars(ROBOT), "set_points": np.array([1.0, 0.0, 0.0])})
    for speed, counts in ((0.2, [True, False]), (0.35, [True, True])):
        one = recorded(speed * STRIBECK * np.ones(100))
        assert [moving(one, which)[50, 0] for which in (ROBOT, robot)] == counts
