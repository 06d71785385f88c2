"""Classical identification: the torque is linear in the parameters, and they come back."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.rigid.base_parameters import held_out_error, identify
from faultgen.discovery.rigid.drives import Drives
from faultgen.discovery.rigid.physical import Spread, fit
from faultgen.discovery.rigid.regression import DRIVE, Coupling, Regression
from faultgen.discovery.terms.candidates import INERTIA
from faultgen.discovery.terms.regressor import link_parameters, link_regressor
from faultgen.effects.coupling import add_coupling_friction
from faultgen.recordings.checks import without_friction
from faultgen.recordings.recording import Recording
from faultgen.robot import BRISTLE_STIFFNESS, COULOMB, STRIBECK_VELOCITY, Robot, load_robot
from faultgen.simulation.arm import Arm, loads, motor_torque

BLANK = Recording(
    source="computed",
    robot="tiny",
    side="motor",
    sample_period=0.004,
    position=np.zeros((1, 2)),
    torque=np.zeros((1, 2)),
)


@pytest.mark.parametrize("name", ["puma560", "irb6700"])
def test_the_regressor_gives_the_torque_of_other_links(name):
    """Torque of links with other parameters, against mj_inverse; springs and payload included."""
    robot = load_robot(name)
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 20, robot.n_axes))
    spec = robot.spec()
    for axis in range(robot.n_axes):
        body = spec.joint(f"joint{axis + 1}").parent
        body.mass *= rng.uniform(0.5, 2)
        body.ipos = np.array(body.ipos) + rng.normal(scale=0.05, size=3)
        body.iquat = rng.normal(size=4)
        body.inertia = np.array(body.inertia) * rng.uniform(1, 1.3)
    spec.compile()
    other = Arm(robot.edited(spec))
    arm = Arm(robot)
    change = link_parameters(other) - link_parameters(arm)
    got = arm.inverse_dynamics(q, qd, qdd) + link_regressor(arm, q, qd, qdd) @ change
    expected = other.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_motors_turn_with_more_than_one_joint(tiny_robot):
    """A third joint in the tendon of a gearbox is a coupled wrist."""
    np.testing.assert_allclose(tiny_robot.gearing.matrix, np.diag([100.0, -50.0]), rtol=1e-12)
    third = '<joint joint="joint2" coef="-1"/><joint joint="joint1" coef="-0.5"/></fixed>'
    coupled = tiny_robot.xml.replace('<joint joint="joint2" coef="-1"/></fixed>', third)
    assert coupled != tiny_robot.xml
    # length 0 = -0.02 motor2 - joint2 - 0.5 joint1
    np.testing.assert_allclose(
        Robot("wrist", coupled).gearing.matrix, [[100, 0], [-25, -50]], rtol=1e-12
    )


def test_parameters_of_a_simulated_robot_come_back(measured, tiny_robot):
    """Friction directly, inertias as the torque that they cause together."""
    recording = measured([("coulomb_friction", 1, 0.5), ("viscous_friction", 2, 0.4)], 3)
    regression = Regression(recording, tiny_robot)
    value = identify(regression.products)
    coulomb, viscous = (value[regression.drive(name)] for name in ("Coulomb", "viscous"))
    np.testing.assert_allclose(coulomb, [0.3, 0.1], rtol=0.05)
    np.testing.assert_allclose(viscous, [0.001, 0.0014], rtol=0.05)
    assert held_out_error(regression.products) < 0.03
    error = (recording.torque - regression.torque(value))[regression.inside]
    assert np.sqrt(np.mean(error**2) / np.mean(recording.torque[regression.inside] ** 2)) < 0.02


def test_both_sides_of_the_gearbox_give_the_same_parameters(measured, tiny_robot):
    recording = measured([("coulomb_friction", 1, 0.5)], 3)
    joint = replace(
        recording,
        side="joint",
        position=recording.position / tiny_robot.gear_ratio,
        torque=recording.torque * tiny_robot.gear_ratio,
    )
    values = [identify(Regression(one, tiny_robot).products) for one in (recording, joint)]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-6, atol=1e-9)


def test_the_physical_model_has_the_fitted_parameters(measured, tiny_robot):
    """What the regression says of the torque is what the model that is built says."""
    recording = measured([("rotor_inertia", 1, 0.5), ("coulomb_friction", 2, 0.5)], 3)
    regression = Regression(recording, tiny_robot)
    fitted = fit(regression, regression.products, Spread(3.0, exclude=["torque_constant"]))
    arm = Arm(fitted.robot)
    parameters = link_parameters(arm)
    np.testing.assert_allclose(parameters, fitted.value[: len(parameters)], rtol=1e-6, atol=1e-12)
    built = Drives.of(fitted.robot).named()
    for name in DRIVE:
        np.testing.assert_allclose(built[name], fitted.value[regression.drive(name)], rtol=1e-9)
    np.testing.assert_allclose(built["rotor inertia"], [1.5e-3, 5e-4], rtol=0.05)
    np.testing.assert_allclose(built["Coulomb"], [0.2, 0.15], rtol=0.05)


def test_known_and_excluded_numbers_stay(measured, tiny_robot):
    recording = measured([("rotor_inertia", 1, 0.5), ("coulomb_friction", 2, 0.5)], 3)
    regression = Regression(recording, tiny_robot)
    spread = Spread(10.0, exclude=["coulomb_friction", INERTIA])
    fitted = fit(regression, regression.products, spread)
    np.testing.assert_allclose(fitted.drives.coulomb, [0.2, 0.1], rtol=1e-3)
    np.testing.assert_allclose(
        link_parameters(Arm(fitted.robot)), link_parameters(Arm(tiny_robot)), rtol=1e-2, atol=1e-4
    )


def test_a_coupling_is_found_where_there_is_one(tiny_robot):
    """Its Coulomb and viscous friction and its inertia come back, and it is not found elsewhere."""
    spec = tiny_robot.spec()
    add_coupling_friction(spec, 2, 3.0, ratio=1.0)
    spec.actuators[-1].damping[0] = 1.0
    spec.tendons[-1].armature = 0.2
    spec.compile()
    times = np.arange(5000) * 0.004
    waves = [
        np.sin(2 * np.pi * np.outer(times, f)) @ [0.4, 0.2] for f in ([0.31, 1.3], [0.47, 1.7])
    ]
    q = np.stack(waves, axis=1)
    qd = np.gradient(q, 0.004, axis=0)
    qdd = np.gradient(qd, 0.004, axis=0)
    blank = replace(
        BLANK, position=q * tiny_robot.gear_ratio, torque=np.zeros_like(q), segments=(0, 1700, 3400)
    )
    errors = {}
    for name, robot in (("coupled", tiny_robot.edited(spec)), ("plain", tiny_robot)):
        recording = replace(blank, torque=motor_torque(Arm(robot), q, qd, qdd))
        regressions = [
            Regression(recording, tiny_robot, couplings=couplings)
            for couplings in ([], [Coupling(2, 1.0)])
        ]
        errors[name] = [held_out_error(one.products) for one in regressions]
        found = identify(regressions[1].products)[regressions[1].coupling(0)]
        expected = [0.2, 3.0, 1.0] if name == "coupled" else np.zeros(3)
        np.testing.assert_allclose(found, expected, atol=0.1)  # sign of a smoothed speed
    assert errors["coupled"][1] < 0.2 * errors["coupled"][0]
    assert errors["plain"][1] > 0.9 * errors["plain"][0]


def test_the_controller_knows_a_coupling_of_the_model(tiny_robot):
    """Feed-forward of friction and inertia that two axes share, joint side 3 N m and 0.2 kg m^2."""
    spec = tiny_robot.spec()
    add_coupling_friction(spec, 2, 3.0, ratio=-1.0)
    spec.tendons[-1].armature = 0.2
    spec.compile()
    q, qd, qdd = np.zeros((1, 2)), np.array([[0.5, -1.0]]), np.array([[2.0, 1.0]])
    got, without = (
        motor_torque(Arm(robot), q, qd, qdd) for robot in (tiny_robot.edited(spec), tiny_robot)
    )
    shared = 3.0 * np.sign(-1.0 - 0.5) + 0.2 * (1.0 - 2.0)
    np.testing.assert_allclose(got - without, [[-shared / 100, shared / -50]], rtol=1e-3)
    (load, _), (same, _) = (loads(one, q, qd, qdd) for one in (tiny_robot.edited(spec), tiny_robot))
    np.testing.assert_array_equal(load, same)  # friction and inertia of rotors are no load


def without(robot):
    """The same robot without any friction."""
    spec = robot.spec()
    for axis in (1, 2):
        spec.actuator(f"friction{axis}").set_to_dcmotor(
            motorconst=[0.0, 0.0], resistance=1.0, ctrlspec=16
        )
        spec.actuator(f"friction{axis}").damping = np.zeros(3)
    spec.compile()
    return Robot("tiny", spec.to_xml())


def test_axes_without_friction_get_a_law(measured, tiny_robot):
    """Only the constants that are documented; the friction is next to nothing until fitted."""
    recording = measured([], 3)
    assert with_friction_law(tiny_robot, recording) is tiny_robot
    bare = without(tiny_robot)
    assert without_friction(bare).all()
    model = with_friction_law(bare, recording).model
    friction = tiny_robot.ids("actuator", "friction")
    speed = np.abs(recording.derivatives(recording.position)[1]).max(axis=0)
    np.testing.assert_allclose(model.actuator_biasprm[friction, STRIBECK_VELOCITY], 0.015 * speed)
    assert np.all(model.actuator_dynprm[friction, BRISTLE_STIFFNESS] > 0)
    rms = np.sqrt(np.mean(recording.torque**2, axis=0))
    assert np.all(model.actuator_biasprm[friction, COULOMB] < 0.002 * rms)
    assert np.isfinite(Replay(recording, with_friction_law(bare, recording)).torque()).all()
