"""How many bins for transfer entropy: chosen on healthy series alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .transfer_entropy import net_transfer_entropy

CANDIDATES = (2, 3, 4, 5, 6, 8, 10, 12, 15, 20)


def isolation_by_bins(
    healthy: ArrayLike,
    *,
    candidates: Sequence[int] = CANDIDATES,
    amplitudes: Sequence[float] = (1.0, 2.0, 4.0),
) -> np.ndarray:
    """How often the axis is named on which a trend is put, for each number of bins.

    The trend is A sd (k / n)^4 at sample k of n, with sd the axis' own healthy standard deviation:
    slow at first and steep towards the end, as wear grows. Every axis of every series gets it in
    turn.

    Args:
        healthy: Healthy series of the length that is to be judged. Shape (series, samples, axes).
        candidates: Numbers of bins.
        amplitudes: Values of A.

    Returns:
        Share of trends that were named. Shape (candidates,).

    Raises:
        ValueError: As `net_transfer_entropy`.
    """
    series = np.asarray(healthy, float)
    if series.ndim != 3:
        raise ValueError(f"healthy must have shape (series, samples, axes), got {series.shape}")
    if not len(candidates):
        raise ValueError("candidates must hold at least one number of bins")
    n, axes = series.shape[1:]
    shape = ((np.arange(n) + 1) / n) ** 4
    spread = series.std(axis=1)
    worn = np.repeat(series[None], axes * len(amplitudes), axis=0)
    for index, (axis, amplitude) in enumerate(np.ndindex(axes, len(amplitudes))):
        worn[index, :, :, axis] += amplitudes[amplitude] * spread[:, axis, None] * shape
    truth = np.repeat(np.arange(axes), len(amplitudes))[:, None]
    return np.array([np.mean(_named(worn, bins) == truth) for bins in candidates])


def choose_bins(healthy: ArrayLike, *, candidates: Sequence[int] = CANDIDATES) -> int:
    """Number of bins with which transfer entropy names most trends, see `isolation_by_bins`.

    Args:
        healthy: Healthy series of the length that is to be judged. Shape (series, samples, axes).
        candidates: Numbers of bins.

    Returns:
        The number of bins; the smallest of those that are best.
    """
    ordered = sorted(candidates)
    return ordered[int(np.argmax(isolation_by_bins(healthy, candidates=ordered)))]


def _named(series: np.ndarray, bins: int) -> np.ndarray:
    """Axis with the largest sum of net transfer entropies, shape of the batch."""
    return net_transfer_entropy(series, bins).sum(axis=-1).argmax(axis=-1)
