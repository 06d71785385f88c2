"""Assumed drives against arms whose drives are known, and the numbers that follow from others."""

import json
from pathlib import Path

import numpy as np
import pytest
from real_robots.known_drives import LAWS, class_ratios, fit, ratios, told, typical

from faultgen.building.alike import NUMBERS, find_like, payload_class, read_arms
from faultgen.building.drive_numbers import drive_of
from faultgen.building.seen import Seen
from faultgen.building.usual import HOLD, usual_torque
from faultgen.errors import InputError

ARMS = {arm["name"]: arm for arm in read_arms()}
SAVED = Path(__file__).parents[2] / "benchmarks" / "results" / "known_drives.json"


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_laws_are_those_of_the_known_arms(law):
    """The numbers of the package are the fitted ones, rounded to two digits."""
    found, now = fit(law, list(ARMS.values())), law.now()
    assert np.exp(now[0]) == pytest.approx(np.exp(found[0]), rel=0.03)
    np.testing.assert_allclose(now[1:], found[1:], atol=0.01)


LEFT_OUT = {  # typical and largest factor on arms to which the laws were not fitted
    "torque limit": (1.7, 3.7),  # before, without a fit: 4.2 and 42
    "motor speed": (1.6, 2.5),
    "rotor inertia": (2.5, 5.5),
    "Coulomb friction": (1.6, 4.0),
    "viscous friction": (2.3, 6.6),
    "gearbox stiffness": (1.7, 2.0),
}


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_assumed_drives_fit_to_arms_that_were_left_out(law):
    arms = list(ARMS.values())
    errors = [ratios(law, arm, fit(law, [one for one in arms if one is not arm])) for arm in arms]
    assert sum(np.isfinite(one).any() for one in errors) >= (3 if "stiff" in law.name else 8)
    most_typical, most = LEFT_OUT[law.name]
    assert typical(errors) < most_typical
    assert np.nanmax(np.abs(np.log(np.concatenate(errors)))) < np.log(most)


def test_the_saved_table_is_that_of_the_present_laws():
    saved = json.loads(SAVED.read_text())
    assert {name: saved[name] for name in ("laws", "classes")} == told()


def test_every_number_of_a_known_arm_has_a_source_and_an_axis():
    for arm in ARMS.values():
        assert arm["sources"] and arm["links"]
        sizes = {len(value) for value in arm.values() if isinstance(value, np.ndarray)}
        assert len(sizes) == 1, arm["name"]


def seen_by(arm, axis, **changes):
    """What the drive of an axis of a known arm sees, from 0."""
    stated = {"speed_limit": arm["speed_limit"][axis]}
    numbers = {
        "slide": False,
        "most": arm["arm_inertia"][axis],
        "least": arm["arm_inertia"][axis] / 2,
        "gravity": arm["gravity"][axis],
        "weight": arm["weight_torque"][axis],
        "arm_weight": arm["weight_torque"].max(),
        "stated": stated,
    }
    return Seen(**{**numbers, **changes})


@pytest.mark.parametrize("name", ["PUMA 560", "IRB 6700, the model here"])
def test_a_build_assumes_what_the_supplied_robots_have(name):
    """Torque limits within a factor of 1.8, which were 0.03 to 5 times the known; friction 3.2."""
    arm = ARMS[name]
    for axis in range(6):
        values = drive_of({}, seen_by(arm, axis))
        assert values["torque_limit"].source == "assumed"
        off = values["torque_limit"].value / arm["torque_limit"][axis]
        assert 1 / 1.8 < off < 1.8, axis
        friction = values["coulomb_friction"].value * values["gear_ratio"].value
        assert 1 / 3.2 < friction / arm["coulomb"][axis] < 3.2, axis


def test_a_stated_torque_limit_leads_to_the_friction_and_rotor_of_such_drives():
    """5.6 % of the limit, 2.5 times that at full speed, and a run-up in 24 ms at 100 N m."""
    seen = Seen(False, 5.0, 2.0, 60.0, 60.0, 60.0, {"torque_limit": 100.0, "speed_limit": 2.0})
    values = {name: one.value for name, one in drive_of({}, seen).items()}
    n = values["gear_ratio"]
    assert n * 2.0 == pytest.approx(280, rel=1e-3)
    assert values["coulomb_friction"] * n == pytest.approx(5.6, rel=1e-3)
    assert values["viscous_friction"] * n**2 * 2.0 == pytest.approx(2.5 * 5.6, rel=1e-3)
    acceleration = 100.0 / (values["rotor_inertia"] * n**2)
    assert 2.0 / acceleration == pytest.approx(0.024, rel=1e-3)


def test_a_usual_torque_holds_the_arm():
    assert usual_torque(9000.0, 9000.0, 9000.0) == HOLD * 9000.0
    assert usual_torque(100.0, 100.0, 50.0) > HOLD * 50.0
    assert usual_torque(0.0, 100.0) > 0


@pytest.mark.parametrize(("most", "least"), [(50.0, 0.2), (2.0, 1.5), (1.0, 1.0)])
def test_gearboxes_are_damped_with_the_rotor_locked_and_free(most, least):
    """0.05 with the largest inertia, at most 0.1 with the smallest and a free rotor."""
    seen = Seen(False, most, least, 10.0, 40.0, 60.0, {"torque_limit": 100.0, "speed_limit": 2.0})
    values = {name: one.value for name, one in drive_of({"gear_stiffness": 4e4}, seen).items()}
    reflected = values["rotor_inertia"] * values["gear_ratio"] ** 2
    free = 1 / (1 / least + 1 / reflected)
    locked_ratio, free_ratio = (
        values["gear_damping"] / (2 * np.sqrt(4e4 * inertia)) for inertia in (most, free)
    )
    assert locked_ratio <= 0.05 * 1.001 and free_ratio <= 0.10 * 1.001
    assert max(locked_ratio / 0.05, free_ratio / 0.10) == pytest.approx(1.0, rel=1e-3)


SIX, SEVEN = [f"j{k}" for k in range(6)], [f"j{k}" for k in range(7)]


def test_a_part_of_the_name_finds_a_known_arm():
    like = find_like("ur10e", SIX)
    assert like.name == "Universal Robots UR10e"
    assert like.axes[1]["coulomb"] == 13.27 and "reflected_inertia" not in like.axes[0]
    assert "Mamedov" in like.source["coulomb"]


@pytest.mark.parametrize(
    ("text", "joints", "match"),
    [
        ("ur10e", SEVEN, "has 6 axes, but the arm has 7; give one with 7 axes: Kinova Gen3"),
        ("universal", SIX, "fits to several arms"),
        ("nonsense", SIX, "is no known arm and no payload"),
        ("900 kg", SIX, "must be 0.5 to 500 kg"),
        ("5 kg", ["j"], "too few arms with 1 axes"),
        ("", SIX, "no known arm"),
    ],
)
def test_what_is_like_nothing_is_refused(text, joints, match):
    with pytest.raises(InputError, match=match):
        find_like(text, joints)


def test_a_class_is_the_power_law_on_which_arms_lie():
    """Arms that follow 3 m^0.7 on one axis and 5 m^0.7 on the other give it back."""
    arms = [
        {
            "name": f"{m}",
            "payload": m,
            **{key: np.array([3.0, 5.0]) * m**0.7 for key in NUMBERS},
            "stiffness": np.full(2, np.nan),
        }
        for m in (1.0, 10.0, 40.0)
    ]
    like = payload_class(4.0, 2, arms)
    assert like.axes[0]["torque_limit"] == pytest.approx(3 * 4**0.7)
    assert like.axes[1]["coulomb"] == pytest.approx(5 * 4**0.7)
    assert "stiffness" not in like.axes[0]
    assert "extrapolation" not in like.remark
    assert "extrapolation" in payload_class(80.0, 2, arms).remark


def test_known_numbers_replace_assumed_ones_but_no_stated_ones():
    """Joint-side numbers reach the motor through the gear ratio that is used."""
    like = find_like("manutec", SIX)
    seen = seen_by(ARMS["Manutec r3"], 0)
    values = drive_of({"gear_ratio": -50.0}, seen, like, 0)
    assert values["gear_ratio"].source == "given"
    assert values["speed_limit"].source == "model"
    assert values["torque_limit"].value == 945.0 and values["torque_limit"].source == "like"
    assert values["rotor_inertia"].value == pytest.approx(14.33 / 50**2, rel=1e-3)
    assert values["coulomb_friction"].value == pytest.approx(42 / 50, rel=1e-3)
    assert values["viscous_friction"].value == pytest.approx(8.958 / 50**2, rel=1e-3)
    assert values["gear_stiffness"].value == 474100.0
    assert values["encoder_counts"].source == "assumed"
    other = drive_of({}, seen_by(ARMS["Manutec r3"], 0, slide=True), like, 0)
    assert "like" not in {one.source for one in other.values()}


def test_classes_of_payloads_fit_to_arms_that_were_left_out():
    """Typical factors; docs/robots.md says that they are rougher than what masses tell."""
    six = [arm for arm in ARMS.values() if len(arm["torque_limit"]) == 6]
    found = [class_ratios(arm, [one for one in six if one is not arm]) for arm in six]
    for key, most in (("torque_limit", 2.25), ("speed_limit", 1.8), ("coulomb", 2.9)):
        assert typical([one[key] for one in found]) < most, key
