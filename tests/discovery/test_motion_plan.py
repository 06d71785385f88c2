import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from conftest import faultgen_here
from scipy.signal import lfilter

from faultgen.discovery.planning import motion_plan
from faultgen.discovery.planning.expected_rates import (
    Candidates,
    Fault,
    clarity,
    draw_rates,
    severity,
)
from faultgen.discovery.planning.information import (
    NOISE,
    SAMPLE_PERIOD,
    Information,
    drifting,
    information,
)
from faultgen.discovery.planning.motion_library import AllowedPoses, library, task_toml
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import FORM, Term, effect_terms
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.recordings.recording import Recording
from faultgen.report.plan import plan_motions, table
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

SMALL = ("friction_wear", "torque_offset", "backlash", "rotor_inertia", "payload_mass")
SLIDE = "benchmarks/laboratories/robots/lift1.xml"


@pytest.fixture(scope="module", params=["puma560", SLIDE])
def motions(request):
    """The library of a robot with six axes, and of one with a single axis that slides."""
    return library(load_robot(request.param), np.random.default_rng(0))


@pytest.fixture(scope="module")
def short(tiny_robot):
    """Three short motions of the small robot."""
    found = library(tiny_robot, np.random.default_rng(0))
    return [one for one in found if one.task.name.startswith(("fast", "mixed"))][:3]


def few(robot, include=()):
    """Terms of some effects."""
    return [term for term in effect_terms(robot) if term.name in SMALL]


def test_motions_keep_the_limits(motions):
    """No motion leaves the joint ranges, is too fast, or goes into the floor."""
    robot = motions[0].robot
    space = AllowedPoses.of(robot)
    assert len({motion.task.name for motion in motions}) == len(motions) > 5
    for motion in motions:
        q, qd, qdd = motion(np.arange(0, motion.period, 0.01))
        low, high = robot.joint_range.T
        assert (q >= low).all() and (q <= high).all()
        assert (np.abs(qd * robot.gear_ratio) <= 1.001 * robot.motor_velocity_limit).all()
        assert (np.abs(qdd) <= 1.001 * robot.joint_acceleration_limit).all()
        assert all(space.is_clear(pose) for pose in q[::5])


def test_the_floor_is_seen():
    """A pose of the PUMA that reaches down in front of its base is refused."""
    space = AllowedPoses.of(load_robot("puma560"))
    assert space.is_allowed(np.radians([0, 90, -90, 0, 0, 0]))
    down = np.radians([0, -40, -90, 0, 0, 0])
    assert not space.is_clear(down) and not space.is_allowed(down)


def test_a_motion_is_a_task_file(motions, tmp_path):
    """The TOML text of a motion is a task from which the same motion is planned."""
    for motion in motions[:: len(motions) - 1]:
        path = tmp_path / "motion_1.toml"
        path.write_text(task_toml(motion.task))
        again = plan(load_task(motion.robot.name, str(path)), motion.robot)
        times = np.arange(0, motion.period, 0.02)
        assert again.period == motion.period
        np.testing.assert_array_equal(again(times)[0], motion(times)[0])


def test_short_cuts_agree_with_full_sensitivities(tiny_robot, short):
    """Information is what full simulations of each term tell, to a few per cent."""
    motion, terms = short[0], few(tiny_robot)
    links = [one for one in inertia_terms(tiny_robot) if one.axis == 2]
    told = information(tiny_robot, [motion], terms, reference=0)
    way = motion(np.arange(int(motion.period / SAMPLE_PERIOD)) * SAMPLE_PERIOD)[0]
    recording = Recording(
        source="test",
        robot="tiny",
        side="motor",
        sample_period=SAMPLE_PERIOD,
        position=way * tiny_robot.gear_ratio,
        torque=np.zeros_like(way),
        reference_position=way,
    )
    base, full = sensitivities(Replay(recording, tiny_robot, measured=False), terms + links)
    sigma = NOISE * np.sqrt(np.mean(base**2, axis=0))
    inside = counted(recording, tiny_robot, baseline=False)
    stds = np.array([one.prior_std for one in terms + links])
    white = drifting(sigma).whiten(full, recording.parts) * inside
    white = white.reshape(len(full), -1) * stds[:, None]
    chosen = [told.terms.index(one) for one in terms + links]
    found = told.gram[0][np.ix_(chosen, chosen)]
    size = np.sqrt(np.diag(white @ white.T))
    shown = size > 0.01 * size.max()  # products of columns that are nearly zero mean nothing
    error = ((found - white @ white.T) / np.outer(size, size))[np.ix_(shown, shown)]
    np.testing.assert_allclose(error, 0, atol=0.08)


def random_problem(rng, count=6):
    """Terms, columns and inner products of a problem with friction and offsets."""
    names = ("coulomb_friction", "torque_offset", "delay", FORM)
    terms = [Term(names[k % 4], 1 + k // 4, 0.1, 0.01) for k in range(count)]
    columns = rng.standard_normal((count, 50, 1))
    gram = np.einsum("isa,jsa->ij", columns, columns)
    return terms, columns, gram


def test_drifting_noise_is_whitened():
    """White noise plus noise with a time constant of 18 ms becomes white, with a deviation of 1."""
    rng = np.random.default_rng(6)
    memory, count = np.exp(-SAMPLE_PERIOD / 0.018), 200_000
    drift = np.sqrt(1 - memory**2) * rng.standard_normal(count)
    drift = lfilter([1.0], [1.0, -memory], drift)
    noise = 0.3 * np.sqrt(0.5) * (rng.standard_normal(count) + drift)
    white = drifting(np.array([0.3])).whiten(noise[:, None], [slice(0, count)])[50:, 0]
    assert white.std() == pytest.approx(1, abs=0.01)
    assert [white[k:] @ white[:-k] / count for k in (1, 2, 5)] == pytest.approx([0] * 3, abs=0.01)


def test_gains_are_those_of_fits():
    """By how much the misfit falls if a candidate has no prior any more."""
    rng = np.random.default_rng(1)
    terms, columns, gram = random_problem(rng)
    candidates = Candidates.of(terms)
    flat, y = columns.reshape(len(columns), -1), rng.standard_normal(50)

    def fitted(free=()):
        weight = np.ones(len(flat))
        weight[list(free)] = 1e-9
        value = np.linalg.solve(gram + np.diag(weight), flat @ y)
        return value, float(np.sum((y - value @ flat) ** 2) + np.sum(weight * value**2))

    value, misfit = fitted()
    inverse = np.linalg.inv(gram + np.eye(len(gram)))
    found = candidates.gains(inverse, value[:, None])[:, 0]
    for gain, group, least in zip(found, candidates.groups, candidates.least, strict=True):
        freed, less = fitted(group)
        expected = misfit - less if freed[group[0]] > least else 0.0
        assert gain == pytest.approx(expected, rel=1e-4, abs=1e-6)
    assert all(terms[g[0]].name != FORM for g in candidates.groups)


def faults_of(candidates, size=10.0):
    """Each candidate as a fault of some prior standard deviations."""
    return [
        Fault(*key, size * candidates.terms[group[0]].prior_std, k)
        for k, (key, group) in enumerate(zip(candidates.keys, candidates.groups, strict=True))
    ]


def test_rates_of_clear_hidden_and_similar_effects():
    """A separate column is named, a zero column never, and two similar ones half of the time."""
    terms = [Term("coulomb_friction", axis, 0.1, 0.01) for axis in (1, 2, 3, 4)]
    columns = np.zeros((4, 10))
    columns[0, 0] = columns[1, 1] = columns[2, 1] = 30.0
    columns[2, 2] = 0.02
    candidates = Candidates.of(terms)
    faults = faults_of(candidates)
    gram = columns @ columns.T
    rates, alarms = draw_rates(candidates, faults, gram, np.random.default_rng(0))
    assert rates[0].right == 1 and rates[0].instead is None
    assert rates[3].right == 0 and rates[3].wrong == 0
    for k in (1, 2):
        assert rates[k].right == pytest.approx(0.5, abs=0.1)
        assert rates[k].wrong == pytest.approx(1 - rates[k].right, abs=0.02)
        assert rates[k].instead == ("coulomb_friction", 4 - k)
    assert alarms < 0.01
    share = clarity(candidates, faults, gram).share
    assert share[0] > 0.99 and share[3] < 0.01 and share[1:3] == pytest.approx(0.5, abs=0.05)


def test_expected_share_agrees_with_draws():
    """The quick estimate with which motions are chosen is near the rate that is drawn."""
    rng = np.random.default_rng(3)
    terms, _, gram = random_problem(rng)
    candidates = Candidates.of(terms)
    for size in (4.0, 5.0, 6.0, 8.0):
        faults = faults_of(candidates, size)
        rates, _ = draw_rates(candidates, faults, gram, np.random.default_rng(4))
        share = clarity(candidates, faults, gram).share
        np.testing.assert_allclose([rate.right for rate in rates], share, atol=0.15)


def test_the_smallest_severity_is_named_nine_times_of_ten():
    """At the smallest severity of a lone effect the rate that is drawn is 90 %."""
    terms = [Term("coulomb_friction", 1, 0.1, 0.01), Term("delay", 2, 0.1, 0.01)]
    candidates = Candidates.of(terms)
    gram = np.diag([2.0, 0.0])
    faults = faults_of(candidates)
    smallest = clarity(candidates, faults, gram).smallest
    assert np.isinf(smallest[1])
    again = [replace(faults[0], severity=smallest[0] * faults[0].severity)]
    rates, _ = draw_rates(candidates, again, gram, np.random.default_rng(5))
    assert rates[0].right == pytest.approx(0.9, abs=0.06)


def test_the_motion_that_separates_is_chosen():
    """A motion that tells two effects apart beats a louder one on which they look the same."""
    terms = [Term("coulomb_friction", axis, 0.1, 0.01) for axis in (1, 2)]
    loud, telling = np.full((2, 2), 900.0), np.diag([100.0, 100.0])
    told = Information(terms, np.array([loud, telling, loud]), np.array([40.0, 40.0, 40.0]))
    candidates = Candidates.of(terms)
    assert motion_plan.choose_motions(told, candidates, faults_of(candidates), [0, 1, 2]) == [1]


def test_severities_that_healthy_robots_have_are_not_asked_for(tiny_robot):
    """Friction is asked for at 20 %; where healthy robots differ widely, at more."""
    by_name = {term.name: severity(tiny_robot, term) for term in motion_plan.terms_of(tiny_robot)}
    assert by_name["friction_wear"] == 0.2 and by_name["backlash"] == 2e-4
    assert by_name["gear_stiffness"] == pytest.approx(0.7)
    assert by_name["delay"] == pytest.approx(7 * 6e-4)


@pytest.fixture(scope="module")
def planned(tiny_robot_path, short, tmp_path_factory):
    """A plan for the small robot from few motions and effects."""
    out = tmp_path_factory.mktemp("plan")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion_plan, "library", lambda robot, rng: list(short))
        patch.setattr(motion_plan, "terms_of", few)
        result = plan_motions(tiny_robot_path, out=out)
        again = plan_motions(tiny_robot_path, workers=2)
    return out, result, again


def test_a_plan_is_written(planned, short, tiny_robot):
    """plan.json states the rates, and every motion that it lists is a task of the robot."""
    out, result, _ = planned
    assert json.loads((out / "plan.json").read_text()) == result
    assert result["reference"] == short[0].task.description
    assert 0 < result["duration"] <= motion_plan.DURATION
    for one in result["motions"]:
        text = (out / one["file"]).read_text()
        assert tomllib.loads(text)["description"] == one["description"]
        motion = plan(load_task("tiny", str(out / one["file"])), tiny_robot)
        assert motion.period == one["duration"]
    keys = [(one["effect"], one["axis"]) for one in result["rates"]]
    assert len(keys) == len(set(keys)) and ("payload_mass", 2) in keys
    for one in result["rates"]:
        for which in ("plan", "reference"):
            assert 0 <= one[which]["right"] <= one[which]["right"] + one[which]["wrong"] <= 1.001
    wear = [one["plan"]["right"] for one in result["rates"] if one["effect"] == "friction_wear"]
    assert min(wear) > 0.9


def test_a_plan_does_not_depend_on_workers(planned):
    """Two processes give the same plan and the same rates as one."""
    _, result, again = planned
    seconds = {"seconds": 0}
    assert result | seconds == again | seconds


def test_the_table_is_short(planned):
    """Effects with errors have a row; those that are always named are only listed."""
    result = planned[1]
    *lines, sure = table(result).splitlines()
    assert lines[0].split() == ["effect", "severity", "axis", "1", "axis", "2"]
    shown = {line.split()[0] for line in lines[1:] if line}
    poor = {
        one["effect"]
        for one in result["rates"]
        if min(one["plan"]["right"], one["reference"]["right"]) < 0.99
    }
    assert shown == poor != set()
    assert all(name in sure for name in set(SMALL) - poor)
    row = next(one for one in result["rates"] if one["effect"] in poor and one["axis"] == 2)
    cell = f"{100 * row['reference']['right']:.0f} -> {100 * row['plan']['right']:.0f}"
    assert any(line.startswith(row["effect"]) and line.endswith(cell) for line in lines)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plan"], "faultgen: Missing option '--robot'."),
        (["--robot", "puma560"], "give a recording of the robot, or --plan"),
        (["x.h5", "--plan", "--robot", "puma560"], "analyses no recording: leave out a recording"),
        (["--plan", "--robot", "puma560", "--low-pass", "5"], "leave out --low-pass"),
        (["--plan", "--robot", "nobody"], "unknown robot 'nobody'"),
        (["--plan", "--robot", "puma560", "--include", "rust"], "include: unknown name 'rust'"),
    ],
)
def test_wrong_use_is_one_line(arguments, message):
    """A plan needs a robot and no recording; without --plan a recording is needed."""
    done = faultgen_here("discover", *arguments)
    assert done.returncode == 2
    assert done.stdout == "" and len(done.stderr.splitlines()) == 1 and message in done.stderr
