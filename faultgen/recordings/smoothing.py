"""Smoothing of a measured position according to its own noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solveh_banded
from scipy.optimize import brentq

_ORDER = 3  # differences that are penalised: acceleration stays continuous and is not drawn to zero
_NOISE = 5  # differences from which the noise is found
_RANGE = (-6.0, 14.0)  # common logarithms of the penalties that are tried
_ROUGH = 0.1  # noise of the acceleration, over the acceleration: assumed
_FEWEST = 20  # samples from which anything is smoothed


def noise_of_position(position: np.ndarray) -> float:
    """Estimate the standard deviation of white noise on a smooth motion.

    Args:
        position: Shape (samples,), in any unit.

    Returns:
        The deviation from differences of fifth order, which a motion that is sampled densely hardly
        has. An encoder that counts has no noise at rest, so that differences of 0 are left out, and
        so is the largest hundredth, which may be jerks of the motion.
    """
    size = np.abs(np.diff(position, _NOISE))
    size = size[size > 0]
    if not len(size):
        return 0.0
    weights = np.diff(np.eye(_NOISE + 1), _NOISE, axis=0)[0]
    kept = size[size <= np.quantile(size, 0.99)]
    return float(np.sqrt(np.mean(kept**2))) / float(np.linalg.norm(weights))


def is_rough(position: np.ndarray, period: float) -> bool:
    """Whether the accelerations of a position are spoilt by its noise.

    Args:
        position: Shape (samples,), equally spaced in time, in any unit.
        period: Time between samples [s].

    Returns:
        Whether second differences of white noise of its size are more than `_ROUGH` of the RMS
        acceleration of the smoothed position.
    """
    if len(position) < _FEWEST:
        return False
    noise = np.sqrt(6.0) * noise_of_position(position) / period**2
    acceleration = np.diff(smoothed(position), 2) / period**2
    return bool(noise > _ROUGH * np.sqrt(np.mean(acceleration**2)))


def smoothed(position: np.ndarray) -> np.ndarray:
    """Smooth a position as far as its own noise requires.

    Args:
        position: Shape (samples,), equally spaced in time, in any unit.

    Returns:
        The smoothed position, same shape and unit. A position without noise stays as it is.
    """
    return smoothed_with(position, *strengths(position, (0.0,)))


def strengths(position: np.ndarray, stronger: Sequence[float]) -> list[float | None]:
    """Find how strongly a position is smoothed: as far as its own noise requires, and more.

    The smoothed position has the smallest third differences of all that depart from the measured
    one by the noise (Whittaker 1923, with the discrepancy principle of Morozov 1966).

    Args:
        position: Shape (samples,), equally spaced in time, in any unit.
        stronger: Common logarithms of factors by which the penalty of third differences is
            multiplied.

    Returns:
        Common logarithm of the penalty for each factor, for `smoothed_with`; None for a position
        without noise.
    """
    own = required(position)
    return [None if own is None else min(own + more, _RANGE[1]) for more in stronger]


def required(position: np.ndarray) -> float | None:
    """Find how much smoothing the noise of a position requires.

    Args:
        position: Shape (samples,), equally spaced in time, in any unit.

    Returns:
        Common logarithm of the penalty of third differences; None for a position without noise.
    """
    noise = noise_of_position(position) if len(position) >= _FEWEST else 0.0
    if noise <= 1e-12 * max(float(np.ptp(position)), 1e-300):
        return None

    def excess(exponent: float) -> float:
        left = smoothed_with(position, exponent) - position
        return float(np.mean(left**2)) / noise**2 - 1.0

    low, high = _RANGE
    if excess(low) >= 0:
        return None
    return high if excess(high) <= 0 else float(brentq(excess, low, high, xtol=0.05))


def smoothed_with(values: np.ndarray, exponent: float | None) -> np.ndarray:
    """Smooth values with a given penalty.

    Args:
        values: Shape (samples, ...), in any unit.
        exponent: Common logarithm of the penalty of third differences; None for no smoothing.

    Returns:
        The smoothed values, same shape and unit.
    """
    if exponent is None:
        return values
    system = 10.0**exponent * _penalty(len(values))
    system[-1] += 1.0
    return np.asarray(solveh_banded(system, values))


def kept(exponent: float | None, frequency: np.ndarray, period: float) -> np.ndarray:
    """Compute the share of a wave that smoothing keeps, far from the ends.

    Args:
        exponent: Common logarithm of the penalty of third differences; None for no smoothing.
        frequency: Any shape, in [Hz].
        period: Time between samples [s].

    Returns:
        The share, same shape.
    """
    if exponent is None:
        return np.ones(np.shape(frequency))
    roughness = (2 - 2 * np.cos(2 * np.pi * np.asarray(frequency) * period)) ** _ORDER
    return np.asarray(1 / (1 + 10.0**exponent * roughness))


def _penalty(count: int) -> np.ndarray:
    """Squared third differences as a symmetric matrix in upper banded form."""
    weights = np.diff(np.eye(_ORDER + 1), _ORDER, axis=0)[0]
    bands = np.zeros((_ORDER + 1, count))
    for start in range(_ORDER + 1):
        for other in range(start, _ORDER + 1):
            product = weights[start] * weights[other]
            bands[_ORDER - (other - start), other : other + count - _ORDER] += product
    return bands
