"""How the logged torque of an axis reacts to a cause, learned from simulations that are known.

The servo reacts to a torque on the rotor or an error of the gearbox with a delay, and not to fast
changes. To first order this is a linear filter. It is found by least squares from causes whose
reaction has been simulated, and then tells that of other causes without a simulation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve, toeplitz
from scipy.signal import fftconvolve

_MEMORY = 0.15  # time after which a reaction has ended [s]: assumed
_RIDGE = 1e-6  # share of the causes' energy that is added, so that the filter is determined


class Reaction:
    """A linear filter from a cause to the logged torque of the same axis."""

    def __init__(
        self,
        causes: Sequence[np.ndarray],
        reactions: Sequence[np.ndarray],
        parts: Sequence[slice],
        sample_period: float,
    ) -> None:
        """Find the filter.

        Args:
            causes: Known causes, shape (samples,) each.
            reactions: Their simulated reactions, shape (samples,) each.
            parts: Samples of each separate recording.
            sample_period: Time between samples [s].
        """
        taps = max(2, round(_MEMORY / sample_period))
        products, cross = np.zeros((taps, taps)), np.zeros(taps)
        for cause, reaction in zip(causes, reactions, strict=True):
            for part in parts:
                x, y = cause[part], reaction[part].astype(float)
                products += _products(x, taps)
                cross += _lagged(x, y, taps)
        energy = products[0, 0]
        products[np.diag_indices(taps)] += _RIDGE * energy
        self._filter = np.zeros(taps)
        if energy > 0:
            self._filter = solve(products, cross, assume_a="pos")
        self._parts = parts

    def to(self, cause: np.ndarray) -> np.ndarray:
        """Compute the reaction to a cause, or to several.

        Args:
            cause: Shape (..., samples).

        Returns:
            Change of the logged torque, same shape.
        """
        out = np.zeros(cause.shape)
        taps = self._filter.reshape((1,) * (cause.ndim - 1) + (-1,))
        for part in self._parts:
            length = part.stop - part.start
            out[..., part] = fftconvolve(cause[..., part], taps, axes=-1)[..., :length]
        return out


def _products(x: np.ndarray, count: int) -> np.ndarray:
    """Sums of x[t - i] x[t - j] over the samples t, shape (count, count); x is 0 before them."""
    first = _lagged(x, x, count)
    last = np.pad(x[::-1][: count - 1], (0, max(count - 1 - len(x), 0)))
    products = toeplitz(first)
    for i in range(1, count):  # what has left at the end is not in the sum
        products[i, i:] = products[i - 1, i - 1 : -1] - last[i - 1] * last[i - 1 :]
        products[i:, i] = products[i, i:]
    return products


def _lagged(x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
    """Sums of x[t] y[t + lag] over t, for each lag from 0; shape (count,)."""
    products = fftconvolve(y, x[::-1])[len(x) - 1 :][:count]
    return np.pad(products, (0, count - len(products)))
