"""Which samples of a recording are used, and the parts into which it is divided."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from faultgen.discovery.replay.replay import settled
from faultgen.recordings.noise import FEWEST, usable
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

_SLOWEST, _CREEPING = 0.1, 0.3  # speed of an axis that moves, over the Stribeck velocity: assumed
PRESLIDING = 0.1  # time from rest or reversal until friction has settled [s]: assumed
_BLOCKS = 6  # into which a single recording is cut, to fit on some and choose on others
_LEAST_SHARE = 1 / 3  # samples of an axis that are compared, over those of an even spread: assumed
_FIFTHS = 5  # blocks of which one is kept for scoring, where axes move in turn


def cut(recording: Recording, robot: Robot, used: np.ndarray) -> tuple[list[slice], list[int]]:
    """Cut a recording into parts, and choose those that are kept for scoring.

    The parts are the separate recordings. One or two of them are cut into blocks of the same
    length. Where long rests would leave a block with little motion, something moves for equally
    long in each block. The last fifth of the parts is kept for scoring. If the samples at which an
    axis is compared are hardly in this fifth, or hardly elsewhere, all recordings are cut into
    shorter blocks, and every fifth block is kept. This happens where axes move in turn, or where
    the last motion consists of reversals.

    Args:
        recording: The measured data.
        robot: The model.
        used: Samples that are compared, shape (samples, n_axes).

    Returns:
        The parts, and the numbers of those that are kept for scoring, from 0.
    """
    parts = blocks(recording, robot)
    scoring = for_scoring(parts)
    used = used & moving(recording, robot)  # at rest nothing is told apart
    if _shows_every_axis(parts, scoring, used):
        return parts, scoring
    moves = _moves(recording, robot)
    each = -(-robot.n_axes // len(recording.parts))
    for finer in range(1, each + 1):
        shorter: list[slice] = []
        for part in recording.parts:
            most = max(1, int(moves[part].sum()) // (_FIFTHS * FEWEST))
            shorter += _cut(part, _FIFTHS * min(finer, most), moves)
        every_fifth = list(range(_FIFTHS - 1, len(shorter), _FIFTHS))
        if _shows_every_axis(shorter, every_fifth, used):
            return shorter, every_fifth
    return parts, scoring


def blocks(recording: Recording, robot: Robot) -> list[slice]:
    """List the parts of a recording. One or two parts are cut into blocks.

    Args:
        recording: The measured data.
        robot: The model, which tells at which speed an axis moves.

    Returns:
        The parts. Something moves in each block of a recording for at least half of its share.
    """
    parts = recording.parts
    if len(parts) > 2:
        return parts
    return divided(parts, _moves(recording, robot))


def divided(parts: Sequence[slice], counts: np.ndarray | None = None) -> list[slice]:
    """Divide parts into blocks of the same length, at least `_BLOCKS` in total.

    Args:
        parts: The parts.
        counts: Samples of which each block holds at least half of its share, shape (samples,).
            None: all count.

    Returns:
        The blocks.
    """
    number = -(-_BLOCKS // len(parts))
    if counts is None:
        counts = np.ones(parts[-1].stop, bool)
    return [block for part in parts for block in _cut(part, number, counts)]


def _cut(part: slice, number: int, counts: np.ndarray) -> list[slice]:
    """Cut a part into blocks of the same length.

    If one of them held less than half of its share of the samples that count, and there are enough
    of these, the blocks hold equally many of them instead.
    """
    edges = np.linspace(part.start, part.stop, number + 1).round().astype(int)
    held = [int(counts[a:b].sum()) for a, b in pairwise(edges)]
    share = sum(held) / number
    if share >= 1 and min(held) < share / 2:
        goals = np.round(np.arange(1, number) * share)
        edges[1:-1] = part.start + np.searchsorted(np.cumsum(counts[part]), goals) + 1
    return [slice(a, b) for a, b in pairwise(edges.tolist())]


def for_scoring(parts: Sequence[slice]) -> list[int]:
    """The last fifth of the parts, at least one. They are not used for fitting or choosing."""
    return list(range(len(parts) - max(1, len(parts) // 5), len(parts)))


def _shows_every_axis(parts: Sequence[slice], scoring: Sequence[int], used: np.ndarray) -> bool:
    """Whether both kinds of parts hold enough of the samples at which each axis is compared."""
    kept = samples_of([parts[p] for p in scoring], len(used))
    total = used.sum(axis=0)
    compared = total > 0
    share = used[kept].sum(axis=0)[compared] / total[compared]
    least, fair = _LEAST_SHARE, float(kept.mean())
    return bool(len(share) and np.all((share >= least * fair) & (1 - share >= least * (1 - fair))))


def enough(inside: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Leave out axes with too few samples to estimate their noise, as in recordings of single axes.

    Args:
        inside: Samples that are compared, shape (samples, n_axes).
        parts: Samples of each separate recording.

    Returns:
        The mask without the samples of these axes, same shape.
    """
    able = [usable(one, parts) >= FEWEST for one in inside.T]
    return inside & np.array(able)


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


def counted(recording: Recording, robot: Robot, *, baseline: bool) -> np.ndarray:
    """Find the samples that are used in a comparison.

    All numbers of an answer, and the score on other motions, use these samples only. Samples that
    the log has lost are not among them.

    Args:
        recording: The measured data.
        robot: The model.
        baseline: Whether the recording is compared with another recording. If it is compared with
            the model, samples at rest, shortly after rest and shortly after a reversal are not
            used.

    Returns:
        Mask of shape (samples, n_axes).
    """
    inside = settled(recording, robot)
    if recording.lost is not None:
        inside &= ~recording.lost
    return inside if baseline else inside & rolling(recording, robot)


def rolling(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples that are at least `PRESLIDING` after rest and after a reversal.

    Earlier, the torque of an axis depends on how its friction bristles are bent, and no two models
    agree on that.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    moves = moving(recording, robot)
    count = max(1, round(PRESLIDING / recording.sample_period))
    disturbed = turning(recording) | ~moves
    for part in recording.parts:
        for axis in range(robot.n_axes):
            after = np.convolve(disturbed[part, axis].astype(int), np.ones(count, int))
            moves[part, axis] = after[: part.stop - part.start] == 0
    return moves


def turning(recording: Recording) -> np.ndarray:
    """Find the first sample after each change of direction.

    Args:
        recording: The measured data.

    Returns:
        Mask of shape (samples, n_axes).
    """
    turned = np.zeros(recording.position.shape, bool)
    for part in recording.parts:
        direction = np.sign(np.gradient(recording.position[part], axis=0))
        turned[part][1:] = direction[1:] != direction[:-1]
    return turned


def moving(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples at which axes move.

    A servo that is not given the torque in advance lets an axis creep to rest.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    slowest = _SLOWEST if robot.set_points[2] else _CREEPING
    return _motor_speed(recording, robot) > slowest * robot.stribeck_velocity


def runs(mask: np.ndarray) -> list[slice]:
    """List the runs of samples that are true.

    Args:
        mask: Shape (samples,).
    """
    return list(np.ma.clump_masked(np.ma.array(mask, mask=mask)))


def _moves(recording: Recording, robot: Robot) -> np.ndarray:
    """Samples at which at least one axis moves, shape (samples,)."""
    return np.asarray(moving(recording, robot).any(axis=1))


def _motor_speed(recording: Recording, robot: Robot) -> np.ndarray:
    """Size of the motors' speed by differences, shape (samples, n_axes), in [rad/s]."""
    position = recording.motor_position(robot)
    speed = np.zeros(position.shape)
    for part in recording.parts:
        speed[part] = np.gradient(position[part], recording.sample_period, axis=0)
    return np.abs(speed)
