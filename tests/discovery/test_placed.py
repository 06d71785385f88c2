"""Effects with a place, phase or direction are named with it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from faultgen.discovery.decision.reaction import Reaction
from faultgen.discovery.discover import Discovery
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.terms.candidates import Term, names_by_use
from faultgen.effects import get_effect

HIDDEN = {
    "seizing_spot": (1, 2.0, {"angle": 0.3, "width": 0.25}),
    "tooth_damage": (2, 2e-3, {"phase": 1.0, "per": "motor"}),
    "winding_fault": (1, 0.3, {"phase": -2.0, "pole_pairs": 3}),
    "loose_tool": (2, 2e-3, {"direction": 2}),
}
"""Axis, severity and parameters of each effect."""


def with_effect(recording, robot, name):
    """A recording to which the simulated change by an effect is added, with the servo's answer."""
    axis, severity, parameters = HIDDEN[name]
    replay = Replay(recording, robot, measured=False)
    changes = [(Term(name, axis, 0.0, 0.0, tuple(parameters.items())), severity)]
    return replace(
        recording,
        torque=recording.torque + replay.torque(changes) - replay.torque(),
        position=recording.position + replay.position(changes) - replay.position(),
        source="worn",
    )


UNSEEN = pytest.mark.xfail(
    strict=True, reason="the servo answers its ripple; what is left is named as a torque constant"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(k, marks=UNSEEN) if k == "winding_fault" else k for k in HIDDEN]
)
def test_a_hidden_effect_is_named_with_its_place(name, tiny_robot, measured):
    axis, severity, parameters = HIDDEN[name]
    worn = with_effect(measured([], 0), tiny_robot, name)
    found = Discovery(tiny_robot, laws=False).fit(worn, measured([], 1))
    (named,) = found.answer_.effects
    assert (named.effect, named.axis) == (name, axis)
    assert named.severity == pytest.approx(severity, rel=0.15)
    for key, value in parameters.items():
        if isinstance(value, str):
            assert named.parameters[key] == value
        else:
            assert named.parameters[key] == pytest.approx(value, abs=0.15)
    assert found.answer_.after < 1.1 * found.answer_.floor


@pytest.mark.slow
def test_a_healthy_robot_has_no_promising_place(tiny_robot, measured):
    found = Discovery(tiny_robot, laws=False).fit(measured([], 2), measured([], 3))
    assert {t.name for t in found.problem_.terms}.isdisjoint(names_by_use("searched"))
    assert found.answer_.effects == ()


@pytest.mark.slow
def test_what_happens_once_has_no_place(tiny_robot, measured):
    """A bump of the torque that comes once is at some angle too, but is not an effect there."""
    worn = measured([], 0)
    time = worn.sample_period * np.arange(len(worn.torque))
    bump = 0.1 * np.exp(-(((time - time[-1] / 2) / 0.05) ** 2))
    torque = worn.torque + bump[:, np.newaxis] * [1.0, 0.0]
    found = Discovery(tiny_robot, laws=False).fit(replace(worn, torque=torque), measured([], 1))
    assert {t.name for t in found.problem_.terms}.isdisjoint(names_by_use("searched"))


@pytest.mark.slow
def test_excluded_effects_are_not_searched_for(tiny_robot, measured):
    worn = with_effect(measured([], 0), tiny_robot, "seizing_spot")
    found = Discovery(tiny_robot, exclude=["seizing_spot"], laws=False).fit(worn, measured([], 1))
    assert "seizing_spot" not in {term.name for term in found.problem_.terms}


def test_reaction_is_that_of_the_filter():
    """A filter that is known is found from two causes, in two separate recordings."""
    rng = np.random.default_rng(0)
    parts, period = [slice(0, 400), slice(400, 1000)], 0.01

    def filtered(x):
        return np.concatenate([lfilter([0.2, 0.1], [1.0, -0.6], x[part]) for part in parts])

    causes = np.cumsum(rng.standard_normal((2, 1000)), axis=1)
    reaction = Reaction(causes, [filtered(one) for one in causes], parts, period)
    new = np.sin(np.arange(1000) / 7)
    assert reaction.to(new) == pytest.approx(filtered(new), abs=2e-3)
    assert np.all(Reaction([0 * new], [new], parts, period).to(new) == 0)


@pytest.mark.parametrize("name", names_by_use("searched"))
def test_every_searched_effect_tells_its_cause(name):
    """Each search has a parameter of the effect, and knows its other ones."""
    effect = get_effect(name)
    for search in effect.prior.search:
        assert {search.parameter, *search.others} <= set(effect.parameters)
