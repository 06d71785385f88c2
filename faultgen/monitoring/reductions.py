"""Reductions that a remote monitoring system keeps of a cycle.

All take what was measured, motor side, shape (samples, n_axes), and give one row an axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

SPEED_WINDOW = (50.0, 120.0)
"""Motor speeds in which thesis 6.3.2 samples the torque [rad/s]."""

_PART = (0.5, 1.2)  # of the top speed, where that window is empty: as 50 and 120 are of 100 rad/s
_MARGIN = 1.02  # between planned speeds and those of a simulation, at the ends of the window
_STILL = 0.1  # top speed of an axis that does not move [rad/s]

BINS = 12
"""Bins of every histogram, thesis 3.4 and 5.3.1."""

LIFE_EXPONENT = 10 / 3
"""Of the torque in the rating life of reducers."""


@dataclass(frozen=True)
class Limits:
    """Largest design values, which span the histograms. Arrays have shape (n_axes,)."""

    torque: np.ndarray
    """Motor torque [N m]."""
    speed: np.ndarray
    """Motor speed [rad/s]."""
    angle: np.ndarray
    """Lower and upper joint angle, shape (n_axes, 2), in [rad]."""
    gear_ratio: np.ndarray
    """Rotor turns per joint turn."""


def default_window(speed: np.ndarray) -> np.ndarray:
    """Speed window of each axis for a motion.

    It is that of the thesis if the motion has samples in it. For an axis that never turns at such
    speeds it is 0.5 to 1.2 of the axis' top speed, and for an axis that does not move it is that
    of the thesis.

    Args:
        speed: Planned motor speed or velocity, shape (samples, n_axes), in [rad/s].

    Returns:
        Low and high, shape (n_axes, 2), in [rad/s].
    """
    speed = np.abs(speed)
    low, high = SPEED_WINDOW
    visited = ((speed >= low * _MARGIN) & (speed <= high / _MARGIN)).any(axis=0)
    top = speed.max(axis=0)
    own = top[:, None] * np.array(_PART)
    return np.where((visited | (top < _STILL))[:, None], SPEED_WINDOW, own)


def mean_abs_torque(
    velocity: np.ndarray, torque: np.ndarray, window: ArrayLike = SPEED_WINDOW
) -> np.ndarray:
    """Mean |torque| of the samples whose motor speed is within a window (thesis 6.3.2).

    Args:
        velocity: Motor velocity, shape (samples, n_axes), in [rad/s].
        torque: Motor torque, same shape, in [N m].
        window: Low and high motor speed, both included, shape (2,) or (n_axes, 2), in [rad/s].

    Returns:
        Shape (n_axes,), in [N m]; nan where no sample is within the window.
    """
    speed = np.abs(velocity)
    low, high = np.asarray(window).T
    inside = (speed >= low) & (speed <= high)
    count = inside.sum(axis=0)
    total = (np.abs(torque) * inside).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def monitor(
    position: np.ndarray,
    velocity: np.ndarray,
    torque: np.ndarray,
    limits: Limits,
    window: ArrayLike = SPEED_WINDOW,
) -> dict[str, np.ndarray]:
    """All reductions of one cycle.

    Histograms are the share of time in 12 equal parts of the design range; what lies beyond goes
    to the end bins. The indicators are those of reducer rating life, since the thesis does not
    give its own: mean |speed|, and the mean torque weighted by speed with the exponent 10/3.

    Args:
        position: Motor position, shape (samples, n_axes), in [rad].
        velocity: Motor velocity, same shape, in [rad/s].
        torque: Motor torque, same shape, in [N m].
        limits: Design values.
        window: Speed window of `mean_abs_torque`, shape (2,) or (n_axes, 2), in [rad/s].

    Returns:
        By name: mean_abs_torque, torque_indicator [N m], speed_indicator [rad/s], shape (n_axes,);
        torque_histogram, speed_histogram, angle_histogram, shape (n_axes, 12).

    Source: rating life of RV reducers (exponent 10/3), as in their makers' selection guides.
    """
    speed = np.abs(velocity)
    distance = speed.sum(axis=0)
    weighted = (speed * np.abs(torque) ** LIFE_EXPONENT).sum(axis=0)
    load = np.where(distance > 0, weighted / np.maximum(distance, 1e-300), 0.0)
    return {
        "mean_abs_torque": mean_abs_torque(velocity, torque, window),
        "torque_histogram": histogram(torque, -limits.torque, limits.torque),
        "speed_histogram": histogram(velocity, -limits.speed, limits.speed),
        "angle_histogram": histogram(position / limits.gear_ratio, *limits.angle.T),
        "torque_indicator": load ** (1 / LIFE_EXPONENT),
        "speed_indicator": speed.mean(axis=0),
    }


def histogram(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Share of samples in each of 12 equal bins; what lies beyond goes to the end bins.

    Args:
        values: Shape (samples, n_axes), in any unit.
        low: Lowest edge of each axis, shape (n_axes,).
        high: Highest edge of each axis, shape (n_axes,).

    Returns:
        Shape (n_axes, 12).
    """
    which = np.floor((values - low) / (high - low) * BINS).astype(int).clip(0, BINS - 1)
    n_axes = values.shape[1]
    codes = which + BINS * np.arange(n_axes)
    counts = np.bincount(codes.ravel(), minlength=BINS * n_axes)
    return counts.reshape(n_axes, BINS) / len(values)
