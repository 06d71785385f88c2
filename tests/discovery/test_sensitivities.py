"""Candidates that a model cannot have."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import impossible, sensitivities
from faultgen.discovery.terms.candidates import effect_terms


@pytest.fixture(scope="module")
def recording(measured):
    """Motion of the small robot, which also becomes warm."""
    found = measured([], 1)
    return replace(found, temperature=np.linspace(30.0, 60.0, len(found.torque)))


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
