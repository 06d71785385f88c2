"""Discovery on sealed cases: other functional forms, robots that are off, an own integrator."""

import numpy as np
import pytest
from sealed.cases import make_recordings
from sealed.effects import Effect
from sealed.plan import Case

from faultgen.discovery import Discovery
from faultgen.robot import load_robot

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Discovery of a sealed PUMA with a twin; cases share their sensitivities."""
    cache = tmp_path_factory.mktemp("sensitivities")
    robot = load_robot("puma560")

    def run(seed, *effects, exclude=()):
        case = Case("x", "twin", "puma560", "single", 0.01, seed, effects, (5.0,) * len(effects))
        measured, healthy = make_recordings(case)
        return (
            Discovery(robot, exclude=exclude, laws=False, workers=2, cache=cache)
            .fit(measured, healthy)
            .answer_
        )

    return run


def test_a_clean_robot(found):
    answer = found(1)
    assert (answer.verdict, answer.effects) == ("no missing effect", ())
    assert answer.before == pytest.approx(answer.floor, rel=0.1)


@pytest.mark.xfail(
    strict=True,
    reason="the loss of stiffness is expected, and a hardening of the same gearbox is named",
)
def test_a_single_effect(found):
    """A gearbox that lost a fifth of its stiffness.

    On the motions that are not used it adds 3 % to the noise, too little to see the gap close.
    """
    answer = found(2, Effect("gear_stiffness", 2, 0.2))
    (one,) = answer.effects
    assert (answer.verdict, one.effect, one.axis) == ("named", "gear_stiffness", 2)
    # the loss falls with the twist here, so that on the whole it is less than 0.2
    assert 0.1 < one.severity < 0.2
    assert answer.after < 1.1 * answer.floor


def test_two_effects(found):
    """Viscous friction, which here is a power of speed, and an offset, which drifts.

    The gap closes on motions that are not used. Effects of a third of this size are not sure.
    """
    effects = Effect("viscous_friction", 3, 0.2), Effect("torque_offset", 1, 0.03)
    answer = found(3, *effects)
    keys = {(one.effect, one.axis): one for one in answer.effects}
    assert set(keys) == {("viscous_friction", 3), ("torque_offset", 1)}
    assert keys["viscous_friction", 3].severity == pytest.approx(0.2, rel=0.2)
    assert keys["torque_offset", 1].severity == pytest.approx(0.03, rel=0.2)
    assert answer.before - answer.floor > 2 * (answer.after - answer.floor)


BESIDE_A_SMALL_SPOT = pytest.param(
    0.2,
    marks=pytest.mark.xfail(
        strict=True,
        reason="friction at a spot of axis 2 is expected, and a stiffer gearbox of axis 5 is named",
    ),
)


@pytest.mark.parametrize("severity", [0.5, BESIDE_A_SMALL_SPOT])
def test_an_effect_that_is_not_considered(found, severity):
    """Friction over a small range of angle, whose place discovery would have to search."""
    answer = found(4, Effect("seizing_spot", 2, severity), exclude=["seizing_spot"])
    assert answer.verdict == "unknown effect" and not answer.effects
    axis, along = answer.left[0]
    assert axis == 2 and along.startswith("joint angle")


@pytest.mark.parametrize("severity", [0.5, BESIDE_A_SMALL_SPOT])
def test_an_effect_at_one_place(found, severity):
    answer = found(4, Effect("seizing_spot", 2, severity))
    assert [(one.effect, one.axis) for one in answer.effects] == [("seizing_spot", 2)]


def test_severity_and_sign_follow_the_data(found):
    """Twice the effect the other way round gives twice the answer with the other sign."""
    one, two = (found(5, Effect("torque_offset", 3, s)).effects[0] for s in (0.01, -0.02))
    assert (one.effect, two.effect) == ("torque_offset", "torque_offset")
    assert two.severity == pytest.approx(-2 * one.severity, rel=0.1)
    assert np.sign(one.severity) == 1
