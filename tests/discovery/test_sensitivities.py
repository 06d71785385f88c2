"""Sensitivities of several axes from one simulation."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery.replay import sensitivities as module
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.replay import replay as replayed
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.replay.sensitivities import (
    are_alone,
    impossible,
    own_sensitivities,
    sensitivities,
)
from faultgen.discovery.terms.candidates import ORDERS, effect_terms, periodic_terms
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.errors import InputError, SimulationFailed


@pytest.fixture(scope="module")
def recording(measured):
    """Motion of the small robot, which also becomes warm."""
    found = measured([], 1)
    return replace(found, temperature=np.linspace(30.0, 60.0, len(found.torque)))


def shared(replay):
    """Terms that share simulations."""
    terms = effect_terms(replay.robot)
    return [term for term, alone in zip(terms, are_alone(replay, terms), strict=True) if alone]


def test_which_terms_share_a_simulation(recording, tiny_robot):
    """What acts on rotors that follow measured positions; ripple in any case."""
    ripple = list(periodic_terms(tiny_robot, "torque_ripple", 1, ORDERS[0]))
    error = list(periodic_terms(tiny_robot, "transmission_error", 1, ORDERS[0]))
    others = inertia_terms(tiny_robot) + error
    commanded, measured = (Replay(recording, tiny_robot, measured=how) for how in (False, True))
    assert are_alone(measured, ripple + others) == [True] * 2 + [False] * len(others)
    assert are_alone(commanded, ripple + others) == [True] * 2 + [False] * len(others)
    assert shared(commanded) == []
    names = {term.name for term in shared(measured)}
    assert {"coulomb_friction", "rotor_inertia", "temperature_friction"} <= names
    assert not names & {"gear_stiffness", "gravity_spring", "wrist_coupling_friction", "backlash"}


def test_they_agree_with_simulations_of_their_own(recording, tiny_robot):
    """On their own axis; and what is left out on the other one is small beside it.

    The stick and slip of slow motion is not compared, as in discovery.
    """
    replay = Replay(recording, tiny_robot, measured=True)
    # small, as a formula is the slope at 0; what follows the temperature is composed of others
    terms = [replace(term, step=0.1 * term.step) for term in shared(replay)]
    terms = [term for term in terms if term.name != "temperature_friction"]
    base = replay.torque()
    each = [(replay.torque([(term, term.step)]) - base) / term.step for term in terms]
    together = own_sensitivities(replay, terms, base)
    inside = counted(recording, tiny_robot, baseline=False)
    for term, alone, own in zip(terms, each, together, strict=True):
        axis, other = term.axis - 1, 2 - term.axis
        size = np.sqrt(np.mean(alone[inside[:, axis], axis] ** 2))
        assert size > 0, term
        assert not own[:, other].any()
        apart = np.sqrt(np.mean((own - alone)[inside[:, axis], axis] ** 2))
        left_out = np.sqrt(np.mean(alone[inside[:, other], other] ** 2))
        assert apart < 0.03 * size, (term, apart / size)
        assert left_out < 0.1 * size, (term, left_out / size)


def test_an_axis_that_diverges_does_not_spoil_the_others(recording, tiny_robot, monkeypatch):
    """Each axis is then simulated for itself."""
    replay = Replay(recording, tiny_robot, measured=False)
    terms = [periodic_terms(tiny_robot, "torque_ripple", axis, ORDERS[0])[0] for axis in (1, 2)]
    base = replay.torque()
    whole = own_sensitivities(replay, terms, base)
    simulate = Replay.torque

    def torque(self, changes=(), disturbance=None):
        if any(term.axis == 2 for term, _ in changes):
            raise SimulationFailed("it diverges")
        return simulate(self, changes, disturbance)

    monkeypatch.setattr(module.Replay, "torque", torque)
    found = own_sensitivities(replay, terms, base)
    assert np.abs(found[0]).max() > 0 and not found[1].any()
    np.testing.assert_allclose(found[0], whole[0], atol=0.03 * np.abs(whole[0]).max())


def test_a_candidate_that_the_model_cannot_have_drops_out(recording, tiny_robot):
    """Calibration may make a payload lighter than 1 g: then nothing is loose on the flange."""
    terms = [t for t in effect_terms(tiny_robot) if t.name in ("loose_tool", "payload_offset")]
    assert {term.name for term in terms} == {"loose_tool", "payload_offset"}
    spec = tiny_robot.spec()
    spec.body("payload").mass = 5e-4
    replay = Replay(recording, tiny_robot).on(tiny_robot.edited(spec))
    loose = [term for term in terms if term.name == "loose_tool"]
    _, columns = sensitivities(replay, loose)
    assert not columns.any()
    (note,) = impossible(replay, loose, columns)
    assert note == (
        "loose_tool of axis 2 is no candidate: loose_tool: the payload has no mass that could be "
        "loose"
    )
    assert impossible(Replay(recording, tiny_robot), loose, columns) == []


def test_what_the_user_asks_for_and_cannot_be_is_wrong_input(recording, tiny_robot):
    """Only candidates drop out; an effect that a user names does not."""
    with pytest.raises(InputError, match="unknown"):
        replayed(recording, tiny_robot, [("lose_tool", 2, 0.01)])
