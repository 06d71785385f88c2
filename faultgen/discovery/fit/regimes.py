"""Weights of samples near reversals, learned from how badly they are foretold.

After an axis has turned round, its torque depends for some tenths of a second on friction at rest
and on how the servo recovers; when another axis turns round, it feels the jolt. Models foretell
these samples worse than others, and by how much depends on the robot. A few samples that are wrong
by many standard deviations would decide what a fit finds, so they get less weight.
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.replay.samples import moving, turning
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

OWN = (0.0, 0.12, 0.15, 0.2, 0.3, 0.5)
"""Times since the axis itself has turned round or rested, between which weights are learned [s]."""

OTHERS = (0.0, 0.03, 0.06, 0.1, 0.2)
"""The same since any other axis has turned round, started or stopped [s]."""

_FEWEST = 30  # samples of a regime from which its weight is learned
_CAP = 25.0  # squared error that counts at most for a single sample


def trust_by_regime(
    error: np.ndarray, recording: Recording, robot: Robot, inside: np.ndarray
) -> np.ndarray:
    """Learn a weight for each sample from the errors of the samples in the same regime.

    Args:
        error: Whitened error of each sample, foretold from other periods; shape (samples, n_axes).
        recording: The measured data.
        robot: The model.
        inside: Samples that are compared, same shape.

    Returns:
        The weights, at most 1, shape (samples, n_axes). A weight divides an error by what is usual
        in its regime, compared with the samples that are in none.
    """
    own, others = _times(recording, robot)
    trust = np.ones(error.shape)
    for axis in range(error.shape[1]):
        rows = inside[:, axis]
        calm = rows & (own[:, axis] >= OWN[-1]) & (others[:, axis] >= OTHERS[-1])
        if calm.sum() < _FEWEST:
            calm = rows
        square = np.minimum(error[:, axis] ** 2, _CAP)
        usual = max(float(np.mean(square[calm])), 1.0) if calm.any() else 1.0
        for time, edges in ((own, OWN), (others, OTHERS)):
            factor = np.ones(len(rows))
            for low, high in zip(edges[:-1], edges[1:], strict=True):
                regime = (time[:, axis] >= low) & (time[:, axis] < high)
                if (regime & rows).sum() >= _FEWEST:
                    worse = float(np.mean(error[regime & rows, axis] ** 2)) / usual
                    factor[regime] = 1 / np.sqrt(max(worse, 1.0))
            trust[:, axis] = np.minimum(trust[:, axis], factor)
    return trust


def _times(recording: Recording, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Time since each axis turned or rested, and since any other axis turned, started or stopped.

    Returns:
        Two arrays of shape (samples, n_axes), in [s]; infinite before the first such event.
    """
    moves, turned = moving(recording, robot), turning(recording)
    own, others = np.full(moves.shape, np.inf), np.full(moves.shape, np.inf)
    for part in recording.parts:
        event = turned[part] & moves[part]
        event[1:] |= moves[part][1:] != moves[part][:-1]
        own[part] = _since(turned[part] | ~moves[part], recording.sample_period)
        by_axis = _since(event, recording.sample_period)
        for axis in range(moves.shape[1]):
            rest = np.delete(by_axis, axis, axis=1)
            if rest.shape[1]:
                others[part, axis] = rest.min(axis=1)
    return own, others


def _since(event: np.ndarray, period: float) -> np.ndarray:
    """Time since the last event of each axis, infinite before the first; shape of event."""
    index = np.arange(len(event))[:, None]
    last = np.maximum.accumulate(np.where(event, index, -1), axis=0)
    return np.where(last < 0, np.inf, (index - last) * period)
