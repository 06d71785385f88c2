"""The probabilistic model of a difference, on arrays whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from faultgen.inference.confirm import confirmed, log_predictive, without_refuted
from faultgen.inference.hypotheses import Hypothesis
from faultgen.inference.limits import AGAINST
from faultgen.inference.model import Group, Model, log_bayes_factors
from faultgen.inference.products import Products
from faultgen.inference.search import search

SAMPLES, AXES = 300, 2


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def columns(rng):
    """Twelve numbers in two groups, then four effects; shape (16, samples, axes)."""
    return rng.normal(size=(16, SAMPLES, AXES))


def model_of(columns, difference, std=0.1, mean=0.0):
    products = Products.of(columns, difference, difference.size)
    sizes = np.append(np.full(12, std), np.full(len(columns) - 12, 1.0))
    means = np.append(np.zeros(12), np.full(len(columns) - 12, mean))
    groups = (Group("narrow", 3.0), Group("wide", 3.0))
    return Model(products, sizes, means, np.repeat([0, 1], 6), groups)


def singles(count=4):
    return [Hypothesis((f"effect {k}", 1), f"effect {k}", ((k,),)) for k in range(count)]


def test_the_evidence_is_the_density_of_the_data(columns, rng):
    """Against the density of a normal distribution with the covariance of all parts."""
    difference = rng.normal(size=(SAMPLES, AXES)) + columns[13]
    model = model_of(columns, difference)
    dense = []
    for effects in ((), (1,)):
        found = model.fit(effects)
        chosen = [*range(12), *(12 + k for k in effects)]
        x = columns[chosen].reshape(len(chosen), -1)
        scale = np.exp(np.append(found.log_scales, 0.0))[[*model.group, *(2 for _ in effects)]]
        covariance = np.eye(difference.size) + (x.T * (scale * model.std[chosen]) ** 2) @ x
        prior = 0.5 * np.sum((found.log_scales / np.log(3.0)) ** 2)
        log_density = multivariate_normal(cov=covariance).logpdf(difference.ravel())
        dense.append(log_density - prior - found.log_evidence)
    assert dense[0] == pytest.approx(dense[1], abs=1e-4)  # but for one constant


def test_scales_are_those_of_the_numbers(columns, rng):
    """One group is ten times as far off as usual, the other a third."""
    values = np.append(rng.normal(0, 0.03, 6), rng.normal(0, 1.0, 6))
    difference = np.tensordot(values, columns[:12], axes=1)
    difference += rng.normal(size=difference.shape)
    narrow, wide = np.exp(model_of(columns, difference).healthy.log_scales)
    assert narrow < 1 < 4 < wide


@pytest.mark.parametrize("effects", [(), (1,)])
def test_the_curvature_is_that_of_the_evidence(columns, rng, effects):
    """Against differences of its slope, where the data tell more than the prior."""
    difference = np.tensordot(rng.normal(0, 0.2, 12), columns[:12], axes=1) + columns[13]
    model = model_of(columns, difference + rng.normal(size=(SAMPLES, AXES)))
    found = model.fit(effects)
    cost, best = model.cost_of(effects), found.log_scales
    steps = 1e-3 * np.eye(2)
    slopes = [(cost(best + d)[1] - cost(best - d)[1]) / 2e-3 for d in steps]
    np.testing.assert_allclose(found.curvature, slopes, rtol=1e-5, atol=1e-5)
    assert np.abs(cost(best)[1]).max() < 0.05


def test_a_fit_from_another_one_is_the_same(columns, rng):
    """Also where a scale stands at its bound."""
    difference = np.tensordot(rng.normal(0, 0.1, 12), columns[:12], axes=1) + columns[13]
    difference += rng.normal(size=(SAMPLES, AXES))
    for size in (1.0, 300.0):
        model = model_of(columns, size * difference)
        near, far = model.fit([1], model.healthy), model.fit([1])
        assert near.log_evidence == pytest.approx(far.log_evidence, abs=0.01)
        np.testing.assert_allclose(near.log_scales, far.log_scales, atol=0.1)


def test_scales_come_back_beside_a_large_effect(columns, rng):
    """Numbers were widened for what an effect explains far better, so that no curvature holds."""
    difference = 1e3 * columns[13] + 0.3 * columns[0] + rng.normal(size=(SAMPLES, AXES))
    model = model_of(columns, difference)
    near, far = model.fit([1], model.healthy), model.fit([1])
    assert np.exp(model.healthy.log_scales).max() > 20
    assert near.log_evidence == pytest.approx(far.log_evidence, abs=0.01)


def test_the_largest_effect_comes_first(columns, rng):
    """However sure the others are."""
    difference = 0.5 * columns[12] + 2.0 * columns[13] + rng.normal(size=(SAMPLES, AXES))
    found = search(model_of(columns, difference), singles(), sure=3.0)
    turned = replace(
        found,
        effects=found.effects[::-1],
        fitted=found.fitted.model.fit([one.forms[0][0] for one in found.effects[::-1]]),
    )
    for one in (found, turned):
        assert [effect.keys[0][0] for effect in one.by_size()] == ["effect 1", "effect 0"]


def test_other_data_refute_what_only_the_first_ones_show(columns, rng):
    """An effect that is in both stays."""
    first = columns[12] + 0.8 * columns[13] + rng.normal(size=(SAMPLES, AXES))
    found = search(model_of(columns, first), singles(), sure=3.0)
    assert len(found.effects) == 2
    others = rng.normal(size=columns.shape)
    other = others[12] + rng.normal(size=(SAMPLES, AXES))
    kept, refuted = confirmed(found, Products.of(others, other, other.size))
    assert [one.keys[0][0] for one in kept.effects] == ["effect 0"]
    ((lost, gained),) = refuted
    assert lost.keys[0][0] == "effect 1" and gained < -AGAINST
    both = other + 0.8 * others[13]
    kept, refuted = confirmed(found, Products.of(others, both, both.size))
    assert len(kept.effects) == 2 and not refuted


def test_numbers_that_other_data_refute_are_exact(columns, rng):
    """A group that only fits the first data; the other group keeps its scale."""
    values = np.append(rng.normal(0, 0.1, 6), rng.normal(0, 1.0, 6))
    first = np.tensordot(values, columns[:12], axes=1) + rng.normal(size=(SAMPLES, AXES))
    others = rng.normal(size=columns.shape)
    noise = rng.normal(size=(SAMPLES, AXES))
    held = [
        Products.of(others, np.tensordot(values[:count], others[:count], axes=1) + noise, 600)
        for count in (6, 12)
    ]
    model = model_of(columns, first)
    refuted, right = (without_refuted(model, one, ["narrow", "wide"]) for one in held)
    assert refuted.groups[0] == model.groups[0]
    assert np.exp(refuted.healthy.log_scales[1]) < 0.05
    assert right.groups == model.groups


def test_the_probability_of_other_data_is_their_density(columns, rng):
    """Against a normal distribution with the covariance of noise and of all errors."""
    first = columns[12] + rng.normal(size=(SAMPLES, AXES))
    model = model_of(columns, first)
    others = rng.normal(size=(len(columns), 20, AXES))
    other = others[12] + rng.normal(size=(20, AXES))
    apart = []
    for effects in ((), (0,)):
        found = model.fit(effects)
        chosen = [*range(12), *(12 + k for k in effects)]
        x = others[chosen].reshape(len(chosen), -1)
        law = multivariate_normal(x.T @ found.values, np.eye(40) + x.T @ found.covariance @ x)
        told = log_predictive(found, Products.of(others, other, 40))
        apart.append(law.logpdf(other.ravel()) - told)
    assert apart[0] == pytest.approx(apart[1], abs=1e-6)  # but for one constant


def test_an_effect_is_found_with_its_size(columns, rng):
    difference = 0.8 * columns[14] + rng.normal(size=(SAMPLES, AXES))
    model = model_of(columns, difference)
    found = search(model, singles(), sure=3.0)
    (effect,) = found.effects
    assert effect.keys[0] == ("effect 2", 1)
    assert effect.credible == 1
    assert abs(found.fitted.values[12] - 0.8) < 3 * found.fitted.errors[12]


def test_a_number_that_is_far_off_does_not_hide_its_group(columns, rng):
    """An effect that changes one number of a group: the others say that it is no usual error."""
    usual = np.append(rng.normal(0, 0.1, 6), rng.normal(0, 0.1, 6))
    usual[2] = 0.0
    difference = np.tensordot(usual, columns[:12], axes=1) + 1.5 * columns[2]
    difference += rng.normal(size=difference.shape)
    with_effect = np.concatenate([columns[:12], columns[2:3]])
    found = search(model_of(with_effect, difference), singles(1), sure=3.0)
    assert [one.keys[0] for one in found.effects] == [("effect 0", 1)]


def test_what_cannot_be_told_apart_stays_together(columns, rng):
    columns[15] = columns[14] + 1e-3 * rng.normal(size=(SAMPLES, AXES))
    difference = columns[14] + rng.normal(size=(SAMPLES, AXES))
    found = search(model_of(columns, difference), singles(), sure=3.0)
    (effect,) = found.effects
    assert effect.credible == 2
    assert {key[0] for key in effect.keys[:2]} == {"effect 2", "effect 3"}
    assert effect.probabilities[:2] == pytest.approx(0.5, abs=0.05)


def test_two_effects_are_found_one_after_the_other(columns, rng):
    difference = columns[12] - 0.6 * columns[13] + rng.normal(size=(SAMPLES, AXES))
    found = search(model_of(columns, difference), singles(), sure=3.0)
    assert [one.keys[0][0] for one in found.effects] == ["effect 0", "effect 1"]
    assert found.rejected.odds < 0


def test_the_next_effect_is_told_if_it_is_likely(columns, rng):
    """Of three sizes, the smallest is not told, and the largest needs no such rule."""
    noise = rng.normal(size=(SAMPLES, AXES))
    noise -= columns[14] * np.sum(columns[14] * noise) / np.sum(columns[14] ** 2)
    told = {}
    for size in (0.1, 0.17, 0.3):
        found = search(model_of(columns, size * columns[14] + noise), singles(), sure=4.6)
        told[size] = len(found.effects), [one.keys[0] for one in found.or_likely(singles()).effects]
    assert told == {
        0.1: (0, []),
        0.17: (0, [("effect 2", 1)]),
        0.3: (1, [("effect 2", 1)]),
    }


def test_healthy_differences_hardly_show_effects(columns, rng):
    """In 200 draws from the model itself, odds of 20 to 1 are rarer than 1 in 20."""
    alarms = 0
    for _ in range(200):
        difference = np.tensordot(rng.normal(0, 0.1, 12), columns[:12], axes=1)
        difference += rng.normal(size=difference.shape)
        alarms += bool(search(model_of(columns, difference), singles(), sure=3.0).effects)
    assert alarms < 10


def test_a_play_has_the_size_of_its_column(columns, rng):
    """A column that explains with a hundredth of its size is no play of that size."""
    for share, is_play in ((1.0, True), (-0.05, False)):
        difference = 3 * share * columns[13] + rng.normal(size=(SAMPLES, AXES))
        model = model_of(columns, difference, mean=3.0)
        model.std[12:] = 0.45
        found = search(model, singles(), sure=3.0)
        assert bool(found.effects) == is_play


def test_bayes_factors_are_those_of_the_model_with_given_scales(columns, rng):
    difference = columns[12] + rng.normal(size=(SAMPLES, AXES))
    model = model_of(columns, difference)
    healthy = model.healthy
    left = model.without_numbers(healthy.log_scales)
    (factor,) = log_bayes_factors(left, np.zeros(4), [(0,)])
    assert factor == pytest.approx(model.fit([0]).log_evidence - healthy.log_evidence, abs=1.0)


def test_a_centre_is_what_scales_are_before_the_data(columns):
    """Columns that tell nothing leave the centre; given scales hold however far off data are."""
    products = Products.of(1e-6 * columns, columns[0], columns[0].size)
    groups = (Group("narrow", 2.0, 0.3), Group("wide", 2.0, 5.0))
    model = Model(products, np.full(16, 0.1), np.zeros(16), np.repeat([0, 1], 6), groups)
    assert np.exp(model.healthy.log_scales) == pytest.approx([0.3, 5.0], rel=1e-3)
    fixed = (Group("narrow", 1.001, 0.3), Group("wide", 1.001, 5.0))
    given = Model(
        Products.of(columns, 3 * columns[0], columns[0].size), *vars_of(model), groups=fixed
    )
    assert np.exp(given.healthy.log_scales) == pytest.approx([0.3, 5.0], rel=0.01)


def vars_of(model):
    return model.std, model.mean, model.group


def test_learned_groups_are_the_posterior_of_their_scales(columns, rng):
    """Against the posterior on a grid; a group without data keeps what was known."""
    values = np.append(rng.normal(0, 0.3, 6), np.zeros(6))
    columns[6:12] = 1e-6 * columns[6:12]
    difference = np.tensordot(values, columns[:12], axes=1)
    difference += rng.normal(size=difference.shape)
    model = model_of(columns, difference)
    narrow, wide = model.learned()
    grid = np.linspace(-1, 3.4, 300)
    densities = []
    x = columns[:6].reshape(6, -1)
    gram, right = x @ x.T, x @ difference.ravel()
    for one in grid:
        precision = gram + np.eye(6) / (0.1 * np.exp(one)) ** 2
        log = 0.5 * right @ np.linalg.solve(precision, right)
        log -= 0.5 * np.linalg.slogdet(precision)[1] + 6 * one
        densities.append(log - 0.5 * (one / np.log(3.0)) ** 2)
    weights = np.exp(np.array(densities) - max(densities))
    weights /= weights.sum()
    mean = weights @ grid
    assert np.log(narrow.centre) == pytest.approx(grid[np.argmax(weights)], abs=0.03)
    assert np.log(narrow.spread) == pytest.approx(np.sqrt(weights @ (grid - mean) ** 2), rel=0.15)
    assert (wide.name, wide.centre) == ("wide", pytest.approx(1.0, rel=1e-3))
    assert wide.spread == pytest.approx(3.0, rel=1e-3)


def test_scales_are_learned_from_one_difference_after_another(columns, rng):
    """Each makes them better known; all together are as good as their number."""
    groups, spreads = None, []
    for _ in range(4):
        values = np.append(rng.normal(0, 0.3, 6), rng.normal(0, 0.1, 6))
        difference = np.tensordot(values, columns[:12], axes=1)
        difference += rng.normal(size=difference.shape)
        model = model_of(columns, difference)
        if groups:
            model = Model(model.products, *vars_of(model), groups=groups)
        groups = model.learned()
        spreads.append(groups[0].spread)
    assert spreads == sorted(spreads, reverse=True)
    assert groups[0].centre == pytest.approx(3.0, rel=0.5)
    assert groups[1].centre == pytest.approx(1.0, rel=0.5)


def test_a_model_without_groups_is_that_of_the_others(columns, rng):
    """The same evidence as of a model that never had them; effects stay."""
    difference = columns[13] + rng.normal(size=(SAMPLES, AXES))
    model = model_of(columns, difference)
    less = model.without(["wide"])
    assert (model.count, less.count) == (12, 6)
    rest = np.concatenate([columns[:6], columns[12:]])
    products = Products.of(rest, difference, difference.size)
    own = Model(products, less.std, less.mean, np.zeros(6, int), model.groups)
    for effects in ((), (1,)):
        assert less.fit(effects).log_evidence == pytest.approx(own.fit(effects).log_evidence)
    assert model.without([]).count == 12


def with_unknown(columns, rng, size, named=0.0):
    """Six numbers, six torques of unknown form, and two named effects; the first is a mixture."""
    columns = columns[:14].copy()
    shapes = 0.5 * rng.normal(size=6)
    difference = size * np.tensordot(shapes, columns[6:12], axes=1) + named * columns[12]
    difference += rng.normal(size=(SAMPLES, AXES))
    every = np.concatenate([columns, columns[6:12]])
    products = Products.of(every, difference, difference.size)
    std = np.concatenate([np.full(6, 0.1), np.full(6, 1e-3), np.ones(2), np.full(6, 0.5)])
    groups = (Group("narrow", 3.0), Group("generic", 3.0))
    model = Model(products, std, np.zeros(20), np.repeat([0, 1], 6), groups)
    hypotheses = [*singles(2), Hypothesis(("unknown", 1), "unknown", (tuple(range(2, 8)),), True)]
    return search(model, hypotheses, 4.6, ["generic"])


def test_what_no_named_effect_explains_is_unknown(columns, rng):
    assert [one.keys[0] for one in with_unknown(columns, rng, 1.0).effects] == [("unknown", 1)]
    assert with_unknown(columns, rng, 0.0).effects == ()


def test_a_named_effect_stays_beside_an_unknown_one(columns, rng):
    """And alone, although a torque of any form could explain it as well."""
    both = with_unknown(columns, rng, 1.0, named=1.0)
    assert {one.keys[0] for one in both.effects} == {("unknown", 1), ("effect 0", 1)}
    alone = with_unknown(columns, rng, 0.0, named=1.0)
    assert [one.keys[0] for one in alone.effects] == [("effect 0", 1)]


def test_an_effect_that_others_make_needless_is_taken_back(columns, rng):
    """The sum of two effects looks like a third one, which is found first."""
    columns[14] = 0.7 * (columns[12] + columns[13]) + 0.1 * columns[14]
    difference = columns[12] + 0.4 * columns[13] + rng.normal(size=(SAMPLES, AXES))
    model = model_of(columns, difference)
    first = search(model, [singles()[2]], sure=3.0)
    assert [one.keys[0][0] for one in first.effects] == ["effect 2"]
    found = search(model, singles(), sure=3.0)
    assert {one.keys[0][0] for one in found.effects} == {"effect 0", "effect 1"}
    sizes = dict(
        zip((one.keys[0][0] for one in found.effects), found.fitted.values[12:], strict=True)
    )
    assert sizes == pytest.approx({"effect 0": 1.0, "effect 1": 0.4}, abs=0.15)
