"""A model near to a recording, and terms that keep their meaning about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery.decision.near import moved_by, near_model
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.signatures import signatures
from faultgen.discovery.terms.candidates import INERTIA, Term
from faultgen.discovery.terms.inertia import Moved, inertia_terms
from faultgen.errors import SimulationFailed


@pytest.fixture(scope="module")
def recording(measured):
    return measured([], 1)


@pytest.fixture(scope="module")
def replay(recording, tiny_robot):
    return Replay(recording, tiny_robot)


def values_of(moved):
    """The moved numbers as changes of a model."""
    return [
        (Term(name, axis, 0.0, 0.0, more), value) for (name, axis, more), value in moved.items()
    ]


MOVED = {
    (INERTIA, 1, (("component", 3.0),)): 0.06,
    (INERTIA, 2, (("component", 0.0),)): -0.05,
    (INERTIA, 2, (("component", 4.0),)): 0.04,
    (INERTIA, 2, (("component", 7.0),)): 0.01,
}
"""Links of which two moments of inertia, or all three, are equal: their main axes turn at once."""


def test_a_moved_model_is_that_with_the_changes(replay):
    """With links and stiffness changed; whatever is changed more counts from the given model."""
    moved = {**MOVED, (STIFFNESS, 2, ()): 0.1}
    own = moved_by(replay, moved)
    # a model that is written has some seven digits
    np.testing.assert_allclose(own.torque(), replay.torque(values_of(moved)), atol=1e-6)
    assert moved_by(replay, {}) is replay
    assert own.recording is replay.recording and own.robot is not replay.robot


@pytest.mark.parametrize(
    ("link", "component"),
    [(1, 0), (1, 3), (1, 7), (2, 0), (2, 3), (2, 4), (2, 5), (2, 7)],
)
def test_columns_at_a_moved_model_are_those_of_the_given_one(replay, tiny_robot, link, component):
    """Finite differences of the given model, about the moved values.

    Before, those of the moved link counted, whose main axes are others.
    """
    which = (("component", float(component)),)
    (term,) = [
        one
        for one in inertia_terms(tiny_robot)
        if one.key == (INERTIA, link) and one.parameters == which
    ]
    told = Formulas(moved_by(replay, MOVED)).columns([term])[term]
    size = 5e-3

    def torque(side):
        more = dict(MOVED)
        more[INERTIA, link, which] = more.get((INERTIA, link, which), 0.0) + side * size
        return replay.torque(values_of(more))

    change = (torque(1) - torque(-1)) / (2 * size)
    error = np.sqrt(np.mean((told - change) ** 2))
    assert error < 0.03 * np.sqrt(np.mean(change**2))


def test_links_and_stiffness_of_a_changed_robot_are_found(measured, tiny_robot, recording):
    """10 % more mass of link 2, whose centre stays; the torque of the near model is the robot's."""
    spec = tiny_robot.spec()
    link = spec.joint("joint2").parent
    link.mass *= 1.1
    link.inertia = np.asarray(link.inertia) * 1.1
    spec.compile()
    heavy = tiny_robot.edited(spec)
    clean = Replay(recording, heavy).torque()
    noise = np.random.default_rng(3).standard_normal(clean.shape)
    torque = clean + 0.003 * np.abs(clean).mean(axis=0) * noise
    replay = Replay(replace(recording, torque=torque), tiny_robot)
    moved = near_model(replay, np.ones(len(torque), bool))
    assert {name for name, *_ in moved} <= {INERTIA, STIFFNESS}
    assert all(abs(value) <= 0.3 for value in moved.values())
    before, after = replay.torque() - clean, moved_by(replay, moved).torque() - clean
    assert np.sqrt(np.mean(after**2)) < np.sqrt(np.mean(before**2)) / 3


def test_a_model_that_diverges_is_not_moved(replay, monkeypatch):
    def diverges(self, *changes):
        raise SimulationFailed("it diverges")

    monkeypatch.setattr(type(replay), "torque", diverges)
    assert near_model(replay, np.ones(len(replay.recording.torque), bool)) == {}


@pytest.mark.slow
def test_signatures_tell_by_how_much_the_model_was_moved(recording, tiny_robot):
    """With a baseline the model is fitted to it, so that a change of the robot stays visible."""
    own = signatures(recording, tiny_robot, exclude=["torque_ripple", "transmission_error"])
    assert own.moved and own.replay is not own.given
    np.testing.assert_allclose(own.base, moved_by(own.given, own.moved).torque(), atol=1e-9)
    np.testing.assert_allclose(own.given_torque, own.given.torque(), atol=1e-9)
    assert len(own.raw) == len(own.terms) + len(own.scanned)
    healthy = replace(recording, reference_position=None)  # compared at measured positions
    other = replace(healthy, torque=1.1 * recording.torque)
    found = signatures(
        other, tiny_robot, baseline=healthy, exclude=["torque_ripple", "transmission_error"]
    )
    before = near_model(Replay(healthy, tiny_robot), np.ones(len(recording.torque), bool))
    assert found.moved == before


def test_what_moved_says_is_about_the_given_robot(tiny_robot):
    one = Moved(tiny_robot, values_of(MOVED))
    assert one.given is tiny_robot and len(one.changes) == len(MOVED)
