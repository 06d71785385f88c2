"""Lags of largest cross-correlation: sign, symmetry, ties, and the axis they name."""

import numpy as np
import pytest
from faultgen.analysis.cross_correlation import (
    cross_correlation_lags,
    isolate_axis_by_lags,
    leading_axis,
)


def delayed(delays, n=200, seed=0):
    """Copies of one noise, each delayed by so many samples. Shape (n, len(delays))."""
    noise = np.random.default_rng(seed).normal(size=n + max(delays))
    return np.stack([noise[max(delays) - d :][:n] for d in delays], axis=1)


def test_the_leading_axis_has_the_negative_lag():
    """A copy that trails by 7 gives -7 in the row of the leader and 7 in its own."""
    np.testing.assert_array_equal(cross_correlation_lags(delayed([0, 7])), [[0, -7], [7, 0]])


def test_lags_are_differences_of_delays():
    """Between copies of one signal, each lag is the difference of the two delays."""
    delays = np.array([4, 9, 0, 4, 23, 11])
    lags = cross_correlation_lags(delayed(delays))
    np.testing.assert_array_equal(lags, delays[:, None] - delays[None, :])


def test_lag_maximises_the_thesis_equation():
    """The lag is minus the d at which eq. 3.5 and 3.6, summed as they are printed, are largest."""
    x = np.random.default_rng(1).normal(size=(30, 2)).cumsum(axis=0)
    n = len(x)
    a, b = (x - x.mean(axis=0)).T

    def correlation(d):
        times = range(max(0, -d), min(n, n - d))
        return sum(a[t] * b[t + d] for t in times) / n / (a.std() * b.std())

    assert cross_correlation_lags(x)[0, 1] == -max(range(1 - n, n), key=correlation)


def test_lags_are_antisymmetric_whatever_offset_and_scale():
    """Lag [i, j] is minus lag [j, i], and neither an offset nor a positive factor changes it."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        x = rng.normal(size=(50, 6)).cumsum(axis=0)
        lags = cross_correlation_lags(x)
        np.testing.assert_array_equal(lags, -lags.T)
        np.testing.assert_array_equal(lags, cross_correlation_lags(100 + x * rng.uniform(1, 9, 6)))


def test_a_mirrored_copy_is_not_aligned():
    """The largest correlation counts, not the largest in magnitude."""
    x = delayed([0, 7])
    assert cross_correlation_lags(x * [1, -1])[0, 1] not in (-7, 7)


def test_ties_go_to_the_shortest_lag():
    """Of equal maxima the shortest lag counts, and 0 if both directions are equally short."""
    pulse, both, late = np.zeros((3, 21))
    pulse[10], both[[7, 13]], late[[12, 14]] = 1, 1, 1
    lags = cross_correlation_lags(np.stack([pulse, both, late], axis=1))
    assert lags[0, 1] == 0
    assert lags[0, 2] == -2


def test_constant_series_have_no_lag():
    """A constant axis has lag 0 to all others and changes none of theirs."""
    x = delayed([0, 7, 3])
    x[:, 2] = 0.1
    np.testing.assert_array_equal(cross_correlation_lags(x), [[0, -7, 0], [7, 0, 0], [0, 0, 0]])
    x[:, 2] *= 0
    np.testing.assert_array_equal(cross_correlation_lags(x), [[0, -7, 0], [7, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize("leader", range(4))
def test_the_axis_that_leads_all_is_named(leader):
    """The axis with negative lags only is named wherever it stands."""
    delays = [8, 5, 13, 6]
    delays[leader] = 2
    assert isolate_axis_by_lags(delayed(delays)) == leader


def test_two_leaders_name_none():
    """Where two axes lead together, or none does, no axis is named."""
    assert isolate_axis_by_lags(delayed([0, 5, 0, 3])) == -1
    assert isolate_axis_by_lags(np.ones((40, 6))) == -1


def test_the_rule_names_the_axis_that_the_thesis_names():
    """The lags of thesis table 3.3 name axis 1, though one of its lags is 0."""
    table = [
        [0, -3, -3, -27, 0, -4],
        [3, 0, 0, 0, -38, -2],
        [3, 0, 0, 0, 6, 0],
        [27, 0, 0, 0, -22, 5],
        [0, 38, -6, 22, 0, 32],
        [4, 2, 0, -5, -32, 0],
    ]
    assert leading_axis(table) == 0


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.zeros(9), r"x must have shape \(samples > 1, axes > 1\), got \(9,\)"),
        (np.zeros((9, 1)), r"got \(9, 1\)"),
        (np.zeros((1, 6)), r"got \(1, 6\)"),
        (np.full((9, 2), np.nan), "x has 18 NaN or infinite values"),
    ],
)
def test_errors_name_the_fault(x, message):
    """Bad input raises a ValueError that says what is wrong."""
    for function in (cross_correlation_lags, isolate_axis_by_lags):
        with pytest.raises(ValueError, match=message):
            function(x)
