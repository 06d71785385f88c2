"""The detector of known effects in sequences of recordings, on data drawn from its own model."""

import numpy as np
import pytest
from faultgen.analysis import Cause, Days, EffectPosterior, Effects, Form
from scipy.stats import multivariate_normal
from sklearn.base import clone

FEATURES, AXES, KINDS = 200, 3, 4
RATE = 1 / 150


@pytest.fixture(scope="module")
def known():
    """Columns of days and effects; each effect resembles the friction of its axis."""
    rng = np.random.default_rng(1)
    days = 0.3 * rng.standard_normal((AXES, FEATURES))
    columns = np.repeat(days, KINDS, axis=0) + 0.3 * rng.standard_normal((AXES * KINDS, FEATURES))
    causes = [
        Cause(f"effect {k} on axis {axis + 1}", str(k), (Form((KINDS * axis + k,), (2.0,)),), True)
        for axis in range(AXES)
        for k in range(KINDS)
    ]
    return (
        Effects(columns, tuple(causes)),
        Days(days, np.full(AXES, 0.5), np.zeros(AXES, int), np.array([2.0])),
    )


def recordings(known, count, rng, change=0.0, scale=1.0):
    """Recordings of a robot."""
    _, days = known
    daily = scale * 0.5 * rng.standard_normal((count, AXES))
    return 7.0 + daily @ days.columns + rng.standard_normal((count, FEATURES)) + change


def fitted(known, healthy, **given):
    return EffectPosterior(*known, **{"false_alarms": RATE, **given}).fit(healthy)


def test_probabilities_are_those_of_normal_densities(known):
    """Bayes' rule with the full covariance matrices of the features, on a grid of severities."""
    effects, days = known
    rng = np.random.default_rng(2)
    healthy = recordings(known, 6, rng)
    model = fitted(known, healthy)
    x = recordings(known, 1, rng, 0.8 * effects.columns[5])
    std = days.stds * np.exp(model.log_scales_[0])
    one = (days.columns.T * std**2) @ days.columns + model.noise_ * np.eye(FEATURES)
    apart = x[0] - healthy.mean(axis=0)
    density = multivariate_normal(np.zeros(FEATURES), one * (1 + 1 / 6))
    grid = (np.arange(4000) + 0.5) * 3e-3  # up to six standard deviations
    prior = 2 * np.exp(-0.5 * (grid / 2) ** 2) / (2 * np.sqrt(2 * np.pi)) * 3e-3
    logs = [density.logpdf(apart)]
    for column in effects.columns:
        each = density.logpdf(apart - grid[:, None] * column)
        logs.append(np.log(np.sum(prior * np.exp(each - each.max()))) + each.max())
    weight = np.exp(np.array(logs) - max(logs)) * np.array([1.0, *[1 / 12] * 12])
    np.testing.assert_allclose(model.predict_proba(x)[0], weight / weight.sum(), atol=1e-6)


def test_scales_of_days_are_found_and_count_as_uncertain_when_recordings_are_few(known):
    rng = np.random.default_rng(3)
    many = fitted(known, recordings(known, 60, rng, scale=3.0))
    assert np.exp(many.log_scales_[0]) == pytest.approx(3.0, rel=0.2)
    assert many.noise_ == pytest.approx(1.0, rel=0.05)
    few = fitted(known, recordings(known, 2, rng, scale=3.0))
    one = fitted(known, recordings(known, 1, rng, scale=3.0))
    assert many.scale_errors_[0] < few.scale_errors_[0] < one.scale_errors_[0]
    assert one.scale_errors_[0] == pytest.approx(np.log(2.0))


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3, 10])
def test_false_alarms_occur_at_the_stated_rate(known, count):
    """Robots whose healthy spread differs from the usual one as much as was stated."""
    rng = np.random.default_rng(4 + count)
    robots, length, alarmed = 24, 60, 0
    for robot in range(robots):
        scale = float(np.exp(np.log(2.0) * rng.standard_normal()))
        model = fitted(known, recordings(known, count, rng, scale=scale), random_state=robot)
        scores = model.transform(recordings(known, length, rng, scale=scale))
        alarmed += any(model.judge(scores[: k + 1]).alarm for k in range(0, length, 3))
    expected = robots * -np.expm1(-RATE * length)
    assert alarmed < expected + 3 * np.sqrt(expected)
    assert alarmed > expected / 4


def test_a_difference_between_days_that_no_column_describes_is_learned(known):
    """Without it, recordings of a healthy robot look like an effect."""
    effects, _ = known
    rng = np.random.default_rng(40)
    unknown = effects.columns[[0, 5, 10]].sum(axis=0) + rng.standard_normal(FEATURES)
    unknown *= 8 / np.linalg.norm(unknown)

    def robot(count):
        return recordings(known, count, rng, rng.standard_normal((count, 1)) * unknown)

    many, few = fitted(known, robot(100)), fitted(known, robot(3))
    assert len(many.directions_) == 1 and len(few.directions_) == 0
    # the part of it that effects can show, whose size is known to within its sampling error
    weight = many.projection_
    found, true = many.directions_[0] @ weight, unknown @ weight
    size = np.linalg.solve(many.information_, true) @ true
    overlap = np.linalg.solve(many.information_, true) @ found / size
    assert abs(overlap) == pytest.approx(1.0, abs=0.3)
    assert np.mean([many.judge(one).alarm for one in many.transform(robot(400))]) < 3 * RATE
    blind = fitted(known, robot(100))
    blind.restore({**blind.state(), "directions_": np.zeros((0, FEATURES))})
    assert np.mean([blind.judge(one).alarm for one in blind.transform(robot(400))]) > 10 * RATE


@pytest.mark.slow
def test_no_difference_is_learned_where_there_is_none(known):
    rng = np.random.default_rng(41)
    found = [len(fitted(known, recordings(known, 30, rng)).directions_) for _ in range(8)]
    assert sum(found) <= 1


def test_an_effect_is_named_with_its_beginning_and_severity(known):
    effects, _ = known
    rng = np.random.default_rng(5)
    model = fitted(known, recordings(known, 5, rng))
    inside = right = since = 0
    for _ in range(40):
        cause = int(rng.integers(len(effects.causes)))
        before = recordings(known, 10, rng)
        after = recordings(known, 10, rng, 0.8 * effects.columns[cause])
        told = model.judge(model.transform(np.concatenate([before, after])))
        right += told.alarm and told.best == cause
        since += abs(told.since - 10) <= 3
        low, high = told.intervals[cause]
        inside += low <= 0.8 <= high
        assert told.healthy + told.probabilities.sum() == pytest.approx(1.0)
    assert right >= 38 and since >= 36 and inside >= 35


def test_sequences_show_what_single_recordings_do_not(known):
    effects, _ = known
    rng = np.random.default_rng(6)
    model = fitted(known, recordings(known, 30, rng))
    scores = model.transform(recordings(known, 60, rng, 0.3 * effects.columns[1]))
    assert not model.judge(scores[:1]).alarm
    assert model.judge(scores).best == 1 and model.judge(scores).alarm


@pytest.mark.slow
def test_delays_are_those_of_recordings(known):
    effects, _ = known
    rng = np.random.default_rng(7)
    model = fitted(known, recordings(known, 200, rng))
    promised = model.delays(1, 0.25, longest=40)
    seen = []
    for _ in range(60):
        scores = model.transform(recordings(known, 40, rng, 0.25 * effects.columns[1]))
        alarms = [k + 1 for k in range(40) if model.judge(scores[: k + 1]).alarm]
        seen.append(alarms[0] if alarms else np.inf)
    assert np.median(seen) == pytest.approx(np.median(promised), abs=3)


def test_many_robots_are_tested_at_once_as_each_is_judged(known):
    """Statistic and most probable cause are those of `judge`, healthy robots included."""
    effects, _ = known
    rng = np.random.default_rng(8)
    model = fitted(known, recordings(known, 20, rng))
    changes = [0.0, 0.4 * effects.columns[5], 1.5 * effects.columns[9]]
    scores = np.array([model.transform(recordings(known, 14, rng, c)) for c in changes])
    statistic, odds = model.strongest(scores)
    for one, value, logs in zip(scores, statistic, odds, strict=True):
        told = model.judge(one)
        assert value == pytest.approx(told.statistic) and np.argmax(logs) == told.best
    assert statistic[2] > model.limit_ > statistic[0] and np.argmax(odds[2]) == 9


def test_results_repeat_and_the_estimator_can_be_cloned(known):
    healthy = recordings(known, 4, np.random.default_rng(8))
    first = fitted(known, healthy)
    again = clone(first).fit(healthy)
    assert first.limit_ == again.limit_
    assert first.get_params()["false_alarms"] == RATE


@pytest.mark.parametrize(
    ("given", "words"), [({"false_alarms": 0}, "false_alarms"), ({"prior": 1.0}, "prior")]
)
def test_impossible_numbers_are_named(known, given, words):
    with pytest.raises(ValueError, match=words):
        fitted(known, recordings(known, 2, np.random.default_rng(9)), **given)


def test_other_features_are_named(known):
    with pytest.raises(ValueError, match="3 features, but the effects have 200"):
        fitted(known, np.zeros((2, 3)))


def test_another_prior_counts_after_another_fit(known):
    healthy = recordings(known, 4, np.random.default_rng(10))
    model = fitted(known, healthy)
    before = model.predict_proba(healthy)[:, 0]
    after = model.set_params(prior=0.01).fit(healthy).predict_proba(healthy)[:, 0]
    np.testing.assert_allclose(after / (1 - after), 99 * before / (1 - before), rtol=1e-6)
