"""Errors of two models on the same samples, compared axis by axis.

    one = compared(error, of_other, inside, parts, period)
    one.worse        # axes on which the first is worse beyond its interval

Both predict the same recording, so that noise and hard motions are common to both and only the
difference of the squared errors counts. Errors last, so that the difference is summed over pieces
of one second. Its mean over the pieces has a t interval (95 %); a ratio estimator accounts for
pieces with fewer samples (Cochran 1977, Sampling Techniques, ch. 6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

LEVEL = 0.95
"""Coverage of the interval."""

RELEVANT = 1.02
"""Ratio of two errors from which their difference matters: assumed. Simulation and regression
differ by as much on a robot without noise, because filters and time steps do."""

BAD = 1e6
"""Relative error that stands for an infinite one."""

_PIECE = 1.0  # duration of a piece [s]: longer than friction and servo remember; assumed
_LEAST = 6  # pieces of an axis that make an interval, if need be shorter ones


@dataclass(frozen=True, eq=False)
class Compared:
    """Relative RMS torque errors of two models on each axis. Arrays of shape (n_axes,)."""

    error: np.ndarray
    """Error of the model, over the RMS torque of the axis."""
    other: np.ndarray
    """Error of the other model."""
    low: np.ndarray
    """Lower end of the interval of the difference of the two errors."""
    high: np.ndarray
    """Its upper end."""

    @property
    def worse(self) -> np.ndarray:
        """Axes on which the model is worse beyond the interval, and by more than `RELEVANT`.

        Shape (n_axes,).
        """
        return (self.low > 0) & (self.error > RELEVANT * self.other)


def compared(
    error: np.ndarray,
    other: np.ndarray,
    inside: np.ndarray,
    parts: Sequence[slice],
    period: float,
) -> Compared:
    """Compare the errors of two models.

    Args:
        error: Error of the model over the RMS torque of its axis, shape (samples, n_axes). What is
            not finite is as bad as can be.
        other: The same of the other model.
        inside: Samples that are used, same shape.
        parts: Slices of samples that are compared; no piece reaches over their ends.
        period: Time between samples [s].

    Returns:
        The comparison. An axis with fewer than three pieces has an infinite interval.
    """
    squares = [
        np.where(inside, np.clip(np.nan_to_num(x, nan=BAD), -BAD, BAD), 0.0) ** 2
        for x in (error, other)
    ]
    pieces = _pieces(parts, period)
    own, others = (np.array([x[piece].sum(axis=0) for piece in pieces]) for x in squares)
    count = np.array([inside[piece].sum(axis=0) for piece in pieces], float)
    total = np.maximum(count.sum(axis=0), 1.0)
    mean, of_other = own.sum(axis=0) / total, others.sum(axis=0) / total
    difference = mean - of_other
    used = (count > 0).sum(axis=0)
    enough = used > 2
    free = np.where(enough, used - 1, 1)
    spread = np.sum((own - others - difference * count) ** 2, axis=0) * used / free
    reach = student.ppf(0.5 + LEVEL / 2, free) * np.sqrt(spread) / total

    def shifted(by: np.ndarray) -> np.ndarray:
        """Difference of the errors for a difference of their squares."""
        return np.asarray(np.sqrt(np.maximum(of_other + by, 0.0)) - np.sqrt(of_other))

    return Compared(
        np.sqrt(mean),
        np.sqrt(of_other),
        np.where(enough, shifted(difference - reach), -np.inf),
        np.where(enough, shifted(difference + reach), np.inf),
    )


def _pieces(parts: Sequence[slice], period: float) -> list[slice]:
    """Cut parts into pieces of about the same duration."""
    total = sum(part.stop - part.start for part in parts)
    length = max(1, min(round(_PIECE / period), total // _LEAST))
    pieces = []
    for part in parts:
        number = max(1, round((part.stop - part.start) / length))
        edges = np.linspace(part.start, part.stop, number + 1).astype(int).tolist()
        pieces += [slice(a, b) for a, b in pairwise(edges)]
    return pieces
