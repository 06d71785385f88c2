"""Transfer entropy against RTransferEntropy, Inform, closed forms and its own symmetries."""

import importlib
import json
from fractions import Fraction
from math import floor, log, log2
from pathlib import Path

import numpy as np
import pytest
from faultgen.analysis.symbols import quantile_symbols
from faultgen.analysis.transfer_entropy import (
    effective_net_transfer_entropy,
    effective_transfer_entropy,
    isolate_axis,
    net_transfer_entropy,
    shuffled,
    transfer_entropy,
    transfer_entropy_matrix,
)
from scipy.signal import lfilter

from faultgen import analysis

TESTS = Path(__file__).parents[1]
VALUES = TESTS.parents[1] / "shared" / "reference" / "values"
RTE = json.loads((TESTS / "data" / "te_rtransferentropy.json").read_text())

# The two values of a series of 0 and 1 are its symbols.
AS_IS = 2


def reference_series(name):
    """Columns of a CSV file that is not part of the repository."""
    if not (VALUES / name).exists():
        pytest.skip(f"{name} is not part of the repository")
    return np.loadtxt(VALUES / name, delimiter=",", skiprows=1).T


def lcg(seed, n=600):
    """Values in [0, 1) of the linear congruential generator that the reference values name."""
    out = np.empty(n)
    for t in range(n):
        seed = (1103515245 * seed + 12345) % 2**31
        out[t] = seed / 2**31
    return out


@pytest.fixture(scope="module")
def xyz():
    """The three coupled series of the reference values."""
    x, y, z, w = lcg(1), lcg(2), lcg(3), lcg(3)
    v = y.copy()
    for t in range(1, 600):
        y[t] = 0.6 * x[t - 1] + 0.4 * v[t]
        z[t] = 0.5 * z[t - 1] + 0.3 * y[t - 1] + 0.2 * w[t]
    return {"x": x, "y": y, "z": z}


def chain(rng, n=100, axes=6):
    """Series of which each follows the one before it. Shape (n, axes)."""
    x = rng.normal(size=(n, axes))
    for i in range(1, axes):
        x[1:, i] += x[:-1, i - 1]
    return x


def bits(text):
    """Array of the digits."""
    return np.array([int(c) for c in text])


# Symbols


def test_symbols_are_type_8_quantile_bins():
    """Symbols count the type 8 quantiles below a value, for any length and number of bins."""
    rng = np.random.default_rng(1)
    for n in range(3, 120):
        x = rng.normal(size=n)
        for bins in (2, 3, 5, 7, 10, 20):
            positions = [
                Fraction(1, 3) + Fraction(k, bins) * (n + Fraction(1, 3)) for k in range(1, bins)
            ]
            symbols = quantile_symbols(x, bins)
            below = [np.sum(symbols < k) for k in range(1, bins)]
            assert below == [min(max(floor(p), 1), n) for p in positions], (n, bins)
            if all(p.denominator > 1 for p in positions):
                edges = np.quantile(x, np.arange(1, bins) / bins, method="median_unbiased")
                np.testing.assert_array_equal(symbols, np.searchsorted(edges, x, side="left"))


def test_without_ties_a_value_on_an_edge_belongs_to_the_lower_bin():
    """Symbols count the edges below a value, also if there are fewer values than bins."""
    np.testing.assert_array_equal(quantile_symbols([3, 1, 2], 2), [1, 0, 0])
    np.testing.assert_array_equal(quantile_symbols([-3, -1, -2], 2), [0, 1, 0])
    np.testing.assert_array_equal(quantile_symbols([3, 1, 2, 4], 8), [4, 0, 3, 6])


def test_few_distinct_values_are_the_symbols():
    """A series with at most as many distinct values as bins loses nothing."""
    np.testing.assert_array_equal(quantile_symbols([1, 2, 2, 2, 2, 3], 3), [0, 1, 1, 1, 1, 2])
    np.testing.assert_array_equal(quantile_symbols([7, 0.1, 7, -4], 10), [2, 1, 2, 0])
    np.testing.assert_array_equal(quantile_symbols([0, 1, 1, 1, 1, 1], [0.1]), [0, 1, 1, 1, 1, 1])
    np.testing.assert_array_equal(quantile_symbols([5.0] * 9, 10), [0] * 9)


def tied_series(rng):
    """Endless series with ties: counts, rounded numbers, few values, short and long."""
    while True:
        n = int(rng.integers(4, 60))
        kinds = (
            rng.poisson(rng.uniform(0.1, 6), n),
            np.round(rng.normal(size=n), 1),
            rng.integers(0, rng.integers(1, 6), n),
            np.r_[rng.normal(size=n - 1), 9, 9],
            np.repeat(rng.normal(size=2), n),
        )
        x = np.asarray(kinds[rng.integers(len(kinds))], float)
        if len(set(x)) < len(x):
            yield x


def test_ties_go_to_the_nearer_side_of_an_edge():
    """In exact arithmetic: an edge within equal values moves to the nearer end of them."""
    series = tied_series(np.random.default_rng(40))
    halves = 0
    for x, _ in zip(series, range(600), strict=False):
        bins, n, ordered = 2 + len(x) % 5, len(x), sorted(x)
        # ends[c]: number of values up to the c-th distinct one; no edge lies at 0 or n
        ends = [c for c in range(1, n) if ordered[c - 1] < ordered[c]]
        if len(ends) < bins:
            expected = np.unique(x, return_inverse=True)[1]
        else:
            cuts = []
            for k in range(1, bins):
                # an edge of rank r leaves the values of ranks up to r - 1/2 below it
                edge = Fraction(1, 3) + Fraction(k, bins) * (n + Fraction(1, 3)) - Fraction(1, 2)
                distances = [abs(c - edge) for c in ends]
                nearest = [c for c, d in zip(ends, distances, strict=True) if d == min(distances)]
                if len(nearest) == 2:
                    halves += 1
                    within = ordered[nearest[0]]
                    first = next(value for value in x if value != within)
                    nearest = nearest[1:] if first < within else nearest[:1]
                cuts.append(nearest[0])
            expected = [sum(np.sum(x <= value) > c for c in cuts) for value in x]
        np.testing.assert_array_equal(quantile_symbols(x, bins), expected)
    assert halves > 20


def test_ties_leave_no_series_without_information():
    """A series that is not constant has at least two symbols, also with edges in the tails."""
    for x, _ in zip(tied_series(np.random.default_rng(41)), range(500), strict=False):
        for bins in (2, 3, 10, (0.05, 0.95), (0.01,)):
            assert (len(set(quantile_symbols(x, bins))) > 1) == (len(set(x)) > 1)


def test_negated_and_relabelled_ties_change_nothing():
    """The same values stay together, and the transfer stays what it was but for rounding."""
    rng = np.random.default_rng(42)
    for x, _ in zip(tied_series(rng), range(100), strict=False):
        other = np.unique(x, return_inverse=True)[1] ** 3 - 5.0
        y = np.roll(x, 1)
        for bins in (2, 3, 4, 10, (0.05, 0.95)):
            symbols = quantile_symbols(x, bins)
            order = np.argsort(x, kind="stable")
            negated = quantile_symbols(-x, bins)[order]
            np.testing.assert_array_equal(np.diff(symbols[order]) > 0, np.diff(negated) < 0)
            np.testing.assert_array_equal(quantile_symbols(other, bins), symbols)
            te = transfer_entropy(x, y, bins)
            assert transfer_entropy(-x, -y, bins) == pytest.approx(te, abs=1e-12)
            assert transfer_entropy(other, y, bins) == te


def test_levels_make_the_bins_of_their_count():
    """Levels k / bins give what the number of bins gives."""
    x = np.random.default_rng(2).normal(size=77)
    np.testing.assert_array_equal(quantile_symbols(x, [0.2, 0.4, 0.6, 0.8]), quantile_symbols(x, 5))


# Values of other programs


def test_generator_makes_the_reference_series(xyz):
    """The series made here are those that the reference values were computed from."""
    np.testing.assert_allclose(
        np.array(list(xyz.values())), reference_series("lcg_xyz.csv"), atol=1e-15
    )


@pytest.mark.parametrize(
    "row", RTE["values"], ids=lambda r: "{}{}-{}-{}-{}".format(*r[:4], len(r[4]))
)
def test_equals_rtransferentropy(xyz, row):
    """Transfer entropy equals that of RTransferEntropy, also where its windows differ."""
    source, target, source_history, target_history, percent, expected = row
    te = transfer_entropy(
        xyz[source],
        xyz[target],
        [p / 100 for p in percent],
        source_history=source_history,
        target_history=target_history,
    )
    assert te == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("file", "forth", "back", "effective_forth", "effective_back"),
    [
        ("rte_testthat_xy.csv", 0.11202779636479893, 0.0076428859765014737, 0.10529, 0.00182),
        ("rte_readme_xy.csv", 0.12447087604441028, 0.0020382835717188789, 0.12101, 0.0),
    ],
)
def test_equals_rtransferentropy_on_its_own_data(
    file, forth, back, effective_forth, effective_back
):
    """RTransferEntropy's test and README data give its numbers; effective ones but for chance.

    Its shuffles draw with replacement, and their mean has a standard error of 0.0004 bit.
    """
    x, y = reference_series(file)
    q = (0.05, 0.95)
    assert transfer_entropy(x, y, q) == pytest.approx(forth, abs=1e-12)
    assert transfer_entropy(y, x, q) == pytest.approx(back, abs=1e-12)
    rng = np.random.default_rng(3)
    driven = effective_transfer_entropy(x, y, q, rng=rng)
    free = effective_transfer_entropy(y, x, q, rng=rng)
    assert driven.value == pytest.approx(effective_forth, abs=2e-3)
    assert max(free.value, 0) == pytest.approx(effective_back, abs=2e-3)
    assert driven.p_value == pytest.approx(1 / 101)
    assert free.p_value > 0.01


@pytest.mark.parametrize(
    ("source", "target", "forth", "back"),
    [
        ("11001", "11100", 0.666667, 0),
        ("1100000011", "0011100001", 0.5, 0.106844),
        ("0010111011", "0101001100", 0.344361, 0.25),
    ],
)
def test_equals_inform(source, target, forth, back):
    """The unit tests of Inform, whose target history is 2, give its values."""
    source, target = bits(source), bits(target)
    assert transfer_entropy(source, target, AS_IS, target_history=2) == pytest.approx(
        forth, abs=1e-6
    )
    assert transfer_entropy(target, source, AS_IS, target_history=2) == pytest.approx(
        back, abs=1e-6
    )


# Closed forms


def test_period_four_series_need_a_second_symbol():
    """A shifted copy of 0011.. gives one bit to one symbol of history, and none to two."""
    target, source = bits("0011" * 50 + "0"), bits("0110" * 50 + "0")
    assert transfer_entropy(source, target, AS_IS) == pytest.approx(1, abs=1e-12)
    assert transfer_entropy(source, target, AS_IS, target_history=2) == pytest.approx(0, abs=1e-12)
    assert transfer_entropy(target, target, AS_IS) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("flip", [0.1, 0.25])
def test_noisy_copy(flip):
    """A copy with a share p of flipped bits receives 1 - H(p) bits and sends none."""
    rng = np.random.default_rng(4)
    n = 20_000
    source = rng.integers(0, 2, n)
    flips = rng.permutation(np.arange(n) < flip * n)
    target = np.roll(source, 1) ^ flips
    capacity = 1 + flip * log2(flip) + (1 - flip) * log2(1 - flip)
    # The reverse is bias of 2 degrees of freedom: a mean of 7e-5 bit.
    assert transfer_entropy(source, target, AS_IS) == pytest.approx(capacity, abs=1e-3)
    assert transfer_entropy(target, source, AS_IS) < 1e-3


def test_exclusive_or():
    """A target that is the xor of its own and the source's last bit receives one bit."""
    source = np.random.default_rng(5).integers(0, 2, 20_000)
    target = np.concatenate([[0], np.cumsum(source)[:-1] % 2])
    assert transfer_entropy(source, target, AS_IS) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("bins", [2, 3, 10])
def test_a_coin_transfers_one_bit(bins):
    """Whichever side is a little more frequent, in all functions."""
    coin = np.random.default_rng(0).integers(0, 2, 5000).astype(float)
    for x in (coin, 1 - coin, -coin):
        y = np.roll(x, 1)
        assert transfer_entropy(x, y, bins) == pytest.approx(1, abs=1e-3)
        assert transfer_entropy(y, x, bins) == pytest.approx(0, abs=1e-3)
        net = net_transfer_entropy(np.stack([x, y], axis=1), bins)
        assert net[0, 1] == pytest.approx(1, abs=1e-3)
        shuffled_too = effective_transfer_entropy(x, y, bins, rng=np.random.default_rng(1))
        assert shuffled_too.value == pytest.approx(1, abs=2e-3)


def test_a_markov_chain_transfers_its_entropy_rate():
    """A copy one step later gets what the chain adds in each step, sum pi_i H(P_i)."""
    steps = np.array([[0.9, 0.1, 0.0], [0.2, 0.5, 0.3], [0.0, 0.6, 0.4]])
    # Detailed balance: pi_0 / 10 = pi_1 / 5 and 3 pi_1 / 10 = 6 pi_2 / 10.
    frequency = np.array([4, 2, 1]) / 7
    added = -np.sum(steps * np.log2(np.where(steps > 0, steps, 1)), axis=1)
    rng = np.random.default_rng(43)
    state, states = 0, []
    for chance in rng.random(20_000):
        state = int(np.searchsorted(np.cumsum(steps[state]), chance))
        states.append(state)
    for values in ([0, 1, 2], [-3, 0, 0.5], [2, 1, 0]):
        x = np.array(values, float)[states]
        for bins in (3, 10):
            # Standard error of 20 000 steps: sd(log2 p) / sqrt(n), about 0.01 bit.
            te = transfer_entropy(x, np.roll(x, 1), bins)
            assert te == pytest.approx(frequency @ added, abs=0.03)
            assert transfer_entropy(np.roll(x, 1), x, bins) < 1e-3


def test_counts_transfer_what_their_symbols_hold():
    """Rare counts, delayed by one sample: the entropy of the symbols, whatever the sign."""
    counts = np.minimum(np.random.default_rng(1).poisson(0.2, 5000), 2).astype(float)
    shares = np.bincount(counts.astype(int)) / len(counts)
    whole = -np.sum(shares * np.log2(shares))
    lowest = shares[0]
    in_two = -lowest * log2(lowest) - (1 - lowest) * log2(1 - lowest)
    for x in (counts, -counts):
        for bins, expected in ((2, in_two), (3, whole), (5, whole), (10, whole)):
            # Independent draws: what a symbol says about the next is bias, below 1e-3 bit.
            te = transfer_entropy(x, np.roll(x, 1), bins)
            assert te == pytest.approx(expected, abs=2e-3)


def test_bias_of_independent_series():
    """Shuffled sources transfer (b - 1)^2 b / (2 N ln 2) bits on average."""
    x, y = np.random.default_rng(6).normal(size=(2, 1000))
    te = effective_transfer_entropy(x, y, 4, shuffles=400, rng=np.random.default_rng(7))
    # Standard error: sqrt(2 * 36) / (2 * 999 ln 2) / sqrt(400) = 3e-4 bit.
    assert te.shuffle_mean == pytest.approx(9 * 4 / (2 * 999 * log(2)), abs=1e-3)


# Matrices


def test_matrix_holds_the_pairs():
    """Entry [i, j] is the transfer from column i to column j, with zeros on the diagonal."""
    x = chain(np.random.default_rng(8), 80, 4)
    for bins in (5, 20, [0.05, 0.95]):
        matrix = transfer_entropy_matrix(x, bins)
        pairs = [[transfer_entropy(a, b, bins) for b in x.T] for a in x.T]
        np.testing.assert_allclose(matrix, pairs, atol=1e-12)
        assert np.all(np.diag(matrix) == 0)
    assert matrix[0, 1] > matrix[1, 0]


def test_net_is_antisymmetric():
    """Net transfer entropy is the matrix minus its transpose."""
    x = chain(np.random.default_rng(9))
    matrix, net = transfer_entropy_matrix(x), net_transfer_entropy(x)
    np.testing.assert_array_equal(net, -net.T)
    np.testing.assert_array_equal(net, matrix - matrix.T)
    assert np.any(net != 0)


def test_increasing_transforms_change_nothing():
    """Strictly increasing transforms of each series leave every digit as it was."""
    rng = np.random.default_rng(10)
    transforms = (np.exp, np.cbrt, np.arctan, lambda a: 3 * a - 7, lambda a: a**3, np.sinh)
    for n in (40, 63, 100):
        x = chain(rng, n)
        y = np.stack([f(column) for f, column in zip(transforms, x.T, strict=True)], axis=1)
        np.testing.assert_array_equal(net_transfer_entropy(x), net_transfer_entropy(y))


def test_permuted_axes_permute_the_matrix():
    """The order of the axes does not matter."""
    rng = np.random.default_rng(11)
    x, order = chain(rng), rng.permutation(6)
    expected = net_transfer_entropy(x)[np.ix_(order, order)]
    np.testing.assert_array_equal(net_transfer_entropy(x[:, order]), expected)


def test_batch_equals_loop():
    """Leading dimensions give what their parts give one by one."""
    batch = np.random.default_rng(12).normal(size=(2, 30, 60, 6))
    net = net_transfer_entropy(batch, 7)
    assert net.shape == (2, 30, 6, 6)
    for i in np.ndindex(2, 30):
        np.testing.assert_array_equal(net[i], net_transfer_entropy(batch[i], 7))
    assert net_transfer_entropy(np.empty((0, 60, 6))).shape == (0, 6, 6)


def test_a_long_series_is_a_batch_of_one():
    """Longer than what is sorted at a time; each pair is what it is alone."""
    x = chain(np.random.default_rng(27), 70_000, 2)
    matrix = transfer_entropy_matrix(x, 3)
    for i, j in ((0, 1), (1, 0)):
        assert matrix[i, j] == pytest.approx(transfer_entropy(x[:, i], x[:, j], 3), abs=1e-12)


def test_codes_beyond_32_bits():
    """Four values make the same transfer in 4 bins as in 2000, whose codes need 64 bits."""
    first = np.random.default_rng(13).permutation(np.repeat(np.arange(4), 125))
    x = np.stack([first, np.roll(first, 1), np.roll(first, 2)], axis=1)
    few = transfer_entropy_matrix(x, 4)
    assert few[0, 1] > 1.5
    np.testing.assert_allclose(transfer_entropy_matrix(x, 2000), few, atol=1e-12)


# Isolation


def test_isolate_names_the_driver():
    """The axis that the others follow is named wherever it stands."""
    rng = np.random.default_rng(14)
    for driver in range(6):
        x = rng.normal(size=(400, 6))
        x[1:] += 3 * x[:-1, [driver]] * (np.arange(6) != driver)
        assert isolate_axis(x, 4) == driver


def test_isolate_names_none_on_a_tie():
    """Constant axes, and two axes with the same largest sum, name none."""
    assert isolate_axis(np.ones((50, 6))) == -1
    rng = np.random.default_rng(15)
    x = rng.normal(size=(400, 3))
    x[1:, 2] += 3 * x[:-1, 0]
    x[:, 1] = x[:, 0]
    assert isolate_axis(x, 4) == -1


# Shuffles


def test_p_values_are_uniform_without_transfer():
    """Independent series reject "no transfer" as often as the level says."""
    rng = np.random.default_rng(16)
    pairs = rng.normal(size=(250, 2, 60))
    p = np.array(
        [effective_transfer_entropy(x, y, 3, shuffles=99, rng=rng).p_value for x, y in pairs]
    )
    # Standard errors: 0.018 of the mean, 0.014 of the share below 0.05.
    assert p.mean() == pytest.approx(0.5, abs=0.07)
    assert 0.01 < np.mean(p <= 0.05) < 0.1
    assert p.min() >= 0.01


def false_positives(pair, block):
    """Share of independent pairs with p <= 0.05; of 400, its standard error is 1.1 % at 5 %."""
    rng = np.random.default_rng(31)
    found = [
        effective_transfer_entropy(*pair(rng), 3, shuffles=99, block=block, rng=rng).p_value
        for _ in range(400)
    ]
    return np.mean(np.array(found) <= 0.05)


def with_trend(rng):
    """Independent noise beside one linear trend of two standard deviations from end to end."""
    return np.linspace(-1, 1, 200) + rng.normal(size=(2, 200))


def with_memory(rng):
    """Two independent autoregressions with a coefficient of 0.95."""
    return lfilter([1.0], [1.0, -0.95], rng.normal(size=(2, 400)))


@pytest.mark.parametrize(("pair", "plain"), [(with_trend, 0.2), (with_memory, 0.1)])
def test_shuffles_within_blocks_stand_trends_and_memory(pair, plain):
    """Where plain shuffling finds transfer far too often, shuffling within blocks does not."""
    assert false_positives(pair, None) > plain
    assert 0.005 < false_positives(pair, 10) < 0.085


def test_shuffles_within_blocks_find_a_driven_pair():
    """A source that drives one step ahead is found in spite of the trend, its reverse is not."""
    rng = np.random.default_rng(32)
    x = rng.normal(size=300)
    y = np.r_[0, 0.8 * x[:-1]] + 0.6 * rng.normal(size=300)
    both = np.stack([x, y], axis=1) + np.linspace(-1, 1, 300)[:, None]
    result = effective_net_transfer_entropy(both, 3, block=10, rng=np.random.default_rng(33))
    assert result.p_value[0, 1] == pytest.approx(1 / 101)
    assert result.p_value[1, 0] > 0.05


def test_blocks_keep_their_samples():
    """Samples move by less than a block, and all of them stay."""
    drawn = shuffled(np.arange(23), 200, 5, np.random.default_rng(34))
    np.testing.assert_array_equal(np.sort(drawn, axis=1), np.tile(np.arange(23), (200, 1)))
    moved = np.abs(drawn - np.arange(23))
    assert moved.max() == 4
    assert (moved > 0).any(axis=0).all(), "blocks begin elsewhere, so that no sample is stuck"


def test_driven_pair_is_found():
    """A driven pair has the smallest p-value there can be, its reverse has none such."""
    x = chain(np.random.default_rng(17), 300, 2)
    result = effective_net_transfer_entropy(x, 4, rng=np.random.default_rng(18))
    assert result.p_value[0, 1] == pytest.approx(1 / 101)
    assert result.p_value[1, 0] > 0.05
    assert result.net[0, 1] > 0.05
    np.testing.assert_array_equal(result.net, -result.net.T)
    np.testing.assert_array_equal(np.diag(result.p_value), 1)


def test_shuffles_that_reach_the_value_count():
    """Where every shuffle gives the same value, the p-value is 1."""
    x = np.random.default_rng(22).normal(size=50)
    te = effective_transfer_entropy(x, np.ones(50), 5, rng=np.random.default_rng(0))
    assert (te.value, te.raw, te.p_value) == (0, 0, 1)


def test_effective_is_raw_minus_the_mean_and_unclipped():
    """The value is not clipped: it is below zero for about half of all independent pairs."""
    rng = np.random.default_rng(19)
    pairs = rng.normal(size=(40, 2, 60))
    results = [effective_transfer_entropy(x, y, 5, rng=rng) for x, y in pairs]
    assert all(r.value == r.raw - r.shuffle_mean for r in results)
    assert 8 <= sum(r.value < 0 for r in results) <= 32


def test_raw_value_is_the_transfer_entropy():
    """The raw part is the transfer entropy itself."""
    x, y = chain(np.random.default_rng(20), 90, 2).T
    te = effective_transfer_entropy(x, y, rng=np.random.default_rng(0))
    assert te.raw == transfer_entropy(x, y)


@pytest.mark.parametrize(("n", "bins"), [(1000, 3), (1000, 10), (500, 20), (60, 10)])
def test_mean_of_shuffles_is_that_of_the_plain_function(n, bins):
    """The mean over shuffles is that of `transfer_entropy`, whether codes are counted or sorted."""
    x, y = chain(np.random.default_rng(23), n, 2).T
    te = effective_transfer_entropy(x, y, bins, shuffles=30, rng=np.random.default_rng(24))
    ranks = np.tile(np.argsort(np.argsort(x)), (30, 1))
    by_chance = np.random.default_rng(24).permuted(ranks, axis=1)
    expected = [transfer_entropy(shuffled, y, bins) for shuffled in by_chance]
    assert te.raw == transfer_entropy(x, y, bins)
    assert te.shuffle_mean == pytest.approx(np.mean(expected), abs=1e-12)
    assert te.p_value == (1 + sum(value >= te.raw for value in expected)) / 31


def test_same_seed_same_result():
    """The generator decides the result, and pairs do not share their random numbers."""
    x = chain(np.random.default_rng(21), 60, 3)
    a, b, c = (
        effective_net_transfer_entropy(x, 5, rng=np.random.default_rng(s)) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(a.net, b.net)
    np.testing.assert_array_equal(a.p_value, b.p_value)
    assert np.any(a.net != c.net)
    # The pair (0, 1) is the second stream, whatever was computed before.
    stream = np.random.default_rng(1).spawn(9)[1]
    alone = effective_transfer_entropy(x[:, 0], x[:, 1], 5, rng=stream)
    back = effective_transfer_entropy(x[:, 1], x[:, 0], 5, rng=np.random.default_rng(1).spawn(9)[3])
    assert a.p_value[0, 1] == alone.p_value
    assert a.net[0, 1] == alone.value - back.value


def test_adjusted_p_values_are_those_of_holm():
    """The k-th smallest of m p-values counts (m - k + 1) times; ranks keep their order."""
    x = chain(np.random.default_rng(25), 200, 4)
    result = effective_net_transfer_entropy(x, 3, shuffles=400, rng=np.random.default_rng(26))
    pairs = ~np.eye(4, dtype=bool)
    ranked = sorted(zip(result.p_value[pairs], result.adjusted_p_value[pairs], strict=True))
    expected = 0.0
    for k, (p_value, adjusted) in enumerate(ranked):
        expected = min(max(expected, (len(ranked) - k) * p_value), 1.0)
        assert adjusted == pytest.approx(expected, rel=1e-12), k
    np.testing.assert_array_equal(np.diag(result.adjusted_p_value), 1)
    assert result.adjusted_p_value[0, 1] == pytest.approx(12 / 401)
    assert np.sum(result.adjusted_p_value <= 0.05) == 3


# Interface


def test_package_offers_the_functions():
    """Every public name resolves, and the module of the same name does not hide the function."""
    importlib.import_module("faultgen.analysis.transfer_entropy")
    for name in analysis.__all__:
        assert callable(getattr(analysis, name))
    assert analysis.transfer_entropy([1, 2, 3, 4], [1, 2, 3, 4], bins=2) == 0


GOOD = np.arange(12.0) % 5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: transfer_entropy(GOOD, GOOD[:-1]), "source has 12 samples, target has 11"),
        (
            lambda: transfer_entropy(GOOD[:, None], GOOD),
            r"source must have shape \(samples,\), got",
        ),
        (
            lambda: transfer_entropy(GOOD, [np.nan, *GOOD[1:]]),
            "target has 1 NaN or infinite values",
        ),
        (lambda: transfer_entropy(GOOD, GOOD, 1), "bins must be at least 2.*, got 1"),
        (lambda: transfer_entropy(GOOD, GOOD, [0.5, 0.2]), "ascending levels within"),
        (lambda: transfer_entropy(GOOD, GOOD, [5, 95]), r"within \(0, 1\), got \[5, 95\]"),
        (lambda: transfer_entropy(GOOD, GOOD, []), r"got \[\]"),
        (lambda: transfer_entropy(GOOD[:2], GOOD[:2]), "at least 3 samples are needed, got 2"),
        (lambda: transfer_entropy(GOOD[:5], GOOD[:5], target_history=4), "at least 6 samples"),
        (lambda: transfer_entropy(GOOD, GOOD, source_history=0), "histories must be at least 1"),
        (lambda: transfer_entropy(GOOD, GOOD, 3_000_000), "3000000 bins are too many"),
        (lambda: transfer_entropy(GOOD, GOOD, 0), "bins must be at least 2.*, got 0"),
        (lambda: quantile_symbols(GOOD, -3), "bins must be at least 2.*, got -3"),
        (lambda: transfer_entropy_matrix(GOOD), r"x must have shape \(\.\.\., samples, axes > 1\)"),
        (lambda: net_transfer_entropy(GOOD[:, None]), r"axes > 1\), got \(12, 1\)"),
        (lambda: isolate_axis(np.zeros((2, 12, 6))), r"x must have shape \(samples, axes > 1\)"),
        (
            lambda: effective_transfer_entropy(GOOD, GOOD, shuffles=0, rng=np.random.default_rng()),
            "shuffles must be at least 1, got 0",
        ),
        (
            lambda: effective_transfer_entropy(GOOD, GOOD, block=1, rng=np.random.default_rng()),
            "block must be at least 2 samples, got 1",
        ),
    ],
)
def test_errors_name_the_fault(call, message):
    """Bad input raises a ValueError of one line that says what is wrong."""
    with pytest.raises(ValueError, match=message) as error:
        call()
    assert "\n" not in str(error.value)
