import numpy as np
import pytest

from faultgen.effects import EFFECTS, get_effect, set_temperature
from faultgen.errors import InputError
from faultgen.motion import plan
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY
from faultgen.servo import control_signal
from faultgen.simulate import simulate
from faultgen.tasks import load_task


def fields(model):
    """Every numeric array of a model, by name."""
    named = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: value for name, value in named.items() if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))
def test_severity_zero_leaves_the_model_as_it_is(robot, effect):
    """At severity 0 every field of the compiled model is that of the healthy one, bit for bit."""
    spec = robot.spec()
    for axis in range(1, 7):
        effect.apply(spec, axis, 0.0)
    healthy, worn = fields(robot.model), fields(spec.compile())
    for name, value in healthy.items():
        assert np.array_equal(value, worn[name], equal_nan=True), name


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))
def test_a_worn_axis_is_the_only_one_that_changes(robot, effect):
    """Severity 0.5 on axis 3 changes friction3 and no other actuator."""
    spec = robot.spec()
    effect.apply(spec, 3, 0.5)
    worn, ids = spec.compile(), robot.ids("actuator", "friction")
    changed = (worn.actuator_biasprm != robot.model.actuator_biasprm).any(axis=1)
    changed |= worn.actuator_damping != robot.model.actuator_damping
    assert list(np.flatnonzero(changed)) == [ids[2]]


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))
def test_effects_show_in_the_motor_torque(tiny_robot, tiny_task_path, effect):
    """Every effect changes the simulated motor torque, and severity 0 does not change a bit."""
    motion = plan(load_task("tiny", tiny_task_path), tiny_robot)
    control = control_signal(motion, tiny_robot.model.opt.timestep)
    torque = {}
    for severity in (None, 0.0, 0.3):
        spec = tiny_robot.spec()
        if severity is not None:
            effect.apply(spec, 1, severity)
        cycles = list(simulate(tiny_robot, control, [spec.compile()] * 2, sample_period=0.004))
        torque[severity] = cycles[1].motor_torque
    np.testing.assert_array_equal(torque[None], torque[0.0])
    assert np.abs(torque[0.3] - torque[0.0])[:, 0].max() > 1e-3


def curve(model, actuator, speed):
    """Stribeck curve plus viscous friction as the thesis writes it, eq. 6.3, exponent 2."""
    bias = model.actuator_biasprm[actuator]
    static = bias[STICTION] - bias[COULOMB]
    sliding = bias[COULOMB] + static * np.exp(-((speed / bias[STRIBECK_VELOCITY]) ** 2))
    return sliding + model.actuator_damping[actuator] * speed


def test_growth_is_that_of_equation_6_3(robot):
    """Each effect scales its own term of the friction curve, at every speed."""
    speed = np.linspace(0, 400, 50)
    axis, s = 2, 0.3
    actuator = robot.ids("actuator", "friction")[axis - 1]
    bias = robot.model.actuator_biasprm[actuator]
    before = curve(robot.model, actuator, speed)
    viscous = robot.model.actuator_damping[actuator] * speed
    coulomb = np.full_like(speed, bias[COULOMB])
    growth = {
        "friction_wear": s * (before - viscous),
        "coulomb_friction": s * coulomb,
        "static_friction": s * (before - viscous - coulomb),
        "viscous_friction": s * viscous,
    }
    for name, expected in growth.items():
        spec = robot.spec()
        get_effect(name).apply(spec, axis, s)
        after = curve(spec.compile(), actuator, speed)
        np.testing.assert_allclose(after - before, expected, atol=1e-12, err_msg=name)


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


def test_unknown_effects_are_refused_with_the_choices():
    """The message names the effects that there are."""
    with pytest.raises(InputError, match="unknown effect 'rust': choose healthy, friction_wear"):
        get_effect("rust")
