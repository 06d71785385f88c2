"""The verdict on a residual and its numbers: on torques that are written down."""

from importlib import import_module

import numpy as np
import pytest
from linear import COUNT, PARTS, difference_between, written_down

from faultgen.discovery.calibration import model_edit
from faultgen.discovery.decision.choice import choose
from faultgen.discovery.decision.dispersion import shrunk
from faultgen.discovery.decision.verdict import answer, is_part, significance
from faultgen.discovery.result import AMBIGUOUS, MODEL, NAMED, NONE, PARTLY, UNKNOWN
from faultgen.discovery.terms.candidates import Term
from faultgen.inference.limits import NAMED_SHARE

SCORED = np.arange(COUNT) >= PARTS[-1].start
NAMES = ["torque_offset", "payload_mass"]
verdict_module = import_module("faultgen.discovery.decision.verdict")


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture
def columns(rng):
    """Torques of two terms, which change slowly: a pattern would be seen."""
    return rng.normal(size=(2, COUNT, 2))


def told(problem, monkeypatch, processes=()):
    """The answer, of a model that can always be replayed."""
    monkeypatch.setattr(model_edit, "replaying", lambda recording, robot, *given, **more: robot)
    return answer(problem, choose(problem, difference_between(problem, processes)))


def posed(columns, values, noise, **more):
    terms = [Term(name, 1, 0.1, 1e-4) for name in NAMES]
    residual = np.tensordot(values, columns.astype(np.float32), axes=1) + noise
    return written_down(terms, columns, residual, **more)


def relative(error):
    """Root mean square of each axis on the scoring motion over the torque, which is 10 N m."""
    return np.sqrt(np.mean(error[SCORED] ** 2, axis=0)) / 10


@pytest.mark.parametrize("baseline", [True, False])
def test_a_named_effect_and_the_numbers_around_it(columns, rng, monkeypatch, baseline):
    """Errors before and after, of each axis and of all, and what noise alone makes."""
    noise = rng.normal(size=(COUNT, 2))
    problem = posed(columns, [0.7, 0.0], noise, baseline=baseline)
    found = told(problem, monkeypatch)
    assert found.verdict == NAMED
    (effect,) = found.effects
    assert (effect.effect, effect.axis) == ("torque_offset", 1)
    assert effect.interval[0] < 0.7 < effect.interval[1]
    assert effect.confidence > 0.999
    after = relative(problem.residual - effect.severity * columns[0])
    before = relative(problem.residual)
    floor = np.minimum(0.1, after)
    for k, axis in enumerate(found.per_axis):
        assert axis["axis"] == k + 1
        assert axis["before"] == pytest.approx(before[k], rel=1e-4)
        assert axis["calibrated"] == pytest.approx(before[k], rel=1e-3)
        assert axis["after"] == pytest.approx(after[k], rel=1e-4)
        assert axis["floor"] == pytest.approx(floor[k], rel=1e-4)
    for name, each in (("before", before), ("after", after), ("floor", floor)):
        assert getattr(found, name) == pytest.approx(np.sqrt(np.mean(each**2)), rel=1e-4)
    assert effect.gap_after == pytest.approx(found.after, rel=1e-4)
    assert found.lacks == () and found.calibration == {}
    assert found.p_value < 0.05


def test_noise_alone_is_no_gap(columns, rng, monkeypatch):
    problem = posed(columns, [0.0, 0.0], rng.normal(size=(COUNT, 2)), baseline=True)
    found = told(problem, monkeypatch)
    assert (found.verdict, found.effects, found.alternatives) == (NONE, (), ())
    assert found.p_value > 0.01
    assert found.after == pytest.approx(np.sqrt(np.mean(relative(problem.residual) ** 2)))


def test_what_explains_only_a_part_is_told(columns, rng, monkeypatch):
    """Much more than noise is left, and more than a fifth of what could be explained."""
    noise = rng.normal(size=(COUNT, 2))
    noise[:, 1] += 2 * np.sin(np.arange(COUNT))
    found = told(posed(columns, [1.0, 0.0], noise, baseline=True), monkeypatch)
    assert found.verdict == PARTLY and len(found.effects) == 1


@pytest.mark.parametrize(("in_scoring", "verdict"), [(1.0, NAMED), (-1.0, NONE)])
def test_an_effect_that_other_motions_refute_is_not_named(
    columns, rng, monkeypatch, in_scoring, verdict
):
    """It explains the motions it was fitted to; on those for scoring it has the other sign.

    A line tells it then, and the model does not contain the effect.
    """
    problem = posed(columns, [0.7, 0.0], rng.normal(size=(COUNT, 2)), baseline=True)
    problem.residual[SCORED] *= in_scoring
    found = told(problem, monkeypatch)
    assert found.verdict == verdict
    assert len(found.effects) == (verdict == NAMED)
    lines = [line for line in found.lacks if "speak against it" in line]
    assert len(lines) == (verdict == NONE)
    assert found.after <= 1.001 * found.before
    if verdict == NONE:
        assert lines[0].startswith("torque_offset of axis 1 is not named")
        assert found.changes == [] and found.after == found.calibrated


def test_effects_of_one_shape_are_alternatives(columns, rng, monkeypatch):
    """Two of equal usual size that nothing tells apart have a confidence of one half each."""
    names = ["viscous_friction", "coulomb_friction"]
    columns[1] = columns[0]
    terms = [Term(name, 1, 0.1, 1e-4) for name in names]
    residual = 0.7 * columns[0] + rng.normal(size=(COUNT, 2))
    found = told(written_down(terms, columns, residual, baseline=True), monkeypatch)
    assert found.verdict == AMBIGUOUS
    ((name, axis, odds),) = found.alternatives
    assert {name, found.effects[0].effect} == set(names) and axis == 1
    assert odds == pytest.approx(0.5, abs=1e-3)
    assert found.effects[0].confidence == pytest.approx(0.5, abs=1e-3)


def bumps(course):
    """Torques of axis 1 that depend on one variable: bumps along it."""
    place = (course - course.min()) / np.ptp(course) * 4
    torques = np.zeros((5, COUNT, 2))
    torques[:, :, 0] = np.maximum(1 - np.abs(place - np.arange(5)[:, None]), 0)
    return 10 * torques


@pytest.mark.parametrize(("size", "verdict"), [(2.0, UNKNOWN), (0.5, NONE)])
def test_a_torque_that_no_effect_explains_is_unknown(columns, rng, monkeypatch, size, verdict):
    """It follows a variable of the motion of axis 1, and no term does.

    Such a torque takes up errors of any model, so that it is not told from the odds of an effect.
    """
    course = np.sin(np.arange(COUNT) / 7)
    noise = rng.normal(size=(COUNT, 2))
    noise[:, 0] += size * course**2
    problem = posed(columns, [0.0, 0.0], noise, baseline=True)
    processes = [(1, "joint angle", bumps(course))]
    (seen,) = choose(problem, difference_between(problem, processes)).found.effects
    assert seen.keys[0] == ("unknown", 1)
    found = told(problem, monkeypatch, processes)
    assert (found.verdict, found.effects) == (verdict, ())
    lines = [line for line in found.lacks if line.endswith("depends on the joint angle")]
    assert bool(lines) == (verdict == UNKNOWN)


def test_a_torque_that_no_effect_explains_beside_an_effect_is_a_part(columns, rng, monkeypatch):
    course = np.sin(np.arange(COUNT) / 7)
    noise = rng.normal(size=(COUNT, 2))
    noise[:, 0] += 2 * course**2
    problem = posed(columns, [0.7, 0.0], noise, baseline=True)
    found = told(problem, monkeypatch, [(1, "joint angle", bumps(course))])
    assert found.verdict == PARTLY
    assert [(one.effect, one.axis) for one in found.effects] == [("torque_offset", 1)]


@pytest.mark.parametrize(("count", "period"), [(40, 0.01), (20, 0.05)])
def test_four_blocks_of_a_motion_are_needed_to_judge_it(rng, count, period):
    """A block lasts 0.1 s, and has five samples at least."""
    problem = written_down([], np.zeros((0, COUNT, 2)), np.zeros((COUNT, 2)), period=period)
    white = 5 * rng.normal(size=(COUNT, 2))
    problem.inside[:] = False
    problem.inside[100 : 100 + count, 1] = True
    assert significance(problem, white) < 0.01
    problem.inside[100 + count - 1] = False
    assert significance(problem, white) == 1.0


def test_noise_alone_is_significant_as_often_as_it_should_be(rng):
    """Of white noise, and of noise with a few large values; an excess on one motion is noticed."""
    problem = written_down([], np.zeros((0, COUNT, 1)), np.zeros((COUNT, 1)))
    normal = [significance(problem, rng.normal(size=(COUNT, 1))) for _ in range(150)]
    assert np.mean(np.array(normal) <= 0.05) < 0.13
    assert np.mean(np.array(normal) <= 0.5) == pytest.approx(0.5, abs=0.25)
    white = rng.normal(size=(COUNT, 1))
    white[PARTS[2]] *= 1.8
    assert significance(problem, white) < 0.01


@pytest.mark.parametrize(
    ("explained", "left", "is_partial"),
    [
        (0.01, 3.0, False),
        (-0.01, 3.0, True),
        (-0.3, 0.26, True),
        (-0.3, 0.24, False),  # nothing to be seen beside the noise
        (0.05, 0.26, False),
    ],
)
@pytest.mark.parametrize("floor", [0.02, 3.0])
def test_part_of_a_gap(explained, left, is_partial, floor):
    """Squared errors beyond that of noise: the share that is explained, and the rest in noise."""
    after = np.sqrt((1 + left) * floor**2)
    before = np.sqrt(floor**2 + left * floor**2 / (1 - NAMED_SHARE - explained))
    assert is_part(before, after, floor) == is_partial


def test_what_explains_nothing_is_a_part_however_small():
    """Of errors that do not change, if noise is none of them."""
    assert is_part(0.3, 0.3, 0.0)
    assert not is_part(0.3, 0.0, 0.0)


def waves(kinds):
    """Terms of waves on axis 1, sine and cosine of each, and torques that go with them."""
    rng = np.random.default_rng(4)
    terms = [
        Term(name, 1, 0.1, 1e-4, (("order", order), ("phase", phase)))
        for name, order in kinds
        for phase in (0.0, np.pi / 2)
    ]
    columns = np.zeros((len(terms), COUNT, 2))
    size = 1000.0  # so that severities are within their bounds
    columns[:, :, 0] = size * rng.normal(size=(len(terms), COUNT))
    residual = columns[::2].sum(axis=0) / size + 0.3 * rng.normal(size=(COUNT, 2))
    return written_down(terms, columns, residual, baseline=True)


@pytest.mark.parametrize("second", ["torque_ripple", "transmission_error"])
def test_an_axis_may_have_several_waves(monkeypatch, second):
    """Of one kind or of two, each with its order and phase."""
    found = told(waves([("torque_ripple", 1.0), (second, 2.0)]), monkeypatch)
    assert found.verdict == NAMED
    assert {(one.effect, one.parameters["order"]) for one in found.effects} == {
        ("torque_ripple", 1.0),
        (second, 2.0),
    }
    for one in found.effects:
        assert one.parameters["phase"] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("baseline", [True, False])
def test_an_effect_that_makes_the_error_on_other_motions_larger_is_not_named(
    columns, rng, monkeypatch, baseline
):
    """It has the other sign there, and its probability is not asked: the model is not good."""
    choice_module = import_module("faultgen.discovery.decision.choice")
    monkeypatch.setattr(choice_module, "confirmed", lambda found, _: (found, ()))
    problem = posed(columns, [0.7, 0.0], rng.normal(size=(COUNT, 2)), baseline=baseline)
    problem.residual[SCORED] *= -1
    found = told(problem, monkeypatch)
    assert found.effects == () and found.alternatives == ()
    model = found.contract()["model"]
    assert (found.verdict, model["is_good_enough"]) == (MODEL, False)
    assert ("healthy recordings" in model["reasons"][0]) == baseline
    assert any("error on motions that were not fitted is not smaller" in one for one in found.lacks)


def test_errors_of_other_motions_make_an_effect_doubtful(columns, rng, monkeypatch):
    """The evidence is divided by the dispersion, and a line tells what is not certain any more."""
    noise = rng.normal(size=(COUNT, 2))
    problem = posed(columns, [0.18, 0.0], noise, baseline=True)
    sure = choose(problem, difference_between(problem))
    assert sure.groups and sure.variance == pytest.approx(1.0, abs=0.2)
    problem.residual[SCORED] *= 2
    likely = choose(problem, difference_between(problem))
    assert likely.groups and not likely.is_sure
    problem.residual[SCORED] *= 2
    wide = choose(problem, difference_between(problem))
    assert (wide.variance > 8).all()  # 16 less what is taken for single jumps
    assert wide.groups == () and wide.doubtful == (("torque_offset", 1),)
    (line,) = (one for one in told(problem, monkeypatch).lacks if "not named" in one)
    assert line.startswith("torque_offset of axis 1") and "if the model were exact" in line


def test_a_likely_effect_is_ambiguous(columns, rng, monkeypatch):
    """It is told with its probability; without a baseline, it is not told."""
    noise = rng.normal(size=(COUNT, 2))
    for baseline in (True, False):
        problem = posed(columns, [0.1, 0.0], noise, baseline=baseline)
        found = told(problem, monkeypatch)
        if baseline:
            (effect,) = found.effects
            assert (found.verdict, effect.effect, effect.axis) == (AMBIGUOUS, "torque_offset", 1)
            assert 0.75 <= effect.confidence < 0.99
            problem.residual[SCORED] *= 4  # it was never sure, so that no line says so
            less = choose(problem, difference_between(problem))
            assert less.groups == less.doubtful == ()
        else:
            assert found.verdict == NONE


def test_ratios_of_axes_are_drawn_together():
    """As far as their errors explain; one of which nothing is known has their mean."""
    error = np.full(3, 0.1)
    alike = shrunk(np.array([0.9, 1.0, 1.1]), error)
    assert alike == pytest.approx(1.0, abs=1e-9)  # their variance is that of the errors
    apart = shrunk(np.array([1.0, 1.0, 4.0]), error)
    between = np.var([1.0, 1.0, 4.0], ddof=1) - 0.01
    assert apart[2] == pytest.approx(2.0 + 2.0 * between / (between + 0.01))
    assert shrunk(np.array([1.2, np.nan]), np.array([0.1, np.nan])) == pytest.approx([1.2, 1.2])
    assert shrunk(np.full(2, np.nan), np.full(2, np.nan)) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("size", [900.0, -900.0])
def test_differences_of_the_day_that_make_the_error_larger_are_not_used(
    columns, rng, monkeypatch, size
):
    """They were fitted to other motions."""
    noise = 0.1 * rng.normal(size=(COUNT, 2))
    problem = posed(columns, [0.7, 0.0], noise, baseline=True)
    monkeypatch.setattr(
        verdict_module, "usual", lambda problem, _: np.full(len(problem.terms), size)
    )
    found = told(problem, monkeypatch)
    assert found.calibrated <= found.before and found.verdict == NAMED
    assert found.after <= 1.1 * found.floor


def test_the_contract_says_that_a_good_model_is_good(columns, rng, monkeypatch):
    problem = posed(columns, [0.7, 0.0], rng.normal(size=(COUNT, 2)), baseline=True)
    model = told(problem, monkeypatch).contract()["model"]
    assert model["is_good_enough"] and model["reasons"] == []
    assert all(0.3 < one < 3 for one in model["residual_variance"])
