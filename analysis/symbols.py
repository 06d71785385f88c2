"""Series of numbers as series of symbols. A symbol is the number of the value's quantile bin.

All measures on symbols get them from here, so that they treat equal values alike.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Bins = int | Sequence[float]
Floats = NDArray[np.float64]

_ROUNDING = 1e-9  # ranks; two that differ by less are equal. Ranks are multiples of 1/(6 bins)
_MANY = 40  # bins; from here on a search in each series beats comparing all with every edge


def quantile_symbols(x: ArrayLike, bins: Bins) -> NDArray[np.intp]:
    """Replace each value of a series by the number of its quantile bin.

    The edges are quantiles of the series itself, type 8 (numpy's "median_unbiased"): in a series of
    n values, the edge at level p has the rank 1/3 + p (n + 1/3). A value belongs to the bin in
    which its rank lies. Only ranks count, so a strictly increasing transform changes nothing.

    Equal values (ties) always share a symbol. In a series with ties:

    - If there are no more distinct values than bins, each distinct value is a symbol.
    - Otherwise, equal values go as a whole to the bin in which their mean rank lies. The lowest
      value is always below the first edge and the highest above the last one, so that a series
      that is not constant never falls into a single bin.
    - If a mean rank is exactly that of an edge, the first sample of another value decides: the
      value joins the bin below the edge if that sample is lower, and the bin above if it is higher.

    If the edges are symmetric, as they are with a number of bins, the negated series is therefore
    divided at the same places. A series without ties has one exception: a value whose rank is
    exactly that of an edge belongs to the bin below, also in the negated series. With an even
    number of bins, this concerns the median of an odd number of samples.

    Source: Hyndman and Fan (1996), Sample quantiles in statistical packages; thesis 6.2.2, which
    says nothing about ties. The rules for ties are ours.

    Args:
        x: Series. Shape (samples,), in any unit.
        bins: Number of equally likely bins, at least 2, or the levels of the edges, ascending
            within (0, 1): (0.05, 0.95) makes three bins.

    Returns:
        Symbols from 0 to the number of edges. Shape (samples,).

    Raises:
        ValueError: If x is not a finite series of at least 3 samples or bins are invalid.
    """
    series = finite(x, "x", "(samples,)", 1)
    return coded(series[:, None], bins, exponent=1)[0][0].astype(np.intp)


def coded(x: Floats, bins: Bins, exponent: int, shortest: int = 3) -> tuple[NDArray, int]:
    """Compute the symbols of each axis.

    Args:
        x: Series of all axes. Shape (..., samples, axes), in any unit.
        bins: Number of bins or levels of their edges, see `quantile_symbols`.
        exponent: Number of symbols that are combined to one code later.
        shortest: Fewest samples that are allowed.

    Returns:
        Symbols from 0, shape (..., axes, samples), and the number of possible symbols.

    Raises:
        ValueError: The bins are invalid or too many, or there are too few samples.
    """
    if isinstance(bins, (int, np.integer)):
        levels = np.arange(1, bins) / max(bins, 1)
    else:
        levels = np.asarray(bins, dtype=float)
    inside = levels.ndim == 1 and levels.size and 0 < levels.min() and levels.max() < 1
    if not inside or np.any(np.diff(levels) <= 0):
        raise ValueError(f"bins must be at least 2, or ascending levels within (0, 1), got {bins}")
    rows, size, n = np.swapaxes(x, -1, -2), len(levels) + 1, x.shape[-2]
    if n < shortest:
        raise ValueError(f"at least {shortest} samples are needed, got {n}")
    if size**exponent > np.iinfo(np.int64).max:
        raise ValueError(f"{size} bins are too many for histories of {exponent - 1} samples in all")
    edge_ranks = 1 / 3 + levels * (n + 1 / 3)
    order = np.floor(edge_ranks + _ROUNDING).astype(int).clip(1, n) - 1
    rows = np.ascontiguousarray(rows)
    ascending = np.sort(rows, axis=-1)
    # No value lies between the two order statistics around a quantile: the lower one is the edge.
    edges = ascending[..., order]
    symbols = np.zeros(rows.shape, np.int32 if size**exponent < 2**31 else np.int64)
    if size < _MANY:
        for k in range(len(levels)):
            symbols += rows > edges[..., k, None]
    else:
        for i in np.ndindex(rows.shape[:-1]):
            symbols[i] = np.searchsorted(edges[i], rows[i], side="left")
    tied = (ascending[..., 1:] == ascending[..., :-1]).any(axis=-1)
    for i in zip(*np.nonzero(tied), strict=True):
        symbols[i] = _with_ties(rows[i], edge_ranks)
    return symbols, size


def _with_ties(series: Floats, edge_ranks: Floats) -> NDArray[np.intp]:
    """Symbols of a series with equal values, shape (samples,); see `quantile_symbols`."""
    values, value_of, counts = np.unique(series, return_inverse=True, return_counts=True)
    if len(values) <= len(edge_ranks) + 1:
        return value_of
    mean_ranks = np.cumsum(counts) - (counts - 1) / 2
    below = np.searchsorted(mean_ranks, edge_ranks - _ROUNDING)  # values below each edge
    for k in np.flatnonzero(
        np.abs(mean_ranks[below.clip(max=len(values) - 1)] - edge_ranks) < _ROUNDING
    ):
        others = value_of[value_of != below[k]]
        below[k] += others[0] < below[k]
    below = below.clip(1, len(values) - 1)
    return np.searchsorted(below, np.arange(len(values)), side="right")[value_of]


def finite(x: ArrayLike, name: str, shape: str, ndim: int) -> Floats:
    """Convert to an array of floats, and check its dimensions and values.

    Args:
        x: The values, in any unit.
        name: Name of the argument, for the message.
        shape: Expected shape, for the message.
        ndim: Expected number of dimensions. Above 1, the last one must have at least 2 elements.

    Returns:
        The values in the same shape.

    Raises:
        ValueError: The shape is another, or a value is not finite.
    """
    array = np.asarray(x, dtype=float)
    if array.ndim != ndim or (ndim > 1 and array.shape[-1] < 2):
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has {np.sum(~np.isfinite(array))} NaN or infinite values")
    return array
