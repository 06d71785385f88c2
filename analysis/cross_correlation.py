"""Lags of the largest cross-correlation between series, and the axis that leads according to them.

cross_correlation_lags(x)  # x of shape (samples, axes): (axes, axes), in samples
isolate_axis_by_lags(x)  # index of the axis that leads all others
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

_TIE = 1e-10  # relative to the largest correlation there can be; smaller differences are rounding


def cross_correlation_lags(x: ArrayLike) -> NDArray[np.int_]:
    """Compute the lag at which the cross-correlation of each pair of axes is largest.

        c(d) = sum_t (x_i[t] - mean_i)(x_j[t + d] - mean_j) / N,  R(d) = c(d) / (s_i s_j)

    The sum runs over the samples that overlap. Entry [i, j] is -d at the largest R. A negative lag
    therefore means that axis i leads axis j. For example, if axis j repeats axis i 7 samples later,
    entry [i, j] is -7 and entry [j, i] is 7. This is the sign of thesis table 3.3; its eq. 3.5 has
    the opposite sign. The largest R is used, not the largest |R|: an axis that mirrors another is
    not aligned with it.

    If several lags have the same maximum, the shortest is used. If these are d and -d, neither axis
    leads and the lag is 0. A constant series has no correlation; its lags are 0.

    Source: thesis eq. 3.5 and 3.6, table 3.3.

    Args:
        x: Series of all axes. Shape (samples, axes), in any unit.

    Returns:
        Antisymmetric lags. Shape (axes, axes), in samples.

    Raises:
        ValueError: x has another shape, fewer than 2 samples or axes, or values that are not
            finite.
    """
    series = np.asarray(x, dtype=float)
    if series.ndim != 2 or min(series.shape) < 2:
        raise ValueError(f"x must have shape (samples > 1, axes > 1), got {series.shape}")
    if not np.isfinite(series).all():
        raise ValueError(f"x has {np.sum(~np.isfinite(series))} NaN or infinite values")
    n, axes = series.shape
    # Scaled to unit norm, the correlations of axes are the R above; constant axes become zero.
    centred = series - series.mean(axis=0)
    norm = np.linalg.norm(centred, axis=0)
    norm[(np.ptp(series, axis=0) == 0) | (norm == 0)] = np.inf
    unit = centred / norm
    shifts = signal.correlation_lags(n, n)
    lags = np.zeros((axes, axes), dtype=int)
    for i in range(axes):
        for j in range(i + 1, axes):
            correlation = signal.correlate(unit[:, i], unit[:, j])
            largest = shifts[correlation >= correlation.max() - _TIE]
            shortest = largest[np.abs(largest) == np.abs(largest).min()]
            lags[i, j] = shortest[0] if len(shortest) == 1 else 0
    return lags - lags.T


def leading_axis(lags: ArrayLike) -> int:
    """Find the axis that leads: it has no positive lag and at least one negative lag.

    Lags of 0 are allowed, as in the thesis: the axis that it names in table 3.3 has one. If two
    axes fulfil the condition, none is named.

    Source: thesis 3.4.2 and table 3.3.

    Args:
        lags: Lags as returned by `cross_correlation_lags`. Shape (axes, axes), in samples.

    Returns:
        Index of the axis from 0, or -1 if no axis, or more than one, leads.
    """
    lags = np.asarray(lags)
    leads = (lags <= 0).all(axis=1) & (lags < 0).any(axis=1)
    return int(np.argmax(leads)) if leads.sum() == 1 else -1


def isolate_axis_by_lags(x: ArrayLike) -> int:
    """Find the axis that leads according to `cross_correlation_lags`, see `leading_axis`.

    Source: thesis 6.4.

    Args:
        x: Series of all axes. Shape (samples, axes), in any unit.

    Returns:
        Index of the axis from 0, or -1 if no axis, or more than one, leads.

    Raises:
        ValueError: As `cross_correlation_lags`.
    """
    return leading_axis(cross_correlation_lags(x))
