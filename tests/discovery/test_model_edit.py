"""The model with the found effects in it: on torques that are written down."""

from dataclasses import replace

import numpy as np
import pytest
from linear import COUNT, PARTS, least_squares, written_down

from faultgen.discovery.calibration import model_edit
from faultgen.discovery.calibration.model_edit import build, build_stable
from faultgen.discovery.terms.candidates import Term
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

    replay = type(problem.replay)(**{**vars(problem.replay), "torque": simulate})
    return replace(problem, replay=replay, given=replay)


@pytest.mark.parametrize("baseline", [True, False])
def test_a_model_has_the_effects_and_the_calibrated_numbers(columns, baseline):
    """Numbers of two recordings of one robot are not put in, and are no part of the gap."""
    problem = posed(columns, baseline=baseline)
    found = least_squares(problem, [(0,)])
    built = build(problem, found, np.array([0.0, 0.1 / FRICTION.prior_std]))
    names = {term.name: value for term, value in built.changes}
    expected = {"torque_offset": found.values[0]} | ({} if baseline else {"viscous_friction": 0.1})
    assert names == pytest.approx(expected)
    left = problem.residual - residual_of(columns, [found.values[0], 0.1])
    np.testing.assert_allclose(built.left, left, atol=1e-5)
    assert built.share == (0.0 if baseline else 1.0)


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
    built = build(changed(problem, torque), least_squares(problem, [(0,)]), solution)
    assert built.share == share
    assert [term.name for term, _ in built.changes] == ["torque_offset", "viscous_friction"][
        : 1 + (share > 0)
    ]
    left = residual_of(columns, [0.0, 0.1 * (1 - share)])
    np.testing.assert_allclose(built.left, left, atol=1e-3)


def test_numbers_too_small_to_be_seen_are_left_out(columns):
    """Less than a thousandth of the standard deviation."""
    problem = posed(columns)
    built = build(problem, least_squares(problem, [(0,)]), np.array([0.0, 9e-4]))
    assert [term for term, _ in built.changes] == [EFFECT]


@pytest.mark.parametrize("refused", [0, 2, 4, 5])
def test_the_written_model_replays_the_recording(columns, monkeypatch, refused):
    """It has as much of what was found as it can have, and says what it lacks."""
    problem = posed(columns)
    asked = []

    def replaying(given, changes):
        asked.append(given)
        return None if len(asked) <= refused else "the robot"

    monkeypatch.setattr(model_edit, "replaying", replaying)
    found = least_squares(problem, [(0,)])
    built, robot, lacks = build_stable(problem, found, np.array([0.0, 0.1 / FRICTION.prior_std]))
    assert all(one is problem.given for one in asked)
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
    built, robot, lacks = build_stable(problem, least_squares(problem, [(0,)]), np.zeros(2))
    assert (built.share, robot, lacks) == (0.0, "the robot", [])
