"""Kullback-Leibler divergence of a histogram from that of a healthy reference.

    healthy = HistogramDivergence(bins=12).fit(reference)  # shape (samples, axes)
    healthy.divergence(hour)  # shape (axes,), in bits: 0 if the shares equal the reference's

All samples are used: values outside the range of the reference are counted in the first or last
bin.
"""

from __future__ import annotations

from numbers import Integral
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

Floats = NDArray[np.float64]

_CONSTANT = 1e-12  # relative to its values; an axis that moves less does not move
_HALF_BIN = 1e-9  # relative half width of the bin that holds such an axis


def kl_divergence(p: ArrayLike, q: ArrayLike, *, smoothing: float = 0.0) -> Floats:
    """Compute the divergence of p from q, KL(p || q) = sum_i p_i log2(p_i / q_i).

    Histograms are normalised. For smoothing, q is first scaled to the number of samples in p. Then
    the same count is added to every bin of both, so that equal shares have a divergence of 0
    whatever the size of the reference. With smoothing, a bin that is empty only in q adds a finite
    amount, which grows with the number of samples in p. Without smoothing, it makes the divergence
    infinite.

    Source: Kullback and Leibler (1951), On information and sufficiency; thesis eq. 4.1, in bits.

    Args:
        p: Counts of current samples, at least 0. Shape (..., bins).
        q: Counts of the reference. Shape (..., bins).
        smoothing: Counts added to each bin, at least 0.

    Returns:
        Divergence in [bit], at least 0. Shape (...).

    Raises:
        ValueError: If p and q differ in bins, have none, negative or infinite counts or only
            empty bins, or if smoothing is negative.
    """
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    if p.ndim == 0 or q.ndim == 0 or p.shape[-1] != q.shape[-1] or p.shape[-1] == 0:
        raise ValueError(f"p and q must have the same bins, got shapes {p.shape} and {q.shape}")
    if not (np.isfinite(smoothing) and smoothing >= 0):
        raise ValueError(f"smoothing must be a number from 0, got {smoothing}")
    p, q = _shares(p, "p", p, smoothing), _shares(q, "q", p, smoothing)
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(p > 0, p * np.log2(p / q), 0.0)
    return np.maximum(terms.sum(axis=-1), 0.0)


class HistogramDivergence(BaseEstimator):
    """Divergence of samples from healthy ones for each axis, by histograms with common edges.

    The thesis uses 60 samples of the torque in each hour, in 12 bins over the share of the highest
    torque. To get its bins, set `range` to minus and plus that torque. By default the 12 bins cover
    the range of the reference.

    Bins are closed on the left. Their edges stay those of the reference, and a value outside of
    them is counted in the first or last bin. An axis that never moves in the reference has no range
    to divide. Then one bin contains its value to a relative 1e-9 (absolute, if it is 0), and wide
    bins lie around it.

    Source: thesis 3.4 and eq. 5.4.

    Args:
        bins: Number of equally wide bins, at least 2.
        smoothing: Counts added to each bin of both histograms, see `kl_divergence`.
        range: Lowest and highest edge, each a number or of shape (axes,), in the unit of the
            samples. By default the lowest and highest value of the reference.

    Attributes:
        edges_: Edges. Shape (axes, bins + 1), in the unit of the samples.
        reference_: Counts of the reference. Shape (axes, bins).
    """

    def __init__(
        self,
        *,
        bins: int = 12,
        smoothing: float = 0.5,
        range: tuple[ArrayLike, ArrayLike] | None = None,
    ) -> None:
        self.bins = bins
        self.smoothing = smoothing
        self.range = range

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Fix the edges and count the healthy samples.

        Args:
            X: Healthy samples. Shape (samples,) or (samples, axes), in any unit.
            y: Not used.

        Returns:
            The estimator itself.

        Raises:
            ValueError: If X is empty or not finite, or an argument of the constructor is invalid.
        """
        if not isinstance(self.bins, Integral) or self.bins < 2:
            raise ValueError(f"bins must be a whole number from 2, got {self.bins}")
        samples = _samples(X)
        if self.range is None:
            low, high = samples.min(axis=0), samples.max(axis=0)
        else:
            low, high = (
                np.broadcast_to(np.asarray(end, dtype=float), samples.shape[1:])
                for end in self.range
            )
            if not np.all(np.isfinite(low) & np.isfinite(high) & (low < high)):
                raise ValueError(f"range must be finite and ascending, got {self.range}")
        self.edges_: Floats = np.linspace(low, high, self.bins + 1, axis=-1)
        size = np.maximum(np.abs(low), np.abs(high))
        for axis in np.flatnonzero(high - low <= _CONSTANT * size):
            # The value is at the middle of a bin: on an edge, rounding would choose its side.
            width = 2 * _HALF_BIN * (size[axis] or 1.0)
            steps = np.arange(self.bins + 1) - self.bins // 2 - 0.5
            self.edges_[axis] = low[axis] + width * steps
        self.reference_: NDArray[np.int_] = self.counts(samples)
        return self

    def counts(self, X: ArrayLike) -> NDArray[np.int_]:
        """Compute the histogram of each axis from all samples.

        Args:
            X: Samples. Shape (samples,) or (samples, axes), in the unit of the reference.

        Returns:
            Counts. Shape (axes, bins).

        Raises:
            ValueError: If X is empty, not finite or has other axes than the reference.
        """
        check_is_fitted(self, "edges_")
        samples = _samples(X)
        axes, bins = len(self.edges_), self.edges_.shape[1] - 1
        if samples.shape[1] != axes:
            raise ValueError(f"X has {samples.shape[1]} axes, the reference has {axes}")
        counts = np.empty((axes, bins), dtype=int)
        for axis, edges in enumerate(self.edges_):
            # Searched without the outer edges, the end bins are open to the outside.
            found = np.searchsorted(edges[1:-1], samples[:, axis], side="right")
            counts[axis] = np.bincount(found, minlength=bins)
        return counts

    def divergence(self, X: ArrayLike) -> Floats:
        """Divergence KL(X || reference) of each axis.

        Args:
            X: Samples. Shape (samples,) or (samples, axes), in the unit of the reference.

        Returns:
            Divergence in [bit], at least 0. Shape (axes,).

        Raises:
            ValueError: As `counts`, or if smoothing is negative.
        """
        return kl_divergence(self.counts(X), self.reference_, smoothing=self.smoothing)


def _shares(counts: Floats, name: str, current: Floats, smoothing: float) -> Floats:
    """Shares of the bins, smoothed as if there were as many samples as in `current`."""
    if not np.isfinite(counts).all() or (counts < 0).any():
        raise ValueError(f"{name} has counts that are negative, infinite or nan")
    total = counts.sum(axis=-1, keepdims=True)
    if (total == 0).any():
        raise ValueError(f"{name} has no samples")
    size = current.sum(axis=-1, keepdims=True)
    return (counts * (size / total) + smoothing) / (size + smoothing * counts.shape[-1])


def _samples(x: ArrayLike) -> Floats:
    """Samples with one column per axis."""
    samples = np.asarray(x, dtype=float)
    if samples.ndim not in (1, 2) or samples.size == 0:
        raise ValueError(f"X must have shape (samples,) or (samples, axes), got {samples.shape}")
    if not np.isfinite(samples).all():
        raise ValueError(f"X has {np.sum(~np.isfinite(samples))} NaN or infinite values")
    return samples.reshape(len(samples), -1)
