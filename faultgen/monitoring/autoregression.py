"""Coloured noise as an autoregression, x_t = sum of a_k x_(t-k) + e_t."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_LENGTH = 4096  # samples after which noise has forgotten an innovation


def impulse_response(coefficients: ArrayLike) -> np.ndarray:
    """Compute how an autoregression answers to one innovation of 1.

    Args:
        coefficients: The a_k, shape (order,).

    Returns:
        The answer, shape (4096,), without unit.
    """
    from scipy.signal import lfilter  # takes a second, so only when needed

    impulse = np.zeros(_LENGTH)
    impulse[0] = 1.0
    return lfilter([1.0], [1.0, *(-np.asarray(coefficients))], impulse)


def amplification(coefficients: ArrayLike) -> float:
    """Compute the standard deviation of the noise over that of its innovations.

    Args:
        coefficients: The a_k, shape (order,).
    """
    return float(np.sqrt(np.sum(impulse_response(coefficients) ** 2)))
