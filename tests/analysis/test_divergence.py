"""Divergence of histograms against scipy, a worked value and its own symmetries."""

import numpy as np
import pytest
from faultgen.analysis.divergence import HistogramDivergence, kl_divergence
from scipy import stats
from sklearn.base import clone
from sklearn.exceptions import NotFittedError


@pytest.fixture
def rng():
    return np.random.default_rng(0)


# Divergence


def test_worked_value():
    """An empty bin of p adds nothing, also where q is empty: .0660149997 bit."""
    p, q = [0.1, 0.4, 0.5, 0], [0.2, 0.3, 0.5, 0]
    assert kl_divergence(p, q) == pytest.approx(0.0660149997, abs=5e-11)
    assert kl_divergence(p, q) == pytest.approx(0.0457581109 / np.log(2), abs=1e-10)
    # One sample against even odds is one bit.
    assert kl_divergence([1, 0], [7, 7]) == 1


def test_equals_scipy(rng):
    """Of any counts, with and without smoothing, the divergence is scipy's relative entropy."""
    for bins in range(1, 20):
        p, q = rng.integers(0, 9, bins) + (np.arange(bins) == 0), rng.integers(1, 99, bins)
        assert kl_divergence(p, q) == pytest.approx(stats.entropy(p, q, base=2), abs=1e-12)
        for smoothing in (0.01, 0.5, 3):
            scaled = q * p.sum() / q.sum()
            expected = stats.entropy(p + smoothing, scaled + smoothing, base=2)
            assert kl_divergence(p, q, smoothing=smoothing) == pytest.approx(expected, abs=1e-12)


def test_empty_bins_of_the_reference():
    """What the reference never showed is infinitely far, unless smoothing makes it finite."""
    assert kl_divergence([1, 1], [2, 0]) == np.inf
    assert kl_divergence([2, 0], [1, 1]) == 1
    # Smoothed shares are (1.5, 1.5) / 3 and (2.5, .5) / 3.
    expected = 0.5 * np.log2(1.5 / 2.5) + 0.5 * np.log2(1.5 / 0.5)
    assert kl_divergence([1, 1], [2, 0], smoothing=0.5) == pytest.approx(expected)


def test_more_samples_count_more_than_smoothing():
    """Smoothing weighs less the more samples there are, so that the divergence grows with them."""
    values = [kl_divergence([0, n], [n, 0], smoothing=0.5) for n in (1, 10, 100, 1000)]
    assert np.all(np.diff(values) > 1)


def test_divergence_properties(rng):
    """It is 0 for equal shares only, not symmetric, and blind to order and number of samples."""
    p, q = rng.integers(1, 50, (2, 12))
    order = rng.permutation(12)
    assert kl_divergence(p, q) > 0
    assert kl_divergence(p, q) != pytest.approx(kl_divergence(q, p))
    assert kl_divergence(p[order], q[order]) == pytest.approx(kl_divergence(p, q))
    assert kl_divergence(7 * p, 3 * q) == pytest.approx(kl_divergence(p, q))
    assert kl_divergence(p, 3 * p) == pytest.approx(0, abs=1e-15)
    assert kl_divergence(p, p, smoothing=0.5) == 0
    assert kl_divergence(p, 120 * np.asarray(p), smoothing=0.5) == pytest.approx(0, abs=1e-12)


def test_divergence_is_never_negative(rng):
    """Rounding does not make nearly equal shares diverge by less than nothing."""
    p = rng.random((2000, 12))
    assert (kl_divergence(p, p * (1 + 1e-15 * rng.normal(size=p.shape))) >= 0).all()


def test_batch(rng):
    """Leading dimensions are a batch, and one reference serves all of it."""
    p, q = rng.integers(1, 9, (4, 3, 12)), rng.integers(1, 9, 12)
    batch = kl_divergence(p, q)
    assert batch.shape == (4, 3)
    assert batch[2, 1] == kl_divergence(p[2, 1], q)


@pytest.mark.parametrize(
    ("p", "q", "smoothing", "message"),
    [
        ([1, 2], [1, 2, 3], 0, "same bins"),
        (1, 2, 0, "same bins"),
        ([], [], 0, "same bins"),
        ([1, -1], [1, 1], 0, "p has counts that are negative"),
        ([1, 1], [1, np.nan], 0, "q has counts"),
        ([1, 1], [0, 0], 0.5, "q has no samples"),
        ([1, 1], [1, 1], -0.5, "smoothing must be .* got -0.5"),
        ([1, 1], [1, 1], np.nan, "smoothing"),
    ],
)
def test_invalid_counts(p, q, smoothing, message):
    """Histograms that cannot be compared are refused."""
    with pytest.raises(ValueError, match=message):
        kl_divergence(p, q, smoothing=smoothing)


# Histograms


def test_histogram_is_that_of_numpy(rng):
    """Within the reference's range the counts and edges are those of numpy, axis by axis."""
    x = rng.normal(size=(300, 3)) * [1, 20, 0.1]
    healthy = HistogramDivergence().fit(x)
    assert healthy.reference_.shape == (3, 12)
    for axis in range(3):
        counts, edges = np.histogram(x[:, axis], 12)
        np.testing.assert_array_equal(healthy.reference_[axis], counts)
        np.testing.assert_allclose(healthy.edges_[axis], edges)
    one = HistogramDivergence().fit(x[:, 1])
    np.testing.assert_array_equal(one.reference_, healthy.reference_[1:2])


def test_bins_are_left_closed():
    """A value on an edge belongs to the bin above, the highest to the last bin."""
    healthy = HistogramDivergence(bins=4).fit([0.0, 1.0, 2.0, 3.0, 3.5, 4.0])
    np.testing.assert_array_equal(healthy.reference_, [[1, 1, 1, 3]])


def test_overflow_counts_in_the_end_bins(rng):
    """No sample is dropped: those beyond the reference count in the bins at the ends."""
    healthy = HistogramDivergence(bins=4, range=(0, 4)).fit([0.5, 1.5, 2.5, 3.5])
    counts = healthy.counts([-1e9, -0.1, 0.5, 2.5, 4.1, 7, 1e9])
    np.testing.assert_array_equal(counts, [[3, 0, 1, 3]])
    x = rng.normal(size=(500, 2))
    assert (HistogramDivergence().fit(x).counts(5 * x).sum(axis=1) == 500).all()


def test_range_for_each_axis():
    """Edges can be set beforehand, for all axes at once or for each."""
    x = [[0.5, 5.0], [0.6, -5.0]]
    common = HistogramDivergence(bins=2, range=(-1, 1)).fit(x)
    np.testing.assert_array_equal(common.edges_, [[-1, 0, 1]] * 2)
    own = HistogramDivergence(bins=2, range=([-1, -8], [1, 8])).fit(x)
    np.testing.assert_array_equal(own.edges_, [[-1, 0, 1], [-8, 0, 8]])
    np.testing.assert_array_equal(own.reference_, [[0, 2], [1, 1]])


def test_divergence_of_each_axis(rng):
    """The divergence is that of the two histograms of the axis, current from reference."""
    x, hour = rng.normal(size=(6000, 3)), rng.normal(size=(60, 3)) * [1, 1, 3]
    for smoothing in (0.5, 2.0):
        healthy = HistogramDivergence(smoothing=smoothing).fit(x)
        divergence = healthy.divergence(hour)
        assert divergence.shape == (3,)
        for axis in range(3):
            edges = np.linspace(x[:, axis].min(), x[:, axis].max(), 13)
            clipped = np.clip(hour[:, axis], edges[0], edges[-1])
            p, q = np.histogram(clipped, edges)[0], np.histogram(x[:, axis], edges)[0]
            scaled = q * 60 / 6000
            expected = stats.entropy(p + smoothing, scaled + smoothing, base=2)
            assert divergence[axis] == pytest.approx(expected)
    assert (healthy.divergence(x) == 0).all()


def test_wear_shows_in_its_axis(rng):
    """Of hours of 60 samples of torque, only the axis that is worn leaves the healthy hours."""
    healthy = HistogramDivergence().fit(rng.normal(size=(60 * 24, 6)))
    hours = [healthy.divergence(rng.normal(size=(60, 6))) for _ in range(100)]
    worn = healthy.divergence(rng.normal(size=(60, 6)) + [0, 0, 1.5, 0, 0, 0])
    np.testing.assert_array_equal(worn > np.max(hours, axis=0), np.arange(6) == 2)


def test_units_and_order_do_not_matter(rng):
    """Another unit of torque, a shift of it and another order of samples change nothing."""
    x, hour = rng.normal(size=(500, 2)), 2 * rng.normal(size=(60, 2))
    one = HistogramDivergence().fit(x).divergence(hour)
    other = HistogramDivergence().fit(1e6 * x + 3e5)
    np.testing.assert_allclose(other.divergence(1e6 * hour + 3e5), one)
    np.testing.assert_array_equal(HistogramDivergence().fit(x).divergence(hour[::-1]), one)


@pytest.mark.parametrize("value", [0.0, 0.1, -3e8, 1e-12])
@pytest.mark.parametrize("bins", [2, 3, 12])
def test_axis_that_never_moves(value, bins):
    """A constant axis does not diverge by rounding, and does as soon as it moves."""
    still = np.full(60, value)
    healthy = HistogramDivergence(bins=bins).fit(np.append(still, value * (1 + 3e-16)))
    assert (np.diff(healthy.edges_) > 0).all()
    assert healthy.reference_.max() == 61
    for rounding in (1 - 1e-15, 1, 1 + 1e-15):
        assert healthy.counts(rounding * still).argmax() == healthy.reference_.argmax()
    assert healthy.divergence(still) < 0.01
    step = 1e-6 * (abs(value) or 1.0)
    for moved, end in ((still + step, bins - 1), (still - step, 0)):
        assert healthy.counts(moved)[0, end] == 60
    assert healthy.divergence(still - step) > 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"bins": 1}, "bins must be .* got 1"),
        ({"bins": 2.5}, "bins must be"),
        ({"range": (1, 1)}, "range must be finite and ascending"),
        ({"range": (0, np.inf)}, "range must be"),
        ({"range": ([0, 0], [1, -1])}, "range must be"),
    ],
)
def test_invalid_arguments(rng, arguments, message):
    """Arguments that mean nothing are refused when the reference is fitted."""
    with pytest.raises(ValueError, match=message):
        HistogramDivergence(**arguments).fit(rng.normal(size=(60, 2)))


def test_invalid_samples(rng):
    """Samples that cannot be counted are refused, as is an estimator without a reference."""
    x = rng.normal(size=(60, 2))
    with pytest.raises(NotFittedError):
        HistogramDivergence().divergence(x)
    for bad, message in (
        (np.where(x == x.max(), np.nan, x), "1 NaN"),
        (np.empty((0, 2)), "X must have shape"),
        (x[None], "X must have shape"),
    ):
        with pytest.raises(ValueError, match=message):
            HistogramDivergence().fit(bad)
    healthy = HistogramDivergence().fit(x)
    with pytest.raises(ValueError, match="X has 3 axes, the reference has 2"):
        healthy.divergence(rng.normal(size=(60, 3)))
    with pytest.raises(ValueError, match="X has 1 axes"):
        healthy.divergence(x[:, 0])
    with pytest.raises(ValueError, match="smoothing"):
        HistogramDivergence(smoothing=-1).fit(x).divergence(x)


def test_clone_has_the_arguments_only(rng):
    """A clone starts unfitted with the same arguments, as scikit-learn's tools expect."""
    fitted = HistogramDivergence(bins=5, smoothing=1.0, range=(-1, 1)).fit(rng.normal(size=60))
    copy = clone(fitted)
    assert copy.get_params() == {"bins": 5, "smoothing": 1.0, "range": (-1, 1)}
    assert not hasattr(copy, "edges_")
