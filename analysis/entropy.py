"""Conditional entropy of symbols, from the counts of their codes."""

import numpy as np
from numpy.typing import NDArray

from .symbols import Floats

_CHUNK = 1 << 14  # codes and counts held at a time, so that they stay in the cache


def entropy_left(past: NDArray, following: NDArray, size: int) -> Floats:
    """Compute the entropy of `following` given `past`, for each row.

    Args:
        past: Code of the symbols before each window. Shape (..., windows).
        following: Symbol after each window, from 0 to size - 1. Same shape.
        size: Number of possible symbols.

    Returns:
        Entropy in [bit]. Shape (...).
    """
    codes = np.sort(past * size + following, axis=-1)
    return (_sum_c_log_c(codes // size) - _sum_c_log_c(codes)) / codes.shape[-1]


def entropy_left_counted(x: NDArray, y: NDArray, size: int) -> Floats:
    """Compute the entropy of y's next symbol given the last symbols of y and x, for each row of x.

    It counts in a table of all codes, which is faster than sorting if the table is not much longer
    than the series.

    Args:
        x: Symbols of the sources. Shape (rows, n - 1).
        y: Symbols of the target. Shape (n,).
        size: Number of possible symbols.

    Returns:
        Entropy in [bit]. Shape (rows,).
    """
    rows, windows = x.shape
    c_log_c = _c_log_c(windows)
    step = max(1, _CHUNK // max(windows, size**3))
    # The next symbol goes first, so that sums over it run along the memory.
    table = np.arange(step)[:, None] * size**3 + (y[1:] * size + y[:-1]) * size
    left = np.empty(rows)
    for start in range(0, rows, step):
        part = x[start : start + step]
        codes = (part + table[: len(part)]).ravel()
        counts = np.bincount(codes, minlength=len(part) * size**3).reshape(len(part), size, -1)
        of_past, of_all = c_log_c[counts.sum(axis=1)], c_log_c[counts.reshape(len(part), -1)]
        left[start : start + step] = of_past.sum(axis=1) - of_all.sum(axis=1)
    return left / windows


def _c_log_c(largest: int) -> Floats:
    """Values of c log2(c) for the counts c from 0. Shape (largest + 1,)."""
    c_log_c = np.arange(largest + 1.0)
    c_log_c[1:] *= np.log2(c_log_c[1:])
    return c_log_c


def _sum_c_log_c(codes: NDArray) -> Floats:
    """Sum of c log2(c) over the counts c of equal codes, of each sorted row."""
    rows = codes.reshape(-1, codes.shape[-1])
    is_first = np.ones(rows.shape, dtype=bool)
    np.not_equal(rows[:, 1:], rows[:, :-1], out=is_first[:, 1:])
    first = np.flatnonzero(is_first)
    counts = np.empty_like(first)
    np.subtract(first[1:], first[:-1], out=counts[:-1])
    counts[-1] = rows.size - first[-1]
    row_starts = np.searchsorted(first, np.arange(0, rows.size, rows.shape[1]))
    c_log_c = _c_log_c(rows.shape[1])
    return np.add.reduceat(c_log_c[counts], row_starts).reshape(codes.shape[:-1])
