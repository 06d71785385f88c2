"""The minimum of a quadratic function within bounds.

    x = bounded_minimum(precision, right, low, high)

A bound that is clipped after a free solution leaves the other values where the free one put them.
Here they are the best for the values at the bounds.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import lsq_linear


def bounded_minimum(
    precision: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Minimise x' P x / 2 - b' x within bounds.

    Args:
        precision: P, positive definite, shape (values, values).
        right: b, shape (values,).
        low: Lower bounds, shape (values,). They may be infinite, or equal to the upper ones.
        high: Upper bounds, shape (values,).

    Returns:
        The values, shape (values,).
    """
    free = np.linalg.solve(precision, right)  # with less overhead than a Cholesky factor
    if np.all((free >= low) & (free <= high)):
        return np.asarray(free)
    value = np.clip(free, low, high)
    loose = np.isinf(low) & np.isinf(high)
    open_ = np.flatnonzero((high > low) & ~loose)
    shut, loose = np.flatnonzero(high == low), np.flatnonzero(loose)
    rest = right - precision[:, shut] @ value[shut]
    # values without bounds are the best for the others, which leaves a small problem of the others
    inner = cho_factor(precision[np.ix_(loose, loose)])
    across = cho_solve(inner, precision[np.ix_(loose, open_)])
    small = precision[np.ix_(open_, open_)] - precision[np.ix_(open_, loose)] @ across
    root = cholesky((small + small.T) / 2)  # = root' root
    target = solve_triangular(root, rest[open_] - across.T @ rest[loose], trans="T")
    value[open_] = lsq_linear(root, target, (low[open_], high[open_]), method="bvls").x
    value[loose] = cho_solve(inner, rest[loose]) - across @ value[open_]
    return value
