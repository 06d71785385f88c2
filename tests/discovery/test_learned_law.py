"""Laws that are learned from what no effect of the catalogue explains, on the small robot."""

import json
from dataclasses import replace

import numpy as np
import pytest
from linear import difference_between

import faultgen
from faultgen.applied import Applied
from faultgen.discovery import Discovery, write_recording
from faultgen.discovery.decision.choice import choose as choose_of
from faultgen.discovery.decision.choice import severities
from faultgen.discovery.decision.verdict import answer
from faultgen.discovery.decision.with_laws import contract, outside, with_laws
from faultgen.discovery.laws.law_curves import Courses, Curve
from faultgen.discovery.laws.law_fit import Regression
from faultgen.discovery.laws.law_words import Part, formulas
from faultgen.discovery.laws.learned_law import learn
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.result import Named
from faultgen.effects.law_course import UNITS, Course
from faultgen.effects.learned import NAME, check_law, law_torque
from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.simulation.plant import assemble

TURN = np.linspace(0, 2 * np.pi, 41).tolist()
LAWS = {
    "periodic": {
        "over": "motor_turn",
        "scale": 2 * np.pi,
        "times": "direction",
        "knots": TURN,
        "values": (0.04 * np.cos(TURN)).tolist(),
    },
    "position": {
        "over": "joint_angle",
        "times": "direction",
        "knots": [-0.6, -0.2, 0.2],
        "values": [0.0, 0.1, 0.0],
    },
    "hysteresis": {
        "over": "hysteresis",
        "scale": 3.0,
        "knots": [-1.0, 1.0],
        "values": [-0.05, 0.05],
    },
}
SEEN = {"periodic": "motor angle", "position": "joint angle", "hysteresis": "hysteresis"}


@pytest.fixture(scope="module")
def problem(measured, tiny_robot):
    """Two recordings of the healthy robot, compared at their measured positions."""
    worn, healthy = (replace(measured([], seed), reference_position=None) for seed in (2, 1))
    return Discovery(tiny_robot, laws=False).fit(worn, healthy).problem_


def choose(problem):
    """The choice among the effects of the catalogue."""
    return choose_of(problem, difference_between(problem))


def change_of(problem, law, axis=2):
    """Simulated change of the torque by a law."""
    robot = problem.robot.with_effects([Applied(NAME, axis, 1.0, {"law": [law]})])
    return Replay(problem.recording, robot).torque() - problem.base


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name == "periodic")) for name in LAWS],
)
def test_a_law_is_learned(problem, name):
    """The right axis and variable, and most of the gap is closed on motions that were kept."""
    left = problem.residual + change_of(problem, LAWS[name])
    found = learn(problem, left)
    assert [one.axis for one in found] == [2]
    (law,) = found
    assert SEEN[name] in law.depends_on[0]
    rows = problem.inside[:, 1] & problem.samples(problem.scoring)
    noise = np.mean(problem.residual[rows, 1] ** 2) / np.mean(left[rows, 1] ** 2)
    assert law.share > 0.8 * (1 - noise) > 0 and law.confidence > 0.6
    assert law.interval[0] <= law.size <= law.interval[1]
    again = problem.given.with_effects([law.applied]).torque() - problem.given.torque()
    np.testing.assert_allclose(again, law.change, atol=1e-9)


@pytest.mark.slow
def test_a_shape_that_is_nowhere_has_no_value(problem):
    """A formula may be 0 on all samples, and its values are then not determined."""
    left = np.random.default_rng(0).standard_normal(problem.residual.shape)
    regression = Regression(problem, Courses(problem.replay, problem.inside), left, 1)
    columns = np.array([regression.target, 0 * regression.target])
    np.testing.assert_allclose(regression.fit(columns, np.zeros((2, 2))), [1.0, 0.0], atol=1e-9)


@pytest.mark.slow
def test_noise_is_no_law(problem):
    """Of healthy robots nothing is learned, whatever the draw of the noise."""
    rng = np.random.default_rng(4)
    for _ in range(5):
        noise = problem.noise.of_samples() * rng.standard_normal(problem.residual.shape)
        assert learn(problem, noise) == []
    assert learn(problem, problem.residual) == []


def test_an_effect_of_the_catalogue_is_no_law(problem):
    """What looks like an effect that was not needed is not told as a law."""
    at = next(k for k, t in enumerate(problem.terms) if t.key == ("viscous_friction", 2))
    assert learn(problem, problem.residual + 0.3 * problem.raw[at].astype(float)) == []


def test_a_formula_is_told_where_it_does(problem):
    """A cosine of the motor's angle is told as one, with its amplitude."""
    (law,) = learn(problem, problem.residual + change_of(problem, LAWS["periodic"]))
    amplitude = float(law.formula.strip("()").split(" cos(")[0])
    assert "cos(th)" in law.formula and law.formula.endswith("sign(w)")
    assert amplitude == pytest.approx(0.04, rel=0.15)
    assert "once a motor turn" in law.sentence


@pytest.mark.parametrize("given", ["no missing effect", "unknown effect", "partly named"])
@pytest.mark.slow
def test_laws_complete_an_answer_that_explains_too_little(problem, given):
    """They join the model, and all numbers agree. Where nothing is missing, none is learned."""
    residual = problem.residual + change_of(problem, LAWS["periodic"])
    choice = choose(problem)
    told = answer(problem, choice)
    told = replace(
        told,
        verdict=given,
        left_torque=residual,
        strange_torque=residual,
        changes=[],
        robot=problem.robot,
    )
    new, laws = with_laws(problem, choice, told)
    assert new.verdict == given
    if given == "no missing effect":
        assert new is told and laws == []
        return
    (row,) = contract(problem, new, laws)
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert (row["effect"], row["axis"]) == ("learned", 2)
    assert row["gap_after"] == pytest.approx(new.after)
    assert {"depends_on", "formula", "resembles"} <= row["parameters"].keys()
    assert new.robot.effects == (laws[0].applied,)
    by_axis = np.array([one["after"] for one in new.per_axis])
    assert new.after == pytest.approx(np.sqrt(np.mean(by_axis**2)))
    assert all(one["floor"] <= one["after"] for one in new.per_axis)


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "kept"), [(2, []), (1, [("viscous_friction", 1)])])
def test_effects_that_imitate_a_law_are_left_out(problem, axis, kept):
    """On the axis of the law, the named effect only imitates it; on another axis it is right."""
    at = next(k for k, t in enumerate(problem.terms) if t.key == ("viscous_friction", axis))
    wear = 0.3 * problem.raw[at].astype(float) * (axis == 1)
    case = replace(problem, residual=problem.residual + change_of(problem, LAWS["periodic"]) + wear)
    choice = choose(case)
    scales = choice.found.fitted.log_scales
    best = severities(case, choice.difference, [(at,)], scales)
    choice = replace(
        choice, groups=((at,),), odds=(9.0,), shares=(1.0,), best=best, rivals=(), unknown=()
    )
    told = answer(case, choice)
    # the answer itself leaves out an effect that foretells nothing; here it has not
    named = Named("viscous_friction", axis, 0.01, 0.01, (0.0, 0.03), {}, 0.99, told.after)
    told = replace(told, verdict="named", effects=told.effects or (named,))
    assert [(one.effect, one.axis) for one in told.effects] == [("viscous_friction", axis)]
    new, laws = with_laws(case, choice, told)
    assert [one.axis for one in laws] == [2]
    assert [(one.effect, one.axis) for one in new.effects] == kept
    assert new.verdict == ("partly named" if kept else "unknown effect")


def test_an_answer_without_a_law_stays(problem):
    choice = choose(problem)
    told = answer(problem, choice)
    new, laws = with_laws(problem, choice, told)
    assert new is told and laws == []


@pytest.mark.slow
def test_discover_writes_a_robot_with_the_law(measured, tiny_robot, tiny_robot_path, tmp_path):
    """From files to files; the folder simulates the law, and the report shows it."""
    recording = measured([], 5)
    robot = tiny_robot.with_effects([Applied(NAME, 2, 1.0, {"law": [LAWS["periodic"]]})])
    change = Replay(recording, robot).torque() - Replay(recording, tiny_robot).torque()
    follows = Replay(recording, robot, measured=False)
    noise = recording.torque - Replay(recording, tiny_robot, measured=False).torque()
    odd = replace(recording, position=follows.position(), torque=follows.torque() + noise)
    write_recording(odd, tmp_path / "odd.h5")
    write_recording(measured([], 1), tmp_path / "healthy.h5")
    result = faultgen.discover(
        tmp_path / "odd.h5", tiny_robot_path, tmp_path / "healthy.h5", out=tmp_path / "out"
    )
    assert result["verdict"] == "unknown effect"
    (one,) = result["effects"]
    assert (one["effect"], one["axis"]) == ("learned", 2)
    assert result["gap"]["after"] < 0.8 * result["gap"]["before"]
    found = load_robot(tmp_path / "out" / "model")
    assert [effect.effect for effect in found.effects] == [NAME]
    told = Replay(recording, found).torque() - Replay(recording, tiny_robot).torque()
    assert np.std(told - change) < 0.4 * np.std(change)
    assert "Learned laws" in (tmp_path / "out" / "report.html").read_text()


def test_other_motions_may_leave_the_range_of_a_law(problem):
    """Then a line says so, and the law keeps its last value."""
    (law,) = learn(problem, problem.residual + change_of(problem, LAWS["position"]))
    replay = problem.replay
    assert outside([law], replay) == []
    (term,) = law.terms
    narrow = replace(law, terms=({**term, "knots": [0.0, 0.1], "values": [0.0, 0.1]},))
    (line,) = outside([narrow], replay)
    assert "axis 2: the learned law holds for the joint angle of axis 2 from 0 to 0.1" in line
    torque = law_torque(narrow.terms, 2, course_of(problem))
    assert torque.max() == pytest.approx(0.1, rel=1e-3)


def course_of(problem):
    courses = Courses(problem.replay, problem.inside)
    return courses.courses[0]


def test_variables_are_those_of_the_motion(problem):
    """Derivatives, loads and memories agree with their definitions, on a plain sine."""
    times = np.arange(4000) * 1e-3
    motor = np.stack([50 * np.sin(2 * times), 20 * np.cos(3 * times)], axis=1)

    def loads(q, qd, qdd):
        return 2 * q, qdd

    course = Course(
        problem.robot, motor, 1e-3, (np.array([0.0, 4.0]), np.array([30.0, 50.0])), loads
    )
    inner = slice(50, -50)
    speed = 100 * np.cos(2 * times)
    np.testing.assert_allclose(course.variable("speed", 1, 1.0)[inner], speed[inner], atol=0.1)
    np.testing.assert_allclose(
        course.variable("acceleration", 1, 1.0)[inner], -200 * np.sin(2 * times)[inner], atol=1.0
    )
    ratio = problem.robot.gear_ratio
    load = course.variable("load", 2, 1.0)
    np.testing.assert_allclose(load, 2 * motor[:, 1] / ratio[1], atol=1e-3)
    np.testing.assert_allclose(course.variable("temperature", 1, 1.0)[[0, -1]], [30, 50], atol=0.01)
    turn = course.variable("motor_turn", 1, np.pi)
    assert 0 <= turn.min() and turn.max() < np.pi
    bristle = course.variable("hysteresis", 1, 5.0)
    assert bristle.min() == -1.0 and bristle.max() == 1.0
    small = np.abs(np.diff(bristle)) < 0.99 * np.abs(np.diff(motor[:, 0]) / 5.0)
    assert np.all(np.abs(bristle[1:][small]) == 1.0)  # it slips only at its reach
    rest = course.variable("since_rest", 1, 1.0)
    turned = int(np.argmin(np.abs(times - np.pi / 4)))
    assert rest[turned + 200] == pytest.approx(0.2, abs=0.02)
    for over in UNITS:
        assert np.isfinite(course.variable(over, 2, 0.5)).all(), over


def test_curves_repeat_and_formulas_are_curves():
    """The basis of a turn closes; a formula at its dense knots is the formula."""
    turn = Curve("motor_turn", 1, "", tuple(TURN), 2 * np.pi)
    x = np.linspace(0, 2 * np.pi, 200)
    np.testing.assert_allclose(turn.basis(x).sum(axis=0), 1.0)
    np.testing.assert_allclose(turn.basis(np.array([0.0])), turn.basis(np.array([2 * np.pi])))
    wave = next(formulas(turn))
    term = Part(turn, np.array([0.3, 0.4]), wave).term
    at = np.interp(x, term["knots"], term["values"])
    np.testing.assert_allclose(at, 0.3 * np.cos(x) + 0.4 * np.sin(x), atol=3e-3)
    speed = Curve("abs_speed", 1, "direction", (0.0, 10.0))
    for formula in formulas(speed):
        part = Part(speed, np.ones(len(formula.shapes)), formula)
        assert "|w|" in part.written(1) or part.written(1) == "1 sign(w)"
        assert len(part.term["knots"]) == len(part.term["values"])


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (3, "law must be a list of terms"),
        ([{"over": "speed"}], "term 1: must be an object with over, knots and values"),
        ([{"over": "mood", "knots": [0], "values": [1]}], "term 1: over 'mood'; choose speed"),
        ([{"over": "speed", "knots": [1, 0], "values": [1, 1]}], "knots must ascend"),
        ([{"over": "speed", "knots": [0, 1], "values": [1]}], "a value for each"),
        ([{"over": "speed", "knots": [0], "values": ["x"]}], "values must be a list of numbers"),
        ([{"over": "speed", "knots": [0], "values": [1], "of": 7}], "the robot has axes 1 to 2"),
        ([{"over": "speed", "knots": [0], "values": [1], "times": "joy"}], "times 'joy'; choose"),
        ([{"over": "speed", "knots": [0], "values": [1], "scale": 0}], "scale must be a positive"),
        ([{"over": "speed", "knots": [0], "values": [1], "mood": 0}], "unknown 'mood'"),
    ],
)
def test_what_is_no_law_is_refused(tiny_robot, law, message):
    with pytest.raises(InputError, match=message):
        check_law(law, 2)
    with pytest.raises(InputError, match=message):
        assemble(tiny_robot, [Applied(NAME, 1, 1.0, {"law": law})])
