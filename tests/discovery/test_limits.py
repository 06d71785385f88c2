"""Limits of a model that a real robot exceeds are raised, and nothing else is."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import faultgen_here

from faultgen.discovery.calibration.limits import with_limits_for, with_limits_of
from faultgen.errors import InputError
from faultgen.recordings.recorded_task import recorded_task
from faultgen.recordings.recording import write_recording
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task


def with_text(robot, folder, *changes):
    """The robot with other text in its MJCF file, from this file."""
    text = robot.xml
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "tight.xml"
    path.write_text(text)
    return load_robot(str(path))


@pytest.fixture
def top(measured):
    """Largest measured torque of each motor [N m]."""
    return np.quantile(np.abs(measured([], 1).torque), 0.999, axis=0)


def test_torques_that_a_drive_does_not_have(measured, tiny_robot, tmp_path, top):
    """One limit is 20 % too small; noise reaches 5 % beyond the other."""
    tight = [f'saturation="{top[0] / 1.2:.5g} 0 0"', f'saturation="{top[1] / 1.05:.5g} 0 0"']
    changes = zip(('saturation="3 0 0"', 'saturation="2 0 0"'), tight, strict=True)
    robot = with_text(tiny_robot, tmp_path, *changes)
    for recording in (measured([], 1), as_joint_side(measured([], 1), robot)):
        wide, (line,) = with_limits_of([recording], robot)
        assert line == (
            "axis 1 needs 1.2 times the torque that its drive has in the model in the recordings: "
            "the limit is raised"
        )
        assert wide.motor_torque_limit == pytest.approx([1.2 * top[0], top[1] / 1.05], rel=1e-4)
        assert with_limits_of([recording], wide) == (wide, [])
    assert with_limits_of([measured([], 1)], tiny_robot) == (tiny_robot, [])


def as_joint_side(recording, robot):
    """The same recording with the positions and torques of the joints."""
    return replace(
        recording,
        side="joint",
        position=recording.joint_position(robot),
        torque=recording.torque * robot.gear_ratio,
    )


def test_positions_beyond_the_range(measured, tiny_robot, tmp_path):
    """The stop of a simulated joint would push back."""
    recording = measured([], 1)
    least, most = np.percentile(recording.joint_position(tiny_robot)[:, 0], (0, 100))
    narrow = f'axis="0 0 1" range="{least - 0.5:.5g} {most - 0.01:.5g}"'
    robot = with_text(tiny_robot, tmp_path, ('axis="0 0 1" range="-3 3"', narrow))
    wide, (line,) = with_limits_of([recording], robot)
    assert line.startswith("axis 1 leaves its range in the model in the recordings: the range is ")
    assert wide.joint_range[0, 0] == pytest.approx(least - 0.5, abs=1e-4)
    assert most < wide.joint_range[0, 1] < most + 0.05 * (most - least)
    assert wide.joint_range[1].tolist() == [-3, 3]


def test_a_recorded_motion_beyond_the_model(measured, tiny_robot, tmp_path, top):
    """With raised limits of torque and speed, the motion that was refused is planned."""
    changes = (
        ('saturation="3 0 0"', f'saturation="{top[0] / 3:.5g} 0 0"'),
        ('name="motor_velocity_limit" data="300 300"', 'name="motor_velocity_limit" data="300 5"'),
    )
    robot = with_text(tiny_robot, tmp_path, *changes)
    text = recorded_task(measured([], 1), tiny_robot, "own")
    task = load_task("tight", "own", {"own": text.replace('"tiny"', '"tight"')})
    with pytest.raises(InputError, match="correct this limit of the model"):
        plan(task, robot)
    wide, lines = with_limits_for(task, robot)
    assert [line.split()[1] for line in lines] == ["1", "2"]
    assert "times the torque that its drive has in the model on the recorded motion" in lines[0]
    assert "motor_velocity_limit allows: the limit is raised" in lines[1]
    assert plan(task, wide).period > 1
    assert wide.motor_velocity_limit[0] == 300 and wide.motor_velocity_limit[1] > 5


@pytest.mark.slow
def test_a_tight_limit_is_no_fault(measured, tiny_robot, tmp_path, top):
    """A healthy robot beside a model with too small a drive is healthy, and the user is told."""
    tight = f'saturation="{top[1] / 1.6:.5g} 0 0"'
    with_text(tiny_robot, tmp_path, ('saturation="2 0 0"', tight))
    write_recording(measured([], 1), tmp_path / "new.h5")
    words = ["discover", tmp_path / "new.h5", "--robot", tmp_path / "tight.xml"]
    done = faultgen_here(*words, "-o", tmp_path / "found", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["verdict"], found["effects"]) == ("no missing effect", [])
    assert found["gap"]["before"] < 0.02
    assert any("axis 2 needs 1.6 times the torque" in line for line in found["warnings"])
