"""Sets of effects at given severities, on laws that are written down."""

from types import SimpleNamespace

import numpy as np
import pytest
from linear import COUNT, written_down

from faultgen.discovery.fit.fit import bounds_of, changes_of, first_of, fit_at, no_effect
from faultgen.discovery.terms.candidates import PAYLOAD, Term
from faultgen.effects import get_effect
from faultgen.errors import SimulationFailed

TERMS = [
    Term("payload_mass", 1, 1.0, 0.01),
    Term("rotor_inertia", 1, 1.0, 0.01),
    Term("coulomb_friction", 1, 1.0, 0.01),
]
VALUES = np.array([0.5, 0.3, 0.2])
COVARIANCE = np.diag([1.0, 4.0, 9.0]) * 1e-4
GROUPS = [(0,), (1,), (2,)]


@pytest.fixture
def shapes():
    return np.random.default_rng(0).normal(size=(3, COUNT, 1))


def bent(value):
    """The law that the columns are slopes of: twice the value at 1."""
    return value + value**2


@pytest.fixture
def pose(shapes):
    """A problem whose simulation is bent; optionally it diverges, in one of two ways."""

    def make(diverges=""):
        def torque(changes=()):
            if diverges == "raises":
                raise SimulationFailed("it diverges")
            total = np.zeros((COUNT, 1))
            for term, value in changes:
                total += bent(value) * shapes[TERMS.index(term)]
            return total * (np.nan if diverges == "nan" else 1.0)

        problem = written_down(TERMS, 2 * shapes, shapes.sum(axis=0), baseline=True)
        replay = SimpleNamespace(**{**vars(problem.replay), "torque": torque})
        object.__setattr__(problem, "replay", replay)
        return problem

    return make


def test_a_set_is_simulated_at_its_severities(pose, shapes):
    """All effects together."""
    problem = pose()
    found = fit_at(problem, GROUPS, VALUES, COVARIANCE)
    change = np.tensordot(bent(VALUES), shapes, axes=1)
    np.testing.assert_allclose(found.change, change, rtol=1e-12)
    assert found.terms == [0, 1, 2]
    assert changes_of(problem, found) == list(zip(TERMS, VALUES, strict=True))
    (group, value, covariance), *others = found.members()
    assert (group, value, covariance) == ((0,), [0.5], [[1e-4]]) and len(others) == 2


@pytest.mark.parametrize("diverges", ["nan", "raises"])
def test_a_set_is_linear_where_its_simulation_diverges(pose, shapes, diverges):
    found = fit_at(pose(diverges), GROUPS, VALUES, COVARIANCE)
    told = np.tensordot(2 * VALUES, shapes, axes=1)
    np.testing.assert_allclose(found.change, told, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("diverges", ["", "nan"])
def test_the_first_effects_of_a_set_keep_their_severities(pose, shapes, diverges):
    """Their torque is simulated, or to first order where the simulation diverges."""
    problem = pose(diverges)
    found = fit_at(problem, GROUPS, VALUES, COVARIANCE)
    first = first_of(problem, found, 2)
    assert first.groups == ((0,), (1,))
    np.testing.assert_array_equal(first.values, VALUES[:2])
    np.testing.assert_array_equal(first.covariance, COVARIANCE[:2, :2])
    law = 2 * VALUES if diverges else bent(VALUES)
    told = np.tensordot(law[:2], shapes[:2], axes=1)
    np.testing.assert_allclose(first.change, told, rtol=1e-4, atol=1e-4)
    assert first_of(problem, found, 3) is found


def test_nothing_is_simulated_for_no_effect(pose):
    """Also where the model diverges."""
    found = no_effect(pose("raises"))
    assert found.groups == () and found.terms == [] and not found.change.any()


def test_severities_have_the_bounds_of_their_effects(pose):
    """A wave is a sine and a cosine, which may be negative; points of a payload as well."""
    wave = (("order", 1.0), ("phase", 0.0))
    point = (("x", 0.1), ("y", 0.0), ("z", 0.0))
    terms = [
        Term("coulomb_friction", 1, 1.0, 1.0),
        Term("torque_ripple", 1, 1.0, 1.0, wave),
        Term(PAYLOAD, 1, 0.1, 1.0, point),
    ]
    problem = written_down(terms, np.zeros((3, COUNT, 1)), np.zeros((COUNT, 1)))
    low, high = bounds_of(problem, [0, 1, 2])
    friction, ripple = get_effect("coulomb_friction"), get_effect("torque_ripple")
    assert low.tolist() == [friction.smallest, -ripple.largest, -np.inf]
    assert high.tolist() == [friction.largest, ripple.largest, np.inf]
    assert [len(one) for one in bounds_of(problem, [])] == [0, 0]
