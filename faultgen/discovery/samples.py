"""Which samples of a recording are used, and the parts into which it is divided."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.discovery.noise import FEWEST, usable
from faultgen.discovery.recording import Recording
from faultgen.discovery.replay import settled
from faultgen.robot import Robot

_JUMP = 0.05  # time around a change of direction in which the noise is not looked for [s]
_PRESLIDING = 0.1  # time from rest or reversal until friction has settled [s]: assumed
_BLOCKS = 6  # into which a single recording is cut, to fit on some and choose on others


def blocks(recording: Recording) -> list[slice]:
    """List the parts of a recording. A recording of a single part is divided into blocks."""
    parts = recording.parts
    return parts if len(parts) > 2 else divided(parts)


def divided(parts: Sequence[slice]) -> list[slice]:
    """Divide parts into blocks of the same length, at least `_BLOCKS` in total."""
    count = -(-_BLOCKS // len(parts))
    cut = []
    for part in parts:
        edges = np.linspace(part.start, part.stop, count + 1).round().astype(int)
        cut += [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return cut


def for_scoring(parts: Sequence[slice]) -> list[int]:
    """The last fifth of the parts, at least one. They are not used for fitting or choosing."""
    return list(range(len(parts) - max(1, len(parts) // 5), len(parts)))


def for_noise(
    inside: np.ndarray, steady: np.ndarray, parts: Sequence[slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Make sure that there are enough samples of every axis to estimate its noise.

    Where an axis hardly moves steadily, all of its samples that are compared are used. Where it
    hardly moves at all, as in a recording of single axes, it is not compared.

    Args:
        inside: Samples that are compared, shape (samples, n_axes).
        steady: Those of them at which friction does not jump, same shape.
        parts: Samples of each separate recording.

    Returns:
        The two masks, of the same shape. An axis that is not compared is steady everywhere.
    """
    inside, steady = inside.copy(), steady.copy()
    for axis in range(inside.shape[1]):
        if usable(steady[:, axis], parts) >= FEWEST:
            continue
        if usable(inside[:, axis], parts) >= FEWEST:
            steady[:, axis] = inside[:, axis]
        else:
            inside[:, axis], steady[:, axis] = False, True
    return inside, steady


def samples_of(parts: Sequence[slice], count: int) -> np.ndarray:
    """Find the samples of some parts.

    Args:
        parts: The parts.
        count: Number of samples of the whole recording.

    Returns:
        Mask of shape (count,).
    """
    use = np.zeros(count, bool)
    for part in parts:
        use[part] = True
    return use


def counted(recording: Recording, robot: Robot, *, twin: bool) -> np.ndarray:
    """Find the samples that are used in a comparison.

    All numbers of an answer, and the score on other motions, use these samples only.

    Args:
        recording: The measured data.
        robot: The model.
        twin: Whether the recording is compared with another recording. If it is compared with the
            model, samples at rest, shortly after rest and shortly after a reversal are not used.

    Returns:
        Mask of shape (samples, n_axes).
    """
    inside = settled(recording, robot)
    return inside if twin else inside & rolling(recording, robot)


def rolling(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples that are at least `_PRESLIDING` after rest and after a reversal.

    Earlier, the torque of an axis depends on how its friction bristles are bent, and no two models
    agree on that.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    moves = moving(recording, robot)
    count = max(1, round(_PRESLIDING / recording.sample_period))
    for part in recording.parts:
        turned = np.zeros(moves[part].shape, bool)
        position = recording.position[part]
        direction = np.sign(np.gradient(position, axis=0))
        turned[1:] = direction[1:] != direction[:-1]
        disturbed = turned | ~moves[part]
        for axis in range(robot.n_axes):
            after = np.convolve(disturbed[:, axis].astype(int), np.ones(count, int))
            moves[part, axis] = after[: len(position)] == 0
    return moves


def near_reversal(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples near a change of direction, where friction jumps.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    still = _motor_speed(recording, robot) < 3 * robot.stribeck_velocity
    width = max(1, round(_JUMP / recording.sample_period))
    near = np.zeros(recording.position.shape, bool)
    for part in recording.parts:
        for axis in range(robot.n_axes):
            spread = np.convolve(still[part, axis].astype(int), np.ones(2 * width + 1, int))
            near[part, axis] = spread[width : width + part.stop - part.start] > 0
    return near


def moving(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples at which axes move.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    return _motor_speed(recording, robot) > 0.1 * robot.stribeck_velocity


def _motor_speed(recording: Recording, robot: Robot) -> np.ndarray:
    """Size of the motors' speed by differences, shape (samples, n_axes), in [rad/s]."""
    position = recording.motor_position(robot.gear_ratio)
    speed = np.zeros(position.shape)
    for part in recording.parts:
        speed[part] = np.gradient(position[part], recording.sample_period, axis=0)
    return np.abs(speed)
