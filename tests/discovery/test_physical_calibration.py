"""Calibration stays physical, is no worse than classical identification on any axis, and tells."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from linear import COUNT, difference_between, written_down
from scipy.optimize import minimize

from faultgen.discovery import Discovery
from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.calibration.compared import compared
from faultgen.discovery.calibration.held_out import HeldOut
from faultgen.discovery.calibration.ranges import severities, unphysical
from faultgen.discovery.calibration.result import at_bound
from faultgen.discovery.calibration.weak_axes import AGAIN, GIVEN, repaired, weak_axes, with_choices
from faultgen.discovery.decision.calibrated import calibrated
from faultgen.discovery.fit.bounded import bounded_minimum
from faultgen.discovery.rigid.drives import Drives, built
from faultgen.discovery.rigid.regression import possible_regression
from faultgen.discovery.terms.candidates import Term
from faultgen.effects import EFFECTS
from faultgen.effects.spreads import SPREADS
from faultgen.inference.limits import LIMITS, table
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

LOW_SPEED = ("static_friction", "stribeck_velocity")


def other_law(robot, coulomb, viscous, ratio):
    """The robot with friction that is larger, and static friction of a given ratio."""
    spec = robot.spec()
    for axis in (1, 2):
        friction = spec.actuator(f"friction{axis}")
        friction.biasprm[COULOMB] *= coulomb
        friction.biasprm[STICTION] = ratio * friction.biasprm[COULOMB]
        friction.damping[0] *= viscous
    spec.compile()
    return robot.edited(spec)


def friction_of(robot):
    return robot.model.actuator_biasprm[robot.ids("actuator", "friction")]


def assert_physical(given, made, static=5.0):
    """No friction or inertia that cannot be, and no static friction that explains other things."""
    friction, drives = friction_of(made), Drives.of(made)
    assert np.all(friction[:, COULOMB] > 0) and np.all(drives.viscous >= 0)
    assert np.all(drives.inertia > 0) and np.all(drives.rise >= 0)
    assert np.all(friction[:, STICTION] >= friction[:, COULOMB])
    assert np.all(friction[:, STICTION] < static * friction_of(given)[:, STICTION])
    assert np.all(friction[:, STRIBECK_VELOCITY] < 3.01 * friction_of(given)[:, STRIBECK_VELOCITY])
    assert np.all(made.model.body_inertia[1:] > 0) and np.all(made.model.body_mass[1:] > 0)


def no_axis_is_worse(found):
    return all(
        one["interval"][0] <= 0 or one["calibrated"] <= 1.02 * one["classical"]
        for one in found.per_axis
    )


def test_the_minimum_within_bounds_is_no_clipped_one():
    rng = np.random.default_rng(0)
    for _ in range(20):
        root = rng.normal(size=(6, 4))
        precision, right = root.T @ root, rng.normal(size=4)
        low, high = -rng.uniform(0, 1, 4), rng.uniform(0, 1, 4)
        low[0] = high[0] = 0.1
        low[1], high[1] = -np.inf, np.inf
        found = bounded_minimum(precision, right, low, high)
        told = minimize(
            lambda x, p=precision, r=right: x @ p @ x / 2 - r @ x,
            np.clip(found, low, high),
            jac=lambda x, p=precision, r=right: p @ x - r,
            bounds=list(zip(low, high, strict=True)),
            tol=1e-12,
        )
        np.testing.assert_allclose(found, told.x, atol=1e-5)
        free = np.linalg.solve(precision, right)
        np.testing.assert_allclose(
            bounded_minimum(precision, right, np.full(4, -np.inf), np.full(4, np.inf)), free
        )


def test_the_interval_of_a_difference_covers_it():
    """About 95 % of the intervals of two errors of the same size contain zero."""
    rng, inside = np.random.default_rng(3), np.ones((4000, 1), bool)
    misses = 0
    for _ in range(300):
        common = rng.normal(size=(4000, 1))
        ours, theirs = (
            common + 0.5 * np.repeat(rng.normal(size=(80, 1)), 50, axis=0) for _ in range(2)
        )
        one = compared(ours, theirs, inside, [slice(0, 2000), slice(2000, 4000)], 0.004)
        misses += not one.low[0] <= 0 <= one.high[0]
    assert 0.02 < misses / 300 < 0.09


def test_an_axis_is_worse_beyond_its_interval_only():
    rng, parts = np.random.default_rng(4), [slice(0, 1500), slice(1500, 3000)]
    noise = rng.normal(size=(3000, 3))
    ours = noise * [1.3, 1.005, 1.0]
    inside = np.ones(noise.shape, bool)
    inside[:, 2] = False
    inside[:200, 2] = True  # too few pieces to tell
    one = compared(ours, noise, inside, parts, 0.004)
    assert one.worse.tolist() == [True, False, False]
    assert one.error[0] / one.other[0] == pytest.approx(1.3)
    assert one.low[0] < 0.3 * one.other[0] < one.high[0]
    assert np.isinf(one.low[2])
    assert compared(np.nan * ours, noise, inside, parts, 0.004).worse.tolist() == [1, 1, 0]


def test_a_number_may_change_by_the_factor_of_its_type():
    assert severities(Term("static_friction", 1, 0.1, 0.1)) == pytest.approx((-2 / 3, 2.0))
    assert severities(Term("inertia", 1, 0.1, 0.1)) == (-np.inf, np.inf)
    assert severities(Term("friction_asymmetry", 1, 0.1, 0.1)) == (-np.inf, np.inf)


@pytest.mark.parametrize("name", ["static_friction", "stribeck_velocity", "coulomb_friction"])
def test_no_number_of_friction_explains_what_is_not_friction(name):
    """A column that resembles another effect asks for 5.7 times the static friction."""
    columns = np.random.default_rng(5).normal(size=(1, COUNT, 2))
    term = Term(name, 1, 0.1, 1.0)
    problem = written_down([term], columns, 4.7 * columns[0])
    difference = difference_between(problem)
    scales = difference.model.healthy.log_scales
    found = calibrated(problem, difference, scales, np.zeros((COUNT, 2))).values
    assert found == pytest.approx([2.0], abs=0.01)  # severity 2 is 3 times the friction


def test_what_is_unusual_is_told(tiny_robot):
    drives = Drives.of(tiny_robot)
    factor = np.array([1.0, 0.2])
    made = built(tiny_robot, replace(drives, coulomb=drives.coulomb * factor))
    lines = unphysical(tiny_robot, made)
    assert any(line.startswith("Coulomb friction of axis 2 is 0.2 times") for line in lines)
    assert any(
        "static friction is more than 3 times Coulomb friction on axis 2" in x for x in lines
    )
    assert len(lines) == 2
    gain = built(tiny_robot, drives, gain=np.array([1.0, 1.25]))
    (line,) = unphysical(tiny_robot, gain)
    assert line.startswith("torque constant of axis 2 differs from the log by 25 %")
    assert unphysical(tiny_robot, tiny_robot) == []
    inertia = built(tiny_robot, replace(drives, inertia=drives.inertia * [4.0, 1.0]))
    assert "rotor inertia of axis 1 is 4 times" in unphysical(tiny_robot, inertia)[0]


def test_a_prior_scale_at_its_bound_is_told():
    assert at_bound(10.0, [1.0, 10.0, 100.0]) == [] == at_bound(10.0, [10.0])
    assert at_bound(100.0, [1.0, 100.0])[0].startswith("the prior scale stands at the largest")


def test_friction_of_another_size_stays_physical(measured, tiny_robot):
    """The model has 5 times the friction: its static friction would be 8 times the Coulomb one."""
    rough = other_law(tiny_robot, 5.0, 5.0, 2.3)
    found = calibrate(
        measured([], 3), rough, prior_scales=[1.0, 100.0], exclude=["torque_constant"]
    )
    assert_physical(rough, found.robot)
    friction = friction_of(found.robot)
    np.testing.assert_allclose(friction[:, COULOMB], [0.2, 0.1], rtol=0.15)
    assert np.all(friction[:, STICTION] < 3 * friction[:, COULOMB])
    assert no_axis_is_worse(found)
    assert any("Coulomb friction of axes 1, 2 is" in line for line in found.findings)


@pytest.mark.slow
def test_calibration_in_discovery_does_not_spoil_an_axis(measured, tiny_robot):
    """A spring is missing on axis 2. Links that imitate it must not spoil axis 1."""
    effects = [("gravity_spring", 2, 3.0), ("torque_ripple", 1, 0.05), ("torque_ripple", 2, 0.03)]
    recording = measured(effects, 3, torque_ripple={"order": 8.0})
    found = Discovery(tiny_robot, exclude=["gravity_spring", "delay"], laws=False).fit(recording)
    problem, answer = found.problem_, found.answer_
    size = {t.key: 1 + value for t, value in answer.changes if t.is_effect and not t.parameters}
    assert all(1 / 3.01 < size.get((n, axis), 1) < 3.01 for n in LOW_SPEED for axis in (1, 2))
    torque = np.sqrt(np.mean(recording.torque**2, axis=0))
    after, before = answer.left_torque / torque, problem.residual / torque
    scored = [problem.parts[k] for k in problem.scoring]
    period = recording.sample_period
    assert not compared(after, before, problem.inside, scored, period).worse.any()
    assert answer.calibrated < answer.before


def test_an_axis_that_hardly_moves_stays_physical(tiny_robot, measured, tmp_path):
    """Axis 1 turns by half a degree, so that its friction, inertia and offset look alike."""
    task = tmp_path / "little.toml"
    moves = "".join(
        f"[[move]]\njoints = [{a}, {b}]\nspeed = {s}\n"
        for a, b, s in [(0.5, 60, 1.0), (0, -20, 0.4), (0.5, 50, 0.7), (0, -60, 1.0)] * 2
    )
    task.write_text(f'description = "little"\n[start]\njoints = [0, -60]\n{moves}')
    motion = plan(load_task("tiny", str(task)), tiny_robot)
    control = control_signal(motion, tiny_robot.model.opt.timestep)
    (run,) = simulate(tiny_robot, control, [tiny_robot.model], sample_period=0.004)
    times = np.arange(len(run.motor_torque)) * 0.004
    noise = np.random.default_rng(1).standard_normal(run.motor_torque.shape)
    recording = replace(
        measured([], 3),
        position=run.motor_position,
        torque=run.motor_torque + 0.01 * np.abs(run.motor_torque).mean(axis=0) * noise,
        reference_position=motion(times)[0],
    )
    rough = other_law(tiny_robot, 1.5, 1.5, 1.5)
    found = calibrate(recording, rough, prior_scales=[1.0, 100.0], exclude=["torque_constant"])
    assert_physical(rough, found.robot)
    assert no_axis_is_worse(found)
    ratio = Drives.of(found.robot).inertia / Drives.of(rough).inertia
    assert np.all((ratio > 0.3) & (ratio < 3.01))


@pytest.mark.parametrize(("wrong", "choice"), [("model", GIVEN), ("given", AGAIN)])
def test_a_weak_axis_gets_better_numbers_of_its_drive(measured, tiny_robot, wrong, choice):
    """The given ones if these are right, and otherwise those that its own torque shows."""
    recording = measured([], 3)
    worn = built(
        tiny_robot,
        replace(Drives.of(tiny_robot), coulomb=Drives.of(tiny_robot).coulomb * [1.0, 1.5]),
    )
    held_out = HeldOut(recording, possible_regression(recording, tiny_robot))
    given = tiny_robot if wrong == "model" else worn
    before, of_given = held_out.torque_of(worn), held_out.torque_of(given)
    weak = weak_axes(held_out, before, of_given)
    assert weak.tolist() == [False, True]
    torque, choices = repaired(held_out, before, worn, given, weak)
    assert set(choices) == {1} and choices[1] == choice
    made = with_choices(held_out, worn, given, choices)
    np.testing.assert_allclose(Drives.of(made).coulomb, [0.2, 0.1], rtol=0.1)
    np.testing.assert_array_equal(Drives.of(made).named()["viscous"][0], 1e-3)
    assert held_out.error(torque) < 0.5 * held_out.error(before)
    assert held_out.error_of(made) == pytest.approx(held_out.error(torque), rel=0.1)
    assert with_choices(held_out, worn, given, {}) is worn


def test_the_documentation_has_the_table_of_spreads():
    page = (Path(__file__).parents[2] / "docs" / "discovery_details.md").read_text()
    for name, one in SPREADS.items():
        value = f"{one.std:g} of the {one.of}" if one.of else f"{one.std:g}"
        row = f"| `{name}` | {value} | {one.reason} | {one.source or 'assumed'} |"
        assert row in page, row


def test_the_documentation_has_the_table_of_limits():
    page = (Path(__file__).parents[2] / "docs" / "discovery_details.md").read_text()
    assert table() in page
    assert len({one.name for one in LIMITS}) == len(LIMITS) < 40


def test_every_candidate_has_a_spread_with_a_reason():
    for effect in EFFECTS.values():
        if effect.prior.use in ("always", "on request", "periodic"):
            assert effect.name in SPREADS, effect.name
    assert all(one.std > 0 and len(one.reason) > 10 for one in SPREADS.values())
    assert {name for name, one in SPREADS.items() if not one.assumed} >= {
        "coulomb_friction",
        "viscous_friction",
        "rotor_inertia",
    }
