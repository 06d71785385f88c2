"""The model with the found effects in it: on torques that are written down."""

from dataclasses import replace

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down

from faultgen.discovery import model_edit
from faultgen.discovery.candidates import FORM, INERTIA, Term
from faultgen.discovery.fit import fit
from faultgen.discovery.gap import unexplained
from faultgen.discovery.model_edit import build, build_stable
from faultgen.errors import SimulationFailed

FITTED = slice(0, PARTS[-1].start)
EFFECT = Term("torque_offset", 1, 0.1, 1e-3)
FRICTION = Term("viscous_friction", 1, 0.1, 0.05)


def residual_of(columns, values):
    return np.tensordot(values, columns.astype(np.float32).astype(float), axes=1)


@pytest.fixture
def columns():
    """Torques of two terms."""
    return np.random.default_rng(5).normal(size=(2, COUNT, 2))


def posed(columns, terms=(EFFECT, FRICTION), values=(0.5, 0.1), **more):
    return written_down(list(terms), columns, residual_of(columns, values), **more)


def changed(problem, torque):
    """The same problem with another simulation: a function of the value of each term."""

    def simulate(changes=(), disturbance=None):
        return torque({term.name: value for term, value in changes})

    return replace(
        problem, replay=type(problem.replay)(**{**vars(problem.replay), "torque": simulate})
    )


@pytest.mark.parametrize("twin", [True, False])
def test_a_model_has_the_effects_and_the_calibrated_numbers(columns, twin):
    """Two recordings of one robot have the same numbers, so that only the effects are put in."""
    problem = posed(columns, twin=twin)
    found = fit(problem, [(0,)])
    built = build(problem, found, np.array([0.0, 0.1 / FRICTION.prior_std]))
    names = {term.name: value for term, value in built.changes}
    expected = {"torque_offset": found.values[0]} | ({} if twin else {"viscous_friction": 0.1})
    assert names == pytest.approx(expected)
    left = problem.residual - residual_of(columns, [found.values[0], 0.0 if twin else 0.1])
    np.testing.assert_allclose(built.left, left, atol=1e-5)
    assert built.share == (0.0 if twin else 1.0)


@pytest.mark.parametrize(
    ("limit", "share"), [(1.0, 1.0), (0.6, 0.5), (0.3, 0.25), (0.12, 0.1), (0.01, 0.0)]
)
@pytest.mark.parametrize("how", ["diverges", "is worse"])
def test_calibrated_numbers_are_reduced_until_the_model_is_simulated(columns, limit, share, how):
    """To the largest share with which the simulation is no worse than with the effects alone."""
    problem = posed(columns)

    def torque(values):
        friction = values.get("viscous_friction", 0.0)
        if friction > 0.1 * limit * 1.001:
            if how == "diverges":
                raise SimulationFailed("it diverges")
            friction = 3.0
        return residual_of(columns, [values.get("torque_offset", 0.0), friction])

    solution = np.array([0.0, 0.1 / FRICTION.prior_std])
    built = build(changed(problem, torque), fit(problem, [(0,)]), solution)
    assert built.share == share
    assert [term.name for term, _ in built.changes] == ["torque_offset", "viscous_friction"][
        : 1 + (share > 0)
    ]
    left = residual_of(columns, [0.0, 0.1 * (1 - share)])
    np.testing.assert_allclose(built.left, left, atol=1e-3)


@pytest.mark.parametrize(
    ("term", "value", "is_allowed"),
    [
        (FRICTION, 0.1, True),
        (FRICTION, -0.899, True),
        (FRICTION, -0.901, False),  # less than the smallest severity
        (FRICTION, 9.99, True),
        (FRICTION, 10.01, False),
        (Term("backlash", 1, 1e-4, 1e-4), 1e-3, True),
        (Term("backlash", 1, 1e-4, 1e-4), -1e-3, False),
        (Term("torque_ripple", 1, 0.1, 0.1), 0.3, False),  # periodic
        (Term("load_friction", 1, 0.1, 0.1), 0.3, False),  # acts between steps
        (Term(INERTIA, 1, 0.1, 0.1), -3.0, True),
        (Term(FORM, 1, 0.1, 0.1), 0.3, False),
        (FRICTION, 4e-5, False),  # less than a thousandth of its standard deviation
    ],
)
def test_what_calibration_may_change(columns, term, value, is_allowed):
    """Numbers that every model has, within the bounds of their effect."""
    problem = posed(columns, (EFFECT, term), (0.5, value))
    built = build(problem, fit(problem, [(0,)]), np.array([0.0, value / term.prior_std]))
    assert [one for one, _ in built.changes] == [EFFECT, term][: 1 + is_allowed]


def test_what_differs_between_any_two_runs_is_no_part_of_the_gap(columns):
    """It is taken off the residual, although no model contains it."""
    problem = posed(columns, twin=True)
    found = fit(problem, [(0,)])
    solution = np.array([0.0, 0.1 / FRICTION.prior_std])
    assert build(problem, found, solution).left.std() > 0.09
    widened = replace(problem, run_to_run=np.zeros((COUNT, 2)))
    built = build(widened, found, solution)
    assert [term for term, _ in built.changes] == [EFFECT]
    np.testing.assert_allclose(built.left, 0.0, atol=1e-3)


@pytest.mark.parametrize("refused", [0, 2, 4, 5])
def test_the_written_model_replays_the_recording(columns, monkeypatch, refused):
    """It has as much of what was found as it can have, and says what it lacks."""
    problem = posed(columns)
    asked = []

    def replaying(recording, robot, changes, *, measured=None):
        asked.append((recording, robot, measured))
        return None if len(asked) <= refused else "the robot"

    monkeypatch.setattr(model_edit, "replaying", replaying)
    found = fit(problem, [(0,)])
    built, robot, lacks = build_stable(problem, found, unexplained(problem, found)[1])
    assert all(one == (problem.recording, problem.robot, True) for one in asked)
    shares = [1.0, 0.5, 0.25, 0.1, 0.0]
    assert built.share == (shares[refused] if refused < 5 else 0.0)
    assert robot == ("the robot" if refused < 5 else problem.robot)
    told = {
        0: [],
        2: ["model.xml has 25% of the calibrated values"],
        4: ["model.xml has none of the calibrated values"],
        5: ["model.xml is the model as it was given"],
    }[refused]
    assert [line.split(":")[0] for line in lacks] == told


def test_nothing_lacks_where_nothing_was_calibrated(columns, monkeypatch):
    """The model with the effects alone is then the whole one."""
    monkeypatch.setattr(model_edit, "replaying", lambda *given, **more: "the robot")
    problem = posed(columns, values=(0.5, 0.0))
    built, robot, lacks = build_stable(problem, fit(problem, [(0,)]), np.zeros(2))
    assert (built.share, robot, lacks) == (0.0, "the robot", [])
