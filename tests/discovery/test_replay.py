"""Recorded motions, simulated again."""

from dataclasses import replace

import numpy as np
import pytest
from replayed import replay
from scipy.signal import lfilter

from faultgen.discovery import Recording, Replay, settled
from faultgen.discovery.replay import followed
from faultgen.discovery.replay.prescribed import prescribed
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.effects import get_effect
from faultgen.effects.coupling import add_coupling_friction
from faultgen.mjcf.rotors import nest_rotor
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

PERIOD = 0.004


def recorded(robot, task, effects=()):
    """Two cycles of a robot with effects, without noise, as two separate recordings."""
    motion = plan(load_task(robot.name, task), robot)
    control = control_signal(motion, robot.model.opt.timestep)
    spec = robot.spec()
    for name, axis, severity in effects:
        get_effect(name).apply(spec, axis, severity)
    (run,) = simulate(robot, control, [spec.compile()], sample_period=PERIOD)
    times = np.arange(len(run.motor_torque)) * PERIOD
    return Recording(
        source="simulated",
        robot=robot.name,
        side="motor",
        sample_period=PERIOD,
        position=np.vstack([run.motor_position] * 2),
        torque=np.vstack([run.motor_torque] * 2),
        reference_position=np.vstack([motion(times)[0]] * 2),
        segments=(0, len(times)),
    )


def soft(robot):
    """The same robot with a servo whose gains are a tenth."""
    spec = robot.spec()
    for axis in range(1, robot.n_axes + 1):
        gains = spec.actuator(f"drive{axis}").gainprm
        gains[4:7] /= 10  # kp, ki, kd of a dcmotor
    return Robot(robot.name, spec.to_xml())


def gap(recording, robot, effects=()):
    """RMS torque error over RMS torque, after settling, of each axis."""
    inside = settled(recording, robot)
    error = np.where(inside, recording.torque - replay(recording, robot, effects), 0.0)
    torque = np.where(inside, recording.torque, 0.0)
    return np.sqrt(np.sum(error**2, axis=0) / np.sum(torque**2, axis=0))


def with_shared_wrist(robot):
    """The same robot with friction and inertia that axes 4 and 5 share."""
    spec = robot.spec()
    add_coupling_friction(spec, 5, 0.5, ratio=1.0)
    spec.tendon("wrist_coupling5").armature = 0.05
    spec.actuator("wrist_coupling5").damping = [0.5, 0.0, 0.0]
    nest_rotor(spec, 5)
    return Robot(robot.name, spec.to_xml())


@pytest.mark.parametrize(
    ("name", "shared"), [("puma560", False), ("irb6700", False), ("puma560", True)]
)
def test_positions_alone_tell_what_torque_another_servo_gave(name, shared):
    """A simulation with a servo of a tenth of the gains gives torque and positions of the rotors.

    The torque is found again from the positions, although the gearboxes oscillate.
    """
    robot = load_robot(name)
    robot = with_shared_wrist(robot) if shared else robot
    other = soft(robot)
    motion = plan(load_task(name, "pick_and_place"), robot)
    timestep = robot.model.opt.timestep
    control = control_signal(motion, timestep)
    (run,) = simulate(other, control, [assemble(other)], sample_period=timestep, lead_in=0.0)
    found = prescribed(robot, assemble(robot), run.motor_position).motor_torque
    late = slice(round(0.3 / timestep), -2)
    error = (found - run.motor_torque)[late]
    assert np.all(np.std(error, axis=0) < 0.005 * np.std(run.motor_torque[late], axis=0))


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (("friction_wear", 1, 0.3),),
        (("torque_offset", 2, 0.05), ("rotor_inertia", 1, 0.5)),
    ],
)
def test_a_replay_has_the_torque_of_the_recording(tiny_robot, tiny_task_path, effects):
    """With the effects in the model 2 % of the torque are left at most, without them far more."""
    recording = recorded(tiny_robot, tiny_task_path, effects)
    assert gap(recording, tiny_robot, effects).max() < 0.02
    for _, axis, _ in effects:
        assert gap(recording, tiny_robot)[axis - 1] > 0.05


def test_a_replay_of_an_industrial_robot():
    """The PUMA in pick and place."""
    from faultgen.robot import load_robot

    robot = load_robot("puma560")
    recording = recorded(robot, "pick_and_place", (("coulomb_friction", 3, 0.2),))
    left = gap(recording, robot, (("coulomb_friction", 3, 0.2),))
    assert left.max() < 0.02
    assert gap(recording, robot)[2] > 3 * left[2]


def test_joint_side_and_no_reference(tiny_robot, tiny_task_path):
    """Joint side is motor side times the gear ratio; measured positions can stand in."""
    recording = recorded(tiny_robot, tiny_task_path)
    ratio = tiny_robot.gear_ratio
    joint = replace(
        recording,
        side="joint",
        position=recording.position / ratio,
        torque=recording.torque * ratio,
    )
    motor = replay(recording, tiny_robot)
    np.testing.assert_allclose(replay(joint, tiny_robot), motor * ratio, rtol=1e-12)
    for one in (recording, joint):  # the positions, too, within 1 mrad of the joint
        reached = Replay(one, tiny_robot).position()
        turns = ratio if one.side == "motor" else 1.0
        np.testing.assert_allclose(reached / turns, joint.position, atol=1e-3)
    assert gap(replace(recording, reference_position=None), tiny_robot).max() < 0.1


def test_axes_count_from_when_they_have_turned(tiny_robot):
    """Not at rest, and not before the settling; in every part anew; never if they do not turn."""
    position = np.zeros((400, 2))
    position[50:200, 0] = position[300:, 0] = 1.0
    recording = Recording(
        source="",
        robot="tiny",
        side="motor",
        sample_period=0.01,
        position=position,
        torque=0 * position,
        segments=(0, 200),
    )
    inside = settled(recording, tiny_robot)
    assert np.flatnonzero(np.diff(inside[:, 0].astype(int))).tolist() == [79, 199, 329]
    assert not inside[:, 1].any()


def test_the_servo_of_the_robot_does_not_matter(tiny_robot, tiny_task_path):
    """A robot with a soft servo moves otherwise than was commanded, and its torque is explained."""
    other = recorded(soft(tiny_robot), tiny_task_path)
    inside = settled(other, tiny_robot)
    error, commanded = (
        relative_error((other.torque - one.torque()) ** 2, other, inside)
        for one in (Replay(other, tiny_robot), Replay(other, tiny_robot, measured=False))
    )
    assert error < 0.02 and error < 0.2 * commanded


def test_a_noisy_position_is_followed_without_its_noise(tiny_robot, tiny_task_path):
    """An encoder of 4096 counts, and no commanded positions: most of the torque is right."""
    recording = recorded(tiny_robot, tiny_task_path)
    count = 2 * np.pi / 4096
    counted = replace(
        recording,
        position=np.round(recording.position / count) * count,
        reference_position=None,
    )
    suited = Replay(counted, tiny_robot)
    inside = settled(recording, tiny_robot)
    assert relative_error((recording.torque - suited.torque()) ** 2, recording, inside) < 0.1


def test_samples_that_are_late_by_different_times_are_smoothed_more(
    tiny_robot, tiny_task_path, monkeypatch
):
    """Their noise is not white, so that the torque has to tell how much is smoothed."""
    clean = recorded(tiny_robot, tiny_task_path)
    rng = np.random.default_rng(3)
    late = lfilter([1.0], [1.0, -0.8], 2e-4 * rng.standard_normal(len(clean.position)))  # [s]
    speed = np.gradient(clean.position, PERIOD, axis=0)
    noisy = replace(clean, position=clean.position + speed * late[:, None], reference_position=None)

    def error():
        torque = Replay(replace(noisy), tiny_robot).torque()  # which was not smoothed before
        return relative_error((noisy.torque - torque) ** 2, noisy, settled(clean, tiny_robot))

    more = error()
    monkeypatch.setattr(followed, "STRONGER", (0.0,))
    assert more < 0.5 * error()
