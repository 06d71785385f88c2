"""What a twin learns from healthy recordings."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import faultgen
from recorded import NOISE, record

from faultgen.discovery.replay.replay import Replay
from faultgen.errors import InputError
from faultgen.monitoring.sensors import get_sensors
from faultgen.recordings.read import read_recording
from faultgen.recordings.recording import write_recording
from faultgen.robot import load_robot
from faultgen.twin.alignment import KnownMotion, find_cycles
from faultgen.twin.columns import Fault, Generated
from faultgen.twin.disturbances import run_differences, torque_noise_of
from faultgen.twin.likeness import likeness
from faultgen.twin.make import furnish, make_twin
from faultgen.twin.train import learn

RUNS = 4


@pytest.fixture(scope="module")
def recordings(tiny_robot, tiny_task_path):
    return [record(tiny_robot, tiny_task_path, seed) for seed in range(1, RUNS + 1)]


@pytest.fixture(scope="module")
def known(recordings, tiny_robot):
    first = recordings[0]
    return KnownMotion(
        path=first.position / tiny_robot.gear_ratio,
        stretches=((0, len(first.position)),),
        sample_period=0.004,
        gear_ratio=tiny_robot.gear_ratio,
    )


def test_a_seed_below_0_is_refused_first(tmp_path):
    with pytest.raises(InputError, match="seed: must be at least 0, not -1"):
        make_twin(["nowhere.h5"], "puma560", tmp_path / "twin", seed=-1)
    assert not (tmp_path / "twin").exists()


def test_a_cycle_is_found_where_it_is(recordings, known):
    """A recording that begins later, or holds two cycles, gives the torque of the same places."""
    one = recordings[0]
    (whole,) = find_cycles(one, known)
    assert np.allclose(whole, one.torque)
    count = len(one.torque)
    rows = np.r_[np.zeros(40, int), np.arange(count), np.arange(count), np.full(30, count - 1)]
    twice = replace(one, position=one.position[rows], torque=one.torque[rows])
    cycles = find_cycles(twice, known)
    assert len(cycles) == 2
    for cycle in cycles:
        assert np.sqrt(np.mean((cycle - one.torque) ** 2)) < 0.1 * one.torque.std()


def test_cycles_between_two_samples_and_at_other_rates(recordings, known):
    """Half a sample of delay, or half the sample rate, change the torque by little."""
    one = recordings[0]
    times = np.arange(len(one.torque)) * 0.004
    late = times + 0.002

    def at(x, when):
        return np.stack([np.interp(when, times, column) for column in x.T], axis=1)

    shifted = replace(one, position=at(one.position, late), torque=at(one.torque, late))
    slow = replace(one, position=one.position[::2], torque=one.torque[::2], sample_period=0.008)
    joint = replace(
        one,
        side="joint",
        position=one.position / known.gear_ratio,
        torque=one.torque * known.gear_ratio,
    )
    smooth = np.ones(25) / 25
    for other, limit in ((shifted, 0.02), (slow, 0.05), (joint, 1e-9)):
        (cycle,) = find_cycles(other, known)
        apart = np.stack([np.convolve(x, smooth, "valid") for x in (cycle - one.torque).T])
        assert np.abs(apart[:, 5:-5]).max() < limit * np.abs(one.torque).max()


def test_other_motions_are_refused(recordings, known):
    one = recordings[0]
    other = replace(one, position=0.7 * one.position)
    with pytest.raises(InputError, match="does not contain the motion of the task"):
        find_cycles(other, known)
    with pytest.raises(InputError, match="too short"):
        find_cycles(replace(one, position=one.position[:60], torque=one.torque[:60]), known)
    with pytest.raises(InputError, match="has 1 axes, but the motion has 2"):
        find_cycles(replace(one, position=one.position[:, :1], torque=one.torque[:, :1]), known)


@pytest.mark.slow
def test_a_fault_needs_no_parameters_beside_its_defaults(recordings, known, tiny_robot):
    """Data state only parameters that differ; a ripple without any has two periods a turn."""
    torque = np.stack([one.torque for one in recordings])
    fault = Fault(effect="torque_ripple", axes=(1,), largest=0.01, unit="N m")
    nothing = np.zeros((1, *torque.shape[1:]))
    ripple = Generated(fault=fault, change=nothing, severity=np.ones(1))
    learned = learn(tiny_robot, known, torque, [ripple], 0.01, 0)
    wave = np.zeros(torque.shape[1:])
    wave[:, 0] = -np.sin(2 * known.path[:, 0] * tiny_robot.gear_ratio[0])
    expected = learned.program.whiten(wave)
    found = learned.posterior.effects.columns[0]
    assert np.corrcoef(found, expected)[0, 1] > 0.99


def test_differences_of_runs_are_measured(tiny_robot, tiny_task_path):
    """Runs whose friction differs by 5 % show about that; runs that do not differ show less."""
    found = {}
    for spread in (0.05, 0.0):
        runs = [record(tiny_robot, tiny_task_path, s, spread=spread) for s in range(20, 28)]
        told = run_differences(Replay(runs[0], tiny_robot), runs).table(2)
        found[spread] = np.array(told["coulomb_friction"])
    # eight runs determine a deviation to within a factor of two, in 95 of 100 cases
    assert np.all((found[0.05] > 0.02) & (found[0.05] < 0.12))
    assert np.all(found[0.0] < 0.01)


def test_noise_is_measured(tiny_robot, tiny_task_path):
    """Its level is that which was drawn, its colour is white, and it does not grow with speed."""
    runs = [record(tiny_robot, tiny_task_path, s) for s in range(30, 35)]
    replay = Replay(runs[0], tiny_robot)
    noise = torque_noise_of(
        run_differences(replay, runs),
        replay,
        np.abs(np.gradient(runs[0].position, 0.004, axis=0)),
        np.abs(runs[0].torque),
    )
    drawn = NOISE * np.abs(runs[0].torque).mean(axis=0)
    assert noise.deviation == pytest.approx(drawn, rel=0.15)
    assert np.abs(np.array(noise.colour)).max() < 0.15
    assert noise.growth == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize("count", [3, 12])
def test_equal_data_look_alike_and_other_data_do_not(known, count):
    """The AUC is near 0.5 for cycles of one kind, and near 1 if one kind has more noise."""
    rng = np.random.default_rng(0)
    shape = known.path.shape
    mean = np.cumsum(rng.standard_normal(shape), axis=0)

    def cycles(number, size):
        return mean + size * rng.standard_normal((number, *shape))

    def lacking(measured, _=None):
        """As a twin does: what the model lacks, without the noise of the recordings."""
        apart = (measured - mean).T
        return np.stack([np.convolve(one, np.ones(25) / 25, "same") for one in apart], axis=1)

    def compared(size):
        measured = cycles(count, size)
        generated = cycles(48, 1.0) + lacking(measured.mean(axis=0))
        return likeness([[one] for one in measured], generated, known, lacking)

    same, other = compared(1.0), compared(1.3)
    assert abs(same["auc"] - 0.5) < 3 * same["standard_error"]
    assert other["auc"] > 0.95
    assert likeness([[mean]], cycles(4, 1.0), known, lacking)["auc"] is None


def test_a_furnished_robot_generates_what_was_measured(recordings, tiny_robot, tmp_path):
    """The folder is a robot with sensors and the recorded task; the means agree within 2 %."""
    told = furnish(tiny_robot, recordings, tmp_path / "own")
    robot = load_robot(tmp_path / "own")
    assert "recorded" in robot.tasks
    sensors = get_sensors(tmp_path / "own" / "sensors.toml")
    assert sensors.remainder is not None and set(sensors.run_to_run) >= {"coulomb_friction"}
    assert told["noise"]["over_rms_torque"] == pytest.approx([NOISE * 0.8] * 2, rel=0.5)
    assert told["likeness"]["auc"] is not None
    page = (tmp_path / "own" / "report.html").read_text()
    assert "AUC" in page and "data:image/png" in page


def test_the_whole_twin(recordings, tiny_robot_path, tmp_path):
    """Two files and a model give a folder with all numbers."""
    files = []
    for number, one in enumerate(recordings[:2]):
        files.append(tmp_path / f"healthy{number}.h5")
        write_recording(one, files[-1])
    told = make_twin(files, tiny_robot_path, tmp_path / "own", with_discovery=False)
    assert told["discovery"]["verdict"] == "not searched"
    assert told["calibration"]["errors"]["calibrated"] < 0.1
    assert (tmp_path / "own" / "twin.json").is_file()
    with pytest.raises(InputError, match="the same run; give each run once"):
        make_twin([files[0], files[0]], tiny_robot_path, tmp_path / "two")
    with pytest.raises(InputError, match="must be a folder"):
        make_twin(files, tiny_robot_path, files[0])


@pytest.mark.slow
def test_the_example_of_the_page(tmp_path):
    """The commands of docs/twin.md name wear of 5 % and more on the right axis, and no healthy one.

    The robot has another servo than the model, which the twin must not get wrong.
    """
    root = Path(__file__).parents[2]
    (tmp_path / "docs").symlink_to(root / "docs")
    page = (root / "docs" / "twin.md").read_text()
    commands = page.split("more friction on axis 1.\n\n")[1].split("\n\n")[0].replace("\\\n", " ")
    for command in commands.strip().split("\n"):
        words = [
            sorted(tmp_path.glob(word)) if "?" in word else [word]
            for word in command.replace(".venv/bin/faultgen", "").split()
        ]
        done = faultgen(*(one for found in words for one in found), cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    answers = done.stdout.strip().split("\n")
    assert all("healthy, probability" in line for line in answers[:2])
    assert all("friction_wear on axis 1, severity" in line for line in answers[2:6])


@pytest.mark.slow
def test_the_recordings_of_the_page_can_be_made_again(tmp_path):
    """Their simulator is compiled, so that the last digits depend on the machine."""
    root = Path(__file__).parents[2]
    own = root / "docs" / "examples" / "twin"
    made = [sys.executable, "-m", "benchmarks.monitoring.twin_example", "-o", tmp_path]
    subprocess.run(made, cwd=root, check=True)
    assert (tmp_path / "arm.xml").read_text() == (own / "arm.xml").read_text()
    files = sorted(own.glob("*.h5"))
    assert len(files) == 11
    for path in files:
        again, shipped = read_recording(tmp_path / path.name), read_recording(path)
        for name in ("position", "torque", "velocity", "reference_position"):
            right = getattr(shipped, name)
            scale = np.abs(right).max(axis=0)
            # rounded to steps of the log, of which one lies between two results of rounding
        assert (np.abs(getattr(again, name) - right) < 1e-3 * scale).all(), (path.name, name)
