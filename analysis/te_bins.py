"""How many bins should transfer entropy use? The choice needs healthy series only."""

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
    """Compute for each number of bins how often the axis is named to which a trend was added.

    The trend is A sd (k / n)^4 at sample k of n, with sd the axis' own healthy standard deviation.
    It is slow at first and steep towards the end, as wear grows. It is added to every axis of every
    series in turn.

    Args:
        healthy: Healthy series of the length that is to be judged. Shape (series, samples, axes).
        candidates: Numbers of bins.
        amplitudes: Values of A.

    Returns:
        Share of trends whose axis was named. Shape (candidates,).

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
    """Choose the number of bins with which most trends are named, see `isolation_by_bins`.

    Args:
        healthy: Healthy series of the length that is to be judged. Shape (series, samples, axes).
        candidates: Numbers of bins.

    Returns:
        The number of bins. If several are best, the smallest of them.
    """
    ordered = sorted(candidates)
    return ordered[int(np.argmax(isolation_by_bins(healthy, candidates=ordered)))]


def _named(series: np.ndarray, bins: int) -> np.ndarray:
    """Axis with the largest sum of net transfer entropies, shape of the batch."""
    return net_transfer_entropy(series, bins).sum(axis=-1).argmax(axis=-1)
