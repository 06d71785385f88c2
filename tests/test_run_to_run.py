"""Several healthy runs: what differs between them is measured, and is no effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear import COUNT, written_down

import faultgen
from faultgen.discovery import investigate, read_recording, write_recording
from faultgen.discovery.decision.run_to_run import (
    USUAL,
    between_axes,
    differences,
    repetitions,
    variances,
)
from faultgen.discovery.decision.selection import choose
from faultgen.discovery.fit.evidence import Evidence
from faultgen.discovery.result import Named
from faultgen.discovery.terms.candidates import Term
from faultgen.effects.temperature import friction_ratios
from faultgen.errors import InputError
from faultgen.recordings.recording import mean_of
from faultgen.report.discover import friction_warnings
from faultgen.robot import COULOMB

FRICTION = (0.05, -0.06, 0.02, -0.02)
"""Coulomb friction of axis 2 in each of the healthy runs, and its mean is near the model's."""

EXCLUDED = ("torque_ripple", "transmission_error", "backlash", "gear_stiffness")
"""Effects that cost the most simulations, and are not looked for here."""


@pytest.fixture(scope="module")
def runs(measured):
    """Healthy runs of a robot whose friction differs from run to run."""
    return [measured([("coulomb_friction", 2, value)], 10 + k) for k, value in enumerate(FRICTION)]


@pytest.fixture(scope="module")
def files(runs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    paths = [folder / f"healthy{k}.h5" for k in range(len(runs))]
    for path, run in zip(paths, runs, strict=True):
        write_recording(run, path)
    return paths


@pytest.fixture(scope="module")
def asked(tiny_robot, tmp_path_factory):
    """Compares recordings by few effects; sensitivities are simulated once."""
    cache = tmp_path_factory.mktemp("cache")
    return lambda worn, healthy: investigate(
        worn, tiny_robot, healthy, cache=cache, exclude=EXCLUDED
    )


def named(answer):
    return {(one.effect, one.axis) for one in answer.effects}


@pytest.mark.slow
def test_what_differs_between_healthy_runs_is_no_effect(measured, runs, asked, tiny_robot):
    """Friction as in a healthy run is named against one of them, and not against all."""
    usual = measured([("coulomb_friction", 2, 0.06)], 3)
    one = asked(usual, runs[1]).answer
    assert named(one) and {axis for _, axis in named(one)} == {2}
    found = asked(usual, runs)
    assert (found.answer.verdict, named(found.answer)) == ("no missing effect", set())
    apart = np.sqrt(np.mean(found.problem.run_to_run**2, axis=0))
    coulomb = tiny_robot.model.actuator_biasprm[tiny_robot.ids("actuator", "friction")[1], COULOMB]
    # of a run minus the mean of four
    assert apart[1] == pytest.approx(coulomb * np.std(FRICTION, ddof=1) * np.sqrt(1.25), rel=0.3)
    assert apart[0] < 0.1 * apart[1]


@pytest.mark.slow
def test_friction_at_another_temperature_is_no_effect(measured, asked):
    """A robot that is 4 K warmer has other friction, which is unknown without temperatures."""
    height, velocity, viscous = friction_ratios(44.0, 40.0)
    warmer = [
        (name, axis, ratio - 1)
        for axis in (1, 2)
        for name, ratio in (
            ("static_friction", height),
            ("stribeck_velocity", velocity),
            ("viscous_friction", viscous),
        )
    ]
    before, now = measured([], 20), measured(warmer, 21)
    unknown = asked(now, before).answer  # what changes the torque most is named, and is true
    assert unknown.verdict == "named"
    assert named(unknown) == {("stribeck_velocity", 1), ("stribeck_velocity", 2)}

    def at(recording, temperature):
        return replace(recording, temperature=np.full(len(recording.torque), temperature))

    found = asked(at(now, 44.0), at(before, 40.0)).answer
    assert (found.verdict, named(found)) == ("no missing effect", set())
    worn = measured([*warmer, ("coulomb_friction", 2, 0.2)], 22)
    found = asked(at(worn, 44.0), at(before, 40.0)).answer
    assert found.effects[0].axis == 2
    assert found.effects[0].effect in ("coulomb_friction", "friction_wear")


@pytest.mark.slow
def test_an_effect_beside_it_is_named(measured, runs, asked):
    """The friction of the runs does not hide another effect."""
    worn = measured([("coulomb_friction", 2, 0.05), ("viscous_friction", 1, 0.3)], 4)
    found = asked(worn, runs).answer
    assert (found.verdict, named(found)) == ("named", {("viscous_friction", 1)})
    # what differs from run to run is no part of the gap
    assert found.after < 1.1 * found.floor < found.calibrated < found.before


@pytest.mark.slow
def test_much_more_of_what_differs_is_named(measured, runs, asked):
    """The friction of axis 2 beyond that of any run."""
    more = asked(measured([("coulomb_friction", 2, 0.7)], 5), runs).answer
    assert named(more) and {axis for _, axis in named(more)} == {2}


def together(runs):
    """Runs as separate parts of one recording."""
    names = ("position", "torque", "reference_position")
    arrays = {name: np.concatenate([getattr(one, name) for one in runs]) for name in names}
    count = len(runs[0].torque)
    return replace(runs[0], **arrays, segments=tuple(count * k for k in range(len(runs))))


@pytest.mark.slow
def test_what_differs_between_repetitions_is_no_effect(measured, runs, asked):
    """Two repetitions in one healthy file, and a recording with the friction of one of them."""
    usual = together([measured([("coulomb_friction", 2, 0.03)], seed) for seed in (3, 4)])
    found = asked(usual, together(runs[:2]))
    assert (found.answer.verdict, named(found.answer)) == ("no missing effect", set())
    assert found.problem.run_to_run is not None


def test_repetitions_in_one_recording_are_runs(runs):
    """Separate recordings with equal reference positions are compared."""
    baseline = together(runs[:3])
    (parts,) = repetitions(baseline)
    assert parts == baseline.parts
    assert repetitions(replace(baseline, reference_position=None)) == []
    first, second = differences([baseline])
    assert first.part == second.part == parts[0]
    spread = np.stack([one.torque[parts[0]] for one in (first, second)])
    of_runs = np.stack([run.torque for run in runs[:3]])
    # a difference of two recordings has twice the variance of one
    np.testing.assert_allclose(
        np.mean(spread**2, axis=0), 2 * np.var(of_runs, axis=0, ddof=1), atol=1e-12
    )


def test_variances_are_found_and_chance_is_not():
    """Two terms of thirty differ from run to run; each gets its own variance."""
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((30, 400, 1))
    scale = np.ones(30)
    scale[[3, 7]] = 20.0, 60.0
    runs = np.tensordot(scale * rng.standard_normal((40, 30)), columns, axes=1)
    runs += rng.standard_normal(runs.shape)
    whole = [slice(0, 400)]
    found = variances([Evidence.of(columns, run, whole) for run in runs])
    assert np.sqrt(found[[3, 7]]) == pytest.approx(scale[[3, 7]], rel=0.35)
    assert np.sum(np.delete(found, [3, 7]) > 1) <= 2
    assert np.delete(found, [3, 7]).max() < 2


@pytest.mark.slow
def test_the_command_takes_several_runs(files, tiny_robot_path, measured, tmp_path):
    """The result states how much runs differ; what shows no difference is refused."""
    write_recording(measured([("coulomb_friction", 2, 0.06)], 3), tmp_path / "usual.h5")
    result = faultgen.discover(tmp_path / "usual.h5", tiny_robot_path, healthy=files)
    assert (result["verdict"], result["effects"]) == ("no missing effect", [])
    assert [one["axis"] for one in result["run_to_run"]] == [1, 2]
    assert result["run_to_run"][1]["torque"] > 5 * result["run_to_run"][0]["torque"]
    copy = tmp_path / "copy.h5"
    copy.write_bytes(files[0].read_bytes())
    with pytest.raises(InputError, match="the same run; give each run once"):
        faultgen.discover(files[1], tiny_robot_path, healthy=[files[0], copy])
    recording = read_recording(files[0])
    wave = 0.01 * np.sin(np.arange(len(recording.torque)))[:, None]
    write_recording(replace(recording, torque=recording.torque + wave), copy)
    with pytest.raises(InputError, match="have the same noise"):
        faultgen.discover(files[1], tiny_robot_path, healthy=[files[0], copy])


def test_the_mean_has_what_all_runs_have(runs):
    first = replace(runs[0], temperature=np.full(len(runs[0].torque), 30.0))
    assert mean_of([first]) is first
    both = mean_of([first, runs[1]])
    assert both.temperature is None
    np.testing.assert_array_equal(both.torque, (runs[0].torque + runs[1].torque) / 2)


@pytest.mark.parametrize(
    ("effect", "severity", "baseline", "known", "warned"),
    [
        ("coulomb_friction", -0.012, True, None, True),
        ("coulomb_friction", 0.03, True, None, False),
        ("torque_constant", 0.01, True, None, False),
        ("coulomb_friction", 0.01, False, None, False),
        ("coulomb_friction", 0.01, True, np.ones((3, 2)), False),
    ],
)
def test_a_usual_change_of_friction_is_told_with_a_warning(
    effect, severity, baseline, known, warned
):
    """Unless several runs show how much the friction of this robot differs."""
    problem = SimpleNamespace(baseline=baseline, run_to_run=known, friction_spread=0.0)
    answer = SimpleNamespace(effects=[Named(effect, 2, severity, 0.001, (0, 0), {}, 1.0, 0.1)])
    lines = friction_warnings(SimpleNamespace(problem=problem, answer=answer))
    assert len(lines) == warned
    assert all("axis 2" in line and "-1.2 %" in line for line in lines)


def test_friction_that_differs_on_many_axes_may_be_the_temperature():
    problem = SimpleNamespace(baseline=True, run_to_run=None, friction_spread=0.0)
    effects = [Named("viscous_friction", k, -0.3, 0.001, (0, 0), {}, 1.0, 0.1) for k in (1, 2, 5)]
    found = SimpleNamespace(problem=problem, answer=SimpleNamespace(effects=effects))
    (line,) = friction_warnings(found)
    assert "axes 1, 2, 5" in line and "temperatures" in line
    found.answer.effects = effects[:2]
    assert friction_warnings(found) == []
    problem.friction_spread = 0.05  # estimated from the axes: nothing of this size is named
    (line,) = friction_warnings(found)
    assert "about 5 % on most axes" in line


def with_friction_changes(rng, changes, *, baseline=True, noise=1.0):
    """A problem in which the friction of each axis differs by a factor, and nothing else."""
    count = len(changes)
    names = ("coulomb_friction", "static_friction", "viscous_friction", "friction_wear")
    terms = [Term(name, axis, 0.1, 1e-3) for name in names for axis in range(1, count + 1)]
    columns = np.zeros((len(terms), COUNT, count))
    each = np.arange(count)
    direction = np.sign(rng.normal(size=(COUNT, count)))
    speed, slow = rng.uniform(0, 1, (2, COUNT, count))
    columns[each, :, each] = 30 * direction.T
    columns[count + each, :, each] = (5 * direction * (slow < 0.2)).T
    columns[2 * count + each, :, each] = (10 * direction * speed).T
    columns[3 * count + each] = columns[each] + columns[count + each]
    residual = np.tensordot(changes, columns[2 * count + each] + columns[3 * count + each], axes=1)
    residual += noise * rng.normal(size=residual.shape)
    return written_down(terms, columns, residual, baseline=baseline)


WEAR = "friction_wear"


def stds(problem):
    return {(term.name, term.axis): term.prior_std for term in problem.terms}


def test_friction_that_differs_on_most_axes_is_allowed_for():
    """The median of the axes tells by how much, whichever of them has a fault as well."""
    rng = np.random.default_rng(5)
    spreads = []
    for _ in range(40):
        changes = 0.05 * rng.normal(size=6)
        changes[rng.integers(6)] = 0.5
        problem = with_friction_changes(rng, changes)
        wider = between_axes(problem)
        (own,) = {round(std, 12) for (name, _), std in stds(wider).items() if name != WEAR}
        spreads.append(own)
        ratio = np.where([term.name == WEAR for term in problem.terms], 1, own / 1e-3)
        np.testing.assert_allclose(wider.white, ratio[:, None, None] * problem.white, rtol=1e-5)
        assert wider.friction_spread * 1.31 == pytest.approx(own, rel=0.01)
        laws = problem.raw[[0, 6, 12], :, 0].astype(float)
        size = wider.run_to_run[:, 0] / np.linalg.norm(laws, axis=0)
        np.testing.assert_allclose(size, size[0], rtol=1e-5)
    # the third of five healthy axes, times the quantile of Student's t with 5 degrees of freedom
    assert np.median(spreads) == pytest.approx(0.05 * 1.31, rel=0.25)
    assert max(spreads) < 0.2  # the fault itself is not taken for usual


@pytest.mark.parametrize(
    ("changes", "baseline"),
    [((0.5, 0, 0, 0, 0, 0), True), ((0.5, 0.3, 0, 0, 0), True), ((0.05,) * 6, False)],
    ids=["one fault", "two faults", "no baseline"],
)
def test_other_differences_of_friction_are_effects(changes, baseline):
    rng = np.random.default_rng(6)
    problem = with_friction_changes(rng, np.array(changes), baseline=baseline, noise=0.01)
    assert between_axes(problem) is problem


def test_axes_at_rest_do_not_count():
    """Four of six axes move; the friction of three of them differs."""
    rng = np.random.default_rng(8)
    changes = np.array([0.05, -0.05, 0.05, 0, 0, 0])
    problem = with_friction_changes(rng, changes, noise=0.01)
    still = replace(problem, white=problem.white.copy(), raw=problem.raw.copy())
    for columns in (still.white, still.raw):
        columns[:, :, 4:] = 0
    assert between_axes(still).friction_spread == pytest.approx(0.05 / 0.674, rel=0.05)
    still.white[:, :, 3] = 0
    assert between_axes(still).friction_spread == USUAL  # three are too few


@pytest.mark.parametrize(("change", "is_found"), [(-0.045, False), (0.05, False), (0.2, True)])
def test_few_axes_do_not_show_how_much_friction_differs(change, is_found):
    """Some percent are usual between two days; a fault is larger than that."""
    rng = np.random.default_rng(9)
    problem = with_friction_changes(rng, np.array([change]), noise=0.01)
    assert choose(problem).best.groups  # without the assumption, each of them is named
    problem = between_axes(problem)
    groups = choose(problem).best.groups
    assert bool(groups) == is_found


def test_a_warmer_day_is_no_effect_and_a_fault_still_is():
    """Friction of all axes differs by some percent; a fault is much larger than that."""
    rng = np.random.default_rng(7)
    usual = np.array([0.04, 0.05, -0.03, 0.06, 0.05, 0.03])
    found = choose(between_axes(with_friction_changes(rng, usual))).best
    assert found.groups == ()
    usual[2] = 0.6
    problem = between_axes(with_friction_changes(rng, usual))
    groups = choose(problem).best.groups
    assert {problem.terms[term].axis for group in groups for term in group} == {3}
