"""Which effects are chosen, and what is not excluded: on torques that are written down."""

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down

from faultgen.discovery.decision.certainty import overdispersion
from faultgen.discovery.decision.selection import (
    FORM_ERROR,
    SHARE,
    SIMILAR,
    SURE,
    SURE_IMITATED,
    SURE_WITH_BASELINE,
    choose,
    groups_of,
    needed,
)
from faultgen.discovery.fit.fit import fit
from faultgen.discovery.terms.candidates import FORM, INERTIA, PAYLOAD, Term

FITTED = np.arange(COUNT) < PARTS[-1].start
NAMES = ["torque_offset", "coulomb_friction", "payload_mass", "torque_constant", "delay"]


@pytest.fixture
def shapes():
    """Five torques; on the motions for fitting they are orthonormal."""
    rng = np.random.default_rng(6)
    made = rng.normal(size=(5, COUNT, 2))
    fitted = np.linalg.qr(made[:, FITTED].reshape(5, -1).T)[0].T
    made[:, FITTED] = fitted.reshape(5, -1, 2)
    made[:, ~FITTED] /= np.sqrt(2 * FITTED.sum())
    return made


def posed(shapes, gains, *, baseline=True, noise=0.0, names=NAMES):
    """A problem whose effects take given amounts off the misfit, of columns of size 100."""
    columns = 100 * shapes
    values = np.sqrt(np.asarray(gains, float)) / 100
    terms = [Term(name, 1, 0.1, 1e-4) for name in names[: len(columns)]]
    residual = np.tensordot(values, columns, axes=1)
    residual += noise * np.random.default_rng(7).normal(size=residual.shape)
    return written_down(terms, columns, residual, baseline=baseline)


def test_candidates_are_effects_of_which_some_have_several_terms():
    """Sine and cosine are one, and so are the points of a payload; the rest is only allowed for."""

    def wave(order, phase, axis=1):
        given = (("order", order), ("phase", phase))
        return Term("torque_ripple", axis, 0.1, 0.1, given)

    def point(x):
        return Term(PAYLOAD, 2, 0.1, 0.1, (("x", x), ("y", 0.0), ("z", 0.0)))

    terms = [
        Term("backlash", 1, 1e-4, 0.1),
        wave(2.0, 0.0),
        Term(INERTIA, 1, 0.1, 0.1),
        wave(2.0, 1.57),
        wave(4.0, 0.0),
        wave(2.0, 0.0, axis=2),
        point(0.0),
        Term(FORM, 1, 0.1, 0.1),
        point(0.1),
        Term("delay", 1, 0.1, 0.1, nuisance=True),
        Term("backlash", 1, 1e-3, 0.1),
        Term(PAYLOAD, 2, 0.1, 0.1),
    ]
    expected = [(0,), (1, 3), (4,), (5,), (6, 8), (10,), (11,)]
    assert groups_of(terms) == expected


def test_more_is_needed_where_other_things_look_like_the_effect():
    """A wrong model imitates some effects; a baseline excludes that."""
    terms = [Term("coulomb_friction", 1, 0.1, 0.1), Term("gravity_spring", 1, 0.1, 0.1)]
    for baseline, least in ((True, [SURE_WITH_BASELINE] * 2), (False, [SURE, SURE_IMITATED])):
        problem = written_down(
            terms, np.zeros((2, COUNT, 1)), np.zeros((COUNT, 1)), baseline=baseline, trust=None
        )
        assert [needed(problem, (k,)) for k in (0, 1)] == least


@pytest.mark.parametrize("baseline", [True, False])
def test_effects_are_added_until_nothing_is_missing(shapes, baseline):
    """The strongest first; each set is fitted, and what is too weak is not taken."""
    gains = [100.0, 0.0, 5000.0, 600.0, 10.0]
    found = choose(posed(shapes, gains, baseline=baseline))
    sets = [set(one.groups) for one in found.fits]
    assert sets[:4] == [set(), {(2,)}, {(2,), (3,)}, {(2,), (3,), (0,)}][: len(sets)]
    # the third is less than 3 % of what all explain together
    assert found.best is found.fits[-1] and len(sets) == 3
    falls = [float(b.misfit - a.misfit) for a, b in zip(found.fits[1:], found.fits, strict=False)]
    assert falls == pytest.approx([5000.0, 600.0], rel=1e-3)
    assert found.best.values * 100 == pytest.approx(np.sqrt([5000.0, 600.0]), rel=1e-3)
    assert found.rivals == ()


@pytest.mark.parametrize("more", [0.9, 1.1])
def test_an_effect_has_a_share_in_what_all_explain(shapes, more):
    """However large it is against noise."""
    first = 50_000.0
    gains = [first, more * SHARE * first, 0, 0, 0]
    assert gains[1] > 10 * SURE
    found = choose(posed(shapes, gains))
    assert len(found.best.groups) == (2 if more > 1 else 1)


@pytest.mark.parametrize(("gain", "is_named"), [(17.5, False), (18.5, True)])
def test_an_effect_is_named_from_a_certain_gain_on(shapes, gain, is_named):
    """That which is needed with a baseline."""
    assert 17.5 < SURE_WITH_BASELINE < 18.5
    found = choose(posed(shapes, [0, 0, 0, gain, 0]))
    assert bool(found.best.groups) == is_named and len(found.fits) == 1 + is_named


def test_a_second_kind_of_friction_must_be_large(shapes):
    """On the axis of another one; a tenth of what all explain."""
    names = ["coulomb_friction", "viscous_friction"]
    for share, count in ((0.08, 1), (0.13, 2)):
        problem = posed(shapes[:2], [2000.0, share * 2000.0], names=names)
        assert len(choose(problem).best.groups) == count


def test_an_effect_that_two_others_explain_is_exchanged(shapes):
    """The first that is added is like the sum of two effects, and none of it is there."""
    shapes = shapes.copy()
    shapes[2] = 0.6 * shapes[0] + 0.6 * shapes[1] + 0.53 * shapes[2]
    found = choose(posed(shapes, [5000.0, 4000.0, 0, 0, 0]))
    assert found.fits[1].groups == ((2,),)
    assert set(found.best.groups) == {(0,), (1,)}
    assert found.best.misfit < 1


@pytest.mark.parametrize("noise", [1.0, 2.0])
@pytest.mark.parametrize("apart", [0.05, 0.2, 0.6])
def test_rivals_are_those_that_are_about_as_good(shapes, apart, noise):
    """How much worse they are is told in units of noise and of what a wrong form may do."""
    shapes = shapes.copy()
    shapes[1] = np.sqrt(1 - apart**2) * shapes[0] + apart * shapes[1]
    problem = posed(shapes[:2], [3000.0 * noise**2, 0], noise=noise)
    found = choose(problem)
    own, other = fit(problem, [(0,)]), fit(problem, [(1,)])
    assert found.best.groups == ((0,),)
    over = overdispersion(problem, own)
    size = float((own.values / own.errors).item() ** 2)
    worse = (other.score - own.score) / (over + FORM_ERROR * size)
    if apart == 0.05:
        assert worse < SIMILAR
        ((place, group, told),) = found.rivals
        assert (place, group) == (0, (1,)) and told == pytest.approx(worse, rel=1e-6)
    else:
        assert worse > SIMILAR and found.rivals == ()
