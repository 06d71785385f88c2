"""Numbers of a model that are fitted beside effects: on torques that are written down."""

from __future__ import annotations

import numpy as np
import pytest
from linear import COUNT, PARTS, difference_between, written_down

from faultgen.discovery.calibration.ranges import severities
from faultgen.discovery.decision.calibrated import calibrated
from faultgen.discovery.terms.candidates import INERTIA, Term
from faultgen.effects import get_effect

NOTHING = np.zeros((COUNT, 2))


@pytest.fixture
def rng():
    return np.random.default_rng(6)


def fitted(problem, change=NOTHING):
    difference = difference_between(problem)
    scales = difference.model.healthy.log_scales
    return calibrated(problem, difference, scales, change)


def test_numbers_are_fitted_beside_effects(rng):
    """Ridge regression of what the effects leave; effects have no value."""
    columns = 5 * rng.normal(size=(3, COUNT, 2))
    terms = [Term(name, 1, 0.1, 0.1) for name in ("viscous_friction", "rotor_inertia")]
    terms.append(Term("backlash", 1, 1e-3, 1e-3))
    change = 1e-3 * columns[2]
    residual = 0.2 * columns[0] + 0.05 * columns[1] + change + rng.normal(size=(COUNT, 2))
    found = fitted(written_down(terms, columns, residual), change)
    assert found.values * 0.1 == pytest.approx([0.2, 0.05, 0.0], abs=0.02)
    assert found.lines == ()


@pytest.mark.parametrize("kept_for_scoring", [0.2, -0.2])
def test_numbers_that_other_motions_refute_are_taken_back(rng, kept_for_scoring):
    """Only those of the axis that becomes worse; the motions of the gap have no say in it."""
    columns = rng.normal(size=(2, COUNT, 2))
    columns[0, :, 1] = columns[1, :, 0] = 0.0
    terms = [Term("viscous_friction", axis, 0.1, 1.0) for axis in (1, 2)]
    residual = 0.5 * columns.sum(axis=0)
    folds = written_down(terms, columns, residual).folds
    for k, friction in enumerate([1.0, -1.0, 1.0, -1.0, 0.6]):  # others foretell none of them
        for fold in folds[2 * k : 2 * k + 2]:
            residual[fold, 1] = friction * columns[1, fold, 1]
    residual[PARTS[-1], 1] = kept_for_scoring * columns[1, PARTS[-1], 1]
    found = fitted(written_down(terms, columns, residual))
    assert found.values == pytest.approx([0.5, 0.0], abs=0.05)
    assert found.values[1] == 0.0
    (line,) = found.lines
    assert line.startswith("axis 2: the numbers of its drive are used as given")


def test_links_that_spoil_another_axis_are_taken_back(rng):
    """A link acts on both axes: what it makes worse cannot be left to the drives alone."""
    columns = rng.normal(size=(2, COUNT, 2))
    columns[0, :, 1] = 0.0
    terms = [Term("viscous_friction", 1, 0.1, 1.0)]
    terms.append(Term(INERTIA, 2, 0.1, 1.0, (("component", 0.0),)))
    residual = 0.5 * columns[0]
    folds = written_down(terms, columns, residual).folds
    for k, sign in enumerate([1.0, -1.0, 1.0, -1.0, 0.8]):
        for fold in folds[2 * k : 2 * k + 2]:
            residual[fold, 1] = sign * columns[1, fold, 1]
    found = fitted(written_down(terms, columns, residual))
    assert found.values[1] == 0.0
    assert any("all links are used as given" in line for line in found.lines)


@pytest.mark.parametrize("name", ["static_friction", "viscous_friction", "rotor_inertia"])
@pytest.mark.parametrize("sign", [1, -1])
def test_numbers_stay_within_their_physical_ranges(rng, name, sign):
    """A column that resembles something else asks for far more, or for less than nothing."""
    columns = rng.normal(size=(1, COUNT, 2))
    term = Term(name, 1, 0.1, 1.0)
    found = fitted(written_down([term], columns, 9.0 * sign * columns[0]))
    bound = severities(term)[sign > 0]
    effect = get_effect(name)
    assert found.values == pytest.approx([bound], abs=0.01)
    assert effect.smallest < bound < effect.largest


def test_torques_that_no_model_has_are_not_fitted(rng):
    """Hardening of a gearbox is allowed for, and is no number of the model."""
    columns = 5 * rng.normal(size=(2, COUNT, 2))
    terms = [Term(name, 1, 0.1, 0.1) for name in ("stiffness_hardening", "viscous_friction")]
    residual = columns.sum(axis=0) * 0.1 + rng.normal(size=(COUNT, 2))
    found = fitted(written_down(terms, columns, residual))
    assert found.values[0] == 0.0 and found.values[1] == pytest.approx(1.0, abs=0.2)
