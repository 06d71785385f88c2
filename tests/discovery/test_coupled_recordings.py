"""Recordings of robots whose gearboxes also turn with other joints."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery import Recording, write_recording
from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.discover import Discovery
from faultgen.discovery.inputs import read_together, usable
from faultgen.discovery.replay.replay import Replay
from faultgen.effects import Applied
from faultgen.errors import InputError
from faultgen.robot import COULOMB, Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task
from faultgen.twin.make import make_twin

SHARE = 0.5
"""Turns of the second gearbox for one turn of joint 1."""

MOTION = """
description = "both axes at several speeds"
[start]
joints = [0, 0]
""" + "".join(
    f"[[move]]\njoints = [{a}, {b}]\nspeed = {speed}\ndwell = 0.2\n"
    for a, b, speed in [
        (60, 50, 1.0), (-60, 0, 0.6), (20, -60, 0.3), (-30, 40, 0.8), (50, 10, 0.15), (0, 0, 0.5),
        (-50, 60, 0.2), (40, -40, 0.9), (-20, 20, 0.1), (0, 0, 0.7),
    ]
)  # fmt: skip


@pytest.fixture(scope="module")
def robot(tiny_robot):
    third = f'<joint joint="joint2" coef="-1"/><joint joint="joint1" coef="{-SHARE}"/></fixed>'
    return Robot("tiny", tiny_robot.xml.replace('<joint joint="joint2" coef="-1"/></fixed>', third))


@pytest.fixture(scope="module")
def record(robot, tmp_path_factory):
    """Function that records the motors of the robot with effects."""
    path = tmp_path_factory.mktemp("coupled") / "motion.toml"
    path.write_text(MOTION)
    motion = plan(load_task("tiny", str(path)), robot)
    control = control_signal(motion, robot.model.opt.timestep)

    def made(effects, seed):
        (run,) = simulate(robot, control, [assemble(robot, effects)], sample_period=0.004)
        noise = np.random.default_rng(seed).standard_normal(run.motor_torque.shape)
        size = 0.01 * np.abs(run.motor_torque).mean(axis=0)
        return Recording(
            source=f"run {seed}",
            robot="tiny",
            side="motor",
            sample_period=0.004,
            position=run.motor_position,
            velocity=run.motor_velocity,
            torque=run.motor_torque + size * noise,
            reference_position=motion(np.arange(len(noise)) * 0.004)[0],
        )

    return made


def on_joints(recording, robot):
    """The same recording as the joints see it: q_1, q_2 and the torques that do the same work."""
    turns = np.array([[1.0, 0.0], [SHARE, 1.0]])  # of the gearboxes for turns of the joints
    n = robot.gear_ratio
    back = np.linalg.inv(turns).T
    return replace(
        recording,
        side="joint",
        position=recording.position / n @ back,
        velocity=recording.velocity / n @ back,
        torque=recording.torque * n @ turns,
    )


def test_joints_are_converted_to_motors(robot, record, tmp_path):
    """Read from a file, it is again what the motors did; power is the same on both sides."""
    motors = record([], 1)
    joints = on_joints(motors, robot)
    power = [np.sum(one.torque * one.velocity, axis=1) for one in (motors, joints)]
    np.testing.assert_allclose(power[1], power[0], atol=1e-9 * np.abs(power[0]).max())
    write_recording(joints, tmp_path / "joints.h5")
    read, warnings = usable(tmp_path / "joints.h5", robot)
    assert read.side == "motor" and not warnings
    for name in ("position", "velocity", "torque"):
        np.testing.assert_allclose(getattr(read, name), getattr(motors, name), rtol=0, atol=1e-9)
    np.testing.assert_allclose(read.joint_position(robot), joints.position, atol=1e-12)


def test_lost_samples_of_a_joint_spoil_both_motors(robot, record):
    joints = on_joints(record([], 1), robot)
    lost = np.zeros(joints.position.shape, bool)
    lost[7, 0] = lost[9, 1] = True
    motors = replace(joints, lost=lost).on_motor_side(robot)
    assert motors.lost[[7, 9]].tolist() == [[True, True], [True, True]]  # the second by its torque
    assert motors.lost.sum() == 4


@pytest.mark.slow
@pytest.mark.parametrize(("baseline", "severity"), [(True, 0.4), (False, 1.5)])
def test_a_hidden_effect_is_named(robot, record, baseline, severity, tmp_path):
    """From logs of the joints: more Coulomb friction on the coupled axis.

    Against a model alone, friction of these two axes that is twice as large may still be the
    model's error.
    """
    worn = record([Applied("coulomb_friction", 2, severity)], 2)
    for name, one in (("worn", worn), ("healthy", record([], 3))):
        write_recording(on_joints(one, robot), tmp_path / f"{name}.h5")
    healthy = [tmp_path / "healthy.h5"] if baseline else []
    given = read_together([tmp_path / "worn.h5"], robot, healthy)
    told = Discovery(robot, laws=False).fit(given.recording, given.runs).answer_
    assert [(one.effect, one.axis) for one in told.effects] == [("coulomb_friction", 2)]
    assert told.effects[0].severity == pytest.approx(severity, rel=0.1)
    assert told.after < 1.2 * told.floor < told.before


def test_the_measured_motion_is_followed(robot, record):
    """Without commanded positions, the replay reaches the torque that was measured."""
    recording = replace(record([], 4), reference_position=None)
    replay = Replay(recording, robot)
    error = (replay.torque() - recording.torque)[50:-50]
    assert np.sqrt(np.mean(error**2) / np.mean(recording.torque**2)) < 0.05


@pytest.mark.slow
def test_friction_is_calibrated(robot, record):
    recording = record([Applied("coulomb_friction", 2, 0.5)], 5)
    made = calibrate(recording, robot).robot
    friction = made.model.actuator_biasprm[made.ids("actuator", "friction"), COULOMB]
    np.testing.assert_allclose(friction, [0.2, 0.15], rtol=0.02)


def test_load_friction_follows_the_torque_of_the_gearbox(robot, record):
    """In sliding, the motor's torque rises by the share of the rigid arm's torque."""
    healthy, worn = (record(one, 6) for one in ([], [Applied("load_friction", 2, 0.2)]))
    q = worn.reference_position
    q, qd, qdd = worn.derivatives(q)
    arm = Arm(robot)
    load = robot.gearing.torque(arm.inverse_dynamics(q, qd, qdd))[:, 1] / robot.gear_ratio[1]
    speed = robot.gearing.outputs(qd)[:, 1] * robot.gear_ratio[1]
    fast = np.abs(speed) > 60
    assert fast.sum() > 500
    change = (worn.torque - healthy.torque)[fast, 1]  # both have the same noise
    expected = (0.2 * np.abs(load) * np.sign(speed))[fast]
    assert np.sqrt(np.mean((change - expected) ** 2)) < 0.1 * np.sqrt(np.mean(expected**2))


def test_what_cannot_be_converted_is_refused(robot, record, tmp_path):
    """A torque sensor behind the gearbox, and a baseline."""
    joints = on_joints(record([], 1), robot)
    with pytest.raises(InputError, match="only the torque of the motors can be compared"):
        replace(joints, link=True).on_motor_side(robot)
    write_recording(joints, tmp_path / "one.h5")
    robot.write(tmp_path / "model")
    with pytest.raises(InputError, match="gearbox2 also turns with another joint"):
        make_twin([tmp_path / "one.h5"], tmp_path / "model", tmp_path / "out")
