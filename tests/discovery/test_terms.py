"""What may differ between a robot and its model."""

import mujoco
import numpy as np
import pytest

from faultgen.discovery.terms.candidates import (
    INERTIA,
    effect_terms,
    names_by_use,
    periodic_terms,
    scanned_terms,
)
from faultgen.discovery.terms.inertia import apply_inertia, inertia_terms
from faultgen.effects import EFFECTS, Effect, Prior
from faultgen.effects.coupling import coupled_axes
from faultgen.errors import InputError
from faultgen.robot import load_robot


def test_every_effect_is_a_term_of_every_axis_that_can_have_it():
    robot = load_robot("puma560")
    keys = {term.key for term in effect_terms(robot)}
    assert {name for name, _ in keys} == set(names_by_use("always"))
    assert keys >= {("viscous_friction", axis) for axis in range(1, 7)}
    assert {axis for name, axis in keys if name == "payload_mass"} == set(range(1, 7))
    points = {axis for axis in range(1, 7) if len(terms_of(robot, "payload_mass", axis)) == 4}
    assert points == {1, 2, 3, 4, 5}  # of unknown place; the payload of the model has one
    assert {axis for name, axis in keys if name == "payload_offset"} == {6}
    without = {term.name for term in effect_terms(robot, exclude=["backlash"])}
    assert "backlash" not in without


def terms_of(robot, name, axis):
    return [term for term in effect_terms(robot) if term.key == (name, axis)]


@pytest.mark.parametrize(
    ("n_axes", "coupled"),
    [(1, []), (2, [2]), (5, [2, 3, 4, 5]), (6, [5, 6]), (7, [5, 6, 7])],
)
def test_axes_of_a_wrist_are_coupled(n_axes, coupled):
    """Each with the one before it; of fewer than six axes, every one that has one before it."""
    assert list(coupled_axes(n_axes)) == coupled


def test_shafts_rub_on_the_sum_or_on_the_difference_of_two_speeds():
    """Both are candidates on every coupled axis."""
    terms = effect_terms(load_robot("puma560"))
    found = [(t.axis, dict(t.parameters)["ratio"]) for t in terms if "coupling" in t.name]
    assert sorted(found) == [(5, -1.0), (5, 1.0), (6, -1.0), (6, 1.0)]


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ({}, "effect rust: has no prior, which states"),
        ({"prior": 0.1}, "effect rust: prior must be a Prior, not float"),
        ({"prior": Prior(steps=(0.1,))}, "effect rust: prior: std must be positive"),
        ({"prior": Prior(std=0.1)}, "effect rust: prior: give either steps or steps_in_std"),
        ({"prior": Prior(use="never")}, "effect rust: prior: use = 'never' needs a reason"),
        (
            {"prior": Prior(use="on request", std=1.0, steps=(0.1,))},
            "effect rust: prior: use = 'on request' needs a reason",
        ),
    ],
)
def test_an_effect_states_what_discovery_assumes(prior, message):
    """Nothing is guessed: an effect without a complete record is refused by name."""
    facts = {"description": "-", "unit": "-", "signature": "-", "element": "-", "source": "-"}
    with pytest.raises(InputError, match=message):
        Effect(name="rust", **facts, **prior)


def test_tolerances_and_steps_are_positive(tiny_robot):
    terms = effect_terms(tiny_robot) + inertia_terms(tiny_robot)
    terms += periodic_terms(tiny_robot, "torque_ripple", 1, 3.5)
    assert all(term.prior_std > 0 and term.step > 0 for term in terms)


def test_inertias_are_those_of_bodies_that_exist(tiny_robot):
    """Any values, far beyond the prior standard deviations, give a model that compiles."""
    rng = np.random.default_rng(1)
    terms = inertia_terms(tiny_robot)
    assert {term.axis for term in terms} == {1, 2, 3}  # two links and the payload
    for _ in range(20):
        spec = tiny_robot.spec()
        apply_inertia(spec, tiny_robot, [(t, 10 * t.prior_std * rng.normal()) for t in terms])
        model = spec.compile()
        a, b, c = np.sort(model.body_inertia[1:], axis=1).T
        assert (model.body_mass[1:] > 0).all() and (a > 0).all() and (a + b >= c * (1 - 1e-6)).all()


def test_a_mass_and_a_shift_are_what_they_say(tiny_robot):
    """(1 + v)^2 of the mass at the same place; a shift moves the centre of mass by v."""
    by = {(t.axis, dict(t.parameters)["component"]): t for t in inertia_terms(tiny_robot)}
    spec = tiny_robot.spec()
    apply_inertia(spec, tiny_robot, [(by[2, 3.0], 0.1), (by[1, 7.0], 0.03)])
    model, before = spec.compile(), tiny_robot.model

    def body(name):
        return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)

    one, two = body("link1"), body("link2")
    assert model.body_mass[two] == pytest.approx(1.21 * before.body_mass[two])
    np.testing.assert_allclose(model.body_ipos[two], before.body_ipos[two], atol=1e-9)
    np.testing.assert_allclose(model.body_ipos[one] - before.body_ipos[one], [0.03, 0, 0])
    assert all(term.name == INERTIA for term in by.values())


def test_no_effect_is_probed_beyond_its_bounds(robot, tiny_robot):
    """A column of ten radians of encoder offset, say, is no slope at all."""
    for one in (robot, tiny_robot):
        for term in effect_terms(one) + scanned_terms(one):
            effect = EFFECTS[term.name]
            is_point = term.name == "payload_mass" and term.parameters
            largest = effect.point_largest if is_point else effect.largest
            assert effect.smallest < term.step < largest, term


def test_an_effect_is_scanned_finely_and_allowed_for_once(tiny_robot):
    """The prior of a play is that of its term; the severities in between add next to nothing."""
    scanned = [term for term in scanned_terms(tiny_robot) if term.axis == 1]
    (own,) = {t.prior_std for t in effect_terms(tiny_robot) if t.key == ("backlash", 1)}
    assert sum(term.prior_std**2 for term in scanned) < (0.5 * own) ** 2
    steps = np.array([term.step for term in scanned])
    assert steps[0] < 5e-5 and steps[-1] > 3e-3  # from hardly seen to badly worn
    assert np.all(steps[1:] / steps[:-1] < 1.3)
    assert not scanned_terms(tiny_robot, exclude=["backlash"])
