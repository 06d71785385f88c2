"""A recorded motion becomes a task that a robot can repeat."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import record

from faultgen.errors import InputError
from faultgen.recordings.recorded_task import known_task, recorded_task
from faultgen.recordings.recording import write_recording
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task


@pytest.fixture(scope="module")
def recording(tiny_robot, tiny_task_path):
    return record(tiny_robot, tiny_task_path, seed=1)


def planned(text, robot, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(text)
    return plan(load_task("tiny", path), robot)


def cut(recording, *parts):
    """Parts of a recording as separate recordings."""
    rows = np.concatenate([np.arange(a, b) for a, b in parts])
    starts = np.cumsum([0, *[b - a for a, b in parts[:-1]]])
    return replace(
        recording,
        position=recording.position[rows],
        torque=recording.torque[rows],
        reference_position=recording.reference_position[rows],
        segments=tuple(starts.tolist()),
    )


def test_the_task_repeats_the_recorded_motion(recording, tiny_robot, tmp_path):
    """Planned positions are the commanded ones, and the cycle ends where it began."""
    motion = planned(recorded_task(recording, tiny_robot, "own"), tiny_robot, tmp_path)
    times = np.arange(len(recording.torque)) * 0.004
    assert np.abs(motion(times)[0] - recording.reference_position).max() < 1e-3
    q, qd, _ = motion(np.array([0.0, motion.period - 1e-6]))
    assert np.abs(q[1] - q[0]).max() < 1e-5 and np.abs(qd).max() < 1e-3


def test_an_open_motion_is_closed_and_ramped(recording, tiny_robot, tmp_path):
    """A piece cut out while the robot moves begins and ends at rest, and leads back."""
    middle = len(recording.torque) // 4
    part = cut(recording, (middle - 60, middle + 60))
    motion = planned(recorded_task(part, tiny_robot, "own"), tiny_robot, tmp_path)
    assert motion.task.move[0].path == "sampled" and motion.task.move[-1].path == "joint"
    # the recorded piece is in it, after the ramp
    fine = motion(np.arange(0, motion.period, 0.004))[0]
    apart = np.abs(fine[:, None] - part.reference_position[None, 30]).max(axis=2).min()
    assert apart < 5e-3
    # no jump of position or speed where the parts meet
    _, qd, qdd = motion(np.arange(0, motion.period, 0.001))
    assert np.abs(np.diff(qd, axis=0)).max() < 0.001 * 1.5 * np.abs(qdd).max()


def test_repeated_motions_occur_once(recording, tiny_robot):
    """Separate recordings of one motion are one sampled path; different ones follow each other."""
    count = len(recording.torque)
    twice = cut(recording, (0, count), (0, count))
    assert recorded_task(twice, tiny_robot, "own").count("sampled") == 1
    halves = cut(recording, (0, count // 2), (count // 2, count))
    assert recorded_task(halves, tiny_robot, "own").count("sampled") == 2


def test_without_commands_the_measured_motion_is_smoothed(recording, tiny_robot, tmp_path):
    """Noise of the encoder does not become acceleration."""
    rng = np.random.default_rng(0)
    noisy = replace(
        recording,
        position=recording.position + 0.005 * rng.standard_normal(recording.position.shape),
        reference_position=None,
    )
    motion = planned(recorded_task(noisy, tiny_robot, "own"), tiny_robot, tmp_path)
    times = np.arange(0, len(recording.torque) * 0.004 - 0.1, 0.004)
    wanted = planned(recorded_task(recording, tiny_robot, "own"), tiny_robot, tmp_path)
    assert np.abs(motion(times)[0] - wanted(times)[0]).max() < 0.02
    assert np.abs(motion(times)[2]).max() < 3 * np.abs(wanted(times)[2]).max()


def test_a_motion_beyond_a_limit_names_axis_and_limit(recording, tiny_robot, tmp_path):
    text = recorded_task(recording, tiny_robot, "own")
    tight = replace(tiny_robot, xml=tiny_robot.xml.replace('data="300 300"', 'data="300 20"'))
    with pytest.raises(InputError, match="axis 2 is faster than motor_velocity_limit"):
        planned(text, tight, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sample_period = ", "duration = ", "needs 'samples' and 'sample_period'"),
        ('path = "sampled"', 'path = "joint"', 'only path = "sampled" has'),
    ],
)
def test_wrong_sampled_paths_are_refused(recording, tiny_robot, tmp_path, old, new, message):
    text = recorded_task(recording, tiny_robot, "own").replace(old, new)
    with pytest.raises(InputError, match=message):
        planned(text, tiny_robot, tmp_path)


def test_a_task_of_the_robot_is_recognised(recording, tiny_robot):
    """Another recording of the same motion finds the task; another motion does not."""
    text = recorded_task(recording, tiny_robot, "own")
    robot = replace(tiny_robot, tasks={"own": text})
    assert known_task(recording, robot) == "own"
    assert known_task(cut(recording, (0, len(recording.torque) // 2)), robot) is None


def test_hashes_of_other_tasks_are_what_they_were():
    """Runs of tasks without samples keep their ids and seeds."""
    assert load_task("puma560", "pick_and_place").sha256.startswith("d48ce8af114a")
    assert load_task("irb6700", "spot_weld").sha256.startswith("71026ec88bb3")


@pytest.mark.slow
def test_generate_takes_the_motion_of_a_recording(
    recording, tiny_robot_path, tmp_path, monkeypatch
):
    """--task-from writes the task into the dataset's folder; wrong uses are one clear line."""
    from conftest import faultgen

    write_recording(recording, tmp_path / "healthy.h5")
    flags = ["generate", "--robot", tiny_robot_path, "--task-from", tmp_path / "healthy.h5"]
    more = ["--axis", "1", "--cycles", "2", "--repetitions", "1", "-o", tmp_path / "out"]
    done = faultgen(*flags, *more)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "tasks" / "healthy.toml").is_file()
    assert "2 runs" in done.stdout
    wrong = faultgen(*flags, *more, "--task", "swing")
    assert wrong.returncode == 2 and "--task-from needs one --robot" in wrong.stderr
