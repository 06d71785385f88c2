"""The noise of torques on noisy measured positions."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from recorded import logged

from faultgen.discovery.replay.followed import rotor_steps
from faultgen.discovery.replay.position_noise import position_noise
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.recordings.recording import Recording
from faultgen.recordings.smoothing import noise_of_position, smoothed_with
from faultgen.recordings.varying_noise import VaryingNoise
from faultgen.robot import COULOMB, STICTION, load_robot

SECONDS, PERIOD, ORDER = 6.0, 0.004, 20
POSITION, TORQUE = 5e-4, 1e-3  # noise of encoders [rad] and of torques, over those of the motion


@pytest.fixture(scope="module")
def robot():
    """The PUMA 560 with hardly any friction, whose sign noise would change at rest."""
    robot = load_robot("puma560")
    spec = robot.spec()
    for axis in range(1, robot.n_axes + 1):
        friction = np.array(spec.actuator(f"friction{axis}").biasprm)
        friction[[COULOMB, STICTION]] *= 1e-4
        spec.actuator(f"friction{axis}").biasprm = friction
    return robot.edited(spec)


@pytest.fixture(scope="module")
def clean(robot) -> Recording:
    """What the robot logs, without noise."""
    return logged(robot, [], SECONDS, PERIOD)


def noisy(recording: Recording, seed: int) -> Recording:
    """The recording with noise of positions and torques."""
    rng = np.random.default_rng(seed)
    size = TORQUE * np.sqrt(np.mean(recording.torque**2, axis=0))
    return replace(
        recording,
        position=recording.position + rng.normal(0.0, POSITION, recording.position.shape),
        torque=recording.torque + rng.normal(0.0, size, recording.torque.shape),
    )


@pytest.fixture(scope="module")
def left(robot, clean) -> tuple[list[VaryingNoise], np.ndarray, np.ndarray, np.ndarray]:
    """Noise as foretold; what simulations on noisy logs leave; samples that count; white noise."""
    replays = [Replay(noisy(clean, seed), robot) for seed in range(4)]
    errors = []
    for one in replays:
        same = copy.copy(one)  # the same without noise of positions
        position = clean.joint_position(robot)
        columns = zip(position.T, one.strengths[0], strict=True)
        smooth = np.stack([smoothed_with(column, how) for column, how in columns], axis=1)
        same.rotors = [rotor_steps(robot, smooth, PERIOD)]
        errors.append(one.recording.torque - clean.torque - one.torque() + same.torque())
    noises = [position_noise(one, ORDER) for one in replays]
    inside = settled(clean, robot)[:, 0].copy()
    inside[:50] = inside[-50:] = False
    logs = [one.recording.torque.T for one in replays]
    white = np.array([[noise_of_position(column) for column in log] for log in logs])
    return noises, np.array(errors), inside, white


def test_the_noise_is_as_large_as_in_simulations(left):
    noises, errors, inside, white = left
    pairs = zip(noises, white, strict=True)
    foretold = np.array([(one.growth[one.frame] * size)[inside] for one, size in pairs])
    seen = errors[:, inside]
    ratio = np.sqrt(np.mean(seen**2, axis=(0, 1)) / np.mean(foretold**2, axis=(0, 1)))
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)
    assert np.all(np.sqrt(np.mean(foretold**2, axis=(0, 1))) > 2 * white.mean(axis=0))


def test_its_innovations_are_white_in_every_part_of_the_motion(left):
    noises, errors, inside, white = left
    pairs = zip(noises, errors, strict=True)
    innovations = np.array([one.whiten(error, [slice(0, len(error))]) for one, error in pairs])
    innovations = innovations[:, inside] / white[:, None]
    for part in np.array_split(innovations, 3, axis=1):
        np.testing.assert_allclose(np.sqrt(np.mean(part**2, axis=(0, 1))), 1.0, atol=0.3)
    size = np.mean(innovations**2, axis=(0, 1))
    for delay in range(1, ORDER):
        product = innovations[:, delay:] * innovations[:, :-delay]
        assert np.all(np.abs(np.mean(product, axis=(0, 1)) / size) < 0.2)


def test_smooth_positions_bring_no_noise(robot, clean):
    noise = position_noise(Replay(replace(noisy(clean, 0), position=clean.position), robot), ORDER)
    assert noise is not None
    np.testing.assert_allclose(noise.growth, 1.0, atol=0.1)
    np.testing.assert_allclose(noise.gain, 1.0, atol=0.1)
