"""Series of numbers as series of symbols. A symbol is the number of the value's quantile bin."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Bins = int | Sequence[float]
Floats = NDArray[np.float64]

_MANY = 40  # bins; from here on a search in each series beats comparing all with every edge


def quantile_symbols(x: ArrayLike, bins: Bins) -> NDArray[np.intp]:
    """Replace each value of a series by the number of its quantile bin.

    Bins are closed on the right. Their edges are quantiles of the series itself, type 8 (numpy's
    "median_unbiased"). Such a quantile interpolates between two order statistics, and no value lies
    between these two. The lower one is therefore used as the edge, so that rounding has no
    influence.

    Source: Hyndman and Fan (1996), Sample quantiles in statistical packages; thesis 6.2.2.

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
    order = np.floor(1 / 3 + levels * (n + 1 / 3) + 1e-9).astype(int).clip(1, n) - 1
    rows = np.ascontiguousarray(rows)
    edges = np.sort(rows, axis=-1)[..., order]
    symbols = np.zeros(rows.shape, np.int32 if size**exponent < 2**31 else np.int64)
    if size < _MANY:
        for k in range(len(levels)):
            symbols += rows > edges[..., k, None]
    else:
        for i in np.ndindex(rows.shape[:-1]):
            symbols[i] = np.searchsorted(edges[i], rows[i], side="left")
    return symbols, size


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
