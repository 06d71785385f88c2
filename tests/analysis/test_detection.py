"""Control charts and their run lengths against published tables and simulation."""

import numpy as np
import pytest
from faultgen.analysis.detection import CUSUMChart, EWMAChart
from faultgen.analysis.run_length import (
    cusum_interval,
    cusum_run_length,
    ewma_run_length,
    ewma_width,
)
from scipy.stats import norm

CHARTS = [EWMAChart, CUSUMChart]


def autoregression(rng, r, shape):
    """Stationary first-order autoregressions of mean 0 and deviation 1, along the first axis."""
    x = rng.normal(size=shape)
    for t in range(1, len(x)):
        x[t] = r * x[t - 1] + np.sqrt(1 - r**2) * x[t]
    return x


def first_alarms(chart, x):
    """Number of samples up to the first alarm, counted to the end where there is none. (runs,)."""
    return np.array(
        [len(x) if (i := chart.first_alarm(run)) is None else i + 1 for run in x.T], dtype=float
    )


# Run lengths


@pytest.mark.parametrize(
    ("weight", "width", "expected"),
    [
        (0.40, 3.054, [500, 224, 71.2, 28.4, 14.3, 5.9, 3.5, 2.5, 2.0, 1.4]),
        (0.25, 2.998, [500, 170, 48.2, 20.1, 11.1, 5.5, 3.6, 2.7, 2.3, 1.7]),
        (0.20, 2.962, [500, 150, 41.8, 18.2, 10.5, 5.5, 3.7, 2.9, 2.4, 1.9]),
        (0.10, 2.814, [500, 106, 31.3, 15.9, 10.3, 6.1, 4.4, 3.4, 2.9, 2.2]),
        (0.05, 2.615, [500, 84.1, 28.8, 16.4, 11.4, 7.1, 5.2, 4.2, 3.5, 2.7]),
    ],
)
def test_ewma_equals_lucas_and_saccucci(weight, width, expected):
    """Two-sided EWMA charts have the run lengths of Lucas and Saccucci (1990), table 3.

    Theirs are rounded to three digits or one decimal.
    """
    shifts = [0, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 4]
    means = [ewma_run_length(weight, width, shift, two_sided=True).mean for shift in shifts]
    np.testing.assert_allclose(means, expected, rtol=3.5e-3, atol=0.05)


def test_ewma_equals_sas():
    """The example of SAS's function EWMAARL, by Crowder's method: shift 1, weight 0.25, width 3."""
    assert ewma_run_length(0.25, 3, 1, two_sided=True).mean == pytest.approx(11.154267016, abs=1e-8)


@pytest.mark.parametrize(
    ("interval", "one_sided", "expected"),
    [
        (4, 335.4, [168, 74.2, 26.6, 13.3, 8.38, 4.75, 3.34, 2.62, 2.19, 1.71]),
        (5, 930.9, [465, 139, 38.0, 17.0, 10.4, 5.75, 4.01, 3.11, 2.57, 2.01]),
    ],
)
def test_cusum_equals_tables(interval, one_sided, expected):
    """CUSUM charts of reference 0.5 have the run lengths of Lucas and Crosier (1982)."""
    shifts = [0, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 4]
    means = [cusum_run_length(0.5, interval, shift, two_sided=True).mean for shift in shifts]
    np.testing.assert_allclose(means, expected, rtol=4e-3)
    assert cusum_run_length(0.5, interval).mean == pytest.approx(one_sided, abs=0.1)


def test_weight_one_is_a_shewhart_chart():
    """With a weight of 1 the run length is geometric."""
    for two_sided, chance in ((True, 2 * norm.sf(3)), (False, norm.sf(3))):
        run = ewma_run_length(1, 3, two_sided=two_sided)
        assert run.mean == pytest.approx(1 / chance, rel=1e-8)
        assert run.probability_within(1) == pytest.approx(chance, rel=1e-8)
        assert run.probability_within(200) == pytest.approx(1 - (1 - chance) ** 200, rel=1e-8)
    away = ewma_run_length(1, 0.1, shift=-5)
    assert away.mean == pytest.approx(1 / norm.sf(5.1), rel=1e-6)


@pytest.mark.parametrize("two_sided", [False, True])
def test_distribution_has_the_mean(two_sided):
    """The mean is the sum of the probabilities that no alarm has come yet."""
    for run in (
        ewma_run_length(0.5, 1, 0.3, two_sided=two_sided, first_shift=1),
        cusum_run_length(0.5, 1, 0.3, first_shift=1),
    ):
        silent = [1 - run.probability_within(n) for n in range(120)]
        assert silent[0] == 1
        assert np.all(np.diff(silent) <= 0)
        assert np.sum(silent) == pytest.approx(run.mean, rel=1e-6)


def test_limits_give_the_run_length():
    """Width and interval are solved to the run length asked for, as in the tables."""
    assert ewma_width(0.1, 500, two_sided=True) == pytest.approx(2.814, abs=1e-3)
    assert ewma_width(0.25, 500, two_sided=True) == pytest.approx(2.998, abs=1e-3)
    for two_sided in (False, True):
        for length in (20, 1e6):
            width = ewma_width(0.3, length, two_sided=two_sided)
            assert ewma_run_length(0.3, width, two_sided=two_sided).mean == pytest.approx(length)
            interval = cusum_interval(0.25, length, two_sided=two_sided)
            run = cusum_run_length(0.25, interval, two_sided=two_sided)
            assert run.mean == pytest.approx(length)


# Charts


@pytest.mark.parametrize("chart", [EWMAChart(weight=0.3, two_sided=True), CUSUMChart(shift=0.8)])
def test_statistic_is_the_recursion(chart):
    """The statistic is the recursion that defines it, on standard residuals."""
    rng = np.random.default_rng(0)
    chart.fit(5 + 2 * autoregression(rng, 0.6, (300,)))
    x = 5 + 2 * autoregression(rng, 0.6, (50,)) + np.linspace(0, 5, 50)
    z = [(x[0] - chart.mean_) / chart.std_]
    for before, now in zip(x[:-1], x[1:], strict=True):
        expected = chart.mean_ + chart.autocorrelation_ * (before - chart.mean_)
        z.append((now - expected) / chart.residual_std_)
    statistic, values = 0.0, []
    for residual in z:
        if isinstance(chart, EWMAChart):
            statistic = 0.3 * residual + 0.7 * statistic
        else:
            statistic = max(0.0, statistic + residual - 0.4)
        values.append(statistic)
    np.testing.assert_allclose(chart.statistic(x), values, atol=1e-12)


def test_fit_recovers_the_model():
    """Mean, deviation and autocorrelation of a long series are found."""
    x = 20 + 3 * autoregression(np.random.default_rng(1), 0.8, (50_000,))
    chart = EWMAChart().fit(x)
    # Standard errors: 0.04, 0.03 and 0.003.
    assert chart.mean_ == pytest.approx(20, abs=0.2)
    assert chart.std_ == pytest.approx(3, abs=0.1)
    assert chart.autocorrelation_ == pytest.approx(0.8, abs=0.01)
    assert chart.residual_std_ == pytest.approx(1.8, abs=0.03)


def test_autocorrelation_of_short_series_is_not_too_low():
    """The mean over many short series is the autocorrelation, which a plain estimate misses."""
    x = autoregression(np.random.default_rng(2), 0.5, (40, 2000))
    charts = [EWMAChart().fit(series) for series in x.T]
    # Standard error 0.003; a plain estimate has a mean of 0.43.
    assert np.mean([c.autocorrelation_ for c in charts]) == pytest.approx(0.5, abs=0.03)
    # Standard error 0.004; divided by the number of samples, the mean is 0.70.
    assert np.mean([c.residual_std_**2 for c in charts]) == pytest.approx(0.75, abs=0.02)


@pytest.mark.parametrize("kind", CHARTS)
@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("r", [-0.4, 0.0, 0.8])
def test_run_length_in_simulation(kind, two_sided, r):
    """Simulated autoregressions have the run lengths computed, healthy and shifted."""
    rng = np.random.default_rng(3)
    chart = kind(in_control_run_length=50, two_sided=two_sided)
    chart.fit(autoregression(rng, r, (20,)))
    chart.mean_, chart.std_, chart.autocorrelation_ = 0.0, 1.0, r
    chart.residual_std_ = np.sqrt(1 - r**2)
    x = autoregression(rng, r, (600, 1500))
    for shift in (0.0, 1.5):
        alarms = first_alarms(chart, x + shift)
        error = alarms.std() / np.sqrt(len(alarms))
        assert alarms.mean() == pytest.approx(chart.average_run_length(shift), abs=4 * error)
    assert chart.average_run_length() == pytest.approx(50)
    # Two sums of a CUSUM are not quite independent.
    share = np.mean(first_alarms(chart, x) <= 30)
    assert share == pytest.approx(chart.run_length().probability_within(30), abs=0.05)


@pytest.mark.parametrize("kind", CHARTS)
def test_autocorrelation_does_not_raise_false_alarms(kind):
    """Charts fitted to a long autoregression give as many false alarms as asked for."""
    rng = np.random.default_rng(4)
    chart = kind(in_control_run_length=100).fit(autoregression(rng, 0.9, (100_000,)))
    alarms = first_alarms(chart, autoregression(rng, 0.9, (1000, 600)))
    # Standard error 4; a chart of the values themselves has a run length of 30.
    assert alarms.mean() == pytest.approx(100, abs=16)


@pytest.mark.parametrize("kind", CHARTS)
def test_cube_root_of_sums_of_squares(kind):
    """The cube root of chi-squared values gives about as many false alarms as asked for."""
    rng = np.random.default_rng(8)
    chart = kind(in_control_run_length=100).fit(np.cbrt(rng.chisquare(3, 50_000)))
    alarms = first_alarms(chart, np.cbrt(rng.chisquare(3, (1000, 1000))))
    # Standard error 3; the values themselves give 80 and 49.
    assert alarms.mean() == pytest.approx(100, abs=15)


@pytest.mark.parametrize("kind", CHARTS)
def test_alarms_are_those_beyond_the_limit(kind):
    """Prediction, first alarm and statistic agree; one-sided charts watch for increases only."""
    rng = np.random.default_rng(5)
    healthy = rng.normal(size=500)
    x = rng.normal(size=100)
    x[60:] += 2
    for two_sided, series in ((False, x), (True, x), (True, -x)):
        chart = kind(in_control_run_length=1000, two_sided=two_sided).fit(healthy)
        predicted = chart.predict(series)
        assert set(predicted) == {-1, 1}
        beyond = np.abs(chart.statistic(series)) > chart.limit_
        np.testing.assert_array_equal(predicted == -1, beyond)
        assert 60 <= chart.first_alarm(series) <= 75
        assert chart.first_alarm(series) == np.argmax(predicted == -1)
    chart = kind(in_control_run_length=1000).fit(healthy)
    assert chart.first_alarm(-x) is None
    assert np.all(chart.predict(-x) == 1)


@pytest.mark.parametrize("kind", CHARTS)
def test_units_do_not_matter(kind):
    """Another unit and origin of the values change nothing."""
    rng = np.random.default_rng(6)
    healthy, x = rng.normal(size=200), rng.normal(size=50)
    a, b = kind().fit(healthy), kind().fit(40 + 3 * healthy)
    np.testing.assert_allclose(a.statistic(x), b.statistic(40 + 3 * x), atol=1e-10)
    assert a.limit_ == b.limit_


X = np.random.default_rng(7).normal(size=50)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: EWMAChart().fit(X[:9]), "at least 10 samples are needed, got 9"),
        (lambda: EWMAChart().fit(np.full(20, 3.0)), "x is constant at 3"),
        (lambda: EWMAChart().fit(X[:, None]), r"x must have shape \(samples,\), got \(50, 1\)"),
        (lambda: EWMAChart().fit([np.nan, *X]), "x has 1 NaN or infinite values"),
        (lambda: EWMAChart().statistic(X), "the chart is not fitted"),
        (lambda: CUSUMChart().average_run_length(), "the chart is not fitted"),
        (lambda: EWMAChart(weight=0).fit(X), "weight must be above 0 and at most 1, got 0"),
        (lambda: EWMAChart(weight=1.1).fit(X), "weight must be above 0 and at most 1, got 1.1"),
        (lambda: CUSUMChart(shift=-1).fit(X), "reference must be at least 0, got -0.5"),
        (
            lambda: CUSUMChart(in_control_run_length=1).fit(X),
            r"run length must lie between .* and 1e\+09 samples, got 1",
        ),
        (lambda: ewma_run_length(0.1, 0), "width must be above 0, got 0"),
        (lambda: cusum_run_length(0.5, 0), "interval must be above 0, got 0"),
        (lambda: ewma_run_length(1, 3).probability_within(-1), "samples must be at least 0, got"),
    ],
)
def test_errors_name_the_fault(call, message):
    """Bad input raises a ValueError that says what is wrong."""
    with pytest.raises(ValueError, match=message):
        call()
