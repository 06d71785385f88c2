"""How well the numbers of a model are known is learned from all numbers of a kind together."""

from dataclasses import replace

import numpy as np
import pytest
from linear import COUNT, written_down

import faultgen
from faultgen.discovery import write_recording
from faultgen.discovery.decision.healthy_spread import learned_scales, with_scales
from faultgen.discovery.terms.candidates import Term

AXES = 12


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def posed(rng, values, *, size=1.0, name="viscous_friction"):
    """A number of the same kind on each axis; a prior standard deviation makes `size` N m."""
    columns = np.zeros((AXES, COUNT, AXES))
    for axis in range(AXES):
        columns[axis, :, axis] = size * rng.standard_normal(COUNT) / 0.05
    terms = [Term(name, axis + 1, 0.1, 0.05) for axis in range(AXES)]
    residual = np.tensordot(values, columns, axes=1) + rng.standard_normal((COUNT, AXES))
    return written_down(terms, columns, residual)


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
def test_a_model_that_is_better_or_worse_than_usual_is_recognised(rng, factor):
    values = factor * 0.05 * rng.standard_normal(AXES)
    (kind, scale), *others = learned_scales(posed(rng, values)).items()
    assert kind == "friction" and not others
    shown = np.sqrt((np.sum((values / 0.05) ** 2) + 1) / (AXES + 1))
    assert scale == pytest.approx(shown, rel=0.35)


def test_one_number_that_is_far_off_hardly_widens_the_others(rng):
    """It is a change of the robot, and is much clearer with the learned scale."""
    values = 0.2 * 0.05 * rng.standard_normal(AXES)
    usual = learned_scales(posed(rng, values))["friction"]
    values[3] = 0.2  # four usual standard deviations
    problem = posed(rng, values)
    scales = learned_scales(problem)
    assert scales["friction"] < 1.5 * usual < 0.7
    gains = [one.evidence().gains([(3,)])[0][0] for one in (problem, with_scales(problem, scales))]
    assert gains[1] > 4 * gains[0]


def test_numbers_that_the_recording_does_not_show_keep_their_priors(rng):
    problem = posed(rng, np.zeros(AXES), size=1e-3)
    assert learned_scales(problem)["friction"] == pytest.approx(1.0, abs=0.01)


def test_no_number_is_taken_for_exact(rng):
    """Even if all numbers are right, the prior stays as wide as one usual number makes it."""
    scale = learned_scales(posed(rng, np.zeros(AXES)))["friction"]
    assert scale == pytest.approx(1 / np.sqrt(AXES + 1), rel=0.2)


def test_a_bad_model_has_to_be_calibrated_first(rng):
    values = 100 * 0.05 * rng.standard_normal(AXES)
    assert learned_scales(posed(rng, values))["friction"] == 10.0


def test_other_terms_keep_their_priors(rng):
    problem = posed(rng, np.zeros(AXES), name="backlash")
    assert learned_scales(problem) == {}
    scaled = with_scales(problem, {"friction": 0.2})
    assert scaled.terms == problem.terms and np.array_equal(scaled.white, problem.white)


def test_columns_are_scaled_as_the_priors_are(rng):
    problem = posed(rng, np.zeros(AXES))
    scaled = with_scales(problem, {"friction": 0.5})
    assert [term.prior_std for term in scaled.terms] == [0.025] * AXES
    assert np.allclose(scaled.white, 0.5 * problem.white)


@pytest.mark.slow
def test_a_change_of_a_well_known_robot_is_named_without_a_baseline(
    measured, tiny_robot_path, tmp_path
):
    """20 % more viscous friction on one axis is four usual standard deviations of a model.

    If the uncertainty is fixed, calibration takes the change for an error of the model.
    """
    write_recording(measured([("viscous_friction", 2, 0.2)], 3), tmp_path / "worn.h5")
    cache = tmp_path / "cache"
    learned = faultgen.discover(tmp_path / "worn.h5", tiny_robot_path, cache=cache)
    assert [(e["effect"], e["axis"]) for e in learned["effects"]] == [("viscous_friction", 2)]
    assert learned["effects"][0]["parameters"]["severity"] == pytest.approx(0.2, rel=0.1)
    assert learned["prior_scales"]["friction"] < 1
    fixed = faultgen.discover(tmp_path / "worn.h5", tiny_robot_path, cache=cache, prior_scale=1.0)
    assert fixed["effects"] == [] and fixed["prior_scales"] == {}


def test_a_torque_from_a_current_is_off_on_all_axes(rng):
    """One axis whose zero is off is a change of the robot; the zeros of all axes are not."""
    values = np.zeros(AXES)
    values[2] = 15 * 0.05
    one = posed(rng, values, name="torque_offset")
    assert learned_scales(one) == {"zero of the torque": 1.0}  # never better than usual
    every = posed(rng, 6 * 0.05 * rng.choice([-1, 1], AXES), name="torque_offset")
    assert learned_scales(every)["zero of the torque"] > 4


def test_friction_of_another_form_says_nothing_about_other_friction(rng):
    names = ["viscous_friction", "static_friction"] * (AXES // 2)
    values = np.where(np.arange(AXES) % 2, 4.0, 0.3) * 0.05 * rng.choice([-1, 1], AXES)
    problem = posed(rng, values)
    terms = [replace(t, name=name) for t, name in zip(problem.terms, names, strict=True)]
    scales = learned_scales(replace(problem, terms=terms))
    assert scales["friction"] < 0.7 and scales["friction at low speed"] > 2.5
    alike = replace(posed(rng, np.zeros(AXES)), terms=terms)
    assert len(set(learned_scales(alike).values())) == 1
