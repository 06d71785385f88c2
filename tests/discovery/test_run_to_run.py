"""Several healthy runs: what differs between them is measured, and is no effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import faultgen
from faultgen.discovery import Discovery, read_recording, write_recording
from faultgen.discovery.decision.arrays import Posed, arrays_of
from faultgen.discovery.decision.numbers import PARTS_OF_FRICTION, at_rest_of
from faultgen.discovery.decision.run_to_run import differences, learned, repetitions
from faultgen.discovery.doubts import friction_warnings
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.result import Named
from faultgen.discovery.terms.candidates import effect_terms
from faultgen.effects.temperature import friction_ratios
from faultgen.errors import InputError
from faultgen.recordings.recording import mean_of

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
    return lambda worn, healthy: Discovery(
        tiny_robot, exclude=EXCLUDED, laws=False, cache=cache
    ).fit(worn, healthy)


def named(answer):
    return {(one.effect, one.axis) for one in answer.effects}


@pytest.mark.slow
def test_what_differs_between_healthy_runs_is_no_effect(measured, runs, asked):
    """Friction as in another healthy run."""
    usual = measured([("coulomb_friction", 2, 0.06)], 3)
    found = asked(usual, runs)
    assert (found.answer_.verdict, named(found.answer_)) == ("no missing effect", set())
    assert found.runs_ is not None


@pytest.mark.slow
def test_friction_at_another_temperature_is_no_effect(measured, asked):
    """A robot that is 4 K warmer has other friction on all axes, whether or not it is measured."""
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
    unknown = asked(now, before).answer_
    assert (unknown.verdict, named(unknown)) == ("no missing effect", set())

    def at(recording, temperature):
        return replace(recording, temperature=np.full(len(recording.torque), temperature))

    found = asked(at(now, 44.0), at(before, 40.0)).answer_
    assert (found.verdict, named(found)) == ("no missing effect", set())
    worn = measured([*warmer, ("coulomb_friction", 2, 0.5)], 22)
    found = asked(at(worn, 44.0), at(before, 40.0)).answer_
    assert found.effects[0].axis == 2
    assert found.effects[0].effect in ("coulomb_friction", "friction_wear")


@pytest.mark.slow
def test_an_effect_beside_it_is_named(measured, runs, asked):
    """The friction of the runs does not hide another effect."""
    worn = measured([("coulomb_friction", 2, 0.05), ("viscous_friction", 1, 0.3)], 4)
    found = asked(worn, runs).answer_
    assert (found.verdict, named(found)) == ("named", {("viscous_friction", 1)})
    assert found.after < 0.2 * found.calibrated
    # what differs from run to run is no part of the gap: the numbers of axis 2 close it alone
    second = found.per_axis[1]
    before, calibrated, after = (
        second[name] ** 2 - second["floor"] ** 2 for name in ("before", "calibrated", "after")
    )
    assert max(calibrated, after) < 0.1 * before


@pytest.mark.slow
def test_much_more_of_what_differs_is_named(measured, runs, asked):
    """The friction of axis 2 beyond that of any run."""
    more = asked(measured([("coulomb_friction", 2, 0.7)], 5), runs).answer_
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
    assert (found.answer_.verdict, named(found.answer_)) == ("no missing effect", set())
    assert found.runs_ is not None


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


def prepared(recording, robot):
    """The recording and the numbers of the model, to be compared with a baseline."""
    replay = Replay(recording, robot)
    terms = [one for one in effect_terms(robot) if one.name not in EXCLUDED]
    base, raw = sensitivities(replay, terms)
    used = np.ones(len(base), bool)
    return Posed(replay, terms, raw, base, np.zeros_like(base), used, baseline=True)


@pytest.mark.slow
def test_scales_are_learned_from_healthy_runs(measured, tiny_robot):
    """All friction of both axes differs by 6 %, or only the noise does; other groups stay."""
    posed = prepared(measured([], 1), tiny_robot)
    scales = {}
    for size in (0.0, 0.06):
        runs = [
            measured(
                [
                    (name, axis, size * one[axis - 1])
                    for name in PARTS_OF_FRICTION
                    for axis in (1, 2)
                ],
                30 + k,
            )
            for k, one in enumerate([(1, -1), (-1, 0.6), (0.4, 1.3), (-0.8, -0.9)])
        ]
        groups = learned(posed, differences(runs)).groups
        scales[size] = {one.name: one for one in groups}
    still, varied = (scales[size]["friction"] for size in (0.0, 0.06))
    assert still.centre < 0.35  # few numbers in four runs, against a factor of 2 before
    # 5.5 % in a run, 6.2 % between a run and the mean of four; 1.2 % is usual from day to day for
    # all friction of an axis, and as much for each of its parts
    assert varied.centre == pytest.approx(6.2 / np.hypot(1.2, 1.2), rel=0.3)
    for one in (still, varied):
        assert 1.0 < one.spread <= 4.0  # better known than before
    assert varied.spread < 3.0
    assert scales[0.06]["links"].centre == pytest.approx(scales[0.0]["links"].centre, abs=0.3)


def test_rests_are_compared_where_both_recordings_follow_the_same_commands(measured, tiny_robot):
    """Friction of each rest is a number there, and one group of each axis."""
    recording = measured([], 1)
    posed = prepared(recording, tiny_robot)
    commanded = replace(posed, replay=Replay(recording, tiny_robot, measured=False))
    for one, uses in (
        (posed, False),
        (commanded, True),
        (replace(commanded, baseline=False), False),
    ):
        arrays = arrays_of(one, only_numbers=True)
        assert (arrays.comparable & arrays.resting).any(axis=0).tolist() == [uses, uses]
        for axis in (1, 2):
            own = [k for k, kind in enumerate(arrays.numbers.kinds) if kind == at_rest_of(axis)]
            seen = sum(np.abs(arrays.numbers.columns[k][:, axis - 1]) > 0 for k in own)
            rests = arrays.comparable[:, axis - 1] & arrays.resting[:, axis - 1]
            assert np.array_equal(seen, rests.astype(int)) if uses else not own
            groups = {arrays.numbers.groups[g].name for g in arrays.numbers.group[own]}
            assert groups == ({at_rest_of(axis)} if uses else set())


def test_nothing_is_learned_without_a_second_run(measured, tiny_robot):
    assert differences([measured([], 1)]) == []
    assert learned(prepared(measured([], 1), tiny_robot), []) is None


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


def discovered(effects, *, moving, baseline=True, runs=None):
    """The parts of a discovery that friction warnings look at."""
    inside = np.zeros((10, 6), bool)
    inside[:, :moving] = True
    numbers = SimpleNamespace(kinds=["links", "friction"], std=[1.0, 0.02])
    return SimpleNamespace(
        problem_=SimpleNamespace(baseline=baseline, inside=inside),
        choice_=SimpleNamespace(difference=SimpleNamespace(numbers=numbers)),
        answer_=SimpleNamespace(effects=effects),
        prior_scales_={"friction": 1.5},
        runs_=runs,
    )


@pytest.mark.parametrize(
    ("more", "warned"),
    [({}, True), ({"baseline": False}, False), ({"runs": object()}, False), ({"moving": 6}, False)],
)
def test_few_axes_do_not_show_how_much_friction_differs(more, warned):
    """Then a line says what is taken, unless several runs show it."""
    lines = friction_warnings(discovered([], **({"moving": 2} | more)))
    assert len(lines) == warned
    assert all("2 moving axes" in line and "3 % is taken" in line for line in lines)


def test_friction_that_differs_on_many_axes_may_be_the_temperature():
    effects = [Named("viscous_friction", k, -0.3, 0.001, (0, 0), {}, 1.0, 0.1) for k in (1, 2, 5)]
    (line,) = friction_warnings(discovered(effects, moving=6))
    assert "axes 1, 2, 5" in line and "temperatures" in line
    assert friction_warnings(discovered(effects[:2], moving=6)) == []
    others = [replace(one, effect="rotor_inertia") for one in effects]
    assert friction_warnings(discovered(others, moving=6)) == []


@pytest.mark.parametrize(
    ("change", "names"),
    [
        pytest.param((-0.045, 0.03), set(), id="some percent on both"),
        pytest.param((0.5, 0.0), {1}, id="half on one", marks=pytest.mark.slow),
        pytest.param((0.05, 0.9), {2}, id="much more on one", marks=pytest.mark.slow),
    ],
)
def test_some_percent_of_friction_are_usual_and_a_fault_is_larger(measured, asked, change, names):
    """Between two days of one robot, of which there is one healthy recording."""
    effects = [("coulomb_friction", axis + 1, size) for axis, size in enumerate(change)]
    found = asked(measured(effects, 8), measured([], 9)).answer_
    assert {axis for _, axis in named(found)} == names
