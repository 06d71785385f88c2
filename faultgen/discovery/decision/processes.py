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

from faultgen.discovery.replay.formulas import Motion
from faultgen.recordings.recording import Recording

OVER = ("joint angle", "joint angle, by direction", "speed", "acceleration", "load", "time")
"""Variables."""

_BUMPS = 6  # along the usual range of a variable: a fifth of it is a length over which laws change
_USUAL = (0.01, 0.99)  # quantiles of the usual range


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
    for axis in range(motion.speed.shape[1]):
        joint, speed = motion.joint[:, axis], motion.speed[:, axis]
        turns, always = np.sign(speed), np.ones_like(speed)
        variables = (
            (joint, always),
            (joint, turns),
            (speed, always),
            (motion.acceleration[:, axis] * turns, turns),  # a change of the speed
            (motion.gear[:, axis], turns),
            (time, turns),
        )
        for over, (x, times) in zip(OVER, variables, strict=True):
            low, high = np.quantile(x, _USUAL)
            if high > low:
                place = np.clip((x - low) / (high - low), 0, 1) * (_BUMPS - 1)
                bumps = np.maximum(1 - np.abs(place - np.arange(_BUMPS)[:, None]), 0)
                yield Process(axis + 1, over, bumps * times)
