"""What the law of an effect of friction may miss is allowed for, in proportion to the effect."""

import numpy as np
import pytest
from linear import COUNT, written_down

from faultgen.discovery.decision.selection import choose
from faultgen.discovery.fit import law_error
from faultgen.discovery.fit.law_error import LAW_ERROR, gains, score, weights
from faultgen.discovery.terms.candidates import Term

SPEED = np.linspace(-2, 2, COUNT)
"""Speed over its usual value."""


def posed(bend, *, baseline=False, size=0.4):
    """Viscous friction that grows less than in proportion, and what it may be taken for."""
    shapes = [SPEED, SPEED * np.abs(SPEED), np.sign(SPEED)]
    terms = [
        Term("viscous_friction", 1, 0.1, 0.05),
        Term("quadratic_viscous_friction", 1, 0.1, 0.003),
        Term("coulomb_friction", 2, 0.1, 0.035),
    ]
    columns = np.zeros((3, COUNT, 2))
    columns[0, :, 0], columns[1, :, 0], columns[2, :, 1] = (20 * shape for shape in shapes)
    law = SPEED * (1 + bend) / (1 + bend * np.abs(SPEED))
    rng = np.random.default_rng(0)
    residual = rng.standard_normal((COUNT, 2))
    residual[:, 0] += size * 20 * law
    # every recording has all speeds
    order = np.arange(COUNT).reshape(100, -1).T.ravel()
    return written_down(terms, columns[:, order], residual[order], baseline=baseline)


def test_weights_follow_the_size_of_the_effect():
    """A tenth of the torque of the effect, whatever the unit of the other one; own axis only."""
    problem = posed(0.0)
    viscous, quadratic = (np.sqrt(np.mean(problem.raw[k, :, 0] ** 2)) for k in (0, 1))
    share = LAW_ERROR * 0.4 * viscous / (0.003 * quadratic)
    found = weights(problem, [0], np.array([0.4]))
    assert found == pytest.approx([1, 1 / (1 + share**2), 1])
    assert weights(problem, [0], np.array([0.0])) == pytest.approx([1, 1, 1])
    assert weights(posed(0.0, baseline=True), [0], np.array([0.4])) is None
    assert weights(problem, [], np.array([])) is None


@pytest.mark.parametrize(("unlike", "is_free"), [(0.1, False), (0.5, True)])
def test_a_law_does_not_miss_what_is_the_same_law(unlike, is_free):
    """Otherwise a part of an effect would count as another effect, such as Coulomb as wear."""
    terms = [Term(name, 1, 0.1, 0.03) for name in ("friction_wear", "coulomb_friction")]
    columns = np.zeros((2, COUNT, 2))
    columns[0, :, 0] = np.sign(SPEED)
    columns[1, :, 0] = np.sign(SPEED) + unlike * np.cos(20 * SPEED)
    problem = written_down(terms, columns, columns[0])
    assert (weights(problem, [0], np.array([0.4]))[1] < 1) == is_free


def test_a_law_without_torque_on_the_motion_is_not_missed():
    """As friction that grows with a load, on a machine without any."""
    terms = [Term(name, 1, 0.1, 0.03) for name in ("friction_wear", "load_friction")]
    columns = np.zeros((2, COUNT, 2))
    columns[0, :, 0] = np.sign(SPEED)
    assert weights(written_down(terms, columns, columns[0]), [0], np.array([0.4]))[1] == 1


@pytest.mark.parametrize("bend", [0.0, 0.15])
def test_an_effect_whose_law_bends_is_named_alone(bend, monkeypatch):
    """Without what laws may miss, a second effect that is not there would be named."""
    problem = posed(bend)
    chosen = choose(problem)
    assert chosen.best.groups == ((0,),)
    assert chosen.best.values == pytest.approx([0.4], rel=0.25)
    monkeypatch.setattr(law_error, "LAW_ERROR", 0.0)
    assert ((1,) in choose(problem).best.groups) == (bend > 0)


def test_freedom_that_is_not_needed_costs_nothing():
    problem = posed(0.0)
    evidence = problem.evidence()
    free = evidence.weighted(weights(problem, [0], np.array([0.4])))
    assert score(evidence, [0]) == evidence.score([0])
    assert score(free, [0]) <= min(free.score([0]), evidence.score([0]))


def test_gains_contain_what_laws_may_miss():
    problem = posed(0.15)
    (plain, _), (allowed, first) = (
        problem.evidence().gains([(0,), (2,)]),
        gains(problem, problem.evidence(), [(0,), (2,)], [], np.array([])),
    )
    assert allowed[0] > plain[0] + 20
    assert first[0] * 0.05 == pytest.approx(0.4, rel=0.25)
    assert allowed[1] == pytest.approx(plain[1], abs=1.0)
