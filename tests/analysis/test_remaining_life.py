"""Forecasts of severities, against closed forms and simulated lives."""

import numpy as np
import pytest
from faultgen.analysis.remaining_life import forecast_severity, phm_score

LIMIT = 0.15


def lives(rng, count):
    """Wear that begins late, with another power, rate and random part in every life."""
    for _ in range(count):
        life, begin, power = rng.uniform(60, 200), rng.uniform(0, 20), rng.uniform(1, 3)
        time = np.arange(1000.0)
        course = LIMIT * (np.maximum(time - begin, 0) / life) ** power
        steps = rng.standard_normal(1000) * (time > begin) * 0.05 * LIMIT / np.sqrt(life)
        true = course + np.cumsum(steps)
        end = int(np.argmax(true >= LIMIT))
        seen = int(rng.uniform(0.4, 0.9) * end)
        yield time[:seen], true[:seen] + 0.01 * rng.standard_normal(seen), end - seen + 1


def test_a_straight_line_without_noise_is_continued():
    time = np.arange(50.0)
    told = forecast_severity(
        time, 0.002 * time, np.full(50, 1e-5), limit=LIMIT, rng=np.random.default_rng(0)
    )
    assert told.remaining(0.5) == pytest.approx(LIMIT / 0.002 - 49, rel=0.03)
    assert told.severity([0.5])[0, 0] == pytest.approx(0.098, abs=1e-4)


def test_intervals_hold_the_true_life_as_often_as_they_say():
    rng = np.random.default_rng(1)
    inside, length = 0, []
    for time, seen, true in lives(rng, 60):
        told = forecast_severity(time, seen, np.full(len(time), 0.01), limit=LIMIT, rng=rng)
        low, high = told.remaining(0.1), told.remaining(0.9)
        inside += low <= true <= high
        length.append(abs(told.remaining(0.5) - true) / true)
    assert 38 <= inside <= 58  # of 60, of which 48 are expected: three standard deviations
    assert np.median(length) < 0.35


def test_a_limit_that_is_reached_or_far_away_is_told():
    time = np.arange(40.0)
    given = {"errors": np.full(40, 0.005), "rng": np.random.default_rng(2)}
    over = forecast_severity(time, 0.01 * time, limit=LIMIT, **given)
    assert over.remaining(0.9) == 0.0
    never = forecast_severity(time, np.zeros(40), limit=LIMIT, horizon=10.0, **given)
    assert never.remaining(0.1) == np.inf


def test_an_error_of_the_scale_makes_the_forecast_wider_and_not_later():
    """Constant wear of a severity that may be wrong by a factor: the time follows the factor."""
    time = np.arange(50.0)
    told = forecast_severity(
        time,
        0.002 * time,
        np.full(50, 1e-5),
        limit=LIMIT,
        rng=np.random.default_rng(4),
        scale_error=0.2,
    )
    for quantile, normal in ((0.1, -1.2816), (0.5, 0.0), (0.9, 1.2816)):
        expected = LIMIT / (0.002 * np.exp(-0.2 * normal)) - 49
        assert told.remaining(quantile) == pytest.approx(expected, abs=4.0)


def test_many_estimates_are_averaged_without_loss():
    rng = np.random.default_rng(3)
    time = np.arange(2000.0) / 10
    seen = 0.0005 * time + 0.02 * rng.standard_normal(2000)
    told = forecast_severity(time, seen, np.full(2000, 0.02), limit=LIMIT, rng=rng)
    assert told.remaining(0.1) < 100.1 < told.remaining(0.9)


def test_the_score_of_phm_2008_is_the_published_one():
    assert phm_score([100.0], [100.0]) == 0.0
    assert phm_score([110.0, 87.0], [100.0, 100.0]) == pytest.approx(2 * np.expm1(1.0))


@pytest.mark.parametrize(
    ("time", "error", "limit", "words"),
    [
        ([0, 1], 1.0, 1.0, "three"),
        ([0, 2, 1], 1.0, 1.0, "ascend"),
        ([0, 1, 2], 0.0, 1.0, "above 0"),
        ([0, 1, 2], 1.0, 0.0, "limit"),
    ],
)
def test_impossible_data_are_named(time, error, limit, words):
    with pytest.raises(ValueError, match=words):
        forecast_severity(
            time,
            np.zeros(len(time)),
            np.full(len(time), error),
            limit=limit,
            rng=np.random.default_rng(4),
        )
