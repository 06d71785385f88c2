"""Noise of a gap, told from how it changes within a few samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

_LARGEST = 0.98  # autocorrelation; beyond it noise cannot be told from a drift


@dataclass(frozen=True, eq=False)
class Noise:
    """First-order autoregressive noise. Arrays have shape (n_axes,)."""

    memory: np.ndarray
    """Correlation of neighbouring samples."""
    innovation: np.ndarray
    """Standard deviation of what is new in each sample, in the unit of the gap."""

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of the noise."""
        return self.innovation / np.sqrt(1 - self.memory**2)

    def whiten(self, x: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Innovations over their standard deviation; 0 in the first sample of each part.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the gap.
            parts: Separate recordings.

        Returns:
            Same shape.
        """
        out = np.zeros_like(x)
        for part in parts:
            now = x[..., part.start + 1 : part.stop, :]
            before = x[..., part.start : part.stop - 1, :]
            out[..., part.start + 1 : part.stop, :] = (now - self.memory * before) / self.innovation
        return out


def noise_of(gap: np.ndarray, inside: np.ndarray, parts: Sequence[slice]) -> Noise:
    """Estimate the noise of a gap that also holds effects.

    Effects change slowly beside the sample period, but for jumps, which `inside` is to leave out.
    Second differences take what is slow away; those of a first-order autoregression have a variance
    and a correlation of neighbours from which its two parameters follow. Source: its
    autocovariances, s^2 m^k / (1 - m^2).

    Args:
        gap: Shape (samples, n_axes), in any unit.
        inside: Samples that may be used, same shape.
        parts: Separate recordings.

    Returns:
        The noise.

    Raises:
        ValueError: An axis has fewer than 50 usable samples.
    """
    axes = gap.shape[1]
    memory, innovation = np.zeros(axes), np.zeros(axes)
    for axis in range(axes):
        squares, products = [], []
        for part in parts:
            x, use = gap[part, axis], inside[part, axis]
            second = x[2:] - 2 * x[1:-1] + x[:-2]
            usable = use[2:] & use[1:-1] & use[:-2]
            squares.append(second[usable] ** 2)
            both = usable[1:] & usable[:-1]
            products.append((second[1:] * second[:-1])[both])
        variance, product = np.concatenate(squares), np.concatenate(products)
        if len(product) < 50:
            raise ValueError(f"axis {axis + 1}: fewer than 50 samples in which it moves steadily")
        ratio = float(product.mean() / variance.mean()) if variance.mean() > 0 else -2 / 3
        memory[axis] = _memory(ratio)
        scale = _covariances(memory[axis])[0]
        innovation[axis] = np.sqrt(variance.mean() / scale)
    return Noise(memory, np.maximum(innovation, 1e-12))


def _covariances(memory: float) -> tuple[float, float]:
    """Variance of second differences and covariance of neighbours, for innovations of 1."""
    g0, g1, g2, g3 = (memory**k / (1 - memory**2) for k in range(4))
    return 6 * g0 - 8 * g1 + 2 * g2, -4 * g0 + 7 * g1 - 4 * g2 + g3


def _memory(ratio: float) -> float:
    """Autocorrelation whose second differences have that correlation of neighbours."""

    def excess(memory: float) -> float:
        variance, covariance = _covariances(memory)
        return covariance / variance - ratio

    if excess(0.0) >= 0:
        return 0.0
    if excess(_LARGEST) <= 0:
        return _LARGEST
    return float(brentq(excess, 0.0, _LARGEST))
