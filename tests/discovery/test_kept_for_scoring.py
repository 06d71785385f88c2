"""Into which parts a recording is cut, and which of them are kept for scoring."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery import Discovery, Recording
from faultgen.discovery.replay.samples import blocks, cut

PERIOD = 0.004


def recording(*swings, segments=(0,)):
    """The small robot swings: for each entry (seconds, axes), these axes move so long."""
    speeds = []
    for seconds, axes in swings:
        times = np.arange(0, seconds, PERIOD)
        speed = np.sin(np.pi * times / max(seconds, 1e-9))
        speeds.append(np.stack([speed * (axis in axes) for axis in (1, 2)], axis=1))
    position = np.cumsum(np.concatenate(speeds), axis=0) * PERIOD * 100
    return Recording(
        source="made",
        robot="tiny",
        side="motor",
        sample_period=PERIOD,
        position=position,
        torque=np.zeros_like(position),
        segments=segments,
    )


def kept(parts, scoring, count):
    mask = np.zeros(count, bool)
    for p in scoring:
        mask[parts[p]] = True
    return mask


def test_rest_at_the_ends_does_not_count(tiny_robot):
    """Logs begin and end at rest, but what is kept for scoring must move."""
    log = recording((20, ()), (6, (1, 2)), (30, ()))
    used = np.zeros(log.position.shape, bool)
    used[round(20 / PERIOD) : round(26 / PERIOD)] = True
    parts, scoring = cut(log, tiny_robot, used)
    assert parts[0].start == 0 and parts[-1].stop == len(used)
    assert all(a.stop == b.start for a, b in zip(parts[:-1], parts[1:], strict=True))
    moved = [used[part].all(axis=1).sum() for part in parts]
    assert max(moved) - min(moved) <= 4  # the ends of the swing are slow
    assert scoring == [len(parts) - 1]


def test_steady_motion_is_cut_into_equal_lengths(tiny_robot):
    log = recording((3, (1, 2)), (3, (1,)), (3, (2,)))
    lengths = [part.stop - part.start for part in blocks(log, tiny_robot)]
    assert len(lengths) == 6 and max(lengths) - min(lengths) <= 4


@pytest.mark.parametrize(("usable", "is_last"), [(0.4, True), (0.02, False)])
def test_a_last_motion_that_can_hardly_be_compared_is_not_all_that_scores(
    tiny_robot, usable, is_last
):
    """As if it consisted of reversals, near which the torque is not compared without a baseline."""
    log = recording(*[(4, (1, 2))] * 4, segments=(0, 1000, 2000, 3000))
    used = np.ones(log.position.shape, bool)
    used[3000:] = False
    used[3000 : 3000 + round(usable * 1000)] = True
    parts, scoring = cut(log, tiny_robot, used)
    assert (scoring == [3] and len(parts) == 4) is is_last
    share = used[kept(parts, scoring, len(used))].sum(axis=0) / used.sum(axis=0)
    assert np.all((share > 0.06) & (share < 0.5))


@pytest.mark.parametrize("segments", [(0,), (0, 1500), (0, 750, 1500)])
def test_where_axes_move_in_turn_each_is_kept_and_fitted(tiny_robot, segments):
    """Axis 1 for six seconds, then axis 2: the last fifth alone would show nothing of axis 1."""
    log = recording((6, (1,)), (6, (2,)), segments=segments)
    used = np.zeros(log.position.shape, bool)
    used[: len(used) // 2, 0] = used[len(used) // 2 :, 1] = True
    parts, scoring = cut(log, tiny_robot, used)
    scored = kept(parts, scoring, len(used))
    for axis in (0, 1):
        share = scored[used[:, axis]].mean()
        assert 0.1 < share < 0.3
    starts = {part.start for part in parts}
    assert set(segments) <= starts


def test_separate_recordings_stay_whole_if_every_axis_moves_in_each(tiny_robot):
    log = recording(*[(2, (1, 2))] * 5, segments=(0, 500, 1000, 1500, 2000))
    parts, scoring = cut(log, tiny_robot, np.ones(log.position.shape, bool))
    assert parts == log.parts and scoring == [4]


@pytest.mark.slow
def test_an_effect_is_named_in_a_log_that_ends_at_rest(measured, tiny_robot):
    """As long as the motion itself, and as if the robot had been left on after it."""

    def resting(one):
        def held(x):
            return np.concatenate([x, np.repeat(x[-1:], len(x), axis=0)])

        quiet = np.random.default_rng(len(one.torque)).standard_normal(one.torque.shape)
        torque = np.concatenate([one.torque, one.torque[-1] + 0.01 * quiet])
        return replace(
            one,
            position=held(one.position),
            reference_position=held(one.reference_position),
            torque=torque,
        )

    worn = resting(measured([("torque_offset", 2, 0.1)], seed=2))
    told = Discovery(tiny_robot, laws=False).fit(worn).answer_
    assert [(one.effect, one.axis) for one in told.effects] == [("torque_offset", 2)]
    assert told.effects[0].severity == pytest.approx(0.1, rel=0.02)
    assert told.after < 0.03 * told.before
