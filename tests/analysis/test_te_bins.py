"""How many bins for transfer entropy: planted trends, ties, repeatability."""

import faultgen.analysis.te_bins as te_bins
import numpy as np
import pytest
from faultgen.analysis.te_bins import CANDIDATES, choose_bins, isolation_by_bins


@pytest.fixture
def healthy():
    """Axes that share noise and have their own. Shape (series, samples, axes)."""
    rng = np.random.default_rng(0)
    common = rng.normal(size=(12, 100, 1))
    return common + rng.normal(size=(12, 100, 3))


def leading(score):
    """Net transfer entropies of which those of an axis sum up to its score."""
    return score[..., None] * np.eye(score.shape[-1])


def from_the_tail(series, bins):
    """A measure that needs no bins: the last tenth above the rest, in standard deviations."""
    end = series.shape[-2] * 9 // 10
    rest, tail = series[..., :end, :], series[..., end:, :]
    return leading((tail.mean(axis=-2) - rest.mean(axis=-2)) / rest.std(axis=-2))


def test_accuracy_rises_with_amplitude(healthy):
    """Without a trend a third of the axes is named, which is chance; with a large one far more."""
    shares = [
        isolation_by_bins(healthy, candidates=(5, 10), amplitudes=(a,)).mean()
        for a in (0.0, 4.0, 10.0)
    ]
    # each series names one axis for all three places of no trend
    assert shares[0] == pytest.approx(1 / 3)
    # 36 places and 2 numbers of bins: a standard error of at most 0.08 a share
    assert shares[1] > 1 / 3 + 3 * 0.08
    assert shares[2] > 0.9
    assert shares[1] < shares[2]


def test_trend_is_put_on_the_axis_that_counts_as_truth(healthy, monkeypatch):
    """An isolator that sees the trend is always right, its opposite never; amplitudes pool."""
    monkeypatch.setattr(te_bins, "net_transfer_entropy", from_the_tail)
    assert isolation_by_bins(healthy, candidates=(2,), amplitudes=(50.0,)) == [1.0]
    pooled = isolation_by_bins(healthy, candidates=(2,), amplitudes=(0.0, 50.0))
    assert pooled == pytest.approx([(1 / 3 + 1) / 2])
    next_axis = lambda x, bins: np.roll(from_the_tail(x, bins), 1, axis=-2)  # noqa: E731
    monkeypatch.setattr(te_bins, "net_transfer_entropy", next_axis)
    assert isolation_by_bins(healthy, candidates=(2,), amplitudes=(50.0,)) == [0.0]


def test_trend_has_the_size_and_shape_that_is_stated(healthy, monkeypatch):
    """The trend is A sd (k / n)^4 on one axis, and nothing else is touched."""
    seen = []

    def record(series, bins):
        seen.append(series)
        return leading(series[..., 0, :])

    monkeypatch.setattr(te_bins, "net_transfer_entropy", record)
    before = healthy.copy()
    isolation_by_bins(healthy, candidates=(4,), amplitudes=(1.0, 2.0))
    np.testing.assert_array_equal(healthy, before)
    trend = (np.arange(1, 101) / 100) ** 4
    expected = np.zeros((6, *healthy.shape))
    for index, (axis, amplitude) in enumerate((a, b) for a in range(3) for b in (1.0, 2.0)):
        sd = healthy[:, :, axis].std(axis=1, keepdims=True)
        expected[index, :, :, axis] = amplitude * sd * trend
    np.testing.assert_allclose(seen[0] - healthy, expected, atol=1e-12)


def test_choice_is_the_best_candidate(healthy):
    """The choice is the candidate with the largest share, again and again the same."""
    candidates = (20, 3, 6, 10)
    share = isolation_by_bins(healthy, candidates=candidates)
    assert share.shape == (4,) and (0 <= share).all() and (share <= 1).all()
    assert len(set(share)) > 1
    choice = choose_bins(healthy, candidates=candidates)
    assert choice == candidates[share.argmax()] == choose_bins(healthy, candidates=candidates)
    assert choose_bins(healthy[:4]) in CANDIDATES
    assert choose_bins(healthy, candidates=(7,)) == 7


@pytest.mark.parametrize("candidates", [(2, 3, 4), (4, 3, 2), (3, 4, 2)])
def test_fewer_bins_on_ties(healthy, candidates, monkeypatch):
    """Of candidates that name equally many trends the smallest is chosen, in any order."""
    monkeypatch.setattr(te_bins, "net_transfer_entropy", from_the_tail)
    assert choose_bins(healthy, candidates=candidates) == 2


def test_unit_of_an_axis_does_not_matter(healthy):
    """Axes in other units, or shifted, give the same shares."""
    moved = healthy * [1e-3, 1.0, 50.0] + [0.0, 7.0, -300.0]
    np.testing.assert_array_equal(
        isolation_by_bins(moved, candidates=(3, 10)), isolation_by_bins(healthy, candidates=(3, 10))
    )


def test_no_bins_are_refused(healthy):
    """Candidates that mean nothing are refused as transfer entropy refuses them."""
    with pytest.raises(ValueError, match="bins"):
        choose_bins(healthy, candidates=(0,))
