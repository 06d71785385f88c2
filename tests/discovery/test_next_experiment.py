"""Motions that tell apart what one recording does not."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear import posed, white_noise

from faultgen.discovery.fit.fit import fit_at
from faultgen.discovery.planning.next_experiment import library, next_experiment, planned_recording
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.terms.candidates import Term

TERMS = [Term("viscous_friction", 2, 0.1, 0.05), Term("coulomb_friction", 2, 0.1, 0.05)]


@pytest.fixture(scope="module")
def problem(measured, tiny_robot):
    """A recording of the small robot, and two kinds of friction."""
    replay = Replay(measured([], 1), tiny_robot)
    base = replay.torque()
    raw = np.array([(replay.torque([(t, t.step)]) - base) / t.step for t in TERMS], np.float32)
    residual = replay.recording.torque - base
    noise = white_noise(0.01 * np.abs(base).mean(axis=0), len(base))
    return posed(replay, TERMS, base, raw, residual, noise, baseline=True)


def moves(toml):
    """Poses and speeds of a task, in degrees."""
    task = tomllib.loads(toml)
    poses = np.array([task["start"]["joints"], *(move["joints"] for move in task["move"])])
    return poses, np.array([move["speed"] for move in task["move"]])


def test_own_motions_stay_within_the_recording(problem):
    """Slow reversals, one way at several speeds, and poses of different load."""
    robot = problem.robot
    tasks = dict(library(problem))
    assert list(tasks) == ["slow_reversals", "speed_ladder", "poses"]
    seen = robot.to_degrees(problem.recording.joint_position(robot))
    extent = seen.max(axis=0) - seen.min(axis=0)
    for name, toml in tasks.items():
        poses, _ = moves(toml)
        assert (poses >= seen.min(axis=0)).all() and (poses <= seen.max(axis=0)).all(), name
        np.testing.assert_array_equal(poses[0], poses[-1])
        reached = planned_recording(problem, name, toml).reference_position
        degrees = robot.to_degrees(reached)
        assert (degrees >= seen.min(axis=0) - 1e-6).all(), name
        assert (degrees <= seen.max(axis=0) + 1e-6).all(), name
    poses, speeds = moves(tasks["slow_reversals"])
    assert speeds.max() <= 0.5 and speeds[:-1].max() == 0.1
    assert (np.abs(np.diff(poses, axis=0)).max(axis=0) < 0.3 * extent).all()
    ladder, speeds = moves(tasks["speed_ladder"])
    assert sorted(set(speeds)) == [0.1, 0.3, 0.5, 0.6, 1.0]
    assert (np.ptp(ladder, axis=0) > 0.3 * extent).all()
    poses, _ = moves(tasks["poses"])
    assert len({tuple(pose) for pose in poses[1:-1].tolist()}) == 4  # high and low of each axis
    for axis in (0, 1):
        assert len(set(poses[1:-1, axis])) == 2


def test_a_planned_recording_is_like_the_given_one(problem):
    """Its side, sample period and mean temperature, and a torque that is not yet known."""
    name, toml = next(library(problem))
    warm = np.linspace([20.0, 40.0], [30.0, 60.0], len(problem.recording.position))
    recording = replace(problem.recording, temperature=warm)
    replay = type(problem.replay).__new__(type(problem.replay))
    vars(replay).update(vars(problem.replay) | {"recording": recording})
    found = planned_recording(replace(problem, replay=replay), name, toml)
    assert (found.source, found.side, found.sample_period) == (name, "motor", 0.004)
    assert found.segments == (0,) and not found.torque.any()
    np.testing.assert_allclose(found.temperature, np.tile([25.0, 50.0], (len(found.position), 1)))
    ratio = problem.robot.gear_ratio
    np.testing.assert_allclose(found.position, found.reference_position * ratio)


def chosen(problem, share, rival):
    """A choice of viscous friction with one rival."""
    best = fit_at(problem, [(0,)], np.array([0.2]), np.eye(1) * 0.01)
    return SimpleNamespace(best=best, shares=(share,), rivals=((0, (1,), rival),))


@pytest.mark.parametrize(
    ("share", "rival", "now"), [(0.9, 0.1, np.sqrt(2 * np.log(9))), (0.5, 0.5, 0.0)]
)
def test_how_far_apart_two_effects_are_now_and_then(problem, share, rival, now):
    """In standard deviations: what is as probable is not apart at all."""
    found = next_experiment(problem, chosen(problem, share, rival))
    assert found.now == pytest.approx(now)
    assert found.separates == (TERMS[0].key, TERMS[1].key)
    assert found.distance > 3
    assert found.toml == dict(library(problem))[found.task]
