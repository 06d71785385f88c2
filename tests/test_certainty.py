"""How certain a severity is: on torques that are written down."""

from dataclasses import replace

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down
from scipy.stats import chi2

from faultgen.discovery.decision.certainty import certainty, overdispersion
from faultgen.discovery.fit.fit import fit
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import SimulationFailed

FITTED = np.arange(COUNT) < PARTS[-1].start
OFFSET = Term("torque_offset", 1, 0.1, 1.0)


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def one(rng, value, noise=1.0, law=None, terms=(OFFSET,), size=1.0):
    """A problem of one effect on one axis, its column, and the error of its severity."""
    columns = rng.normal(size=(len(terms), COUNT, 1)) * size
    residual = noise * rng.normal(size=(COUNT, 1))
    for column in columns:  # chance does not move the fit
        x, y = column[FITTED, 0], residual[FITTED, 0]
        residual[FITTED, 0] -= x * (x @ y) / (x @ x)
    problem = written_down(list(terms), columns, residual)
    exact = problem.raw.astype(float)
    problem = replace(problem, residual=residual + np.tensordot(value, exact, axes=1))
    if law is not None:
        problem = with_law(problem, lambda v: law(v) * exact[0])
    return problem, 1 / np.linalg.norm(exact[0][FITTED])


def with_law(problem, torque):
    """The same problem whose single term has another torque than value times column."""

    def simulate(changes=(), disturbance=None):
        return sum((torque(value) for _, value in changes), np.zeros(problem.residual.shape))

    replay = type(problem.replay)(**{**vars(problem.replay), "torque": simulate})
    return replace(problem, replay=replay)


@pytest.mark.parametrize("noise", [0.3, 1.0, 2.0])
def test_a_straight_law_has_the_interval_of_least_squares(rng, noise):
    """95 % of a normal distribution; wider where more than noise is left, and never narrower."""
    problem, error = one(rng, [0.5], noise)
    found = fit(problem, [(0,)])
    over = overdispersion(problem, found)
    squares = np.sum((problem.residual - found.change)[FITTED] ** 2)
    assert over == pytest.approx(max(squares / FITTED.sum(), 1.0), rel=1e-3)
    assert (over == 1) == (noise < 1) or noise == 1
    known = certainty(problem, found, 0)
    error *= np.sqrt(over)
    assert known.severity == pytest.approx(0.5, rel=1e-4)
    assert known.error == pytest.approx(error, rel=1e-4)
    half = np.sqrt(chi2.ppf(0.95, 1)) * error
    assert known.low == pytest.approx(known.severity - half, abs=0.03 * half)
    assert known.high == pytest.approx(known.severity + half, abs=0.03 * half)
    assert known.absent == pytest.approx((0.5 / error) ** 2, rel=1e-3)


def test_a_severity_may_be_below_zero_but_the_size_of_a_wave_not(rng):
    """Of a sine and a cosine, the root of the sum of squares is given."""
    problem, error = one(rng, [0.0])
    problem = replace(problem, residual=problem.residual + error * problem.raw[0])
    known = certainty(problem, fit(problem, [(0,)]), 0)
    assert known.severity == pytest.approx(error, rel=1e-3)
    assert known.low == pytest.approx(-0.96 * error, abs=0.06 * error)
    wave = [Term("torque_ripple", 1, 0.1, 1.0, (("order", 2.0), ("phase", p))) for p in (0.0, 1.57)]
    problem, _ = one(rng, [0.0, 0.0], terms=wave)
    x = problem.raw[:, FITTED, 0].astype(float)
    value = np.array([0.6, 0.8]) / np.linalg.norm(x[0])
    problem = replace(problem, residual=problem.residual + np.tensordot(value, problem.raw, axes=1))
    found = fit(problem, [(0, 1)])
    known = certainty(problem, found, 0)
    assert known.severity == pytest.approx(np.linalg.norm(found.values))
    size = found.values / known.severity
    covariance = overdispersion(problem, found) * np.linalg.inv(x @ x.T)
    assert known.error == pytest.approx(np.sqrt(size @ covariance @ size), rel=1e-3)
    assert known.low == pytest.approx(0.0, abs=1e-12) and known.high > known.severity


@pytest.mark.parametrize("how", ["nan", "raises"])
@pytest.mark.parametrize("wall", [0.3, 0.7, 1.1, 1.5])
def test_an_interval_ends_beyond_what_cannot_be_simulated(rng, wall, how):
    """Nothing is known of severities beyond the wall, some errors off; the end is just there."""
    problem, error = one(rng, [0.5])
    exact = problem.raw[0].astype(float)

    def torque(value):
        if value > 0.5 + wall * error:
            if how == "raises":
                raise SimulationFailed("it diverges")
            return np.full(exact.shape, np.nan)
        return value * exact

    known = certainty(with_law(problem, torque), fit(problem, [(0,)]), 0)
    assert 0.5 + wall * error <= known.high <= 0.5 + (wall + 0.15) * error
    assert known.low == pytest.approx(0.5 - 1.96 * error, abs=0.06 * error)


@pytest.mark.parametrize("sharp", [3.0, 30.0])
def test_an_interval_holds_all_that_is_not_excluded(rng, sharp):
    """A law that rises faster than its slope says: the misfit at the end is 3.84 above the least.

    If it rises very fast, the search stops where it is more, but never beyond the straight law.
    """
    problem, error = one(rng, [0.5])

    def law(value):
        off = (value - 0.5) / error
        return 0.5 + error * (off + max(off - 1.0, 0.0) ** 2 * sharp)

    exact = problem.raw[0].astype(float)
    bent = with_law(problem, lambda v: law(v) * exact)
    found = fit(problem, [(0,)])
    known = certainty(bent, found, 0)
    reached = (law(known.high) - 0.5) / error / np.sqrt(overdispersion(problem, found))
    assert 1.96 * 0.96 < reached and (reached < 1.96 * 1.04 or sharp > 10)
    assert known.high <= found.values[0] + 1.97 * known.error


def test_an_interval_ends_at_the_largest_severity(rng):
    """Where nothing is known, as of a column that is almost zero."""
    problem, error = one(rng, [4.0], size=1e-3)
    assert error > 30
    found = fit(problem, [(0,)])
    known = certainty(problem, found, 0)
    assert (known.low, known.high) == (-10.0, 10.0)
    assert known.severity == pytest.approx(4.0, rel=1e-2)


def test_the_other_effects_of_a_set_follow(rng):
    """The interval of one of two similar effects is that of their covariance."""
    terms = [OFFSET, Term("viscous_friction", 1, 0.1, 1.0)]
    problem, _ = one(rng, [0.5, 0.5], terms=terms)
    raw = problem.raw.copy()
    raw[1] = 0.8 * raw[0] + 0.6 * raw[1]
    residual = problem.residual + 0.5 * (raw - problem.raw).sum(axis=0)
    problem = written_down(terms, raw, residual)
    found = fit(problem, [(0,), (1,)])
    x = raw[:, FITTED, 0].astype(float)
    errors = np.sqrt(overdispersion(problem, found) * np.diag(np.linalg.inv(x @ x.T)))
    for place in (0, 1):
        known = certainty(problem, found, place)
        assert known.severity == found.values[place]
        assert known.error == pytest.approx(errors[place], rel=1e-3)
        half = 1.96 * errors[place]
        assert known.high - known.severity == pytest.approx(half, rel=0.03)
        assert known.severity - known.low == pytest.approx(half, rel=0.03)
