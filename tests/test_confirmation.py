"""Whether other motions bear out a set of effects: on torques that are written down.

In all cases the noise is white with deviation 1 N m, and the fit to the first 500 samples is exact
unless a test says otherwise. The last 100 samples are the scoring motion.
"""

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down

from faultgen.discovery.calibration.model_edit import simulated_numbers
from faultgen.discovery.decision.confirmation import MISSED, STRONG, Trial, confirmed
from faultgen.discovery.decision.scoring_errors import (
    LARGER,
    LARGER_BUILT,
    LARGER_OWN,
    LARGER_OWN_BUILT,
    LARGER_OWN_SURE,
    LARGER_OWN_WITH_BASELINE,
    LARGER_SURE,
    LARGER_WITH_BASELINE,
)
from faultgen.discovery.decision.selection import SURE, SURE_IMITATED, SURE_WITH_BASELINE, Choice
from faultgen.discovery.fit.fit import fit
from faultgen.discovery.terms.candidates import Term

SCORED = PARTS[-1]
WEAK = np.sqrt(0.95 * STRONG * SURE_IMITATED / 500)
"""Torque of an effect whose evidence on the motions for fitting is not strong."""
STEADY = np.ones(100)
TURNING = np.tile([1.0, -1.0], 50)
FITTED = [np.tile(pattern, 125) for pattern in ([1.0, 1, -1, -1], [1.0, -1, 1, -1], [1.0, 1, 1, 1])]
"""Three patterns of the motions for fitting: orthogonal, each with the square sum 500."""


def offset(axis=1, name="torque_offset", prior_std=1e-3):
    """A term. Its prior is so narrow that calibration does not put it into the model."""
    return Term(name, axis, 0.1, prior_std)


def column(fitted, in_scoring=0.0, axis=1):
    """Torque of a term with value 1: one axis, on the motions for fitting and for scoring."""
    made = np.zeros((COUNT, 2))
    made[: SCORED.start, axis - 1] = fitted
    made[SCORED, axis - 1] = in_scoring
    return made


def chosen(problem, *groups):
    """The choice of a set, as if it had been found, with a rival."""
    fits = [fit(problem, [*groups[:k]]) for k in range(len(groups) + 1)]
    assert None not in fits
    return Choice(problem, tuple(fits), fits[-1], ((0, groups[0], 2.0),))


@pytest.fixture
def trials(monkeypatch):
    """Sets that were tried, each with what was found on one effect of it."""
    made, of = [], Trial.of

    def spied(problem, group, fits, errors):
        made.append((fits[1].groups, group, of(problem, group, fits, errors)))
        return made[-1][2]

    monkeypatch.setattr(Trial, "of", spied)
    return made


def lenient(problem):
    """Error of a calibrated model that is so large that every simulated model is better."""
    return 100.0 + 0 * problem.residual


def judged(problem, choice, calibrated=None):
    """What is borne out, with the calibrated numbers of the model without effects."""
    calibrated = lenient(problem) if calibrated is None else calibrated
    return confirmed(problem, choice, calibrated, simulated_numbers(problem, choice.fits[0]))


def groups_left(problem, choice, calibrated=None):
    """The effects that are kept."""
    return judged(problem, choice, calibrated).choice.best.groups


@pytest.mark.parametrize("baseline", [True, False])
@pytest.mark.parametrize("period", [0.004, 0.01])
def test_facts_of_a_trial(trials, baseline, period):
    """Least squares, written out; there is noise, twice as much of it in the scoring motion."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(2, COUNT, 2))
    noise = rng.normal(size=(COUNT, 2))
    noise[SCORED] *= 2
    residual = 0.8 * columns[0] + 0.5 * columns[1] + noise
    residual[SCORED] -= 0.2 * columns[1][SCORED]  # there, the second effect is weaker
    terms = [offset(1, "coulomb_friction"), offset(2, "gravity_spring")]
    problem = written_down(terms, columns, residual, baseline=baseline, period=period)
    groups_left(problem, chosen(problem, (0,), (1,)))
    first, second = trials[:2]

    def error(used):
        x = columns[used].reshape(len(used), -1).T
        fitted = np.repeat(np.arange(COUNT) < SCORED.start, 2)
        value = np.linalg.lstsq(x[fitted], residual.ravel()[fitted], rcond=None)[0]
        left = residual - np.tensordot(value, columns[used], axes=1)
        return left[SCORED], float(np.sum(left[: SCORED.start] ** 2))

    (having, misfit), length = error([0, 1]), round(0.1 / period)
    over = float(np.mean(having**2))
    assert over > 3
    for tried, own, rest, least in ((first, 0, 1, SURE), (second, 1, 0, SURE_IMITATED)):
        groups, group, trial = tried
        assert groups == ((0,), (1,)) and group == (own,)
        without, more = error([rest])
        decrease = without**2 - having**2
        blocks = decrease.reshape(-1, length, 2).sum(axis=(1, 2))
        least = SURE_WITH_BASELINE if baseline else least
        seen, foretold = decrease.sum() / over, np.sum((without - having) ** 2) / over
        missed = (foretold - seen) / (2 * np.sqrt(foretold)) * (not baseline)
        assert trial.rest.groups == ((rest,),)
        assert trial.gain == pytest.approx(decrease.sum() / np.sqrt(np.sum(blocks**2)), rel=0.02)
        assert trial.seen == pytest.approx(seen, rel=0.02)
        assert trial.missed == pytest.approx(missed, rel=0.05, abs=0.02)
        taken = more - misfit + min(decrease.sum(), 0)
        assert trial.share == pytest.approx(taken / over / least, rel=0.02)
        assert trial.is_supported == (seen >= least and abs(missed) <= MISSED)
    assert first[2].is_supported and not second[2].is_supported


def test_a_motion_as_short_as_a_block_tells_one_standard_error(trials):
    """Errors within 0.1 s may be one error, whichever way they point."""
    for residual in (0.8, 0.2):
        case = column(FITTED[0], residual * STEADY)
        problem = written_down([offset()], [column(FITTED[0], STEADY)], case, period=0.001)
        groups_left(problem, chosen(problem, (0,)))
    assert [trial.gain for _, _, trial in trials[:2]] == pytest.approx([1.0, -1.0])


def test_errors_smaller_than_noise_do_not_raise_what_is_seen(trials):
    """Without any error, the decrease is that of the effect alone."""
    shape = column(FITTED[0], 0.5 * STEADY)
    problem = written_down([offset()], [shape], shape)
    groups_left(problem, chosen(problem, (0,)))
    ((_, _, trial),) = trials
    assert trial.seen == pytest.approx(100 * 0.25, rel=1e-3)
    assert trial.share == pytest.approx(500 / SURE_IMITATED, rel=2e-3)


LIMITS = {True: (LARGER_WITH_BASELINE, LARGER_OWN_WITH_BASELINE), False: (LARGER, LARGER_OWN)}
"""Ratio from which a gap is clearly larger, of all axes and of one, with a baseline and without."""


def without_weight():
    """Weights that leave the scoring motion out of all squared errors, but not out of the gap."""
    trust = np.ones((COUNT, 2))
    trust[SCORED] = 0
    return trust


@pytest.mark.parametrize(
    ("baseline", "strong", "limit"),
    [
        (True, True, LARGER_OWN_WITH_BASELINE),
        (False, True, LARGER_OWN_BUILT),
        (False, False, LARGER_OWN),
    ],
)
@pytest.mark.parametrize("more", [0.996, 1.004])
def test_the_gap_of_the_own_axis_grows_beyond_a_limit(trials, baseline, strong, limit, more):
    """From 1 N m without the effect to some N m; the gap of all axes hardly changes."""
    fitted = (1.0 if strong else WEAK) * FITTED[0]
    shape = column(fitted, (1 - more * limit) * STEADY)
    left = column(fitted, STEADY) + column(0, 10 * STEADY, axis=2)
    problem = written_down([offset(1)], [shape], left, baseline=baseline, trust=without_weight())
    kept = groups_left(problem, chosen(problem, (0,)))
    _, _, trial = trials[0]
    assert trial.grows == (more > 1) and len(kept) == (more < 1)


@pytest.mark.parametrize("baseline", [True, False])
@pytest.mark.parametrize("more", [0.99, 1.01])
def test_the_gap_of_all_axes_grows_beyond_a_limit(trials, baseline, more):
    """The gap of the own axis vanishes, from 0.5 N m; that of the other axis grows from 1 N m."""
    ratio = more * LIMITS[baseline][0] * np.hypot(1, 0.5)
    shape = column(0, 0.5 * STEADY) + column(FITTED[0], (1 - ratio) * STEADY, axis=2)
    left = column(0, 0.5 * STEADY) + column(FITTED[0], STEADY, axis=2)
    problem = written_down([offset(1)], [shape], left, baseline=baseline, trust=without_weight())
    kept = groups_left(problem, chosen(problem, (0,)))
    _, _, trial = trials[0]
    assert trial.grows == (more > 1) and len(kept) == (more < 1)


@pytest.mark.parametrize("axis", [0, 1, 3])
def test_the_gap_of_another_axis_may_grow(trials, axis):
    """By half, while that of all axes hardly changes; effects also act on no axis of the robot."""
    shape = column(FITTED[0], -0.5 * STEADY, axis=2)
    left = column(FITTED[0], STEADY, axis=2) + column(0, 10 * STEADY)
    problem = written_down([offset(axis)], [shape], left, trust=without_weight())
    assert groups_left(problem, chosen(problem, (0,))) == ((0,),)
    assert not trials[0][2].grows


@pytest.mark.parametrize("weaker", [0, 1])
def test_the_weakest_of_refuted_effects_is_removed_first(trials, weaker):
    """Each refutes the other on the scoring motion, and explains it alone."""
    values = [0.5, 0.5]
    values[weaker] = 0.3
    scored = 0.6 * TURNING
    shapes = [column(FITTED[k], scored / value) for k, value in enumerate(values)]
    left = column(sum(v * FITTED[k] for k, v in enumerate(values)), scored)
    problem = written_down([offset(1), offset(1, "viscous_friction")], shapes, left)
    choice = chosen(problem, (0,), (1,))
    found = judged(problem, choice).choice
    assert [one.is_refuted for _, _, one in trials] == [True, True, False]
    assert found.best.groups == ((1 - weaker,),)
    assert found.best.values == pytest.approx([values[1 - weaker]], rel=1e-3)
    assert found.rivals == () and found.fits == choice.fits


@pytest.mark.parametrize("baseline", [True, False])
@pytest.mark.parametrize("of_gap", [True, False])
@pytest.mark.parametrize(("size", "kept"), [(16.0, 0), (50.0, 2)])
def test_effects_that_only_compensate_for_each_other_are_removed(
    trials, baseline, size, kept, of_gap
):
    """One is u there, the other w - u, and nothing is to be explained.

    Together they are wrong by w, and each without the other by more. They stay if each of them is
    sure by itself.
    """
    u = np.sqrt(size / 100) * STEADY
    w = np.where(np.arange(100) < 50, np.sqrt(12 / 50), 0) * TURNING
    trust = np.ones((COUNT, 2))
    if of_gap:  # on another axis, without weight
        trust[:, 1] = 0
    other = column(WEAK * FITTED[1], -u if of_gap else w - u) + of_gap * column(0, w, axis=2)
    shapes = [column(WEAK * FITTED[0], u), other]
    left = column(WEAK * (FITTED[0] + FITTED[1]))
    terms = [offset(1), offset(1, "viscous_friction")]
    problem = written_down(terms, shapes, left, baseline=baseline, trust=trust)
    assert len(groups_left(problem, chosen(problem, (0,), (1,)))) == kept
    assert not any(one.is_refuted for _, _, one in trials[:2])
    if not kept and not of_gap:  # the second decreases the error by 16 - 12, the first by 16
        assert [groups for groups, _, _ in trials[:3]] == [((0,), (1,))] * 2 + [((0,),)]


@pytest.mark.parametrize("strong", [True, False])
@pytest.mark.parametrize("size", [0.98, 1.02])
@pytest.mark.parametrize("baseline", [True, False])
def test_what_an_effect_foretells_must_not_be_missing(size, baseline, strong):
    """Unless the motions for fitting show it clearly; laws differ most at other speeds.

    It foretells as much again as there is, by 1 % more than a half, so that the error grows.

    What is missed, in standard errors of chance, is about the root of half the squared effect.
    """
    amplitude, fitted = size * MISSED / 0.5025 / 10, (1.1 if strong else 1.0) * WEAK * FITTED[0]
    shape = column(fitted, amplitude * TURNING)
    left = column(fitted, 0.4975 * amplitude * TURNING) + column(0, 5 * STEADY, axis=2)
    trust = np.ones((COUNT, 2))
    trust[:, 1] = 0
    problem = written_down([offset()], [shape], left, baseline=baseline, trust=trust)
    assert len(groups_left(problem, chosen(problem, (0,)))) == (baseline or strong or size < 1)


@pytest.mark.parametrize("baseline", [True, False])
@pytest.mark.parametrize("more", [0.95, 1.05])
def test_an_effect_must_explain_more_where_other_errors_are_large(baseline, more):
    """By as many times as the squared error on the scoring motion is that of noise."""
    over = more * 500 * 0.25 / (SURE_WITH_BASELINE if baseline else SURE_IMITATED)
    left = column(0.5 * FITTED[0]) + column(0, np.sqrt(2 * over) * TURNING, axis=2)
    problem = written_down([offset()], [column(FITTED[0])], left, baseline=baseline)
    assert len(groups_left(problem, chosen(problem, (0,)))) == (more < 1)


BUILT = [
    (False, False, 0, LARGER_BUILT),
    (False, True, 0, LARGER_SURE),
    (True, False, 0, LARGER_WITH_BASELINE),
]
BUILT += [(False, False, 1, LARGER_OWN_BUILT), (False, True, 1, LARGER_OWN_SURE)]
BUILT += [(True, False, 1, LARGER_OWN_WITH_BASELINE), (True, True, 0, LARGER_SURE)]


@pytest.mark.parametrize("more", [0.998, 1.002])
@pytest.mark.parametrize(("baseline", "is_sure", "of_own", "limit"), BUILT)
def test_the_simulated_model_must_not_be_clearly_worse(baseline, is_sure, of_own, limit, more):
    """Than the calibrated one: on all axes, and on the own one where the others are better.

    Effects that are sure by themselves may be worse by more.
    """
    rest = column(0, TURNING) + column(0, TURNING, axis=2)
    shape = column(FITTED[0], STEADY if is_sure else 0)
    problem = written_down([offset()], [shape], shape + rest, baseline=baseline)
    calibrated = rest / (limit * more)
    if of_own:
        calibrated[:, 1] = 2 * rest[:, 1]
    choice = chosen(problem, (0,))
    found = judged(problem, choice, calibrated).choice
    assert (found is choice) == (more < 1)
    assert len(found.best.groups) == len(found.rivals) == (more < 1)


@pytest.mark.parametrize("harmless", [0, 1])
@pytest.mark.parametrize(("ratio", "kept"), [(1.015, 2), (1.025, 1), (1.04, 0)])
def test_the_largest_part_that_can_be_built_is_kept(harmless, ratio, kept):
    """One effect does nothing on the scoring motion, the other raises the error there by 1 %."""
    assert LARGER_BUILT == 1.02
    shapes = [column(FITTED[0]), column(FITTED[1])]
    shapes[1 - harmless][SCORED, 0] = -0.01 * TURNING
    left = column(FITTED[0] + FITTED[1], TURNING)
    terms = [offset(1), offset(1, "viscous_friction")]
    problem = written_down(terms, shapes, left, trust=without_weight())
    calibrated = column(0, 1.01 * TURNING / ratio)
    groups = groups_left(problem, chosen(problem, (0,), (1,)), calibrated)
    assert groups == {2: ((0,), (1,)), 1: ((harmless,),), 0: ()}[kept]


@pytest.mark.parametrize("true", ["with", "without"])
@pytest.mark.parametrize("baseline", [True, False])
def test_the_calibrated_values_that_foretell_best(baseline, true):
    """Friction is calibrated together with the effect, or takes a part of its torque without it.

    With a baseline, only the former counts.
    """
    value, friction, prior_std = 4.0, 0.1, 0.05
    shapes = [
        column(FITTED[0], STEADY),
        column(20 * FITTED[1] + 6 * FITTED[0], 20 * TURNING),
    ]
    size = 500 * (20**2 + 6**2)
    shrunk = size / (size + 1 / prior_std**2)  # by the prior
    taken = friction + value * 500 * 6 / size
    values = {"with": friction, "without": shrunk * taken}
    left = value * shapes[0] + friction * shapes[1]
    left[SCORED] = value * shapes[0][SCORED] + values[true] * shapes[1][SCORED]
    terms = [offset(), offset(1, "viscous_friction", prior_std)]
    problem = written_down(terms, shapes, left, baseline=baseline)
    found = judged(problem, chosen(problem, (0,)))
    assert found.choice.best.groups == ((0,),)
    expected = values["with" if baseline else true]
    assert found.solution == pytest.approx([0.0, expected / prior_std], rel=0.01)


def test_without_effects_the_calibration_is_that_without_effects():
    """Of the term that is not borne out, too."""
    prior_std, left = 0.05, column(FITTED[0], -STEADY)
    problem = written_down([offset(1, prior_std=prior_std)], [column(FITTED[0], STEADY)], left)
    found = judged(problem, chosen(problem, (0,)))
    assert found.choice.best.groups == ()
    shrunk = 500 / (500 + 1 / prior_std**2)
    assert found.solution * prior_std == pytest.approx([shrunk], rel=1e-6)


def test_a_set_that_is_not_excluded_takes_the_place_of_a_refuted_one():
    """The two effects fit equally well; on the scoring motion only the rival is right."""
    shape = 0.5 * FITTED[0]
    shapes = [column(shape, -0.5 * STEADY), column(shape, 0.5 * STEADY)]
    problem = written_down([offset(1), offset(1, "viscous_friction")], shapes, shapes[1])
    best = fit(problem, [(0,)])
    choice = Choice(problem, (fit(problem, []), best), best, ((0, (1,), 2.0),))
    found = judged(problem, choice).choice
    assert found.best.groups == ((1,),)
    assert found.rivals == ()


@pytest.mark.parametrize("alike", [1.0, 0.5])
def test_a_set_that_lost_an_effect_still_has_its_rivals(alike):
    """The third effect looks like the first, or has little in common with it."""
    other = alike * FITTED[0] + np.sqrt(1 - alike**2) * FITTED[2]
    shapes = [column(FITTED[0], STEADY), column(FITTED[1], 2 * TURNING), column(other, STEADY)]
    left = column(FITTED[0] + FITTED[1], STEADY)
    terms = [offset(1), offset(1, "viscous_friction"), offset(1, "gravity_spring")]
    problem = written_down(terms, shapes, left)
    found = judged(problem, chosen(problem, (0,), (1,))).choice
    assert found.best.groups == ((0,),)
    assert [(place, group) for place, group, _ in found.rivals] == [(0, (2,))] * (alike == 1)


def two_kinds(first, second):
    """Viscous and quadratic friction of one axis, of two shapes, with a baseline."""
    terms = [
        Term(name, 1, 0.1, 1e-3) for name in ("viscous_friction", "quadratic_viscous_friction")
    ]
    columns = [column(FITTED[0], TURNING), column(FITTED[1], STEADY)]
    residual = first * columns[0] + second * columns[1]
    return written_down(terms, columns, residual, baseline=True)


@pytest.mark.parametrize(
    ("second", "kept"),
    [
        (0.5, ((0,),)),  # 80 % of the misfit is explained by the first alone
        (0.7, ((0,), (1,))),  # 67 %
    ],
)
def test_one_effect_stands_for_several_of_its_kind(second, kept):
    """The others only make up for the form of its law."""
    problem = two_kinds(1.0, second)
    found = groups_left(problem, chosen(problem, (0,), (1,)), lenient(problem))
    assert found == kept


def test_an_effect_that_usual_differences_imitate_at_a_price_explains_it():
    """Friction may differ a little between two runs, but not by ten standard deviations."""
    wear = Term("friction_wear", 1, 0.1, 1e-3)
    usual = Term("coulomb_friction", 1, 0.1, 0.2, nuisance=True)
    shape = column(FITTED[0], TURNING)
    beside = 1.3 * column(FITTED[1], STEADY)  # what nothing explains
    problem = written_down([wear, usual], [shape, shape], 2 * shape + beside, baseline=True)
    assert groups_left(problem, chosen(problem, (0,)), lenient(problem)) == ((0,),)
