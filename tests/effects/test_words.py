"""What a severity means in words and in the units in which people speak of a robot."""

import numpy as np
import pytest

from faultgen.effects import EFFECTS
from faultgen.effects.words import THAN_BEFORE, amount, in_words
from faultgen.robot import COULOMB


def test_fractions_are_told_in_per_cent_and_in_units_of_the_joint(tiny_robot):
    said = in_words(tiny_robot, "coulomb_friction", 2, 0.197, (0.193, 0.203))
    expected = "axis 2 has 20 % more Coulomb friction than its model (19.3 to 20.3 %)"
    assert said.sentence == expected
    friction = tiny_robot.ids("actuator", "friction")[1]
    newton = tiny_robot.model.actuator_biasprm[friction, COULOMB] * abs(tiny_robot.gear_ratio[1])
    (one,) = said.also
    assert one.unit == "N m at the joint"
    assert one.value == pytest.approx(0.197 * newton)
    assert one.interval == pytest.approx((0.193 * newton, 0.203 * newton))


@pytest.mark.parametrize(
    ("effect", "severity", "value", "unit"),
    [
        ("backlash", 1e-3, 60 * np.degrees(1e-3), "arc minutes"),
        ("delay", 2e-3, 2.0, "ms"),
        ("load_friction", 0.03, 3.0, "% of the torque of the gearbox"),
        ("payload_offset", 0.02, 20.0, "mm"),
    ],
)
def test_severities_in_units_that_people_know(tiny_robot, effect, severity, value, unit):
    (one,) = in_words(tiny_robot, effect, 2, severity, (0.0, 2 * severity)).also
    assert (one.value, one.unit) == (pytest.approx(value), unit)
    assert one.interval == pytest.approx((0.0, 2 * value))


def test_what_is_lost_and_what_is_less(tiny_robot):
    lost = in_words(tiny_robot, "gear_stiffness", 1, 0.12, (0.1, 0.14))
    assert lost.sentence.startswith("axis 1 has 12 % less stiffness of the gearbox")
    less = in_words(tiny_robot, "rotor_inertia", 1, -0.05, (-0.06, -0.04))
    assert less.sentence == "axis 1 has 5 % less rotor inertia than its model (4 to 6 %)"
    motor = in_words(tiny_robot, "torque_constant", 1, 0.05, (0.04, 0.06))
    end = "5 % less torque of the motor than its drive believes (4 to 6 %)"
    assert motor.sentence == f"axis 1 has {end}"


def test_fractions_may_be_compared_with_a_healthy_recording(tiny_robot):
    said = in_words(tiny_robot, "friction_wear", 2, 0.2, (0.197, 0.203), than=THAN_BEFORE)
    expected = "axis 2 has 20 % more friction than in the healthy recording (19.7 to 20.3 %)"
    assert said.sentence == expected


@pytest.mark.parametrize(
    ("effect", "severity", "expected"),
    [
        ("friction_wear", 0.2, "20 % more friction"),
        ("gear_stiffness", 0.3, "30 % less stiffness of the gearbox"),
        ("backlash", 1e-3, "play of the gearbox of 3.44 arc minutes"),
        ("delay", 2e-3, "a delay of 2 ms"),
    ],
)
def test_an_amount_is_a_noun_with_its_unit(tiny_robot, effect, severity, expected):
    assert amount(tiny_robot, effect, 2, severity) == expected


def test_every_effect_has_words(tiny_robot):
    """A sentence with the name of no variable."""
    for name, effect in EFFECTS.items():
        if name == "learned_law":
            continue
        axis = effect.axes_on(tiny_robot)[-1]
        said = in_words(tiny_robot, name, axis, effect.step, (0.0, 2 * effect.step))
        assert said.sentence.startswith(f"axis {axis} has ") and "_" not in said.sentence
        for one in said.also:
            assert np.isfinite([one.value, *one.interval]).all() and one.unit
