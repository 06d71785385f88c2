"""Which set is answered with, what is said of it, and that its numbers agree with one another."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from linear import linear

from faultgen.discovery import investigate
from faultgen.discovery.calibration import model_edit as model
from faultgen.discovery.calibration.model_edit import build, simulated_numbers
from faultgen.discovery.decision import confirmation, scoring_errors
from faultgen.discovery.decision import verdict as judgement
from faultgen.discovery.decision.certainty import LEVEL, certainty
from faultgen.discovery.decision.confirmation import confirmed
from faultgen.discovery.decision.selection import SIMILAR, Choice, choose
from faultgen.discovery.decision.verdict import answer, is_part
from faultgen.discovery.fit.fit import fit
from faultgen.discovery.fit.gap import scored, scored_in_motion
from faultgen.discovery.planning import next_experiment as motions
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.samples import rolling
from faultgen.discovery.result import AMBIGUOUS, NAMED, NONE, PARTLY, UNKNOWN
from faultgen.effects import get_effect
from faultgen.simulation.motion import plan
from faultgen.tasks import Task


@pytest.fixture(scope="module")
def posed(measured, tiny_robot):
    """Problems of a clean recording, with a baseline and without, ready for other gaps."""
    worn, healthy = (measured([], seed) for seed in (2, 1))
    return {
        baseline: investigate(worn, tiny_robot, healthy if baseline else None).problem
        for baseline in (True, False)
    }


def at(problem, name, axis, **parameters):
    """Index of a term."""
    wanted = tuple(parameters.items())
    return next(
        k for k, t in enumerate(problem.terms) if t.key == (name, axis) and t.parameters == wanted
    )


def value_of(problem, index, gain):
    """Value of a term which, freed, takes a gain off the misfit where there is no noise."""
    prior_std = problem.terms[index].prior_std
    unit = problem.evidence(prior_std * problem.raw[index].astype(float))
    (taken,), _ = unit.gains([(index,)])
    return prior_std * float(np.sqrt(gain / taken))


def small(problem, *names):
    """A problem with few terms, so that nothing but them can explain a residual."""
    indices = [at(problem, name, axis) for name, axis in names]
    return linear(problem, terms=[problem.terms[k] for k in indices], raw=problem.raw[indices])


@pytest.mark.parametrize("baseline", [True, False])
@pytest.mark.parametrize(
    ("name", "gain", "is_named"),
    [
        ("gravity_spring", 28.0, {True: True, False: False}),
        ("coulomb_friction", 28.0, {True: True, False: True}),
        ("gravity_spring", 70.0, {True: True, False: True}),
        ("coulomb_friction", 5.0, {True: False, False: False}),
    ],
)
def test_what_other_things_look_like_has_to_be_surer_without_a_baseline(
    posed, name, gain, is_named, baseline
):
    """Wrong links look like a spring, and not like friction: of equal gains one is named."""
    assert get_effect("gravity_spring").prior.imitated
    assert not get_effect("coulomb_friction").prior.imitated
    problem = small(posed[baseline], (name, 2))
    value = value_of(problem, 0, gain)
    # no noise is in the residual, so that the gain is what was asked for
    quiet = replace(problem, residual=value * problem.raw[0].astype(float))
    found = choose(quiet)
    assert bool(found.best.groups) == is_named[baseline]
    assert found.fits[0].misfit - fit(quiet, [(0,)]).misfit == pytest.approx(gain, rel=0.02)


@pytest.mark.parametrize("is_part", [False, True])
def test_what_looks_the_same_is_not_excluded(posed, is_part, monkeypatch):
    """Two terms of nearly one shape are rivals, two of other shapes are none.

    Effects that explain only a part are named only where they are certain.
    """
    monkeypatch.setattr(judgement, "is_part", lambda *errors: is_part)
    problem = posed[True]
    one, other = at(problem, "viscous_friction", 2), at(problem, "coulomb_friction", 2)
    rng = np.random.default_rng(5)
    for likeness, is_rival in ((0.999, True), (0.5, False)):
        raw = problem.raw[[one, other]].copy()
        scale = np.linalg.norm(raw[0]) / np.linalg.norm(raw[1])
        noise = rng.standard_normal(raw[1].shape) * raw[0].std()
        raw[1] = likeness * raw[0] + (1 - likeness) * (scale * raw[1] + noise)
        terms = [problem.terms[k] for k in (one, other)]
        small = linear(problem, terms=terms, raw=raw)
        value = value_of(small, 0, 150)
        found = choose(linear(problem, {0: value}, seed=1, terms=terms, raw=raw))
        assert [group for group in found.best.groups] in ([(0,)], [(1,)])
        assert bool(found.rivals) == is_rival
        assert all(worse < SIMILAR for _, _, worse in found.rivals)
        told = answer(found.problem, found)
        assert told.verdict == (AMBIGUOUS if is_rival else PARTLY if is_part else NAMED)
        assert len(told.alternatives) == is_rival
        total = told.effects[0].confidence + sum(odds for _, _, odds in told.alternatives)
        assert total == pytest.approx(1.0, abs=1e-3)
        if is_rival:
            worse = found.rivals[0][2]
            odds = told.alternatives[0][2] / told.effects[0].confidence
            assert odds == pytest.approx(np.exp(-max(worse, 0) / 2), rel=1e-3)


@pytest.mark.parametrize(("apart", "is_rival"), [(0.05, True), (0.4, False)])
def test_a_large_effect_is_similar_to_what_a_wrong_form_could_be(posed, apart, is_rival):
    """However little noise there is, forms that differ by a few per cent are not told apart."""
    problem = posed[True]
    one = at(problem, "viscous_friction", 2)
    other = at(problem, "coulomb_friction", 2)
    raw = problem.raw[[one, other]].copy()
    rng = np.random.default_rng(5)
    raw[1] = raw[0] + apart * rng.standard_normal(raw[0].shape) * raw[0].std()
    terms = [replace(problem.terms[k], prior_std=1e-3) for k in (one, other)]
    value = value_of(linear(problem, terms=terms, raw=raw), 0, 1e5)
    found = choose(linear(problem, {0: value}, seed=1, terms=terms, raw=raw))
    assert found.best.groups == ((0,),)
    assert bool(found.rivals) == is_rival


def closest(problem, own, values, rivals, replay):
    """Smallest whitened distance of an effect to its rivals on a motion, each refitted."""
    base, inside = replay.torque(), settled(replay.recording, problem.robot)

    def white(pairs):
        change = replay.torque([(problem.terms[t], v) for t, v in pairs]) - base
        return (problem.noise.colour.whiten(change, replay.recording.parts) * inside).ravel()

    target, distances = white(zip(own, values, strict=True)), []
    for rival in rivals:
        (term,) = rival
        column = white([(term, problem.terms[term].step)])
        left = target - column * (column @ target) / (column @ column)
        distances.append(float(np.linalg.norm(left)))
    return min(distances)


@pytest.mark.parametrize(
    ("own", "rivals"),
    [
        (("viscous_friction", 2, 0.1), [("coulomb_friction", 2)]),
        pytest.param(
            ("torque_offset", 2, 0.02),
            [("gravity_spring", 2), ("friction_asymmetry", 2)],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_next_experiment_is_the_motion_that_tells_most(posed, monkeypatch, own, rivals):
    """Whatever the order of the motions: the one whose closest pair is furthest apart."""
    problem = posed[True]
    mine = (at(problem, *own[:2]),)
    others = [(at(problem, *key),) for key in rivals]
    fitted = replace(fit(problem, []), groups=(mine,), values=np.array([own[2]]))
    fitted = replace(fitted, errors=np.array([0.1]))
    choice = Choice(problem, (fitted,), fitted, tuple((0, g, 2.0) for g in others))
    library = list(motions.library(problem))
    assert len(library) >= 3
    distances = {}
    for name, toml in library:
        replay = Replay(motions.planned_recording(problem, name, toml), problem.robot)
        distances[name] = closest(problem, mine, [own[2]], others, replay)
    best = max(distances, key=distances.get)
    for turned in (library, library[::-1], library[1:] + library[:1]):
        monkeypatch.setattr(motions, "library", lambda problem, turned=turned: iter(turned))
        found = motions.next_experiment(problem, choice)
        assert found.task == best
        assert found.distance == pytest.approx(distances[best], rel=1e-6)
        assert found.now == pytest.approx(np.sqrt(2.0))
        assert found.separates[0] == own[:2] and found.separates[1] in rivals
    task = Task(**{"name": best, "robot": "tiny", **tomllib.loads(found.toml)})
    reference = plan(task, problem.robot)(np.linspace(0, 3, 50))[0]
    seen = problem.recording.joint_position(problem.robot)
    assert (reference >= seen.min(axis=0) - 1e-6).all()
    assert (reference <= seen.max(axis=0) + 1e-6).all()


def test_no_next_experiment_without_rivals(posed):
    problem = posed[True]
    alone = Choice(problem, (), fit(problem, []), ())
    assert motions.next_experiment(problem, alone) is None


@pytest.mark.parametrize("over", [1.0, 2.0])
def test_intervals_hold_the_severity_as_often_as_they_say(posed, over):
    """Over many draws of the noise, also where it is larger than it was taken to be."""
    problem = small(posed[True], ("viscous_friction", 2))
    true = value_of(problem, 0, 100 * over**2)
    clean = true * problem.raw[0].astype(float)
    rng = np.random.default_rng(6)
    held = []
    for _ in range(150):
        noise = over * problem.noise.deviation * rng.standard_normal(clean.shape)
        case = replace(problem, residual=clean + noise)
        known = certainty(case, fit(case, [(0,)]), 0)
        assert known.low < known.severity < known.high and known.absent > 9
        held.append(known.low <= true <= known.high)
        assert known.high - known.low == pytest.approx(2 * 1.96 * known.error, rel=0.1)
    assert LEVEL - 0.06 < np.mean(held) < 1.0  # three standard errors below


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("backlash", lambda v: 1e-3 * np.expm1(v / 1e-3)),
        ("stribeck_velocity", lambda v: np.tanh(3 * v) / 3),
    ],
)
def test_intervals_follow_a_law_that_bends(posed, name, law):
    """They end where the misfit is 3.84 above its minimum, not where the slope says."""
    problem = small(posed[True], (name, 2))
    shape = problem.raw[0].astype(float)

    def simulate(changes=(), disturbance=None):
        return problem.base + sum(law(value) * shape for _, value in changes)

    bent = replace(problem, replay=replace_torque(problem.replay, simulate))
    unit = problem.evidence(shape).energy.sum()  # squared whitened size of a unit
    width = 1.96 / np.sqrt(unit)
    true = 4 * width
    bent = replace(bent, residual=true * shape)
    found = fit(bent, [(0,)])
    known = certainty(bent, found, 0)
    for end, sign in ((known.low, -1), (known.high, 1)):
        assert law(end) == pytest.approx(law(found.values[0]) + sign * width, abs=0.1 * width)


def replace_torque(replay, simulate):
    return type(replay)(**{**vars(replay), "torque": simulate})


@pytest.mark.slow
@pytest.mark.parametrize("baseline", [True, False])
def test_the_numbers_of_an_answer_agree(posed, baseline):
    """One meaning of gap, floor, interval and confidence, for all kinds of answers."""
    problem = posed[baseline]
    rng = np.random.default_rng(7)
    candidates = [k for k, t in enumerate(problem.terms) if t.is_effect and not t.parameters]
    seen = set()
    for seed in range(10):
        chosen = rng.choice(candidates, size=int(rng.integers(0, 3)), replace=False)
        gains = 10 ** rng.uniform(1.2, 4, size=len(chosen))
        values = {
            int(k): value_of(problem, int(k), gain) for k, gain in zip(chosen, gains, strict=True)
        }
        case = linear(problem, values, seed=seed)
        told = answer(case, choose(case))
        seen.add(told.verdict)
        result = told.contract()
        gap = result["gap"]
        assert gap["floor"] <= min(gap["before"], gap["calibrated"], gap["after"]) + 1e-12
        for axis in gap["per_axis"]:
            assert axis["floor"] <= min(axis[k] for k in ("before", "calibrated", "after")) + 1e-12
        for name in ("before", "calibrated", "after", "floor"):
            by_axis = np.array([axis[name] for axis in gap["per_axis"]])
            assert gap[name] == pytest.approx(np.sqrt(np.mean(by_axis**2)), rel=1e-9)
        if baseline or not told.changes:
            assert gap["calibrated"] == pytest.approx(gap["before"]) or not baseline
        if told.verdict == NONE:
            assert not result["effects"] and gap["after"] == gap["calibrated"]
        if told.verdict in (NAMED, AMBIGUOUS):
            assert result["effects"][-1]["gap_after"] == pytest.approx(gap["after"], rel=1e-9)
            assert (told.verdict == AMBIGUOUS) == bool(result["alternatives"])
        for one in result["effects"]:
            effect = get_effect(one["effect"])
            low, high = one["interval"]["severity"]
            severity = one["parameters"]["severity"]
            assert effect.smallest <= low <= severity <= high <= effect.largest
            if one["confidence"] > 0.9:
                assert not low <= 0 <= high
        total = sum(one["confidence"] for one in result["alternatives"])
        assert total <= len(result["effects"]) or not result["effects"]
    assert len(seen) > 1


@pytest.mark.parametrize(("fails", "share"), [(0, 1.0), (2, 0.25), (99, 0.0)])
def test_a_model_that_diverges_is_not_written(posed, monkeypatch, fails, share):
    """The model keeps the largest share of calibration that replays the recording, and says so."""
    problem = posed[False]
    offset = at(problem, "viscous_friction", 1)
    case = linear(problem, {offset: 0.03})
    asked = []

    def sometimes(recording, robot, changes):
        asked.append(changes)
        return None if len(asked) <= fails else robot

    monkeypatch.setattr(model, "replaying", sometimes)
    told = answer(case, choose(case))
    calibrated = dict((term.key, value) for term, value in told.changes)
    assert told.verdict == NONE
    full = dict((term.key, value) for term, value in asked[0])
    key = problem.terms[offset].key
    assert full[key] == pytest.approx(0.03, rel=0.5)
    assert calibrated.get(key, 0.0) == pytest.approx(share * full[key])
    assert len(told.lacks) == (share < 1)
    result = told.contract()
    if not share:
        assert result["gap"]["after"] == pytest.approx(result["gap"]["before"])


@pytest.mark.parametrize(("in_scoring", "kept"), [(1.0, 1), (-1.0, 0)])
def test_an_effect_that_other_motions_refute_is_not_named(posed, in_scoring, kept):
    """It explains the motions it was fitted to; on those for scoring it has the other sign."""
    problem = small(posed[True], ("torque_offset", 2))
    effect = value_of(problem, 0, 400.0) * problem.raw[0].astype(float)
    scored = problem.samples(problem.scoring)
    residual = problem.residual + np.where(scored[:, None], in_scoring, 1.0) * effect
    case = replace(problem, residual=residual)
    choice = choose(case)
    assert len(choice.best.groups) == 1
    empty = choice.fits[0]
    numbers = simulated_numbers(case, empty)
    calibrated = build(case, empty, numbers).left
    assert len(confirmed(case, choice, calibrated, numbers).choice.best.groups) == kept


@pytest.mark.parametrize(("decrease", "resembled"), [(400.0, False), (4000.0, True)])
def test_a_refuted_effect_may_resemble_what_has_changed(posed, decrease, resembled):
    """If it explains most of a difference that is large beside the noise, also of its level."""
    problem = small(posed[True], ("torque_offset", 2))
    effect = value_of(problem, 0, decrease) * problem.raw[0].astype(float)
    scored = problem.samples(problem.scoring)
    residual = problem.residual + np.where(scored[:, None], -1.0, 1.0) * effect
    case = replace(problem, residual=residual)
    choice = choose(case)
    numbers = simulated_numbers(case, choice.fits[0])
    found = confirmed(case, choice, build(case, choice.fits[0], numbers).left, numbers)
    assert found.choice.best.groups == ()
    assert [term.key for term in found.resembled] == [("torque_offset", 2)] * resembled
    told = answer(case, choice)
    assert told.verdict == UNKNOWN  # also because of its pattern
    assert any("which resembles it" in line for line in told.lacks) == resembled


@pytest.mark.parametrize(
    ("facts", "is_refuted"),
    [
        ({}, False),
        ({"gain": -1.6, "seen": -2.3}, False),  # as little as chance
        ({"gain": -1.6, "seen": -12.0}, True),
        ({"gain": -0.5, "seen": -12.0}, False),  # within its standard error
        ({"missed": 4.1}, False),  # less than foretold, but the error decreases
        ({"missed": 4.1, "seen": -0.1}, True),
        ({"missed": 3.9, "seen": -0.1}, False),
        ({"missed": 4.1, "gain": -1.6, "seen": -12.0, "is_strong": True}, False),
        ({"grows": True, "is_strong": True}, True),
        ({"grows": True}, True),
        ({"grows": True, "is_supported": True}, False),
        ({"share": 0.9, "is_supported": True}, True),
        ({"is_minor": True, "is_supported": True}, True),
    ],
)
def test_reasons_to_refute_an_effect(facts, is_refuted):
    plain = {"gain": 1.0, "grows": False, "missed": 0.0, "seen": 5.0, "share": 2.0}
    plain |= {"rest": None, "is_supported": False, "is_minor": False}
    plain |= {"group": (0,), "is_strong": False, "is_major": False}
    trial = confirmation.Trial(**{**plain, **facts})
    assert trial.is_refuted is is_refuted


@pytest.mark.parametrize(
    ("explained", "left", "is_minor"),
    [
        (0.09, 1.0, True),
        (0.12, 1.0, False),  # a tenth of all is a ninth of the rest
        (0.01, 0.26, True),
        (0.01, 0.24, False),  # within what is known of the noise
    ],
)
def test_an_effect_explains_a_part_of_what_differs(posed, explained, left, is_minor):
    """Squared error on its axis, beyond that of noise, without the effect and with it."""
    problem = posed[True]

    def error(beyond):
        white = np.sqrt(1 + beyond) * problem.inside
        return scoring_errors.Error(white, white, white, np.zeros(white.shape[1]))

    errors = scoring_errors.Errors(error(left + explained), error(left), problem.inside, 5)
    assert errors.is_minor(problem, 1) is is_minor
    assert errors.is_major(problem, 1) is False  # less than half
    assert not errors.is_minor(problem, 0)  # of the payload


@pytest.mark.parametrize("baseline", [True, False])
def test_effects_are_tested_where_axes_move(posed, baseline):
    """Two recordings are compared at rest too, but effects are not tested there."""
    problem = posed[baseline]
    tested, inside = scored_in_motion(problem), scored(problem)
    moves = rolling(problem.recording, problem.robot)
    assert tested.any() and not (tested & ~inside).any() and not (tested & ~moves).any()
    assert (inside & ~moves).any() == baseline


def test_an_answer_is_partial_if_much_more_than_noise_remains():
    """Gap before, after, and of noise."""
    assert not is_part(0.2, 0.02, 0.02)
    assert not is_part(0.2, 0.08, 0.02)  # 85 % explained
    assert is_part(0.2, 0.12, 0.02)
    assert not is_part(0.021, 0.0209, 0.02)  # little of it, but all within the noise
