"""The servo of a robot, found from its set points, its motion and its torque."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import PERIOD, record_cycle

from faultgen.applied import Applied
from faultgen.discovery import Recording
from faultgen.discovery.replay.own_servo import with_own_servo
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.servo_faults import find_servo_faults
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.errors import InputError
from faultgen.mjcf.dcmotor import INTEGRAL_GAIN, OFFSET, POSITION_GAIN, VELOCITY_GAIN, set_servo
from faultgen.simulation.arm import Arm, motor_torque, nominal_friction
from faultgen.simulation.servo import feed_forward

SIX_HERTZ = 2 * np.pi * 6


def gains_of(robot):
    drives = robot.ids("actuator", "drive")
    return robot.model.actuator_gainprm[drives][:, [POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN]]


def with_servo(robot, *, points, friction=(1.0, 1.0), integral=0.0, gains="own"):
    """The same robot with another servo; `integral` [1/s] times kp is the gain of the integral."""
    spec = robot.spec()
    for name, values in (("servo_set_points", points), ("servo_friction", friction)):
        spec.add_numeric(name=name, data=list(values), size=len(values))
    own = gains_of(robot)
    for axis in range(robot.n_axes):
        kp, _, kd = own[axis]
        if gains == "soft":
            kd = 0.6 * kd
            kp = kd * SIX_HERTZ / 1.8
        set_servo(spec.actuator(f"drive{axis + 1}"), kp, integral * kp, kd)
    spec.compile()
    return robot.edited(spec)


@pytest.mark.parametrize(
    "servo",
    [
        {"points": (1, 0, 0), "gains": "soft"},
        {"points": (1, 1, 1), "integral": 5.0, "gains": "soft"},
        {"points": (1, 1, 1), "friction": (1.0, 0.5)},
        pytest.param(
            {"points": (1, 1, 1), "friction": (0.0, 1.0), "gains": "soft"}, marks=pytest.mark.slow
        ),
    ],
    ids=["position only", "integral", "friction in advance", "no friction in advance"],
)
def test_another_servo_is_identified(puma, servo):
    robot = with_servo(puma, **servo)
    recording = record_cycle(robot)
    found, told = with_own_servo(recording, puma)
    assert np.array_equal(found.set_points, robot.set_points)
    if servo["points"][2]:
        assert np.allclose(found.servo_friction[0], robot.servo_friction[0])
    if "friction" in servo and servo["friction"][0]:
        assert np.array_equal(found.servo_friction, robot.servo_friction)
    assert np.allclose(gains_of(found), gains_of(robot), rtol=0.1)
    assert ("PID" if "integral" in servo else "PD") in told
    inside = settled(recording, puma)

    def error(model):
        torque = Replay(recording, model, measured=False).torque()
        return relative_error((recording.torque - torque) ** 2, recording, inside)

    assert error(found) < 0.03 and error(found) < 0.5 * error(puma)
    # what was found is all: the model needs no other servo any more
    assert with_own_servo(recording, found)[0] is found


def test_the_servo_of_the_model_is_kept(puma):
    """Also of a robot with heavier links and more friction, which do not matter."""
    changed = (Applied("payload_mass", 6, 0.5), Applied("coulomb_friction", 2, 0.4))
    for recording in (record_cycle(puma), record_cycle(puma, changed)):
        assert with_own_servo(recording, puma) == (puma, "")


def test_without_what_the_equation_needs_nothing_is_found(puma):
    recording = record_cycle(with_servo(puma, points=(1, 0, 0)))
    assert with_own_servo(recording, puma)[1]
    assert with_own_servo(replace(recording, reference_position=None), puma) == (puma, "")
    assert with_own_servo(replace(recording, link=True), puma) == (puma, "")


def test_torque_that_no_servo_makes_is_left_alone(puma):
    recording = record_cycle(puma)
    strange = np.cumsum(np.random.default_rng(0).standard_normal(recording.torque.shape), axis=0)
    assert with_own_servo(replace(recording, torque=strange), puma) == (puma, "")


def test_a_late_axis_is_no_other_servo(puma):
    """Without a healthy recording, the gains must not take in the delay of one axis."""
    robot = with_servo(puma, points=(1, 1, 1), friction=(1.0, 0.5))
    recording = record_cycle(robot, [Applied("delay", 3, 2e-3)])
    found, _ = with_own_servo(recording, puma)
    assert np.array_equal(gains_of(found), gains_of(puma))
    delays = find_servo_faults(recording, found)
    (late,) = delays.faults
    assert late.axis == 3 and late.severity == pytest.approx(2e-3, rel=0.1)
    assert delays.are_all


def test_the_integral_holds_the_load_from_the_start(puma):
    """A robot at rest neither sags nor rises, and its motors bear the weight and the asymmetry."""
    robot = with_servo(puma, points=(1, 1, 0), integral=5.0)
    still = np.tile(np.radians([0, 20, -100, 0, 30, 0]), (250, 1))
    replayed = Replay(Recording.planned(robot, [still], PERIOD), robot, measured=False)
    load = motor_torque(Arm(robot), still[:1], 0 * still[:1], 0 * still[:1])[0]
    torque, position = replayed.torque(), replayed.position()
    asymmetry = puma.model.actuator_biasprm[puma.ids("actuator", "friction"), OFFSET]
    assert np.allclose(np.abs(torque - load), np.abs(asymmetry), atol=1e-3 * np.abs(load).max())
    assert np.abs(position - position[0]).max() < 1e-3


def test_friction_within_the_feed_forward_torque(puma):
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 20, puma.n_axes))
    qd *= 0.02  # about the Stribeck velocity
    rigid = motor_torque(Arm(puma), q, qd, qdd)
    speed = qd * puma.gear_ratio
    own = nominal_friction(puma, speed)
    none = with_servo(puma, points=(1, 1, 1), friction=(0.0, 1.0))
    assert np.allclose(feed_forward(Arm(none), q, qd, qdd), rigid - own)
    sharp = with_servo(puma, points=(1, 1, 1), friction=(1.0, 0.5))
    bias = puma.model.actuator_biasprm[puma.ids("actuator", "friction")]
    step = bias[:, 3] * (np.tanh(2 * speed / bias[:, 5]) - np.tanh(speed / bias[:, 5]))
    step -= bias[:, 0] * (
        np.abs(np.tanh(2 * speed / bias[:, 5])) - np.abs(np.tanh(speed / bias[:, 5]))
    )
    assert np.allclose(feed_forward(Arm(sharp), q, qd, qdd), rigid + step)


def test_a_step_without_width_is_refused(puma):
    with pytest.raises(InputError, match="servo_friction: its second number must be positive"):
        with_servo(puma, points=(1, 1, 1), friction=(1.0, 0.0))
