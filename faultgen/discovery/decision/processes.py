"""Torques of no known form: smooth functions of one variable on one axis.

Each is a sum of bumps along a variable, as a torque of its own or as friction, which turns with the
direction. Their heights are independent and normal, so that the sum is a Gaussian process. Every
robot has a little of it, because no model is exact. Much of it on one axis is an effect that no
catalogue has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.replay.motion import Motion
from faultgen.recordings.recording import Recording

_IN_TURN = ("motor angle", "motor angle, by direction")
OVER = (
    "joint angle",
    "joint angle, by direction",
    *_IN_TURN,
    "speed",
    "acceleration",
    "load",
    "time since reversal",
    "time",
)
"""Variables. The motor angle counts within a turn; of the time since reversal, its logarithm."""

_BUMPS = 6  # along the usual range of a variable: a fifth of it is a length over which laws change
_USUAL = (0.01, 0.99)  # quantiles of the usual range
_BUMPS_OF_TURN = 8  # around a turn: up to four waves
_TURNS = 3.0  # of a motor in a recording, from which a turn repeats


@dataclass(frozen=True, eq=False)
class Process:
    """A torque of no known form on one axis."""

    axis: int
    """From 1."""
    over: str
    """One of `OVER`."""
    bumps: np.ndarray
    """Shape (bumps, samples), without unit."""

    @property
    def key(self) -> tuple:
        """Name, axis and parameters."""
        return ("process", self.axis, (self.over,))


def processes(recording: Recording, motion: Motion) -> Iterator[Process]:
    """List the processes of all axes.

    Args:
        recording: The measured data.
        motion: Of the model on the recording's motion.
    """
    time = np.arange(len(motion.speed)) * recording.sample_period
    late = np.concatenate([since_reversal(motion.speed[part]) for part in recording.parts])
    for axis in range(motion.speed.shape[1]):
        joint, speed, angle = (x[:, axis] for x in (motion.joint, motion.speed, motion.angle))
        turns, always = np.sign(speed), np.ones_like(speed)
        variables = (
            (joint, always),
            (joint, turns),
            (angle, always),
            (angle, turns),
            (speed, always),
            (motion.acceleration[:, axis] * turns, turns),  # a change of the speed
            (motion.gear[:, axis], turns),
            (np.log1p(late[:, axis]), turns),
            (time, turns),
        )
        for over, (x, times) in zip(OVER, variables, strict=True):
            if over in _IN_TURN:
                if np.ptp(angle) > _TURNS * 2 * np.pi:
                    yield Process(axis + 1, over, _around(angle) * times)
                continue
            low, high = np.quantile(x, _USUAL)
            if high > low:
                place = np.clip((x - low) / (high - low), 0, 1) * (_BUMPS - 1)
                bumps = np.maximum(1 - np.abs(place - np.arange(_BUMPS)[:, None]), 0)
                yield Process(axis + 1, over, bumps * times)


def _around(angle: np.ndarray) -> np.ndarray:
    """Bumps around a turn, shape (bumps, samples)."""
    place = angle / (2 * np.pi) * _BUMPS_OF_TURN
    apart = (place - np.arange(_BUMPS_OF_TURN)[:, None]) % _BUMPS_OF_TURN
    return np.maximum(1 - np.minimum(apart, _BUMPS_OF_TURN - apart), 0)


def since_reversal(speed: np.ndarray, before: int = 0) -> np.ndarray:
    """Count the samples since each axis last turned back in a separate recording.

    Args:
        speed: Shape (samples, ...).
        before: Samples that count before the first one, if an axis has not turned back yet.

    Returns:
        Same shape.
    """
    turned = np.zeros(speed.shape, bool)
    turned[1:] = speed[1:] * speed[:-1] <= 0
    number = np.arange(len(speed)).reshape(-1, *[1] * (speed.ndim - 1))
    last = np.maximum.accumulate(np.where(turned, number, -before), axis=0)
    return np.asarray(number - last)
