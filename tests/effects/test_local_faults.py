"""Faults that show at an angle or in a phase: each against its formula, in motion."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from swing import STEP, force_added, newton, run, servo

from faultgen.effects import Applied
from faultgen.effects.tooth import harmonics, pulse
from faultgen.errors import InputError
from faultgen.robot import COULOMB, STRIBECK_VELOCITY
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task


@pytest.fixture(scope="module")
def control(tiny_robot, tiny_task_path):
    """Control of the small robot's swing."""
    return control_signal(plan(load_task("tiny", tiny_task_path), tiny_robot), STEP)


def test_seizing_spot(tiny_robot, control):
    """In sliding two spots add their raised cosines of the joint's angle; beyond them is nothing.

    To 4 % of the peak: bristles follow the spot with the time in which they slip.
    """
    spots = ((0.5, -0.1, 0.4), (0.3, 0.1 + 2 * np.pi, 0.2))  # severity, angle, width
    effects = [("seizing_spot", 2, s, {"angle": at, "width": width}) for s, at, width in spots]
    cycle, plant = run(tiny_robot, control, *effects)
    assert plant.interval == 2e-3
    friction = tiny_robot.ids("actuator", "friction")[1]
    bias = tiny_robot.model.actuator_biasprm[friction]
    speed, angle = cycle.motor_velocity[:, 1], cycle.joint_position[:, 1]
    own = bias[COULOMB] + tiny_robot.model.actuator_damping[friction] * np.abs(speed)
    added = -cycle.friction_torque[:, 1] * np.sign(speed) - own
    expected = np.zeros_like(angle)
    for severity, at, width in ((0.5, -0.1, 0.4), (0.3, 0.1, 0.2)):
        inside = np.abs(angle - at) < width / 2
        shape = 0.5 + 0.5 * np.cos(2 * np.pi * (angle - at) / width)
        expected += severity * bias[COULOMB] * shape * inside
    fast = np.abs(speed) > 4 * bias[STRIBECK_VELOCITY]
    peak = expected[fast].max()
    assert peak > 0.45 * bias[COULOMB]
    np.testing.assert_allclose(added[fast], expected[fast], atol=0.04 * peak)
    assert np.abs(newton(tiny_robot, cycle)).max() < 1e-9


def test_tooth_damage_has_the_forces_of_its_stretch(robot):
    """K e on the joint, -K e / n - K twist de/dq_m on the rotor, to 2e-4 of K times the peak."""
    rng = np.random.default_rng(4)
    for axis, per, width in ((2, "motor", 0.5), (3, "motor", 0.9), (5, "joint", 0.2)):
        severity, phase = 1e-4, 0.9
        given = {"per": per, "phase": phase, "width": width}
        model = assemble(robot, [Applied("tooth_damage", axis, severity, given)]).model
        ratio = robot.gear_ratio[axis - 1]
        turns = 1 / ratio if per == "joint" else 1.0
        stiffness = robot.model.tendon_stiffness[robot.ids("tendon", "gearbox")[axis - 1]]
        motor, joint = robot.motors[axis - 1], robot.joints[axis - 1]
        # half its height at half the width, in whole harmonics
        power = 2 * round(np.log(0.5) / np.log(np.cos(width / 4)) / 2)
        for _ in range(5):
            position = np.zeros(robot.model.nq)
            away = rng.uniform(-width, width)
            position[motor] = (phase + away + 2 * np.pi * rng.integers(-3, 4)) / turns
            twist = rng.uniform(-2e-3, 2e-3)
            position[joint] = position[motor] / ratio - twist
            change = force_added(model, robot.model, position)
            error = severity * np.cos(away / 2) ** power
            slope = -turns * error * power / 2 * np.tan(away / 2)
            scale = 2e-4 * stiffness * severity
            assert change[joint] == pytest.approx(stiffness * error, abs=scale)
            on_rotor = -stiffness * error / ratio - stiffness * twist * slope
            scale *= 1 / abs(ratio) + abs(twist * turns * power)
            assert change[motor] == pytest.approx(on_rotor, abs=scale)
            assert np.abs(np.delete(change, [joint, motor])).max() < 1e-9


def test_tooth_damage_in_motion(tiny_robot, control):
    """The pulse comes once a turn of the motor, and the log of the gearbox has it."""
    severity = 2e-4
    given = {"width": 0.8, "phase": 0.3}
    cycle, _ = run(tiny_robot, control, ("tooth_damage", 1, severity, given))
    angle = cycle.motor_position[:, 0]
    error = severity * pulse(angle, 0.3, 0.8)
    assert np.ptp(angle) > 6 * np.pi
    # what Newton's law leaves beside the logged gear torque is its part through the slope of e
    slope = severity * (pulse(angle + 1e-6, 0.3, 0.8) - pulse(angle - 1e-6, 0.3, 0.8)) / 2e-6
    stiffness = tiny_robot.model.tendon_stiffness[0]
    twist = angle / tiny_robot.gear_ratio[0] - cycle.joint_position[:, 0]
    left = newton(tiny_robot, cycle)[:, 0]
    size = stiffness * severity / abs(tiny_robot.gear_ratio[0])
    np.testing.assert_allclose(left, -(stiffness * twist * slope)[:-1], atol=1e-3 * size)
    rate = cycle.motor_velocity[:, 0] / tiny_robot.gear_ratio[0] - cycle.joint_velocity[:, 0]
    spring = stiffness * (twist + error) + tiny_robot.model.tendon_damping[0] * rate
    np.testing.assert_allclose(cycle.gear_torque[:, 0], spring, atol=1e-9 * stiffness)


def test_harmonics_are_the_pulse():
    """Their sum is the pulse to 1e-4, and half the height is at half the width."""
    angle = np.linspace(-np.pi, np.pi, 400)
    for width in (0.1, 0.5, 1.0):
        series = np.cos(np.outer(angle, np.arange(len(harmonics(width))))) @ harmonics(width)
        np.testing.assert_allclose(series, pulse(angle, 0.0, width), atol=1e-4)
        assert pulse(np.array(width / 2), 0.0, width) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("severity", [0.1, 0.6])
def test_winding_fault(tiny_robot, control, severity):
    """The rotor lacks s (1 + cos(2 p q_m + phase)) / 3 of the logged torque, to 2 % of the most."""
    given = {"pole_pairs": 3, "phase": 0.7}
    cycle, plant = run(tiny_robot, control, ("winding_fault", 1, severity, given))
    np.testing.assert_allclose(cycle.motor_torque, servo(tiny_robot, cycle, control), atol=1e-9)
    torque, angle = cycle.motor_torque[:-1, 0], cycle.motor_position[:-1, 0]
    lost = severity / 3 * (1 + np.cos(6 * angle + 0.7)) * torque
    left = newton(tiny_robot, cycle)
    np.testing.assert_allclose(left[:, 0], -lost, atol=0.02 * np.abs(lost).max())
    assert np.abs(left[:, 1]).max() < 1e-9


@pytest.mark.parametrize("faults", [((1, 0.1), (2, 0.2), (1, 0.3)), ((2, 0.2), (1, 0.3), (1, 0.1))])
def test_faults_of_two_phases_of_a_motor_add_up(tiny_robot, control, faults):
    """Two of the same form are one of their sum, and each acts on the axis that has it."""
    given = {"pole_pairs": 3, "phase": 0.7}
    parts = [("winding_fault", axis, size, given) for axis, size in faults]
    sums = [("winding_fault", 1, 0.4, given), ("winding_fault", 2, 0.2, given)]
    one, other = (run(tiny_robot, control, *effects)[0] for effects in (parts, sums))
    np.testing.assert_allclose(one.motor_torque, other.motor_torque, atol=1e-8)


def test_three_phases_give_the_form_of_a_winding_fault():
    """Currents I cos(x - k 120 deg) against flux of that form, one of them weaker."""
    x = np.linspace(0, 2 * np.pi, 100)
    phases = np.cos(x[:, None] - 2 * np.pi / 3 * np.arange(3)) ** 2
    weak = phases @ np.array([0.6, 1.0, 1.0]) / phases.sum(axis=1)
    np.testing.assert_allclose(weak, 1 - 0.4 / 3 * (1 + np.cos(2 * x)), atol=1e-12)


@pytest.mark.parametrize("direction", [0, 1, 2])
def test_loose_tool_has_stops_and_nothing_between(robot, direction):
    """Along the play: k (|x| - s / 2) beyond it, damping everywhere, 60 Hz and 5 % on the stops.

    Two plays in one direction add up.
    """
    severity = 2e-3
    given = {"direction": direction}
    parts = [Applied("loose_tool", 6, share * severity, given) for share in (0.25, 0.75)]
    model = assemble(robot, parts).model
    slide = model.joint(f"loose_tool_{'xyz'[direction]}")
    np.testing.assert_array_equal(slide.axis, np.eye(3)[direction])
    at = int(slide.dofadr[0])
    mass = model.body("payload").mass[0]
    rate = 2 * np.pi * 60
    for place in (-3e-3, -0.8e-3, 0.0, 0.9e-3, 1.4e-3):
        for speed in (0.0, 0.2):
            data = mujoco.MjData(model)
            data.qpos[at], data.qvel[at] = place, speed
            mujoco.mj_forward(model, data)
            beyond = np.sign(place) * max(abs(place) - severity / 2, 0.0)
            expected = -mass * rate**2 * beyond - 2 * 0.05 * mass * rate * speed
            assert data.qfrc_passive[at] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_loose_tool_hangs_on_its_stop(tiny_robot, control):
    """At rest the payload is half the play and its sag down the slope, and weighs on the joint."""
    severity = 5e-3
    still = np.tile(control[:1], (3000, 1))
    loose, _ = run(tiny_robot, still, ("loose_tool", 2, severity))
    tight, _ = run(tiny_robot, still)
    angle = tight.joint_position[-1, 1]  # x of the flange points up by -angle
    weight, stiffness = 0.5 * 9.81, 0.5 * (2 * np.pi * 60) ** 2
    moved = np.sign(np.sin(angle)) * severity / 2 + weight * np.sin(angle) / stiffness
    change = loose.gear_torque[-1, 1] - tight.gear_torque[-1, 1]
    assert change == pytest.approx(-weight * np.cos(angle) * moved, rel=2e-3)


def test_a_loose_tool_beside_effects_between_steps(tiny_robot, control):
    """A joint more shifts no other: friction under load and the cycles after go on as they were."""
    load = ("load_friction", 2, 0.05)
    loose = ("loose_tool", 2, 1e-6)
    both, plant = run(tiny_robot, control, load, loose)
    alone, _ = run(tiny_robot, control, load)
    assert plant.model.nv == tiny_robot.model.nv + 1
    assert np.abs(newton(tiny_robot, both)).max() < 1e-9
    size = np.abs(alone.friction_torque).max(axis=0)
    assert (np.abs(both.friction_torque - alone.friction_torque).max(axis=0) < 0.02 * size).all()
    plants = [tiny_robot.model, plant, tiny_robot.model]
    cycles = list(simulate(tiny_robot, control, plants, sample_period=STEP))
    for cycle in cycles[1:]:
        off = np.abs(cycle.motor_position - cycles[0].motor_position).max()
        assert off < 0.05, off


def test_what_is_told_between_steps_converges(tiny_robot, control):
    """At the intervals used the torque is within 2 % of the effect with an update at each step."""
    for name, severity in (("seizing_spot", 0.5), ("winding_fault", 0.3)):
        plant = assemble(tiny_robot, [Applied(name, 2, severity)])

        def torque(entry):
            (cycle,) = simulate(tiny_robot, control, [entry], sample_period=0.004)
            return cycle.motor_torque[:, 1]

        best = torque(replace(plant, interval=STEP))
        size = np.sqrt(np.mean((best - torque(tiny_robot.model)) ** 2))
        error = np.sqrt(np.mean((torque(plant) - best) ** 2))
        assert error < 0.02 * size, (name, error / size)


def test_parameters_that_cannot_be_are_refused(tiny_robot):
    """Each with one line that says what can be."""
    for name, given, message in (
        ("seizing_spot", {"width": 0.0}, "width: must be above 0"),
        ("tooth_damage", {"width": 3.0}, "width: must be from 0.1 to 1 rad"),
        ("tooth_damage", {"per": "link"}, "per: choose motor or joint"),
        ("winding_fault", {"pole_pairs": 2.5}, "pole_pairs: must be 1, 2, 3"),
    ):
        with pytest.raises(InputError, match=message):
            assemble(tiny_robot, [Applied(name, 1, 1e-4, given)])
    with pytest.raises(InputError, match="loose_tool acts on axis 2"):
        assemble(tiny_robot, [Applied("loose_tool", 1, 1e-4)])
    with pytest.raises(InputError, match="direction: choose 0, 1 or 2"):
        assemble(tiny_robot, [Applied("loose_tool", 2, 1e-4, {"direction": 3})])
