"""Answers of a servo that follows commands, by formula and by simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded import logged

from faultgen.discovery.replay.bristles import FRICTION, bending
from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.terms.candidates import Term, effect_terms, periodic_terms
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.mjcf.dcmotor import set_servo
from faultgen.robot import load_robot

SECONDS = 3.0
PERIOD = 0.002


@pytest.fixture(scope="module", params=["puma560", "irb6700", "integral"])
def replay(request) -> Replay:
    """A healthy robot that follows commands, at 500 Hz; the third one has an integral gain."""
    robot = load_robot("puma560" if request.param == "integral" else request.param)
    if request.param == "integral":
        spec = robot.spec()
        for axis in range(1, 7):
            drive = spec.actuator(f"drive{axis}")
            set_servo(drive, drive.gainprm[4], 8.0 * drive.gainprm[4], drive.gainprm[6])
        robot = robot.edited(spec)
    return Replay(logged(robot, [], SECONDS, PERIOD), robot, measured=False)


@pytest.fixture(scope="module")
def base(replay) -> np.ndarray:
    """Torque of the healthy robot."""
    return replay.torque()


def agrees(replay, base, terms, apart: float) -> None:
    """The formulas and the simulations differ by a small share, over all axes."""
    inside = settled(replay.recording, replay.robot)
    columns = Formulas(replay).columns(terms)
    unit = np.sqrt(np.mean(base**2, axis=0))
    for term in terms:
        change = (replay.torque([(term, term.step)]) - base) / term.step
        size = np.linalg.norm((change / unit)[inside])
        if size * term.step < 1e-4 * np.sqrt(inside.sum()):
            continue  # nearly nothing but rounding
        left = np.linalg.norm(((columns[term] - change) / unit)[inside])
        assert left < apart * size, (term, left / size)


def small(term: Term, share: float = 0.1) -> Term:
    """The same with a step at which it is nearly linear."""
    return replace(term, step=share * term.step)


def test_friction_of_rotors(replay, base):
    names = (*FRICTION, "viscous_friction", "quadratic_viscous_friction", "viscous_asymmetry")
    terms = [
        small(term)
        for term in effect_terms(replay.robot)
        if term.name in names and term.axis in (1, 5)
    ]
    assert len({term.name for term in terms}) > 6
    agrees(replay, base, terms, 0.05)


def test_torques_of_rotors(replay, base):
    limit = replay.robot.motor_torque_limit[1]
    terms = [
        Term("torque_offset", 2, 1e-3 * limit, 1.0),
        Term("torque_constant", 2, 1e-3, 1.0),
        Term("rotor_inertia", 2, 1e-2, 1.0),
        *(small(t) for t in periodic_terms(replay.robot, "torque_ripple", 3, 2.0)),
    ]
    agrees(replay, base, terms, 0.03)


def test_loads_of_joints(replay, base):
    terms = [
        Term("gravity_spring", 2, 1.0, 1.0),
        Term("encoder_offset", 2, 1e-4, 1.0),
        Term("payload_mass", 6, 0.01, 1.0),
        *(small(one) for one in inertia_terms(replay.robot) if one.axis == 3),
    ]
    agrees(replay, base, terms, 0.03)


def test_gearboxes(replay, base):
    terms = [
        Term("gear_stiffness", 2, 1e-2, 1.0),
        Term("stiffness_hardening", 2, 1e-2, 1.0),
        *(small(t) for t in periodic_terms(replay.robot, "transmission_error", 3, 2.0)),
    ]
    agrees(replay, base, terms, 0.06)


def test_late_set_points_have_no_formula(replay):
    """The log of a servo is not late: what its formula would say is another fault."""
    assert not Formulas(replay).columns([Term("delay", 2, 1e-3, 1.0)])


def test_all_causes_need_one_simulation(replay, monkeypatch):
    calls = []
    torque = Replay.torque
    monkeypatch.setattr(Replay, "torque", lambda *args: calls.append(1) or torque(*args))
    Formulas(replay).columns(effect_terms(replay.robot))
    assert not calls


def test_bristles_at_rest_are_springs(tiny_robot):
    """And those of a rotor that slides keep the friction at its speed."""
    step, steps = tiny_robot.model.opt.timestep, 2000
    resting = bending(tiny_robot, np.zeros((steps, 2)), 2)
    np.testing.assert_array_equal(resting.rate, 0)
    np.testing.assert_array_equal(resting.gain, 1)
    speed = 5 * tiny_robot.stribeck_velocity.max()
    sliding = bending(tiny_robot, np.outer(np.arange(steps) * step, [speed, speed]), 2)
    friction = tiny_robot.ids("actuator", "friction")
    viscous = tiny_robot.model.actuator_damping[friction]
    # a lasting change of the speed changes the friction by its slope: nearly that of viscosity
    kept = sliding.gain[-2] / sliding.rate[-2]
    slope = sliding.damping[-2] + sliding.stiffness[-2] * kept
    coulomb = tiny_robot.model.actuator_biasprm[friction, 3]
    assert np.abs(slope - viscous).max() < 0.05 * (coulomb / speed).max()
