"""ChangeIsolator against closed forms, its own promises and its symmetries."""

from functools import partial

import numpy as np
import pytest
from faultgen.analysis.isolation import ChangeIsolator
from scipy import stats
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

WINDOW = 12
NOISE = 0.02


def autoregressive(rng, n, columns, memory):
    """Unit variance. Shape (n, columns)."""
    x = rng.normal(size=(n, columns))
    for t in range(1, n):
        x[t] = memory * x[t - 1] + np.sqrt(1 - memory**2) * x[t]
    return x


class World:
    """Features that axes move, and two wandering nuisances, by a known law."""

    def __init__(self, rng, n_axes=4, features=10, memory=0.0):
        self.rng, self.memory = rng, memory
        directions = rng.normal(size=(n_axes, features))
        self.directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        self.nuisance = 0.06 * rng.normal(size=(2, features))
        self.covariance = NOISE**2 * np.eye(features) + self.nuisance.T @ self.nuisance

    def healthy(self, n):
        """Shape (n, features)."""
        wander = autoregressive(self.rng, n, 2, self.memory) @ self.nuisance
        return wander + NOISE * self.rng.normal(size=(n, len(self.covariance)))

    def worn(self, severity, n=WINDOW, directions=None):
        """The same with wear of each axis, constant. Shape (n, features)."""
        moved = np.asarray(severity) @ (self.directions if directions is None else directions)
        return self.healthy(n) + moved

    def fitted(self, n, **arguments):
        """An isolator that has seen n healthy cycles."""
        return ChangeIsolator(directions=self.directions, **arguments).fit([self.healthy(n)])

    def kernel(self):
        """Generalised least squares with the true covariance, and its standard errors."""
        weighted = np.linalg.solve(self.covariance, self.directions.T)
        inverse = np.linalg.inv(self.directions @ weighted)
        return inverse @ weighted.T, np.sqrt(np.diag(inverse))


def one(n_axes, axis, severity):
    """Severity of one axis, 0 of the others."""
    return severity * (np.arange(n_axes) == axis)


def within(rate, expected, n, extra=0.0):
    """Whether a share of n is the expected one, to 3 standard errors of it and of `extra`."""
    return abs(rate - expected) <= 3 * np.hypot(np.sqrt(expected * (1 - expected) / n), extra)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


# Conventions


def test_parameters_survive_cloning(rng):
    """A clone has the same parameters, knows nothing, and learns the same."""
    directions = rng.normal(size=(2, 5))
    isolator = ChangeIsolator(directions=directions, window=6, prior=0.1, covariance="diagonal")
    runs = [rng.normal(size=(50, 5))]
    isolator.fit(runs)
    copy = clone(isolator)
    assert {k: v for k, v in copy.get_params().items() if k != "directions"} == {
        **{"spread": None, "covariance": "diagonal", "condition": None, "window": 6},
        **{"false_alarm": 0.002, "prior": 0.1, "largest": 0.2},
    }
    for method in (copy.isolate, copy.estimate):
        with pytest.raises(NotFittedError):
            method(runs[0])
    with pytest.raises(NotFittedError):
        copy.smallest()
    np.testing.assert_array_equal(copy.fit(runs).isolate(runs[0]).z, isolator.isolate(runs[0]).z)


def test_predictions_are_those_of_single_answers(rng):
    """`predict` and `predict_proba` give, for each series, what `isolate` says."""
    world = World(rng)
    isolator = world.fitted(300)
    series = [world.worn(one(4, axis, 0.3)) for axis in range(4)]
    answers = [isolator.isolate(x) for x in series]
    np.testing.assert_array_equal(isolator.predict(series), [a.worn for a in answers])
    np.testing.assert_array_equal(isolator.predict_proba(series), [a.probability for a in answers])
    assert [a.axis for a in answers] == [0, 1, 2, 3]


# Closed forms


def test_estimates_are_generalised_least_squares(rng):
    """Noise-free wear is recovered exactly; noise is weighted as the true covariance asks for.

    20 000 cycles know the covariance to 1 %, to which the variance is insensitive.
    """
    world = World(rng)
    isolator = world.fitted(20_000)
    severity = rng.uniform(-0.2, 0.2, size=(5, 4))
    exact = isolator.estimate(isolator.mean_ + severity @ world.directions)
    np.testing.assert_allclose(exact, severity, atol=1e-12)
    kernel, error = world.kernel()
    ours = isolator.estimate(isolator.mean_ + np.eye(10)).T
    variance = np.einsum("af,fg,ag->a", ours, world.covariance, ours)
    np.testing.assert_allclose(np.sqrt(variance), error, rtol=0.005)
    np.testing.assert_allclose(ours, kernel, atol=0.05 * np.abs(kernel).max())
    np.testing.assert_allclose(isolator.covariance_, world.covariance, atol=6e-4)
    # standard deviation of a standard deviation from 20 000 / 12 windows is 1.7 %
    stated = isolator.severity_error_ * np.sqrt(WINDOW)
    np.testing.assert_allclose(stated, error, rtol=3 * 0.017)


def test_diagonal_covariance_weighs_each_feature_on_its_own(rng):
    """With one feature an axis z is its mean change over the healthy spread of such means."""
    scale = np.array([0.01, 3.0, 200.0])
    isolator = ChangeIsolator(directions=np.diag(scale), covariance="diagonal")
    healthy = rng.normal(size=(12_000, 3)) * scale
    isolator.fit([healthy])
    x = (rng.normal(size=(WINDOW, 3)) + [0.0, 1.0, 2.0]) * scale
    expected = (x - healthy.mean(axis=0)).mean(axis=0) / scale * np.sqrt(WINDOW)
    # 1000 windows: standard deviations are known to 2.2 %
    np.testing.assert_allclose(isolator.isolate(x).z, expected, rtol=3 * 0.022)


def test_end_of_a_line(rng):
    """Of wear that grows by equal steps the answer is the last value; z is about the mean."""
    world = World(rng)
    isolator = world.fitted(500)
    growth = np.linspace(0.0, 0.3, 30)[:, None] * one(4, 2, 1.0)
    answer = isolator.isolate(isolator.mean_ + growth @ world.directions)
    np.testing.assert_allclose(answer.severity, one(4, 2, 0.3), atol=1e-12)
    mean = growth[-WINDOW:].mean(axis=0)
    np.testing.assert_allclose(answer.z * isolator.severity_error_, mean, atol=1e-12)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.02])
def test_probability_is_bayes_rule(rng, noise):
    """The posterior equals that of numerical integration over the half-normal prior."""
    isolator = ChangeIsolator(
        directions=np.eye(2), covariance="diagonal", prior=0.2, largest=0.1
    ).fit([0.1 * rng.normal(size=(24_000, 2))])
    x = np.zeros((WINDOW, 2)) + [0.06 + noise, -noise]
    answer = isolator.isolate(x)
    grid = np.linspace(0, 1, 200_001)
    weight = 2 * stats.norm.pdf(grid, scale=0.1) * (grid[1] - grid[0])
    for axis in range(2):
        error = isolator.severity_error_[axis]
        mean = answer.z[axis] * error
        worn = 0.2 * weight @ stats.norm.pdf(mean, grid, error)
        healthy = 0.8 * stats.norm.pdf(mean, scale=error)  # of so many windows t is normal
        assert answer.probability[axis] == pytest.approx(worn / (worn + healthy), abs=0.005)


# Promises


def answers(world, n, fits, each, wear, **arguments):
    """Severities and answers, of new worlds and isolators; `wear` of an isolator draws them."""
    for _ in range(fits):
        fresh = World(world.rng, memory=world.memory)
        isolator = fresh.fitted(n, **arguments)
        draw = wear(isolator)
        for _ in range(each):
            given = draw()
            yield given, isolator.isolate(fresh.worn(given))


def random_axis(rng, size):
    """Wear of one random axis, of its own size."""

    def draw():
        axis = rng.integers(4)
        return one(4, axis, size[axis])

    return draw


@pytest.mark.parametrize(
    ("n", "memory", "fits", "each"),
    [
        (60, 0.0, 80, 5),
        pytest.param(200, 0.9, 80, 5, marks=pytest.mark.slow),
        pytest.param(2000, 0.9, 8, 50, marks=pytest.mark.slow),
    ],
)
def test_intervals_and_false_alarms(rng, n, memory, fits, each):
    """95 % of intervals hold the severity, and healthy robots are named as rarely as promised.

    Also if conditions wander slowly, and if few healthy cycles are known: answers of one isolator
    depend on each other, so that isolators are counted as well.
    """
    world = World(rng, memory=memory)
    wear = random_axis(rng, np.full(4, 0.1))
    inside = [
        (answer.interval[:, 0] <= given) & (given <= answer.interval[:, 1])
        for given, answer in answers(world, n, fits, each, lambda _: wear)
    ]
    worn = np.array(inside).mean()
    assert within(worn, 0.96, len(inside), 0.1 / np.sqrt(4 * fits))  # zeros are easier: 97.5 %
    none = partial(np.zeros, 4)
    named = [
        answer.worn.any()
        for _, answer in answers(world, n, fits, each, lambda _: none, false_alarm=0.05)
    ]
    assert within(np.mean(named), 0.045, len(named), 0.08 / np.sqrt(fits))


@pytest.mark.parametrize("length", [2, 5])
def test_short_series_raise_no_more_alarms(rng, length):
    """Fewer cycles than the window have a larger error, which the answer heeds."""
    world = World(rng)
    isolator = world.fitted(2000, false_alarm=0.05)
    named = [isolator.isolate(world.healthy(length)).worn.any() for _ in range(500)]
    assert within(np.mean(named), 0.045, 500, 0.01)


@pytest.mark.slow
def test_smallest_wear_is_found_as_often_as_promised(rng):
    """Wear of the size that `smallest` gives is named with the power that was asked for.

    Errors are known to 5 %, a fifth of a standard error at the limit, of which 8 isolators and 4
    axes make 1 %.
    """
    world = World(rng, memory=0.9)
    for power in (0.8, 0.5):

        def wear(isolator, power=power):
            return random_axis(rng, isolator.smallest(power))

        found = [a.worn[given.argmax()] for given, a in answers(world, 2000, 8, 50, wear)]
        assert within(np.mean(found), power, len(found), 0.01)


@pytest.mark.parametrize(
    ("n", "memory", "fits", "each", "prior", "largest", "extra"),
    [(1000, 0.9, 15, 40, 0.3, 0.02, 0.0), (60, 0.0, 100, 8, 0.2, 0.1, 0.03)],
)
def test_probabilities_are_calibrated(rng, n, memory, fits, each, prior, largest, extra):
    """If severities are drawn from the stated prior, axes of probability p are worn p of the time.

    Prior and size are such that many answers are in doubt. Of 5 healthy windows, Student's t
    describes the estimate but roughly.
    """
    world = World(rng, memory=memory)
    arguments = {"prior": prior, "largest": largest}

    def wear():
        return (rng.random(4) < prior) * np.abs(rng.normal(size=4)) * largest

    seen = [
        (given > 0, a.probability)
        for given, a in answers(world, n, fits, each, lambda _: wear, **arguments)
    ]
    worn, probability = (np.ravel(v) for v in zip(*seen, strict=True))
    for low, high in ((0.0, 0.2), (0.2, 0.5), (0.5, 0.95)):
        chosen = (probability >= low) & (probability <= high)
        assert chosen.sum() > 50
        assert within(worn[chosen].mean(), probability[chosen].mean(), chosen.sum(), extra)


@pytest.mark.slow
def test_intervals_hold_uncertain_directions(rng):
    """If directions differ by draws of the stated spread, intervals cover, and only then."""
    size, each = 0.3 / np.sqrt(10), 8
    covered = {True: [], False: []}
    wrong = {True: [], False: []}
    for _ in range(30):
        world = World(rng)
        spread = size * rng.normal(size=(4, 3, 10))
        told, untold = (world.fitted(600, spread=s, false_alarm=0.02) for s in (spread, None))
        for _ in range(each):
            true = world.directions + np.einsum("av,avf->af", rng.normal(size=(4, 3)), spread)
            axis = rng.integers(4)
            x = world.worn(one(4, axis, 0.2), directions=true)
            for known, isolator in ((True, told), (False, untold)):
                answer = isolator.isolate(x)
                low, high = answer.interval[axis]
                covered[known].append(low <= 0.2 <= high)
                wrong[known].append(np.delete(answer.worn, axis).any())
    assert within(np.mean(covered[True]), 0.95, 30 * each) and np.mean(covered[False]) < 0.7
    assert np.mean(wrong[True]) < 0.05 < 0.2 < np.mean(wrong[False])


def test_estimate_heeds_the_severity_that_it_finds(rng):
    """Severities are those of directions that are uncertain by that much, found by iteration."""
    world = World(rng)
    isolator = world.fitted(600, spread=0.1 * rng.normal(size=(4, 3, 10)))
    x = np.tile(isolator.mean_ + 0.3 * world.directions[1] + 0.05 * rng.normal(size=10), (12, 1))
    found = isolator.isolate(x).severity
    again, first = isolator.estimate(x, severity=found)[0], isolator.estimate(x)[0]
    np.testing.assert_allclose(np.maximum(again, 0), found, atol=1e-3)
    assert np.abs(np.maximum(first, 0) - found).max() > 1e-2


def test_uncertain_directions_count_by_the_true_severity(rng):
    """The square of an estimate exceeds the square of the severity by the estimate's variance.

    What an uncertain direction of one axis adds to the error of another is proportional to the
    square of the true severity. That square is first shown to be right on average, and then to be
    the one that z is made of. Without noise the estimate is exact, and the rest is the formula.
    """
    world = World(rng)
    spread = 0.5 * rng.normal(size=(4, 3, 10))
    isolator = world.fitted(2000, spread=spread)
    error = isolator.severity_error_
    true = np.array([0.0, 3.0 * error[1], 0.0, 0.0])
    means = np.array([isolator.estimate(world.worn(true)).mean(axis=0)[1] for _ in range(4000)])
    # the error is known to 6 % from 167 windows, the mean square to 2 %
    assert np.mean(means**2) - error[1] ** 2 == pytest.approx(true[1] ** 2, rel=0.04)
    severity = np.array([1.5 * error[0], 0.0, 0.0, 0.0])
    severity[1] = 2.2 * error[1]
    x = np.tile(isolator.mean_ + severity @ world.directions, (WINDOW, 1))
    seen = np.array([0.0, severity[1], 0.0, 0.0])  # less than two standard errors may be chance
    # the estimate is linear: of one feature after the other, moved by its healthy spread
    kernel = isolator.estimate(isolator.mean_ + np.diag(isolator.scale_), seen).T
    at = isolator.standard_error(seen)
    from_other = np.sum((kernel[0] @ (spread[1] / isolator.scale_).T) ** 2)
    expected = severity[0] / np.sqrt(at[0] ** 2 + from_other * (severity[1] ** 2 - at[1] ** 2))
    assert isolator.isolate(x).z[0] == pytest.approx(expected, rel=1e-9)
    assert from_other * at[1] ** 2 > 0.02 * at[0] ** 2, "the correction matters here"


def test_few_healthy_cycles_widen_intervals(rng):
    """Of 5 healthy windows, intervals are those of Student's t with 4 degrees of freedom."""
    widths = []
    for _ in range(200):
        isolator = ChangeIsolator(directions=[[1.0]], covariance="diagonal")
        isolator.fit([rng.normal(size=(60, 1))])
        widths.append(np.diff(isolator.isolate(np.full((WINDOW, 1), 100.0)).interval)[0, 0])
    # the end of a line through 6 white values has the variance 1 / 6 + 2.5^2 / 17.5, the mean of
    # the 48 cycles that are not left out 1 / 48; an error from 5 windows is 6 % too small in the
    # mean (square root of a chi-square), and varies by 35 %
    expected = 2 * 0.94 * stats.t.isf(0.025, 4) * np.sqrt(1 / 6 + 2.5**2 / 17.5 + 1 / 48)
    assert np.mean(widths) == pytest.approx(expected, rel=3 * 0.35 / np.sqrt(200) + 0.06)


@pytest.mark.parametrize(("cycles", "freedom"), [(24, 3), (48, 3), (60, 4), (1200, 99)])
def test_limits_are_those_of_student(rng, cycles, freedom):
    """Of as many independent windows as there are, counted as at least four."""
    isolator = World(rng).fitted(cycles, false_alarm=0.04)
    assert isolator.limit_ == pytest.approx(stats.t.isf(0.04 / 4, freedom), rel=1e-12)


def test_uncertain_size_does_not_hide_wear(rng):
    """An axis is named although its direction is known to 50 % only; its interval is wide."""
    world = World(rng)
    spread = 0.5 * world.directions[:, None]
    isolator = world.fitted(600, spread=spread)
    answer = isolator.isolate(isolator.mean_ + np.ones((WINDOW, 1)) * 0.3 * world.directions[1])
    np.testing.assert_array_equal(answer.worn, [False, True, False, False])
    low, high = answer.interval[1]
    assert low < 0.3 * 0.1 and high > 0.3 * 1.9
    # what is asked for at 1.96 standard errors is out of reach at an uncertainty of 51 % and more
    assert np.isfinite(isolator.smallest(0.8)).all()
    assert np.isinf(world.fitted(600, spread=1.1 * spread).smallest(0.975)).all()


def test_several_axes_at_once(rng):
    """Two worn axes are both named and both measured; the one that stands out more comes first."""
    world = World(rng)
    isolator = world.fitted(1000)
    severity = np.array([0.0, 0.15, 0.0, 0.1])
    x = np.tile(isolator.mean_ + severity @ world.directions, (WINDOW, 1))
    answer = isolator.isolate(x)
    np.testing.assert_array_equal(answer.worn, severity > 0)
    np.testing.assert_allclose(answer.severity, severity, atol=1e-12)
    np.testing.assert_allclose(answer.interval[[1, 3]].mean(axis=1), severity[[1, 3]])
    assert answer.axis == answer.z.argmax()
    assert answer.probability[[1, 3]].min() > 0.99 > 0.05 > answer.probability[[0, 2]].max()


def test_none(rng):
    """A healthy robot and one that only a nuisance moves are not named; the axis is -1."""
    world = World(rng)
    isolator = world.fitted(1000)
    for x in (world.healthy(WINDOW), isolator.mean_ + 2 * world.nuisance[[0] * WINDOW]):
        answer = isolator.isolate(x)
        assert not answer.worn.any() and answer.axis == -1
        assert answer.probability.max() < 0.1


# Condition


def curved(world, temperature):
    """Features with square and cube of a temperature in them, and the measured temperature."""
    terms = np.stack([temperature, temperature**2, temperature**3], axis=1)
    healthy = world.healthy(len(temperature))
    mixing = np.random.default_rng(9).normal(size=(3, healthy.shape[1])) * [[0.1], [0.05], [0.02]]
    seen = temperature + 0.1 * world.rng.normal(size=len(temperature))
    return np.column_stack([healthy + terms @ mixing, seen])


def curved_world(rng, features):
    """A world without nuisances, its directions without the temperature, healthy cycles."""
    world = World(rng, features=features)
    world.nuisance *= 0
    directions = np.hstack([world.directions, np.zeros((4, 1))])
    return world, directions, curved(world, autoregressive(rng, 800, 1, 0.9)[:, 0])


def test_condition_takes_the_curve_off(rng):
    """What is told of a temperature that acts in a curved way takes a quarter off the error.

    Two features more than axes cannot tell three terms of temperature from wear.
    """
    named, ratio = [], []
    for _ in range(20):
        world, directions, healthy = curved_world(rng, 6)
        plain = ChangeIsolator(directions=directions).fit([healthy])
        isolator = ChangeIsolator(directions=directions, condition=6, false_alarm=0.05)
        isolator.fit([healthy])
        ratio.append(isolator.severity_error_ / plain.severity_error_)
        for _ in range(15):
            x = curved(world, autoregressive(rng, WINDOW, 1, 0.9)[:, 0])
            named.append(isolator.isolate(x).worn.any())
    assert np.mean(ratio) < 0.75
    assert within(np.mean(named), 0.045, len(named), 0.08 / np.sqrt(20))


def test_condition_outside_of_the_healthy_range(rng):
    """Where no healthy cycle has been, the answer is 'none' with wide intervals that hold."""
    world, directions, healthy = curved_world(rng, 10)
    isolator = ChangeIsolator(directions=directions, condition=10).fit([healthy])
    usual = isolator.isolate(curved(world, np.zeros(WINDOW))).interval[:, 1]
    for temperature in (-6.0, -4.0, 4.0, 6.0):
        answer = isolator.isolate(curved(world, np.full(WINDOW, temperature)))
        assert not answer.worn.any()
        assert (answer.interval[:, 0] == 0).all() and (answer.interval[:, 1] > 3 * usual).all()


def test_condition_that_does_nothing(rng):
    """A constant condition changes no answer."""
    world = World(rng)
    healthy, x = world.healthy(400), world.worn(one(4, 0, 0.1))
    plain = ChangeIsolator(directions=world.directions).fit([healthy]).isolate(x)
    wide = ChangeIsolator(directions=np.hstack([world.directions, np.zeros((4, 1))]), condition=10)
    wide.fit([np.column_stack([healthy, np.full(400, 20.1)])])
    answer = wide.isolate(np.column_stack([x, np.full(WINDOW, 20.1)]))
    # shrinkage knows of more columns, of 400 cycles hardly
    np.testing.assert_allclose(answer.severity, plain.severity, atol=0.005)
    np.testing.assert_array_equal(answer.worn, plain.worn)


# Symmetries


def same(one, other, **tolerance):
    """Whether two answers agree in all they say."""
    for name in ("worn", "severity", "interval", "probability", "z"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), **tolerance)


@pytest.mark.parametrize("covariance", ["diagonal", "shrunk"])
def test_units_and_order_do_not_matter(rng, covariance):
    """Units and order of features change nothing; in another unit of severity it is that unit."""
    world = World(rng)
    healthy, x = world.healthy(300), world.worn(one(4, 3, 0.1))
    spread = 0.03 * rng.normal(size=(4, 2, 10))

    def answer(scale=1.0, shift=0.0, features=slice(None), axes=slice(None), unit=1.0):
        isolator = ChangeIsolator(
            directions=(world.directions * scale / unit)[axes][:, features],
            spread=(spread * scale / unit)[axes][:, :, features],
            covariance=covariance,
            largest=0.2 * unit,
        ).fit([(healthy * scale + shift)[:, features]])
        return isolator.isolate((x * scale + shift)[:, features])

    plain = answer()
    # rounding of features whose mean is large beside their spread
    same(answer(10.0 ** np.arange(-9, 1), 100 * np.arange(10) * 0.01), plain, rtol=1e-3, atol=1e-4)
    same(answer(10.0 ** np.arange(-7, 3)), plain, rtol=1e-7, atol=1e-9)
    same(answer(features=rng.permutation(10)), plain, rtol=1e-7, atol=1e-9)
    axes = rng.permutation(4)
    moved = answer(axes=axes)
    for name in ("worn", "severity", "interval", "probability", "z"):
        np.testing.assert_allclose(getattr(moved, name), getattr(plain, name)[axes], rtol=1e-7)

    def smallest(unit):
        given = {"directions": world.directions / unit, "spread": 3 * spread / unit}
        return ChangeIsolator(covariance=covariance, **given).fit([healthy]).smallest()

    np.testing.assert_allclose(smallest(1e-5), 1e-5 * smallest(1.0), rtol=1e-5)
    percent = answer(unit=100.0)
    np.testing.assert_allclose(percent.z, plain.z)
    np.testing.assert_allclose(percent.probability, plain.probability)
    np.testing.assert_allclose(percent.interval, 100 * plain.interval)


def test_mixed_features(rng):
    """Invertible mixtures of the features say the same, but for shrinkage, with its 1 / n."""
    world = World(rng)
    mixing = np.linalg.qr(rng.normal(size=(10, 10)))[0] * np.linspace(0.5, 2.0, 10)
    healthy, x = world.healthy(20_000), world.worn(one(4, 3, 0.1))
    plain = ChangeIsolator(directions=world.directions).fit([healthy]).isolate(x)
    mixed = ChangeIsolator(directions=world.directions @ mixing).fit([healthy @ mixing])
    np.testing.assert_allclose(mixed.isolate(x @ mixing).z, plain.z, atol=0.1)


def test_only_the_window_counts(rng):
    """What was before the window has no influence."""
    world = World(rng)
    isolator = world.fitted(200, window=8)
    x = world.worn(one(4, 0, 0.1), n=30)
    same(isolator.isolate(x), isolator.isolate(x[-8:]), rtol=0)


# What cannot be observed


def test_axes_that_cannot_be_told_apart(rng):
    """Axes of parallel or dependent directions are not named, and others are as without them."""
    world = World(rng)
    d = world.directions
    healthy = world.healthy(500)
    for axis, copies in ((1, [2 * d[1]]), (1, [-d[1], 0.5 * d[1]])):
        more = ChangeIsolator(directions=np.vstack([d, *copies])).fit([healthy])
        fewer = ChangeIsolator(directions=d).fit([healthy])
        x = world.worn(one(4, axis, 0.3))
        assert fewer.isolate(x).axis == axis
        answer = more.isolate(x)
        alike = np.r_[axis, 4 : 4 + len(copies)]
        assert not answer.worn.any()
        assert np.isnan(answer.severity[alike]).all() and np.isnan(answer.interval[alike]).all()
        assert (answer.probability[alike] == 0.01).all()
        assert np.isinf(more.smallest()[alike]).all()
        others = [0, 2, 3]
        np.testing.assert_allclose(answer.z[others], fewer.isolate(x).z[others], atol=1e-6)
        assert more.isolate(world.worn(one(4 + len(copies), 2, 0.1)[:4])).axis == 2
    nearly = ChangeIsolator(directions=np.vstack([d, d[1] + 1e-4 * rng.normal(size=10)]))
    answer = nearly.fit([healthy]).isolate(world.worn(one(4, 1, 0.1)))
    assert not answer.worn.any() and (np.diff(answer.interval[[1, 4]]) > 1).all()


def test_axis_that_moves_nothing(rng):
    """An axis whose direction is zero is not named and has no severity; others are unchanged."""
    world = World(rng)
    healthy, x = world.healthy(300), world.worn(one(4, 0, 0.3))
    isolator = ChangeIsolator(directions=np.vstack([world.directions, np.zeros(10)]))
    answer = isolator.fit([healthy]).isolate(x)
    plain = ChangeIsolator(directions=world.directions).fit([healthy]).isolate(x)
    np.testing.assert_allclose(answer.z[:4], plain.z)
    assert answer.axis == 0 and np.isnan(answer.severity[4]) and answer.z[4] == 0
    assert isolator.severity_error_[4] == isolator.smallest()[4] == np.inf
    assert (
        np.isnan(isolator.estimate(x)[:, 4]).all() and np.isfinite(isolator.estimate(x)[:, 0]).all()
    )


@pytest.mark.parametrize("value", [0.0, 0.1, -3e8 - 0.1])
def test_constant_feature(rng, value):
    """A feature that is constant while others vary tells nothing, also if axes should move it."""
    world = World(rng)
    healthy, x = world.healthy(300), world.worn(one(4, 0, 0.3))
    isolator = ChangeIsolator(directions=np.column_stack([world.directions, np.ones(4)]))
    isolator.fit([np.column_stack([healthy, np.full(300, value)])])
    still, moved = (
        isolator.isolate(np.column_stack([x, np.full(WINDOW, value + change)])) for change in (0, 5)
    )
    same(still, moved)
    assert still.axis == 0


def test_feature_twice(rng):
    """The same feature twice is no more evidence than once, but for shrinkage."""
    world = World(rng)
    healthy, x = world.healthy(2000), world.worn(one(4, 0, 0.1))
    plain = ChangeIsolator(directions=world.directions).fit([healthy]).isolate(x)
    twice = ChangeIsolator(directions=np.hstack([world.directions] * 2))
    answer = twice.fit([np.hstack([healthy] * 2)]).isolate(np.hstack([x] * 2))
    np.testing.assert_allclose(answer.z, plain.z, atol=0.3)


def test_robot_without_any_spread(rng):
    """Of a noise-free robot any wear is named, and its severity exact."""
    directions = rng.normal(size=(3, 6))
    isolator = ChangeIsolator(directions=directions).fit([np.full((100, 6), 0.1)])
    healthy, worn = np.full((WINDOW, 6), 0.1), np.full((WINDOW, 6), 0.1) + 1e-3 * directions[1]
    assert isolator.isolate(healthy).axis == -1
    answer = isolator.isolate(worn)
    np.testing.assert_array_equal(answer.worn, [False, True, False])
    np.testing.assert_allclose(answer.severity, [0, 1e-3, 0], atol=1e-12)


def test_values_that_are_missing(rng):
    """Cycles with a missing feature are left out; without any left the answer is 'none'."""
    world = World(rng)
    isolator = world.fitted(500)
    x = world.worn(one(4, 1, 0.1))
    gaps = x.copy()
    gaps[[2, 5], [0, 3]] = np.nan, np.inf
    same(isolator.isolate(gaps), isolator.isolate(np.delete(x, [2, 5], axis=0)))
    gaps[:-1, 4] = np.nan
    answer = isolator.isolate(gaps)
    assert answer.axis == -1 and np.isnan(answer.severity).all() and np.isnan(answer.interval).all()
    assert (answer.probability == 0.01).all() and (answer.z == 0).all()


# Refusals


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"covariance": "full"}, "covariance must be 'diagonal' or 'shrunk', got 'full'"),
        ({"window": 1}, "window must be at least 2, got 1"),
        ({"window": 31}, "60 healthy cycles of 10 features are too few.* window of 31"),
        ({"condition": 10}, "condition must be a feature's index, got 10"),
        ({"false_alarm": 0.0}, "false_alarm must be within 0 and 1, got 0"),
        ({"prior": 1.0}, "prior must be within 0 and 1, got 1"),
        (
            {"spread": np.zeros((4, 10))},
            r"spread must have shape \(4, vectors, 10\), got \(4, 10\)",
        ),
        ({"spread": np.zeros((3, 2, 10))}, r"got \(3, 2, 10\)"),
        ({"directions": np.full((4, 10), np.nan)}, "must be finite"),
        ({"directions": np.ones((4, 9))}, r"runs must have shape \(cycles, 9\)"),
    ],
)
def test_invalid_arguments(rng, arguments, message):
    """Arguments that mean nothing are refused by name when the isolator is fitted."""
    world = World(rng)
    isolator = ChangeIsolator(**{"directions": world.directions, **arguments})
    with pytest.raises(ValueError, match=message):
        isolator.fit([world.healthy(60)])


def test_invalid_data(rng):
    """Healthy runs and series of another shape, too short or not finite are refused."""
    world = World(rng)
    isolator = ChangeIsolator(directions=world.directions)
    for runs in ([], [world.healthy(60)[:, :9]], [world.healthy(60)[0]]):
        with pytest.raises(ValueError, match=r"runs must have shape \(cycles, 10\) each"):
            isolator.fit(runs)
    with pytest.raises(ValueError, match="23 healthy cycles of 10 features are too few"):
        isolator.fit([world.healthy(23)])
    with pytest.raises(ValueError, match="one run is shorter than the window of 12"):
        isolator.fit([world.healthy(60), world.healthy(11)])
    with pytest.raises(ValueError, match="finite"):
        isolator.fit([np.full((60, 10), np.inf)])
    isolator.fit([world.healthy(12), world.healthy(12)])
    for x in (world.healthy(5)[:, :9], world.healthy(1), world.healthy(5)[0]):
        with pytest.raises(ValueError, match=r"x must have shape \(cycles > 1, 10\), got"):
            isolator.isolate(x)
