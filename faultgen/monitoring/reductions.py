"""Reductions: the few numbers of each cycle that a remote monitoring system stores.

All functions take measured motor signals of shape (samples, n_axes), and return one row for each
axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

SPEED_WINDOW = (50.0, 120.0)
"""Range of motor speeds within which the thesis (section 6.3.2) uses the torque [rad/s]."""

_PART = (0.5, 1.2)  # of the top speed, where that window is empty: as 50 and 120 are of 100 rad/s
_MARGIN = 1.02  # between planned speeds and those of a simulation, at the ends of the window
_STILL = 0.1  # top speed of an axis that does not move [rad/s]

BINS = 12
"""Number of bins of every histogram, as in sections 3.4 and 5.3.1 of the thesis."""

LIFE_EXPONENT = 10 / 3
"""Exponent of the torque in the formula for the rating life of speed reducers."""


@dataclass(frozen=True)
class Limits:
    """Largest design values, which set the ranges of the histograms. Shape (n_axes,) each."""

    torque: np.ndarray
    """Motor torque [N m]."""
    speed: np.ndarray
    """Motor speed [rad/s]."""
    angle: np.ndarray
    """Lower and upper joint angle, shape (n_axes, 2), in [rad]."""
    gear_ratio: np.ndarray
    """Rotor turns per joint turn."""


def default_window(speed: np.ndarray) -> np.ndarray:
    """Choose the speed window of each axis for a motion.

    It is the window of the thesis if the axis reaches these speeds in the motion. For an axis that
    does not, it is 0.5 to 1.2 times the highest speed of the axis. For an axis that does not move,
    it is again the window of the thesis.

    Args:
        speed: Planned motor speed or velocity, shape (samples, n_axes), in [rad/s].

    Returns:
        Low and high motor speed, shape (n_axes, 2), in [rad/s].
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
    """Average |torque| over the samples whose motor speed is within a window (thesis, 6.3.2).

    Args:
        velocity: Motor velocity, shape (samples, n_axes), in [rad/s].
        torque: Motor torque, same shape, in [N m].
        window: Low and high motor speed, both included, shape (2,) or (n_axes, 2), in [rad/s].

    Returns:
        Mean |torque|, shape (n_axes,), in [N m]; nan for an axis without samples in the window.
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
    """Compute all reductions of one cycle.

    A histogram gives the share of time in 12 equal parts of the design range; values outside the
    range count in the first or last part. The thesis does not define its torque and speed
    indicators. Here they are the quantities from which the rating life of speed reducers is
    computed: the mean |speed|, and the mean torque weighted by speed with the exponent 10/3.

    Args:
        position: Motor position, shape (samples, n_axes), in [rad].
        velocity: Motor velocity, same shape, in [rad/s].
        torque: Motor torque, same shape, in [N m].
        limits: Design values of the robot, which set the ranges of the histograms.
        window: Speed window of `mean_abs_torque`, shape (2,) or (n_axes, 2), in [rad/s].

    Returns:
        Arrays by name. mean_abs_torque [N m], torque_indicator [N m] and speed_indicator [rad/s]
        have shape (n_axes,); torque_histogram, speed_histogram and angle_histogram have shape
        (n_axes, 12) and no unit.

    Source: rating life of RV reducers (exponent 10/3), as in their makers' selection guides.
    """
    return {
        name: reduce(position, velocity, torque, limits, window)
        for name, reduce in REDUCTIONS.items()
    }


def torque_indicator(velocity: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Average the torque, weighted by speed, with the exponent of the rating life.

    Args:
        velocity: Motor velocity, shape (samples, n_axes), in [rad/s].
        torque: Motor torque, same shape, in [N m].

    Returns:
        Shape (n_axes,), in [N m]; 0 for an axis that does not move.
    """
    speed = np.abs(velocity)
    distance = speed.sum(axis=0)
    weighted = (speed * np.abs(torque) ** LIFE_EXPONENT).sum(axis=0)
    load = np.where(distance > 0, weighted / np.maximum(distance, 1e-300), 0.0)
    return load ** (1 / LIFE_EXPONENT)


def histogram(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Compute the share of samples in each of 12 equal bins.

    Values outside the range count in the first or last bin.

    Args:
        values: Shape (samples, n_axes), in any unit.
        low: Lower end of the range of each axis, shape (n_axes,), in the unit of `values`.
        high: Upper end of the range of each axis, shape (n_axes,), in the unit of `values`.

    Returns:
        Shares, shape (n_axes, 12), without unit.
    """
    which = np.floor((values - low) / (high - low) * BINS).astype(int).clip(0, BINS - 1)
    n_axes = values.shape[1]
    codes = which + BINS * np.arange(n_axes)
    counts = np.bincount(codes.ravel(), minlength=BINS * n_axes)
    return counts.reshape(n_axes, BINS) / len(values)


REDUCTIONS: dict[str, Callable[..., np.ndarray]] = {
    "mean_abs_torque": lambda _, velocity, torque, __, window: mean_abs_torque(
        velocity, torque, window
    ),
    "torque_histogram": lambda _, __, torque, limits, ___: histogram(
        torque, -limits.torque, limits.torque
    ),
    "speed_histogram": lambda _, velocity, __, limits, ___: histogram(
        velocity, -limits.speed, limits.speed
    ),
    "angle_histogram": lambda position, _, __, limits, ___: histogram(
        position / limits.gear_ratio, *limits.angle.T
    ),
    "torque_indicator": lambda _, velocity, torque, *__: torque_indicator(velocity, torque),
    "speed_indicator": lambda _, velocity, *__: np.abs(velocity).mean(axis=0),
}
"""Every reduction by its name, as a function of position, velocity, torque, limits and window; see
`monitor` for their meaning and units."""
