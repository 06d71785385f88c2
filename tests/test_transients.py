"""Samples that depend on friction at rest are found by a simulation."""

import numpy as np
import pytest

from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.replay.transients import unsettled
from faultgen.discovery.terms.candidates import effect_terms


@pytest.fixture(scope="module")
def found(measured, tiny_robot):
    replay = Replay(measured([], 1), tiny_robot)
    terms = [term for term in effect_terms(tiny_robot) if term.name == "coulomb_friction"]
    base, raw = sensitivities(replay, terms)
    return replay, terms, base, raw, unsettled(replay, terms, base, raw)


def test_they_are_few_and_hold_what_is_not_in_proportion(found, tiny_robot):
    replay, terms, base, raw, mask = found
    inside = counted(replay.recording, tiny_robot, baseline=False)
    assert mask.shape == base.shape
    assert (mask & inside).sum(axis=0).max() < 0.4 * inside.sum(axis=0).min()
    change = replay.torque([(term, 0.3) for term in terms]) - base
    bend = np.abs(change - 0.3 * raw.sum(axis=0)) * inside
    size = np.sqrt(np.mean(change[inside] ** 2))
    assert (bend * ~mask).max() <= max(0.1 * size, np.quantile(bend[inside], 0.8) + 1e-12)


def test_without_friction_among_the_terms_nothing_is_left_out(found):
    replay, terms, base, raw, _ = found
    assert not unsettled(replay, [], base, raw[:0]).any()
    only = unsettled(replay, terms[:1], base, raw[:1])
    assert not only[:, 1].any()


def test_left_out_samples_belong_to_the_replay(found):
    replay, _, _, _, mask = found
    assert replay.left_out is None
    assert replay.without(mask).left_out is mask
