"""Effects that act on more than the model: each against its formula, in motion."""

from dataclasses import replace

import numpy as np
import pytest
from swing import STEP, channels, force_added, newton, run, servo

import faultgen.simulation.stepping as module
from faultgen.effects import EFFECTS, Applied, get_effect
from faultgen.effects.hooks import Moment
from faultgen.effects.temperature import friction_ratios
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import Plant, assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task


@pytest.fixture(scope="module")
def control(tiny_robot, tiny_task_path):
    """Control of the small robot's swing."""
    return control_signal(plan(load_task("tiny", tiny_task_path), tiny_robot), STEP)


def test_the_log_of_a_healthy_robot_is_the_servo(tiny_robot, control):
    """What the tests below rest on: no torque is left over, and the drive obeys its law."""
    cycle, plant = run(tiny_robot, control)
    assert plant.model is tiny_robot.model
    assert np.abs(newton(tiny_robot, cycle)).max() < 1e-9
    np.testing.assert_allclose(cycle.motor_torque, servo(tiny_robot, cycle, control), atol=1e-9)


def test_torque_ripple(tiny_robot, control):
    """Two ripples add up on the rotor; the log has the servo's answer only."""
    effects = [
        ("torque_ripple", 2, 0.02, {"order": 2.5, "phase": 0.4}),
        ("torque_ripple", 2, 0.01, {"order": 36.0, "per": "joint"}),
    ]
    cycle, _ = run(tiny_robot, control, *effects)
    angle = cycle.motor_position[:-1, 1]
    ratio = tiny_robot.gear_ratio[1]
    expected = 0.02 * np.sin(2.5 * angle + 0.4) + 0.01 * np.sin(36 * angle / ratio)
    left = newton(tiny_robot, cycle)
    np.testing.assert_allclose(left[:, 1], expected, atol=1e-9)
    assert np.abs(left[:, 0]).max() < 1e-9
    np.testing.assert_allclose(cycle.motor_torque, servo(tiny_robot, cycle, control), atol=1e-9)


def test_transmission_error_has_the_energy_of_its_stretch(robot):
    """Forces are the derivative of k (twist + e)^2 / 2, to 1e-4 of the largest term."""
    rng = np.random.default_rng(3)
    for axis, order, per in ((2, 2.0, "motor"), (3, 40.0, "motor"), (5, 30.0, "joint")):
        severity, phase = 2e-4, 0.7
        given = {"order": order, "phase": phase, "per": per}
        one = Applied("transmission_error", axis, severity, given)
        model = assemble(robot, [one]).model
        ratio = robot.gear_ratio[axis - 1]
        poles = order / ratio if per == "joint" else order
        stiffness = robot.model.tendon_stiffness[robot.ids("tendon", "gearbox")[axis - 1]]
        motor, joint = robot.motors[axis - 1], robot.joints[axis - 1]
        for _ in range(5):
            position = np.zeros(robot.model.nq)
            position[motor] = rng.uniform(-100, 100)
            twist = rng.uniform(-2e-3, 2e-3)
            position[joint] = position[motor] / ratio - twist
            change = force_added(model, robot.model, position)
            error = severity * np.sin(poles * position[motor] + phase)
            slope = severity * poles * np.cos(poles * position[motor] + phase)
            stretch = stiffness * (twist + error)
            on_joint = stiffness * error
            on_motor = -stretch * (1 / ratio + slope) + stiffness * twist / ratio
            assert change[joint] == pytest.approx(on_joint, abs=1e-4 * stiffness * severity)
            scale = stiffness * severity / abs(ratio)
            assert change[motor] == pytest.approx(on_motor, abs=1e-4 * scale)


def test_transmission_error_is_in_the_gear_torque(tiny_robot, control):
    """What Newton's law leaves beside the logged gear torque is its part through the slope of e."""
    severity, order = 1e-4, 3.0
    effect = ("transmission_error", 1, severity, {"order": order})
    cycle, plant = run(tiny_robot, control, effect)
    slope = severity * order * np.cos(order * cycle.motor_position[:-1, 0])
    left = newton(tiny_robot, cycle)[:, 0]
    spring = tiny_robot.model.tendon_damping[0] * (
        cycle.motor_velocity[:, 0] / tiny_robot.gear_ratio[0] - cycle.joint_velocity[:, 0]
    )
    expected = -(cycle.gear_torque[:-1, 0] - spring[:-1]) * slope
    np.testing.assert_allclose(left, expected, atol=1e-5)
    assert np.abs(expected).max() > 2e-3


def test_load_friction(tiny_robot, control):
    """In sliding it is the share of the gearbox's torque, against the motion, to 3 %."""
    effects = [("load_friction", 2, 0.03), ("load_friction", 2, 0.02), ("load_friction", 1, 0.05)]
    healthy = tiny_robot.model
    cycle, _ = run(tiny_robot, control, *effects)
    friction = tiny_robot.ids("actuator", "friction")
    bias, speed = healthy.actuator_biasprm[friction], cycle.motor_velocity
    own = (bias[:, COULOMB] + healthy.actuator_damping[friction] * np.abs(speed)) * np.sign(speed)
    load = np.abs(cycle.gear_torque / tiny_robot.gear_ratio)
    expected = -own - 0.05 * load * np.sign(speed)
    fast = np.abs(speed) > 4 * bias[:, STRIBECK_VELOCITY]
    for axis in range(2):
        at = fast[:, axis]
        error = np.abs(cycle.friction_torque - expected)[at, axis].max()
        assert error < 0.03 * 0.05 * load[at, axis].max(), axis
    assert np.abs(newton(tiny_robot, cycle)).max() < 1e-9


def test_load_friction_converges_with_the_square_of_the_interval(tiny_robot, control):
    """At the interval used it is within 0.5 % of its effect at every step."""
    plant = assemble(tiny_robot, [Applied("load_friction", 2, 0.05)])
    assert plant.interval == 2e-3

    def torque(entry):
        (cycle,) = simulate(tiny_robot, control, [entry], sample_period=0.004)
        return cycle.motor_torque[:, 1]

    best = torque(replace(plant, interval=STEP))
    size = np.sqrt(np.mean((best - torque(tiny_robot.model)) ** 2))
    errors = [
        np.sqrt(np.mean((torque(replace(plant, interval=h)) - best) ** 2)) / size
        for h in (2e-3, 8e-3)
    ]
    assert errors[0] < 5e-3
    assert errors[0] < errors[1] / 5


def test_temperature_friction_follows_the_law(tiny_robot):
    """Viscous friction, Stribeck height and velocity by the law's ratios to the power of share."""
    for share in (1.0, 0.5, -1.0):
        one = Applied("temperature_friction", 2, share)
        model = assemble(tiny_robot, [one], temperature=65.0).model
        healthy = tiny_robot.model
        ratios = [r**share for r in friction_ratios(65.0, 40.0)]
        k = tiny_robot.ids("actuator", "friction")[1]
        new, old = model.actuator_biasprm[k], healthy.actuator_biasprm[k]
        height = (new[STICTION] - new[COULOMB]) / (old[STICTION] - old[COULOMB])
        width = new[STRIBECK_VELOCITY] / old[STRIBECK_VELOCITY]
        damping = model.actuator_damping[k] / healthy.actuator_damping[k]
        np.testing.assert_allclose([height, width, damping], ratios, rtol=1e-12)


def test_temperature_friction_along_a_motion(tiny_robot, control):
    """Every 0.1 s friction is that of the temperature in the middle, and so is what is logged."""
    effect = ("temperature_friction", 2, 1.0)
    course = (np.array([0.0, len(control) * STEP]), np.array([35.0, 75.0]))
    cycle, plant = run(tiny_robot, control, effect, temperature=course)
    k = tiny_robot.ids("actuator", "friction")
    viscous = np.tile(tiny_robot.model.actuator_damping[k], (len(control), 1))
    (update,) = plant.updates
    for start in range(0, len(control), 100):
        fields = ("biasprm", "dynprm", "damping")
        arrays = {name: getattr(plant.model, f"actuator_{name}")[None].copy() for name in fields}
        update(Moment(start * STEP, 0.1, np.zeros(0), np.zeros(0), **arrays))
        middle = float(np.interp(start * STEP + 0.05, *course))
        model = assemble(tiny_robot, [Applied(*effect)], temperature=middle).model
        np.testing.assert_allclose(arrays["biasprm"][0], model.actuator_biasprm, rtol=1e-12)
        np.testing.assert_allclose(arrays["damping"][0], model.actuator_damping, rtol=1e-12)
        viscous[start : start + 100] = model.actuator_damping[k]
    assert np.ptp(viscous[:, 1]) > 0.2 * viscous[0, 1]
    assert np.abs(newton(tiny_robot, cycle, viscous)).max() < 1e-9


def test_a_course_of_one_temperature_is_that_temperature(tiny_robot, control):
    """Between steps or in the model: the same robot. At the reference nothing changes."""
    effect = ("temperature_friction", 1, 1.0)
    once, _ = run(tiny_robot, control, effect, temperature=60.0)
    course = (np.array([0.0, 1.0]), np.array([60.0, 60.0]))
    along, plant = run(tiny_robot, control, effect, temperature=course)
    assert len(plant.updates) == 1
    np.testing.assert_allclose(channels(along), channels(once), atol=1e-12)
    without, _ = run(tiny_robot, control, effect)
    np.testing.assert_array_equal(channels(without), channels(run(tiny_robot, control)[0]))


@pytest.mark.parametrize("ratio", [1.0, -1.0])
def test_wrist_coupling_friction(tiny_robot, control, ratio):
    """In sliding both rotors feel the torque, by the sign of the joint speeds together."""
    severity = 4.0
    effect = ("wrist_coupling_friction", 2, severity, {"ratio": ratio})
    healthy = tiny_robot.model
    cycle, _ = run(tiny_robot, control, effect)
    assert np.abs(newton(tiny_robot, cycle)).max() < 1e-9
    gears, speed = tiny_robot.gear_ratio, cycle.motor_velocity
    together = speed[:, 1] / gears[1] + ratio * speed[:, 0] / gears[0]
    friction = tiny_robot.ids("actuator", "friction")
    bias = healthy.actuator_biasprm[friction]
    own = (bias[:, COULOMB] + healthy.actuator_damping[friction] * np.abs(speed)) * np.sign(speed)
    added = cycle.friction_torque + own
    fast = (np.abs(speed) > 4 * bias[:, STRIBECK_VELOCITY]).all(axis=1) & (np.abs(together) > 0.4)
    expected = -severity * np.sign(together[:, None]) * [ratio, 1.0] / gears
    assert fast.sum() > 100
    np.testing.assert_allclose(added[fast], expected[fast], rtol=0.01)


@pytest.mark.parametrize("severity", [0.2, -0.1])
def test_torque_constant(tiny_robot, control, severity):
    """The drive logs what it means to give; the rotor gets 1 - severity of that."""
    cycle, _ = run(tiny_robot, control, ("torque_constant", 1, severity))
    np.testing.assert_allclose(cycle.motor_torque, servo(tiny_robot, cycle, control), atol=1e-9)
    left = newton(tiny_robot, cycle)
    np.testing.assert_allclose(left[:, 0], -severity * cycle.motor_torque[:-1, 0], atol=1e-9)
    assert np.abs(left[:, 1]).max() < 1e-9


def test_encoder_offset(tiny_robot, control):
    """The robot stands at the logged angle + severity, and the drive goes by the logged one."""
    offset = 0.05
    cycle, plant = run(tiny_robot, control, ("encoder_offset", 2, offset))
    np.testing.assert_allclose(cycle.motor_torque, servo(tiny_robot, cycle, control), atol=1e-9)
    twist = cycle.motor_position / tiny_robot.gear_ratio - cycle.joint_position
    gearbox = cycle.gear_torque / tiny_robot.model.tendon_stiffness
    np.testing.assert_allclose(twist[0] - gearbox[0], [0.0, -offset], atol=2e-4)
    healthy, _ = run(tiny_robot, control)
    # at rest: weight of both links about joint 2, horizontal axis, at the true angle
    lever = (1.0 * 0.1 + 0.5 * 0.2) * 9.81
    start = healthy.motor_position[0, 1] / tiny_robot.gear_ratio[1]
    change = cycle.gear_torque[0, 1] - healthy.gear_torque[0, 1]
    weight = lever * (np.cos(start + offset) - np.cos(start))
    assert change == pytest.approx(-weight, rel=0.1)


def test_delay(tiny_robot, control):
    """Rows move by whole steps, or lie in between; the axis beside keeps its own."""
    healthy = tiny_robot.model

    def told(severity, repeats):
        return assemble(tiny_robot, [Applied("delay", 2, severity)]).command(control, repeats)

    own = slice(3, 6)
    assert healthy.actuator_ctrladr[1] == 3
    late = told(5 * STEP, True)
    np.testing.assert_allclose(late[:, own], np.roll(control[:, own], 5, axis=0), atol=1e-9)
    np.testing.assert_array_equal(late[:, :3], control[:, :3])
    early = told(-2.5 * STEP, False)[:, own]
    between = (control[2:-1, own] + control[3:, own]) / 2
    np.testing.assert_allclose(early[: len(between)], between, atol=1e-9)
    np.testing.assert_array_equal(early[-3:], control[[-1] * 3, own])
    cycle, _ = run(tiny_robot, control, ("delay", 2, 5 * STEP))
    np.testing.assert_allclose(cycle.motor_torque, servo(tiny_robot, cycle, late), atol=1e-9)


NEARLY_NOTHING = [
    ("torque_ripple", 2, 1e-14),
    ("wrist_coupling_friction", 2, 1e-14),
    ("load_friction", 1, 1e-14),
    ("temperature_friction", 1, 1e-14, {"temperature": ([0.0, 1.0], [50.0, 70.0])}),
]


def test_plants_of_other_dimensions_take_the_state_over(tiny_robot, control):
    """Elements of no strength, coming and going from cycle to cycle, change next to nothing."""
    healthy = Plant(tiny_robot.model)
    plants = [healthy]
    for count in (1, 2, 4, 3):
        effects = [Applied(*effect) for effect in NEARLY_NOTHING[:count]]
        plants += [assemble(tiny_robot, effects), healthy]
    assert len({plant.model.nactuator for plant in plants}) == 4
    cycles = list(simulate(tiny_robot, control, plants, sample_period=0.004))
    expected = list(simulate(tiny_robot, control, [healthy] * len(plants), sample_period=0.004))
    for cycle, plain in zip(cycles, expected, strict=True):
        np.testing.assert_allclose(channels(cycle), channels(plain), atol=1e-8)


def test_chunks_do_not_matter_to_what_acts_between_steps(tiny_robot, control, monkeypatch):
    """However many steps are recorded at once, the result is the same, bit for bit."""
    effects = [("load_friction", 1, 0.05), ("torque_ripple", 1, 0.01)]
    whole, _ = run(tiny_robot, control, *effects, cycles=2, period=0.003)
    monkeypatch.setattr(module, "CHUNK", 84)
    parts, _ = run(tiny_robot, control, *effects, cycles=2, period=0.003)
    np.testing.assert_array_equal(channels(whole), channels(parts))


def test_divergence_between_steps_is_reported(tiny_robot, control):
    """A run with updates that blows up raises as any other does, and warns of nothing else."""
    spec = tiny_robot.spec()
    spec.tendon("gearbox2").stiffness[0] = 1e12
    plant = assemble(tiny_robot, [Applied("load_friction", 2, 0.05)], spec=spec)
    with pytest.raises(SimulationFailed, match="the simulation diverged before"):
        list(simulate(tiny_robot, control, [plant], sample_period=0.004))


@pytest.mark.parametrize(
    "robot", ["puma560", pytest.param("irb6700", marks=pytest.mark.slow)], indirect=True
)
def test_all_effects_at_once(robot):
    """Every effect on the first axis that it takes, twice, runs; the drives' ids are looked up."""
    control = control_signal(plan(load_task(robot.name, "spot_weld"), robot), 0.0005)
    effects = [
        Applied(effect.name, effect.axes(6)[0], min(0.1 * effect.step, 0.01))
        for effect in EFFECTS.values()
    ] * 2
    plant = assemble(robot, effects, temperature=([0.0, 5.0], [40.0, 50.0]))
    (cycle,) = simulate(robot, control, [plant], sample_period=0.004)
    (plain,) = simulate(robot, control, [robot.model], sample_period=0.004)
    for name in cycle.__dataclass_fields__:
        size = np.abs(getattr(plain, name)).max(axis=0)
        change = np.abs(getattr(cycle, name) - getattr(plain, name)).max(axis=0)
        assert (change < 0.5 * size).all(), name


def test_what_cannot_be_is_refused(tiny_robot, robot):
    """Axes, parameters and severities that make no sense, with the choices."""
    wrong = {
        ("torque_ripple", 3, 0.1): "axis 3: robot tiny has axes 1 to 2",
        ("wrist_coupling_friction", 1, 0.1): "wrist_coupling_friction acts on axis 2 of robot",
        ("loose_tool", 1, 0.001): "loose_tool acts on axis 2 of robot tiny",
        ("torque_constant", 1, 1.0): "severity must be below 1",
    }
    for effect, message in wrong.items():
        with pytest.raises(InputError, match=message):
            assemble(tiny_robot, [Applied(*effect)])
    for given, message in (
        ({"orders": 2}, "no parameter 'orders': choose order, phase, per"),
        ({"order": 0.0}, "order: must be positive"),
        ({"per": "link"}, "per: choose motor or joint"),
    ):
        with pytest.raises(InputError, match=message):
            assemble(tiny_robot, [Applied("torque_ripple", 1, 0.1, given)])
    assert list(get_effect("wrist_coupling_friction").axes(6)) == [5, 6]
    with pytest.raises(InputError, match="acts on axis 5, 6"):
        assemble(robot, [Applied("wrist_coupling_friction", 3, 1.0)])


def test_facts_about_effects():
    """Ranges enclose all steps and what healthy robots have; another unit is that of an effect."""
    robots = [load_robot(name) for name in ("puma560", "irb6700")]
    for effect in EFFECTS.values():
        for robot in robots:
            for axis in effect.axes(robot.n_axes):
                assert 2 * effect.prior.std_on(robot, axis) < effect.largest, effect.name
        assert effect.smallest <= 0 < effect.step < effect.largest, effect.name
        assert effect.signed == (effect.smallest < 0)
        assert not effect.same_as or effect.same_as in EFFECTS
        assert effect.edit or effect.command or effect.log or effect.between or effect.sense
        assert all(0 < step < effect.largest for step in effect.prior.steps), effect.name
    assert get_effect("brake_drag").same_as == "coulomb_friction"
    assert not get_effect("backlash").signed


@pytest.mark.parametrize("severity", [0.5, -0.4])
@pytest.mark.parametrize("name", ["quadratic_viscous_friction", "viscous_asymmetry"])
def test_friction_of_speed_is_in_the_log(tiny_robot, control, name, severity):
    """What is logged as friction is all that acts on the rotors beside drive and gearbox.

    MuJoCo applies damping at the speed after the step, and the log has the one before. The error of
    this is in proportion to the acceleration.
    """
    healthy = tiny_robot.model
    friction = tiny_robot.ids("actuator", "friction")
    cycle, _ = run(tiny_robot, control, (name, 1, severity))
    speed, step = cycle.motor_velocity[:-1, 0], np.diff(cycle.motor_velocity[:, 0])
    if name == "viscous_asymmetry":
        slope = severity * healthy.actuator_damping[friction[0]] * (speed > 0)
    else:
        coulomb = healthy.actuator_biasprm[friction[0]][COULOMB]
        slope = severity * coulomb * 2 * np.abs(speed) / 100**2
    size = np.abs(slope * speed).max()
    left = newton(tiny_robot, cycle)
    assert np.abs(left[:, 0]).max() < 1.1 * np.abs(slope * step).max() + 1e-9 < 0.02 * size
    assert np.abs(left[:, 1]).max() < 1e-9
    plain, _ = run(tiny_robot, control)
    assert np.abs(plain.friction_torque - cycle.friction_torque)[:, 0].max() > 0.4 * size
