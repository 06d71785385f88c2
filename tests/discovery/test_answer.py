"""Which set is answered with, what is said of it, and that its numbers agree with one another."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear import difference_between, linear, ridge

from faultgen.discovery import Discovery
from faultgen.discovery.calibration import model_edit as model
from faultgen.discovery.decision import choice as choices
from faultgen.discovery.decision import verdict as judgement
from faultgen.discovery.decision.verdict import answer, is_part
from faultgen.discovery.fit.fit import fit_at, no_effect
from faultgen.discovery.planning import next_experiment as motions
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.result import AMBIGUOUS, NAMED, NONE, PARTLY
from faultgen.effects import get_effect
from faultgen.simulation.motion import plan
from faultgen.tasks import Task


def choose(problem):
    """The choice for a problem whose laws are straight."""
    return choices.choose(problem, difference_between(problem))


@pytest.fixture(scope="module")
def posed(measured, tiny_robot):
    """Problems of a clean recording, with a baseline and without, ready for other gaps."""
    worn, healthy = (measured([], seed) for seed in (2, 1))
    return {
        baseline: Discovery(tiny_robot, laws=False)
        .fit(worn, healthy if baseline else None)
        .problem_
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
    unit = replace(problem, residual=problem.raw[index].astype(float))
    value, covariance = ridge(unit, [index])
    return float(value[index] * np.sqrt(gain * covariance[index, index]))


def small(problem, *names):
    """A problem with few terms, so that nothing but them can explain a residual."""
    indices = [at(problem, name, axis) for name, axis in names]
    return linear(problem, terms=[problem.terms[k] for k in indices], raw=problem.raw[indices])


@pytest.mark.parametrize("is_part", [False, True])
def test_what_looks_the_same_is_not_excluded(posed, is_part, monkeypatch):
    """Two terms of nearly one shape are rivals, two of other shapes are none.

    Effects that explain only a part are named only where they are certain.
    """
    monkeypatch.setattr(judgement, "is_part", lambda *errors: is_part)
    problem = posed[True]
    one, other = at(problem, "rotor_inertia", 2), at(problem, "torque_constant", 2)
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
        told = answer(found.problem, found)
        assert told.verdict == (AMBIGUOUS if is_rival else PARTLY if is_part else NAMED)
        assert len(told.alternatives) == is_rival
        total = told.effects[0].confidence + sum(odds for _, _, odds in told.alternatives)
        assert 0.95 <= total <= 1.0
        assert told.effects[0].confidence >= max(odds for *_, odds in [*told.alternatives, (0.0,)])


@pytest.mark.parametrize(("apart", "is_rival"), [(0.05, True), (0.4, False)])
def test_a_large_effect_is_similar_to_what_a_wrong_form_could_be(posed, apart, is_rival):
    """However little noise there is, forms that differ by a few per cent are not told apart."""
    problem = posed[True]
    one, other = at(problem, "rotor_inertia", 2), at(problem, "torque_constant", 2)
    raw = problem.raw[[one, other]].copy()
    rng = np.random.default_rng(5)
    other_form = rng.standard_normal(raw[0].shape)
    size = np.linalg.norm(raw[0]) / np.linalg.norm(other_form)
    raw[1] = raw[0] + apart * size * other_form
    terms = [replace(problem.terms[k], prior_std=1e-6) for k in (one, other)]
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
    best = fit_at(problem, [mine], np.array([own[2]]), 0.01 * np.eye(1))
    rivals = tuple((0, group, 0.25) for group in others)
    choice = SimpleNamespace(best=best, shares=(0.5,), rivals=rivals)
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
        assert found.distance == pytest.approx(distances[best], rel=0.01)  # of first order
        assert found.now == pytest.approx(np.sqrt(2 * np.log(2)))
        assert found.separates[0] == own[:2]
        assert found.separates[1] in [problem.terms[group[0]].key for group in others]
    task = Task(**{"name": best, "robot": "tiny", **tomllib.loads(found.toml)})
    reference = plan(task, problem.robot)(np.linspace(0, 3, 50))[0]
    seen = problem.recording.joint_position(problem.robot)
    assert (reference >= seen.min(axis=0) - 1e-6).all()
    assert (reference <= seen.max(axis=0) + 1e-6).all()


def test_no_next_experiment_without_rivals(posed):
    problem = posed[True]
    alone = SimpleNamespace(best=no_effect(problem), shares=(), rivals=())
    assert motions.next_experiment(problem, alone) is None


def test_intervals_hold_the_severity_as_often_as_they_say(posed):
    """Over many draws of the noise, 95 % of them."""
    problem = small(posed[True], ("rotor_inertia", 2))
    true = value_of(problem, 0, 100)
    clean = true * problem.raw[0].astype(float)
    nothing = difference_between(problem)
    scales = nothing.model.healthy.log_scales
    rng = np.random.default_rng(6)
    held = []
    for _ in range(150):
        noise = problem.noise.deviation * rng.standard_normal(clean.shape)
        case = replace(problem, residual=clean + noise)
        case = choices.severities(case, replace(nothing, residual=clean + noise), [(0,)], scales)
        error = float(np.sqrt(case.covariance[0, 0]))
        held.append(abs(case.values[0] - true) < 1.96 * error)
    assert 0.95 - 0.06 < np.mean(held) < 1.0  # three standard errors below


@pytest.mark.slow
@pytest.mark.parametrize("baseline", [True, False])
def test_the_numbers_of_an_answer_agree(posed, baseline):
    """One meaning of gap, floor, interval and confidence, for all kinds of answers."""
    problem = posed[baseline]
    rng = np.random.default_rng(7)
    candidates = [
        k
        for k, t in enumerate(problem.terms)  # the law of a play is not straight
        if t.is_effect and not t.parameters and not get_effect(t.name).prior.play
        if not t.commanded  # nor is it taken on the same motion with the answer of the servo
        if problem.raw[k].any()
    ]
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

    def sometimes(given, changes):
        asked.append(changes)
        return None if len(asked) <= fails else given.robot

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


def test_an_answer_is_partial_if_much_more_than_noise_remains():
    """Gap before, after, and of noise."""
    assert not is_part(0.2, 0.02, 0.02)
    assert not is_part(0.2, 0.08, 0.02)  # 85 % explained
    assert is_part(0.2, 0.12, 0.02)
    assert not is_part(0.021, 0.0209, 0.02)  # little of it, but all within the noise
