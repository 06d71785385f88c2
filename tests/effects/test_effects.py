from dataclasses import replace

import mujoco
import numpy as np
import pytest

from faultgen.effects import EFFECTS, Applied, get_effect, set_temperature
from faultgen.effects.friction import EFFECTS as FRICTION
from faultgen.effects.temperature import friction_ratios
from faultgen.errors import InputError
from faultgen.mjcf.dcmotor import BRISTLE_DAMPING, BRISTLE_STIFFNESS
from faultgen.monitoring.sensors import Measured
from faultgen.robot import COULOMB, OFFSET, STICTION, STRIBECK_VELOCITY
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task


def fields(model):
    """Every numeric array of a model, by name."""
    named = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: value for name, value in named.items() if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))
def test_severity_zero_leaves_the_model_as_it_is(robot, effect):
    """At severity 0 every field of the compiled model is that of the healthy one, bit for bit."""
    spec = robot.spec()
    for axis in effect.axes(6):
        effect.apply(spec, axis, 0.0)
    healthy, worn = fields(robot.model), fields(spec.compile())
    for name, value in healthy.items():
        assert np.array_equal(value, worn[name], equal_nan=True), name


SIZES = {  # where 0.3 is not a sensible severity
    "torque_offset": 0.02,
    "brake_drag": 0.02,
    "backlash": 1e-3,
    "payload_offset": 0.05,
    "gravity_spring": 5.0,
    "transmission_error": 1e-4,
    "delay": 5e-3,
    "tooth_damage": 1e-4,
    "loose_tool": 1e-3,
}


def test_severity_zero_leaves_the_run_as_it_is(tiny_robot, tiny_task_path):
    """Every effect changes what is measured; severity 0 does not change a bit of it."""
    motion = plan(load_task("tiny", tiny_task_path), tiny_robot)
    control = control_signal(motion, tiny_robot.model.opt.timestep)

    def measured(effect, severity):
        applied = [Applied(effect.name, 2, severity)]
        plant = assemble(tiny_robot, applied, temperature=60.0)
        cycle = list(simulate(tiny_robot, control, [plant] * 2, sample_period=0.004))[1]
        clean = Measured(cycle.motor_position, cycle.motor_velocity, cycle.motor_torque)
        seen = plant.sense(clean, 0.004, np.random.default_rng(3))
        return np.stack([seen.motor_position, seen.motor_velocity, seen.motor_torque])

    healthy = measured(get_effect("friction_wear"), 0.0)
    for effect in EFFECTS.values():
        np.testing.assert_array_equal(measured(effect, 0.0), healthy)
        change = np.abs(measured(effect, SIZES.get(effect.name, 0.3)) - healthy)[:, :, 1]
        shown = change if effect.sense else change[2]  # others in the torque
        assert shown.max() > 1e-6, effect.name


def curve(model, actuator, speed):
    """Friction against forward motion, as the thesis writes it (eq. 6.3, exponent 2)."""
    bias = model.actuator_biasprm[actuator]
    static = bias[STICTION] - bias[COULOMB]
    sliding = bias[COULOMB] + static * np.exp(-((speed / bias[STRIBECK_VELOCITY]) ** 2))
    quadratic = model.actuator_dampingpoly[actuator][0] * speed * np.abs(speed)
    offset = bias[OFFSET] * np.sin(bias[OFFSET + 2])
    return sliding * np.sign(speed) + model.actuator_damping[actuator] * speed + quadratic - offset


def test_growth_of_friction(robot):
    """Each effect adds its own term to the friction curve, at every speed of both directions."""
    speed = np.linspace(0.1, 400, 50)
    speed = np.concatenate([-speed, speed])
    axis, s = 2, 0.3
    actuator = robot.ids("actuator", "friction")[axis - 1]
    bias = robot.model.actuator_biasprm[actuator]
    coulomb, height, width = bias[COULOMB], bias[STICTION] - bias[COULOMB], bias[STRIBECK_VELOCITY]
    sign = np.sign(speed)
    stribeck = height * np.exp(-((speed / width) ** 2)) * sign
    growth = {
        "friction_wear": s * (coulomb * sign + stribeck),
        "coulomb_friction": s * coulomb * sign,
        "static_friction": s * stribeck,
        "viscous_friction": s * robot.model.actuator_damping[actuator] * speed,
        "stribeck_velocity": height * np.exp(-((speed / (width * (1 + s))) ** 2)) * sign - stribeck,
        "quadratic_viscous_friction": s * coulomb * speed * np.abs(speed) / 100**2,
        "friction_asymmetry": s * coulomb * (speed > 0),
        "torque_offset": np.full_like(speed, -s),
        "brake_drag": s * sign,
    }
    before = curve(robot.model, actuator, speed)
    for name, expected in growth.items():
        spec = robot.spec()
        get_effect(name).apply(spec, axis, s)
        worn = spec.compile()
        after = curve(worn, actuator, speed)
        np.testing.assert_allclose(after - before, expected, atol=1e-12, err_msg=name)
        changed = (worn.actuator_biasprm != robot.model.actuator_biasprm).any(axis=1)
        changed |= worn.actuator_damping != robot.model.actuator_damping
        changed |= (worn.actuator_dampingpoly != robot.model.actuator_dampingpoly).any(axis=1)
        assert list(np.flatnonzero(changed)) == [actuator], name


@pytest.mark.parametrize("has_static", [True, False])
def test_low_speed_friction_keeps_the_curve_that_a_model_has(robot, has_static):
    """The width is used only where the model has no static friction of its own."""
    spec = robot.spec()
    bias = spec.actuator("friction2").biasprm
    if not has_static:
        bias[STICTION] = bias[COULOMB]
    before = np.array(bias)
    get_effect("low_speed_friction").apply(spec, 2, 0.3, width=7.0)
    assert bias[STRIBECK_VELOCITY] == (before[STRIBECK_VELOCITY] if has_static else 7.0)
    assert bias[STICTION] == pytest.approx(before[STICTION] + 0.3 * before[COULOMB])
    assert bias[COULOMB] == before[COULOMB]


def test_low_speed_friction_is_probed_with_many_widths(robot):
    """Below and above the Stribeck velocity, and with it, if a model has no static friction."""
    prior = get_effect("low_speed_friction").prior
    assert prior.variants_on(robot, 2) == [{}]
    spec = robot.spec()
    bias = spec.actuator("friction2").biasprm
    bias[STICTION] = bias[COULOMB]
    width = bias[STRIBECK_VELOCITY] = 2.5
    widths = [one["width"] for one in prior.variants_on(replace(robot, xml=spec.to_xml()), 2)]
    assert widths == sorted(widths) and pytest.approx(width) in widths
    assert widths[0] < 0.5 * width and widths[-1] > 20 * width
    assert max(b / a for a, b in zip(widths, widths[1:], strict=False)) < 4


@pytest.mark.parametrize("effect", FRICTION, ids=[effect.name for effect in FRICTION])
def test_friction_acts_on_the_rotor_of_its_axis(robot, effect):
    """And on nothing else, which is why a sensor behind the gearbox hardly sees it."""
    spec = robot.spec()
    effect.apply(spec, 2, SIZES.get(effect.name, 0.3))
    healthy, worn = fields(robot.model), fields(spec.compile())
    for name, value in healthy.items():
        if name.startswith(("body_", "dof_", "jnt_", "tendon_")):
            np.testing.assert_array_equal(value, worn[name], err_msg=name)
    targets = set()
    for k in range(len(worn["actuator_trnid"])):
        is_old = k < len(healthy["actuator_trnid"])
        names = ("actuator_biasprm", "actuator_damping", "actuator_dampingpoly")
        if not is_old or any((worn[name][k] != healthy[name][k]).any() for name in names):
            assert worn["actuator_trntype"][k] == mujoco.mjtTrn.mjTRN_JOINT
            targets.add(int(worn["actuator_trnid"][k, 0]))
    assert targets == {robot.model.joint("motor2").id}
    assert effect.prior.at_motor or effect.prior.use == "never"


@pytest.mark.parametrize("name", ["torque_offset", "brake_drag"])
def test_torques_on_a_motor_are_limited_to_its_own(tiny_robot, name):
    get_effect(name).check_severity(1.99, tiny_robot, 2)
    with pytest.raises(InputError, match="motor's torque limit of 2 N m, not 2.01"):
        get_effect(name).check_severity(2.01, tiny_robot, 2)


def force(model, position, velocity):
    """Force on every degree of freedom at a state, bristles at rest, drives at zero set point."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = position, velocity
    mujoco.mj_forward(model, data)
    return data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias


def test_friction_is_what_the_engine_applies(robot):
    """Quadratic friction, offset and viscous friction act on the rotor as their formulas say."""
    axis, w = 2, 150.0
    dof, actuator = robot.motors[axis - 1], robot.ids("actuator", "friction")[axis - 1]
    velocity = np.zeros(robot.model.nv)
    velocity[dof] = -w
    position = np.zeros(robot.model.nq)
    coulomb = robot.model.actuator_biasprm[actuator][COULOMB]
    expected = {
        "viscous_friction": 0.3 * robot.model.actuator_damping[actuator] * w,
        "quadratic_viscous_friction": 0.3 * coulomb * w**2 / 100**2,
        "torque_offset": 0.3,
    }
    for name, value in expected.items():
        spec = robot.spec()
        get_effect(name).apply(spec, axis, 0.3)
        change = force(spec.compile(), position, velocity) - force(robot.model, position, velocity)
        assert change[dof] == pytest.approx(value, rel=1e-6), name
        assert np.abs(np.delete(change, dof)).max() < 1e-9


@pytest.mark.parametrize("twist", [3e-4, -2e-3])
def test_gearbox_torque(robot, twist):
    """Torque of a twisted gearbox on its joint: dead band, lost stiffness, cubic hardening."""
    axis = 3
    gearbox = robot.ids("tendon", "gearbox")[axis - 1]
    stiffness = robot.model.tendon_stiffness[gearbox]
    position = np.zeros(robot.model.nq)
    position[robot.motors[axis - 1]] = twist * robot.gear_ratio[axis - 1]
    play = 8e-4
    beyond = np.sign(twist) * max(abs(twist) - play / 2, 0.0)
    expected = {
        ("backlash", play): stiffness * (beyond - twist),
        ("gear_stiffness", 0.4): -0.4 * stiffness * twist,
        ("stiffness_hardening", 0.5): 0.5 * stiffness * twist**3 / 1e-3**2,
    }
    for (name, severity), value in expected.items():
        spec = robot.spec()
        get_effect(name).apply(spec, axis, severity)
        still = np.zeros(robot.model.nv)
        change = force(spec.compile(), position, still) - force(robot.model, position, still)
        assert change[robot.joints[axis - 1]] == pytest.approx(value, rel=1e-6), name
        on_rotor = -value / robot.gear_ratio[axis - 1]
        assert change[robot.motors[axis - 1]] == pytest.approx(on_rotor, rel=1e-6), name


def test_backlash_in_two_steps_is_backlash_at_once(robot):
    """The dead band widens symmetrically, also where there is one already."""
    specs = [robot.spec(), robot.spec()]
    for severity in (1e-4, 3e-4):
        get_effect("backlash").apply(specs[0], 1, severity)
    get_effect("backlash").apply(specs[1], 1, 4e-4)
    gearbox = robot.ids("tendon", "gearbox")[0]
    bands = [spec.compile().tendon_lengthspring[gearbox] for spec in specs]
    np.testing.assert_allclose(bands, [[-2e-4, 2e-4]] * 2, atol=1e-15)


def test_rotor_inertia(robot):
    """The inertia matrix grows by the rotor's share on its own degree of freedom alone."""
    spec = robot.spec()
    get_effect("rotor_inertia").apply(spec, 2, 0.3)
    worn, dof = spec.compile(), robot.motors[1]
    growth = worn.dof_M0 - robot.model.dof_M0
    assert growth[dof] == pytest.approx(0.3 * robot.model.dof_M0[dof], rel=1e-9)
    assert np.abs(np.delete(growth, dof)).max() < 1e-9


def test_payload_and_spring(robot):
    """Weight of a heavier or displaced payload, m g r of its centre; a spring's torque is -k q."""
    position = np.zeros(robot.model.nq)
    rng = np.random.default_rng(2)
    position[list(robot.joints)] = rng.uniform(-1, 1, 6)
    still = np.zeros(robot.model.nv)
    healthy = force(robot.model, position, still)

    def weight(model, mass):
        """Torque of a weight at the payload's centre, by the Jacobian."""
        data = mujoco.MjData(model)
        data.qpos[:] = position
        mujoco.mj_forward(model, data)
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
        return -9.81 * mass * jacobian[2]

    body = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    mass = robot.model.body_mass[body]
    for name, severity in (("payload_mass", 0.2), ("payload_offset", 0.03)):
        spec = robot.spec()
        get_effect(name).apply(spec, 6, severity)
        worn = spec.compile()
        factor = 1.2 if name == "payload_mass" else 1.0
        expected = weight(worn, factor * mass) - weight(robot.model, mass)
        change = force(worn, position, still) - healthy
        np.testing.assert_allclose(change, expected, atol=1e-6, err_msg=name)
    spec = robot.spec()
    get_effect("gravity_spring").apply(spec, 2, 400.0)
    change = force(spec.compile(), position, still) - healthy
    joint = robot.joints[1]
    assert change[joint] == pytest.approx(-400.0 * position[joint], rel=1e-9)


def test_inertia_of_a_payload(robot):
    """It grows with the mass; a payload without mass becomes a small ball where one says."""
    body = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    spec = robot.spec()
    get_effect("payload_mass").apply(spec, 6, 0.2)
    worn = spec.compile()
    np.testing.assert_allclose(
        worn.body_inertia[body], 1.2 * robot.model.body_inertia[body], rtol=1e-12
    )
    for place in ({}, {"x": 0.1, "y": -0.2, "z": 0.3}):
        spec = robot.spec()
        payload = spec.body("payload")
        payload.mass, payload.inertia = 0.0, np.zeros(3)
        get_effect("payload_mass").apply(spec, 6, 5.0, **place)
        ball = spec.compile()
        assert ball.body_mass[body] == 5.0
        assert ball.body_ipos[body].tolist() == [place.get(name, 0.0) for name in "xyz"]
        np.testing.assert_allclose(ball.body_inertia[body], 5.0 * 0.01**2, rtol=1e-12)


def test_bristles_of_a_coupling_are_those_of_its_axis(robot):
    """Seen at the joint; where less is held they are softer, so that they bend as far."""
    axis = 6
    ratio = robot.gear_ratio[axis - 1]
    own = robot.ids("actuator", "friction")[axis - 1]
    coulomb = robot.model.actuator_biasprm[own, COULOMB]
    bristles = robot.model.actuator_dynprm[own, BRISTLE_STIFFNESS : BRISTLE_DAMPING + 1]
    for share in (0.1, 1.0, 3.0):  # of the axis' own friction
        spec = robot.spec()
        severity = share * coulomb * abs(ratio)
        get_effect("wrist_coupling_friction").apply(spec, axis, severity)
        model = spec.compile()
        added = model.actuator(f"wrist_coupling{axis}").id
        got = model.actuator_dynprm[added, BRISTLE_STIFFNESS : BRISTLE_DAMPING + 1]
        np.testing.assert_allclose(got, min(share, 1.0) * ratio**2 * bristles, rtol=1e-9)
        assert model.actuator_biasprm[added, COULOMB] == pytest.approx(severity)


def test_elements_that_are_added_twice_get_a_number(tiny_robot):
    """The first has the name as it is, and the further ones count from 2."""
    ripple = [Applied("torque_ripple", 1, 0.01, {"order": n}) for n in (2.0, 3.0, 5.0)]
    model = assemble(tiny_robot, ripple).model
    names = [model.actuator(k).name for k in range(model.nactuator)]
    assert [name for name in names if "ripple" in name] == [
        "torque_ripple1",
        "torque_ripple1_2",
        "torque_ripple1_3",
    ]


def test_temperature_follows_the_published_ratios(robot):
    """33 to 80 deg C: viscous x 0.4, Stribeck height x 3.7, Stribeck velocity 8 to 54 rad/s.

    Source: Bittencourt et al. 2010.
    """
    models = {}
    for temperature in (33.0, 80.0):
        spec = robot.spec()
        set_temperature(spec, 4, temperature, 40.0)
        models[temperature] = spec.compile()
    actuator = robot.ids("actuator", "friction")[3]
    cold, hot = (models[t].actuator_biasprm[actuator] for t in (33.0, 80.0))
    height = (hot[STICTION] - hot[COULOMB]) / (cold[STICTION] - cold[COULOMB])
    assert hot[COULOMB] == cold[COULOMB]
    assert height == pytest.approx(3.7, abs=0.05)
    assert hot[STRIBECK_VELOCITY] / cold[STRIBECK_VELOCITY] == pytest.approx(53.6 / 7.54, rel=1e-3)
    damping = [models[t].actuator_damping[actuator] for t in (80.0, 33.0)]
    assert damping[0] / damping[1] == pytest.approx(0.4, abs=0.02)


def test_friction_at_the_temperature_of_the_model_is_that_of_the_model():
    """There all ratios are 1; a change in two steps is the change at once."""
    for temperature in (30.0, 40.0, 55.0, 80.0):
        assert friction_ratios(temperature, temperature) == pytest.approx((1.0, 1.0, 1.0))
    steps = np.multiply(friction_ratios(70.0, 50.0), friction_ratios(50.0, 35.0))
    assert friction_ratios(70.0, 35.0) == pytest.approx(tuple(steps))


def test_unknown_effects_are_refused_with_the_choices():
    """The message names the effects that there are."""
    with pytest.raises(InputError, match="unknown effect 'rust': choose healthy, friction_wear"):
        get_effect("rust")


def test_points_may_be_heavier_than_a_payload_may_grow():
    """Kilograms of a point on a link, which has a place, are no fractions of the model's load."""
    mass = get_effect("payload_mass")
    assert mass.largest_with({}) == mass.largest
    assert mass.largest_with({"x": 0.0, "y": 0.0, "z": 0.0}) == mass.point_largest > 100
