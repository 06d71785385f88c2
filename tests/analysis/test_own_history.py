"""Features of a robot's own history: planted growth, what must not matter, and nothing later."""

from dataclasses import replace

import numpy as np
import pytest
from fake_fleet import fake_fleet
from faultgen.analysis.classification import leave_pair_out
from faultgen.analysis.own_history import (
    FEWEST,
    event_changes,
    growth,
    history_features,
    make_history_classifier,
    rms_torque,
)
from faultgen.analysis.plain_history import plain_history, untrained_auc
from sklearn.metrics import roc_auc_score


def test_planted_growth_is_found():
    """A growth of known size on one axis, beside temperature, mix and payload that move more."""
    rng = np.random.default_rng(0)
    n, axes = 120, 4
    time = np.arange(1, n + 1) / 2
    steep = np.exp(3 * (time - time[0]) / (time[-1] - time[0]))
    steep = (steep - steep.mean()) / steep.std()
    around = rng.standard_normal((n, 2))
    mix = rng.beta(4, 4, n)
    shares = np.outer(mix, [0.7, 0.3, 0.0]) + np.outer(1 - mix, [0.1, 0.2, 0.7])
    payload = rng.standard_normal(n)
    torque = np.full((n, axes), 5.0) + 0.01 * rng.standard_normal((n, axes))
    torque += around @ rng.uniform(0.3, 0.6, (2, axes)) + np.outer(mix, rng.uniform(1, 3, axes))
    torque += np.outer(payload, rng.uniform(0.2, 0.4, axes))
    torque[:, 2] += 5 * 0.06 * steep
    gain, left = growth(time, np.ceil(time).astype(int), torque, around, shares)
    median = np.median(torque[:, 2]) / 5
    # The ridge takes a tenth off what stands by itself.
    assert gain[2] == pytest.approx(0.06 / median, rel=0.2)
    assert np.abs(np.delete(gain, 2)).max() < 0.02
    assert left.shape == (60, axes)


def test_rms_of_a_histogram():
    """Two bins at plus and minus half of the largest torque; all in the last of four."""
    assert rms_torque(np.array([0.5, 0.5])) == pytest.approx(0.5)
    assert rms_torque(np.array([0, 0, 0, 1.0])) == pytest.approx(0.75)


def test_a_row_knows_nothing_of_later_days():
    """Rows up to a day stay as they are, to the last digit, whatever the record holds after it."""
    robot = fake_fleet(failed=1, normal=0, days=50, n_axes=3, a_day=2).robots[0]
    day, rows = history_features(robot)
    assert day.tolist() == list(range(FEWEST - 1, 50))
    cut = robot.day <= 40
    names = ("day", "production", "torque_histogram", "speed_histogram", "angle_histogram")
    names += ("torque_indicator", "speed_indicator", "temperature")
    short = replace(robot, **{name: getattr(robot, name)[cut] for name in names})
    before, same = history_features(short)
    assert before[-1] == 39
    assert np.array_equal(same, rows[: len(same)])


def test_changes_of_events_by_hand():
    """Five kinds of six, of which 1 + events grow by e; days after are not seen."""
    early, often = 1.0, 2 * np.e - 1
    events = np.full((60, 6), early)
    events[30:, :5] = often
    found = event_changes(events, np.array([25, 43, 50]))
    assert found == pytest.approx([0.0, 1.0, 1.0])
    events[51:] = 99
    assert np.array_equal(event_changes(events, np.array([25, 43, 50])), found)
    with pytest.raises(ValueError, match="at least 5 kinds"):
        event_changes(events[:, :4], np.array([40]))
    with pytest.raises(ValueError, match="no events of day 61"):
        event_changes(events, np.array([60]))


def test_short_records_are_told():
    robot = fake_fleet(failed=1, normal=0, days=20, n_axes=2).robots[0]
    with pytest.raises(ValueError, match="history needs 25 days"):
        history_features(robot)


def told(seed, worst):
    fleet = fake_fleet(failed=4, normal=4, days=40, n_axes=3, worst=worst, seed=seed)
    rows = [history_features(robot)[1][-10:] for robot in fleet.robots]
    failed = [robot.failed for robot in fleet.robots]
    return leave_pair_out(rows, failed, make_history_classifier).auc.mean()


@pytest.mark.slow
def test_failing_robots_are_told_by_their_history():
    """Where torque grows before failure, and by chance where it does not."""
    assert told(0, 0.5) > 0.9
    assert 0.3 < np.mean([told(seed, 0.0) for seed in range(6)]) < 0.7


def test_plain_numbers_by_hand():
    """A torque that doubles on one axis after 20 days, and that alternates on the other."""
    days = 40
    histogram = np.zeros((days, 2, 4))
    histogram[:20, 0, 2] = 1.0  # centre of the bin 0.25 of the largest torque
    histogram[20:, 0, 3] = 1.0  # 0.75
    histogram[:, 1, 2] = 1.0
    histogram[::2, 1] = [0, 0, 0, 1.0]
    robot = fake_fleet(failed=1, normal=0, days=days, n_axes=2).robots[0]
    day, rows = plain_history(robot.day, robot.production, histogram)
    assert day.tolist() == list(range(FEWEST - 1, days))
    assert rows[-1, 0] == pytest.approx(3.0)
    assert rows[-1, 1] == pytest.approx(0.5)  # 0.25 and 0.75 in turn: deviation 0.25, mean 0.5
    early = histogram.copy()
    early[FEWEST:] = 0.25
    same = plain_history(robot.day, robot.production, early)[1]
    assert np.array_equal(same[0], rows[0])
    with pytest.raises(ValueError, match="history needs 25 days"):
        plain_history(robot.day[:20], robot.production[:20], histogram[:20])


def test_auc_of_a_column_is_that_of_scikit_learn():
    """Mean over pairs of the area under the curve of the rows of both; ties count half."""
    rng = np.random.default_rng(2)
    rows = [rng.integers(0, 5, (n, 2)) for n in (3, 5, 4, 6)]
    failed = [True, False, True, False]
    expected = np.mean(
        [
            [
                roc_auc_score(
                    [1] * len(rows[i]) + [0] * len(rows[j]), [*rows[i][:, k], *rows[j][:, k]]
                )
                for k in range(2)
            ]
            for i in (0, 2)
            for j in (1, 3)
        ],
        axis=0,
    )
    np.testing.assert_allclose(untrained_auc(rows, failed), expected)
    with pytest.raises(ValueError, match="robots that fail"):
        untrained_auc(rows, [True] * 4)
