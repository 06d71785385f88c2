"""Signatures by formula against simulations of rotors on the same motion."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from recorded import logged

from faultgen.discovery.laws.friction_discrepancy import (
    discrepancy_sensitivities,
    discrepancy_terms,
)
from faultgen.discovery.replay.bristles import FRICTION
from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.terms.candidates import INERTIA, Term, effect_terms, periodic_terms
from faultgen.discovery.terms.inertia import inertia_terms, slopes_of
from faultgen.discovery.terms.regressor import link_regressor
from faultgen.effects import get_effect
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm

SECONDS = 3.0
SIMULATES = import_module("faultgen.discovery.replay.replay")


@pytest.fixture(scope="module", params=["puma560", "irb6700"])
def replay(request) -> Replay:
    """A healthy robot on its own motion, at 500 Hz."""
    robot = load_robot(request.param)
    return Replay(logged(robot, [], SECONDS, 0.002), robot)


SMALL = {
    "viscous_friction": 0.1,
    "quadratic_viscous_friction": 0.1,
    "torque_offset": 1e-3,
    "torque_constant": 1e-4,
    "rotor_inertia": 1e-2,
    "gear_stiffness": 1e-3,
    "stiffness_hardening": 1e-3,
    "gravity_spring": 1.0,
    "encoder_offset": 1e-4,
}


def agreement(replay: Replay, term: Term, least: float = 0.0) -> tuple[float, float]:
    """Correlation of a formula with the simulation, and the ratio of their sizes."""
    return compared(replay, term, Formulas(replay).columns([term])[term], least)


def compared(
    replay: Replay, term: Term, column: np.ndarray, least: float = 0.0
) -> tuple[float, float]:
    """The same for a column that is already there."""
    change = (replay.torque([(term, term.step)]) - replay.torque()) / term.step
    inside = settled(replay.recording, replay.robot)
    one, other = column[inside].astype(float), change[inside]
    if np.std(other) * term.step < least * np.std(replay.recording.torque[inside]):
        return 0.0, 0.0  # nearly nothing but rounding
    return float(np.corrcoef(one, other)[0, 1]), float(one @ other / (other @ other))


@pytest.mark.parametrize("name", SMALL)
def test_formulas_agree_with_simulations(replay, name):
    correlation, ratio = agreement(replay, Term(name, 2, SMALL[name], 1.0))
    assert correlation > 0.99
    assert ratio == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("name", ["torque_ripple", "transmission_error"])
def test_waves_agree_with_simulations(replay, name):
    for term in periodic_terms(replay.robot, name, 3, 2.0):
        small = Term(term.name, 3, 0.01 * term.step, term.prior_std, term.parameters)
        correlation, ratio = agreement(replay, small)
        assert correlation > 0.99
        assert ratio == pytest.approx(1, abs=0.02)


def test_links_agree_with_simulations(replay):
    for term in inertia_terms(replay.robot):
        if term.axis not in (2, replay.robot.n_axes + 1):
            continue
        assert term.name == INERTIA
        small = Term(INERTIA, term.axis, 0.1 * term.prior_std, term.prior_std, term.parameters)
        correlation, ratio = agreement(replay, small, least=1e-4)
        if ratio == 0:
            continue
        assert correlation > 0.99, term
        assert ratio == pytest.approx(1, abs=0.02), term


@pytest.mark.parametrize(
    "term",
    [
        Term("payload_mass", 6, 0.01, 1.0),
        Term("payload_mass", 2, 0.1, 1.0, (("x", 0.1), ("y", 0.0), ("z", 0.0))),
        Term("payload_offset", 6, 1e-3, 1.0, (("direction", 1),)),
        Term("payload_offset", 3, 1e-3, 1.0),
    ],
)
def test_loads_agree_with_simulations(replay, term):
    correlation, ratio = agreement(replay, term)
    assert correlation > 0.99
    assert ratio == pytest.approx(1, abs=0.02)


def test_a_load_on_a_place_without_mass_is_a_part_of_the_last_link(puma):
    """The model's payload only marks where a load would be."""
    spec = puma.spec()
    spec.body("payload").mass, spec.body("payload").inertia = 1e-9, np.full(3, 1e-12)
    empty = replace(puma, xml=spec.to_xml())
    term = Term("payload_mass", 6, 0.1, 1.0, (("x", 0.0), ("y", 0.1), ("z", 0.0)))
    effect = get_effect("payload_mass")
    effect.apply(spec, 6, 0.1, **effect.complete(dict(term.parameters)))
    arms = [Arm(replace(puma, xml=one)) for one in (spec.to_xml(), empty.xml)]
    rng = np.random.default_rng(0)
    motion = rng.normal(size=(3, 20, 6))
    loaded, alone = (arm.inverse_dynamics(*motion) for arm in arms)
    by_formula = link_regressor(arms[1], *motion) @ slopes_of(empty, [term])[:, 0]
    np.testing.assert_allclose(0.1 * by_formula, loaded - alone, atol=1e-4)
    assert np.std(loaded - alone) > 0.1


@pytest.mark.parametrize("share", [0.003, 0.01, 0.03])
def test_play_agrees_with_simulations(replay, share):
    """Of a gearbox whose torque changes sign; play over the deviation of its twist."""
    robot = replay.robot
    gear = np.std(replay.cycles[0].gear_torque[:, 0])
    stiffness = robot.model.tendon_stiffness[robot.ids("tendon", "gearbox")[0]]
    correlation, ratio = agreement(
        replay, Term("backlash", 1, float(share * gear / stiffness), 1.0)
    )
    assert correlation > 0.99
    assert ratio == pytest.approx(1, abs=0.05)  # shorter steps do not bring all impacts nearer


def test_play_as_large_as_the_twist_looks_like_its_simulation(replay):
    """The impacts of a PUMA are not those of the simulation one by one."""
    robot = replay.robot
    gear = np.std(replay.cycles[0].gear_torque[:, 0])
    stiffness = robot.model.tendon_stiffness[robot.ids("tendon", "gearbox")[0]]
    correlation, ratio = agreement(replay, Term("backlash", 1, float(gear / stiffness), 1.0))
    assert correlation > 0.9
    assert ratio == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("name", [name for name in FRICTION if name != "low_speed_friction"])
def test_friction_agrees_with_simulations(replay, name):
    """On every axis on which it is told, each as large as discovery probes it."""
    terms = [term for term in effect_terms(replay.robot) if term.name == name]
    for term in [term for term in terms if term.axis in (2, 5)]:
        correlation, ratio = agreement(replay, term)
        assert correlation > 0.999, term
        assert ratio == pytest.approx(1, abs=0.015), term


@pytest.mark.parametrize("name", ["low_speed_friction", "viscous_asymmetry"])
def test_friction_that_users_ask_for_agrees_with_simulations(replay, name):
    terms = [one for one in effect_terms(replay.robot, include=[name]) if one.name == name]
    assert terms
    correlation, ratio = agreement(replay, terms[1])
    assert correlation > 0.999
    assert ratio == pytest.approx(1, abs=0.01)


def test_friction_of_a_drive_that_logs_another_unit(replay):
    """The log of a drive with a gain of 2 shows half of the torque."""
    spec = replay.robot.spec()
    numeric = spec.numeric("torque_gain") or spec.add_numeric(name="torque_gain")
    numeric.size, numeric.data = 6, [2.0] * 6
    doubled = replay.on(replay.robot.edited(spec))
    assert list(doubled.robot.torque_gain) == [2.0] * 6
    wave = periodic_terms(doubled.robot, "torque_ripple", 2, 2.0)[0]
    numbers = ("coulomb_friction", "viscous_friction", "torque_offset", "rotor_inertia")
    for term in (*(Term(name, 2, 0.1, 1.0) for name in numbers), wave):
        _, ratio = agreement(doubled, term)
        assert ratio == pytest.approx(1, abs=0.02), term


def test_other_forms_of_friction_need_no_simulation(replay, monkeypatch):
    """Their torque is on the rotors, which move as they were measured."""
    terms, base = discrepancy_terms(replay.robot), replay.torque()
    monkeypatch.setattr(SIMULATES, "prescribed", None)
    columns = discrepancy_sensitivities(replay, terms, base)
    assert columns.any(axis=(1, 2)).sum() > len(terms) / 2
    shape = next(k for k, term in enumerate(terms) if term.axis == 2)
    assert not np.delete(columns[shape], 1, axis=1).any()


@pytest.mark.parametrize("direction", [0, 1, 2])
def test_loose_tools_agree_with_simulations(replay, direction):
    """Also where they strike, on the axes that carry most of it."""
    terms = [term for term in effect_terms(replay.robot) if term.name == "loose_tool"]
    own = [term for term in terms if dict(term.parameters)["direction"] == direction]
    assert len(own) == 4
    for term, column in Formulas(replay).columns(own).items():
        correlation, ratio = compared(replay, term, column)
        assert correlation > 0.9, term
        assert ratio == pytest.approx(1, abs=0.15), term


def test_a_robot_is_simulated_once_for_all_its_formulas(replay, monkeypatch):
    fresh = replay.on(replace(replay.robot))
    base = fresh.torque()
    monkeypatch.setattr(SIMULATES, "prescribed", None)
    Formulas(fresh).columns([Term("backlash", 1, 1e-4, 1.0), Term("coulomb_friction", 1, 0.1, 1.0)])
    np.testing.assert_array_equal(fresh.torque(), base)
