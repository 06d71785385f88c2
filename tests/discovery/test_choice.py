"""Severities of the chosen effects, their rivals, and what no catalogue has."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from linear import COUNT, difference_between, written_down

from faultgen.discovery import Discovery
from faultgen.discovery.decision.choice import SURE, choose, only, severities
from faultgen.discovery.terms.candidates import Term

ODDS_OF_ONE_IN_A_HUNDRED = np.log(99)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def simulated(problem, torque):
    """The problem with a simulation: a function of a term and its value."""

    def simulate(changes=(), disturbance=None):
        return sum((torque(term, value) for term, value in changes), np.zeros((COUNT, 2)))

    replay = SimpleNamespace(**{**vars(problem.replay), "torque": simulate})
    object.__setattr__(problem, "replay", replay)
    return problem


def chosen(problem, processes=()):
    return choose(problem, difference_between(problem, processes))


@pytest.mark.parametrize("true", [0.05, 0.3, -0.3])
def test_a_weak_motor_is_as_weak_as_a_simulation_says(rng, true):
    """The log of a motor that lost a share s of its torque is larger by s / (1 - s)."""
    shape = rng.normal(size=(COUNT, 2)) * [3.0, 0.0]

    def torque(term, size):
        return shape * size / (1 - size)

    term = Term("torque_constant", 1, 0.05, 1e-6)
    residual = torque(term, true) + 0.3 * rng.normal(size=(COUNT, 2))
    problem = simulated(written_down([term], [shape], residual, baseline=True), torque)
    difference = difference_between(problem)
    fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
    error = float(np.sqrt(fit.covariance[0, 0]))
    assert fit.values[0] == pytest.approx(true, abs=4 * error + 0.01 * abs(true))
    assert error < 0.02


@pytest.mark.parametrize("share", [0.88, 0.95, 1.0, 1.12])
def test_the_size_of_a_play_is_found_by_simulation(rng, share):
    """Its torque comes at another time for another size, so that no slope leads there."""
    course = np.linspace(0, 1, COUNT)
    step = 1e-3

    def torque(term, size):
        change = np.zeros((COUNT, 2))
        change[:, 0] = 3 * np.exp(-(((course - 400 * size) / 0.03) ** 2))
        return change

    term = Term("backlash", 1, step, 1e-6)
    columns = [torque(term, step) / step]
    residual = torque(term, share * step) + 0.3 * rng.normal(size=(COUNT, 2))
    problem = simulated(written_down([term], columns, residual, baseline=True), torque)
    difference = difference_between(problem)
    fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
    error = float(np.sqrt(fit.covariance[0, 0]))
    assert fit.values[0] == pytest.approx(share * step, abs=4 * error)
    assert error < 0.02 * step
    np.testing.assert_array_equal(fit.change, torque(term, fit.values[0]))


def test_the_error_of_a_play_is_that_of_its_shift(rng):
    """The slope of the torque with the size, whitened, against many draws of the noise."""
    course = np.linspace(0, 1, COUNT)

    def torque(term, size):
        return np.outer(3 * np.exp(-(((course - 400 * size) / 0.03) ** 2)), [1.0, 0.0])

    term = Term("backlash", 1, 1e-3, 1e-6)
    true, values, errors = 1.03e-3, [], []
    for _ in range(60):
        residual = torque(term, true) + rng.normal(size=(COUNT, 2))
        problem = written_down([term], [torque(term, 1e-3) / 1e-3], residual, baseline=True)
        problem = simulated(problem, torque)
        difference = difference_between(problem)
        fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
        values.append(fit.values[0])
        errors.append(float(np.sqrt(fit.covariance[0, 0])))
    slope = (torque(term, true + 1e-6) - torque(term, true - 1e-6)) / 2e-6
    expected = 1 / np.linalg.norm(slope[problem.samples(problem.fitting)])
    assert np.median(errors) == pytest.approx(expected, rel=0.2)
    assert np.std(values) == pytest.approx(expected, rel=0.35)
    assert np.mean(values) == pytest.approx(true, abs=3 * expected / np.sqrt(60))


def test_a_play_that_cannot_be_simulated_has_the_size_of_its_column():
    """And an error as wide as the next columns are apart."""
    shape = np.zeros((COUNT, 2))
    shape[::7] = 3.0
    term = Term("backlash", 1, 1e-3, 1e-6)
    problem = written_down([term], [shape / 1e-3], shape, baseline=True)
    problem = simulated(problem, lambda term, size: np.full((COUNT, 2), np.nan))
    difference = difference_between(problem)
    fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
    assert fit.values[0] == 1e-3
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(0.2e-3)
    np.testing.assert_allclose(fit.change, shape, rtol=1e-5)


def test_an_effect_that_is_not_linear_is_simulated_at_its_severity(rng):
    """Its law grows by a tenth from the probe of 0.2 to 0.4; the severity is right all the same."""
    shape = 3 * rng.normal(size=(COUNT, 2))

    def torque(term, value):
        return (value + 0.5 * value**2) * shape

    term = Term("gear_stiffness", 1, 0.2, 1e-6)
    residual = torque(term, 0.4) + rng.normal(size=(COUNT, 2))
    problem = written_down([term], [torque(term, 0.2) / 0.2], residual, baseline=True)
    problem = simulated(problem, torque)
    difference = difference_between(problem)
    fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
    assert fit.values[0] == pytest.approx(0.4, abs=0.015)
    np.testing.assert_allclose(fit.change, torque(term, fit.values[0]))


def test_what_no_simulation_explains_counts_less_than_its_linear_signature_promises(rng):
    """Its torque is largest at 0.1; the column would explain five times as much at 0.6."""
    shape = 3 * rng.normal(size=(COUNT, 2))

    def torque(term, value):
        return value * np.exp(-value / 0.1) * shape

    term = Term("gear_stiffness", 1, 0.02, 1e-6)
    residual = 0.5 * shape + rng.normal(size=(COUNT, 2))
    problem = written_down([term], [torque(term, 0.02) / 0.02], residual, baseline=True)
    problem = simulated(problem, torque)
    difference = difference_between(problem)
    fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
    explained = 0.5 * np.sum(residual**2) - 0.5 * np.sum((residual - fit.change) ** 2)
    linear = 0.5 * np.sum(residual * shape) ** 2 / np.sum(shape**2)
    assert fit.lost[0] == pytest.approx(linear - explained, rel=0.2)
    assert fit.lost[0] > 0.5 * linear


def test_severities_stay_within_the_bounds_of_their_effects(rng):
    shape = 3 * rng.normal(size=(COUNT, 2))
    term = Term("load_friction", 1, 0.03, 1e-6)  # none that is negative
    problem = written_down([term], [shape], -0.05 * shape, baseline=True)
    difference = difference_between(problem)
    fit = severities(problem, difference, [(0,)], difference.model.healthy.log_scales)
    assert fit.values.tolist() == [0.0]


def test_no_effect_has_no_severity():
    term = Term("rotor_inertia", 1, 0.1, 1e-6)
    problem = written_down([term], np.ones((1, COUNT, 2)), np.zeros((COUNT, 2)), baseline=True)
    assert severities(problem, difference_between(problem), [], np.zeros(0)).groups == ()


def two_offsets(rng, apart):
    """Loss of torque constant and payload, whose shapes differ by a share; the first is there."""
    first = 5 * rng.normal(size=(COUNT, 2))
    second = first + apart * 5 * rng.normal(size=(COUNT, 2))
    terms = [Term(name, 2, 0.1, 1e-6) for name in ("coulomb_friction", "viscous_friction")]
    residual = 0.3 * first + 0.3 * rng.normal(size=(COUNT, 2))
    return written_down(terms, [first, second], residual, baseline=True)


def test_rivals_are_what_is_not_excluded(rng):
    found = chosen(two_offsets(rng, 0.01))
    assert found.groups == ((0,),) and found.odds[0] > SURE
    ((place, rival, share),) = found.rivals
    assert (place, rival) == (0, (1,))
    assert share + found.shares[0] == pytest.approx(1.0)
    clear = chosen(two_offsets(rng, 0.5))
    assert clear.groups == ((0,),) and clear.rivals == ()


def test_only_keeps_some_effects_with_new_severities(rng):
    """What remains takes over what the others explained."""
    first = 5 * rng.normal(size=(COUNT, 2))
    second = 0.5 * first + 5 * rng.normal(size=(COUNT, 2))
    terms = [Term(name, 2, 0.1, 1e-6) for name in ("rotor_inertia", "torque_constant")]
    residual = 0.3 * first + 0.2 * second + 0.1 * rng.normal(size=(COUNT, 2))
    found = chosen(written_down(terms, [first, second], residual, baseline=True))
    assert sorted(found.groups) == [(0,), (1,)]
    kept = only(found, [found.groups.index((0,))])
    assert kept.groups == kept.best.groups == ((0,),)
    assert len(kept.odds) == len(kept.shares) == 1 and kept.rivals == ()
    own = 0.3 + 0.2 * np.sum(first * second) / np.sum(first**2)
    assert kept.best.values[0] == pytest.approx(own, rel=0.02)
    assert only(found, []).best.groups == ()


def test_a_torque_of_no_catalogue_is_told_with_axis_and_variable(rng):
    bumps = np.zeros((3, COUNT, 2))
    for k in range(3):
        bumps[k, 200 * k : 200 * (k + 1), 1] = 10.0
    residual = 0.3 * bumps[0] - 0.2 * bumps[1] + rng.normal(size=(COUNT, 2))
    term = Term("rotor_inertia", 1, 0.1, 1e-6)
    column = np.zeros((1, COUNT, 2))
    column[0, :, 0] = 5 * rng.normal(size=COUNT)
    problem = written_down([term], column, residual, baseline=True)
    found = chosen(problem, [(2, "time", bumps)])
    assert found.unknown == ((2, "time"),)
    assert found.groups == () and found.best.groups == ()
    nothing = written_down([term], column, rng.normal(size=(COUNT, 2)), baseline=True)
    assert chosen(nothing, [(2, "time", bumps)]).unknown == ()


def test_an_effect_counts_from_odds_of_99_to_1():
    assert pytest.approx(ODDS_OF_ONE_IN_A_HUNDRED) == SURE


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "size"), [(1, 1.13e-3), (2, 4e-3)])
def test_a_play_between_two_columns_is_named_with_its_size(measured, tiny_robot, axis, size):
    """Of simulated recordings; the model with it leaves noise."""
    found = Discovery(tiny_robot, laws=False).fit(
        measured([("backlash", axis, size)], 3), measured([], 1)
    )
    (one,) = found.answer_.effects
    assert (one.effect, one.axis) == ("backlash", axis)
    assert one.severity == pytest.approx(size, rel=0.05)  # beside unknown damping of bristles
    assert found.answer_.after < 1.05 * found.answer_.floor
