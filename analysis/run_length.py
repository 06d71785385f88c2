"""Run length of control charts: the number of samples until the alarm, computed exactly.

The run length of independent Gaussian samples with the same mean follows from an integral
equation, which is solved on Gauss-Legendre nodes. Means and distributions have more correct digits
than published tables. A Markov chain of the same size (Brook and Evans 1972) has about three.

    ewma_run_length(0.1, 2.814, two_sided=True).mean  # 500 samples until a false alarm
    cusum_run_length(0.5, 5, shift=1).mean  # 10.4 samples until the alarm
    cusum_run_length(0.5, 5).probability_within(720)  # of a false alarm in a month of hours
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, log, pi, sqrt

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, roots_legendre

from .symbols import Floats

_DEEP = 9.0  # standard deviations of a one-sided EWMA, below which it is never found
_LONGEST = 1e9  # samples; means of longer runs lose their digits to rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class RunLength:
    """Distribution of the number of samples up to the alarm, including its sample."""

    mean: float
    """Average run length, in samples."""
    sides: tuple[tuple[Floats, Floats], ...]
    """For each side of the chart, the densities of the statistic times the weights of its nodes:
    after the first sample, shape (nodes,), and after a sample that started from a node, shape
    (nodes, nodes)."""

    def probability_within(self, samples: int) -> float:
        """Compute the probability of an alarm within the first samples.

        The sides of a two-sided CUSUM are assumed to be independent, see `cusum_run_length`.

        Args:
            samples: Number of samples, at least 0.

        Returns:
            Probability, 0 for 0 samples.

        Raises:
            ValueError: If samples is negative.
        """
        if samples < 0:
            raise ValueError(f"samples must be at least 0, got {samples}")
        if samples == 0:
            return 0.0
        silent = 1.0
        for first, moves in self.sides:
            silent *= float(first @ np.linalg.matrix_power(moves, samples - 1).sum(axis=1))
        return min(max(1.0 - silent, 0.0), 1.0)


def ewma_run_length(
    weight: float,
    width: float,
    shift: float = 0.0,
    *,
    two_sided: bool = False,
    first_shift: float | None = None,
) -> RunLength:
    """Run length of an exponentially weighted moving average, E = weight z + (1 - weight) E.

    E starts at 0. An alarm is raised when E, or |E| if the chart has two sides, exceeds width
    sqrt(weight / (2 - weight)), which is `width` times its standard deviation after many samples.

    Source: Crowder (1987), A simple method for studying run-length distributions of exponentially
    weighted moving average charts; Lucas and Saccucci (1990), Exponentially weighted moving average
    control schemes, table 3, whose values it reproduces.

    Args:
        weight: Weight of the newest sample, above 0 and at most 1.
        width: Control limit, in standard deviations of E.
        shift: Mean of the samples, in their standard deviations.
        two_sided: Whether an alarm is also raised below the negative limit.
        first_shift: Mean of the first sample, if it differs.

    Returns:
        Run length.

    Raises:
        ValueError: If the weight or the width is out of range.
    """
    if not 0 < weight <= 1:
        raise ValueError(f"weight must be above 0 and at most 1, got {weight}")
    if width <= 0:
        raise ValueError(f"width must be above 0, got {width}")
    deviation = sqrt(weight / (2 - weight))
    limit = width * deviation
    lowest = -limit if two_sided else -_DEEP * deviation + min(shift, 0.0)
    nodes, weights = _legendre(lowest, limit, weight)

    def density(start: Floats | float, mean: float) -> Floats:
        z = (nodes - (1 - weight) * np.asarray(start)[..., None]) / weight - mean
        return weights * _normal(z) / weight

    first = density(0.0, shift if first_shift is None else first_shift)
    moves = density(nodes, shift)
    return RunLength(mean=_mean(first, moves), sides=((first, moves),))


def cusum_run_length(
    reference: float,
    interval: float,
    shift: float = 0.0,
    *,
    two_sided: bool = False,
    first_shift: float | None = None,
) -> RunLength:
    """Run length of a cumulative sum, C = max(0, C + z - reference).

    C starts at 0. An alarm is raised when C exceeds the interval. A chart with two sides has a
    second sum for -z; its mean run length is exactly 1 / (1 / mean of one + 1 / mean of the other).
    `probability_within` assumes that the two sides are independent. Its result is therefore up to
    0.02 too low at references from 0.5 on, and up to 0.05 too low at 0.1.

    Source: Page (1954), Continuous inspection schemes; Goel and Wu (1971), Determination of A.R.L.
    and a contour nomogram for CUSUM charts to control normal mean; Kemp (1961) for two sides.

    Args:
        reference: Number subtracted from each sample: half the shift to be found, at least 0, in
            standard deviations of the samples.
        interval: Control limit, in the same unit.
        shift: Mean of the samples, in the same unit.
        two_sided: Whether a second sum detects a decrease.
        first_shift: Mean of the first sample, if it differs.

    Returns:
        Run length.

    Raises:
        ValueError: If the reference or the interval is out of range.
    """
    if reference < 0:
        raise ValueError(f"reference must be at least 0, got {reference}")
    if interval <= 0:
        raise ValueError(f"interval must be above 0, got {interval}")
    nodes, weights = _legendre(0.0, interval, 1.0)
    nodes, weights = np.concatenate([[0.0], nodes]), np.concatenate([[0.0], weights])

    def density(start: Floats | float, mean: float) -> Floats:
        z = nodes - np.asarray(start)[..., None] + reference - mean
        chance = weights * _normal(z)
        # The first node is 0 itself, where the sum rests with a probability of its own.
        chance[..., 0] = ndtr(z[..., 0])
        return chance

    first_mean = shift if first_shift is None else first_shift
    sides = tuple(
        (density(0.0, sign * first_mean), density(nodes, sign * shift))
        for sign in ((1, -1) if two_sided else (1,))
    )
    mean = 1 / sum(1 / _mean(*side) for side in sides)
    return RunLength(mean=mean, sides=sides)


@lru_cache(maxsize=128)
def ewma_width(weight: float, run_length: float, *, two_sided: bool = False) -> float:
    """Find the width of the EWMA chart that has `run_length` samples between false alarms.

    Args:
        weight: Weight of the newest sample, above 0 and at most 1.
        run_length: Average run length without a shift, in samples.
        two_sided: Whether the chart has two sides.

    Returns:
        Width, as in `ewma_run_length`.

    Raises:
        ValueError: If the weight is out of range, or no width gives that run length.
    """
    return _solve(
        lambda width: ewma_run_length(weight, width, two_sided=two_sided).mean, run_length
    )


@lru_cache(maxsize=128)
def cusum_interval(reference: float, run_length: float, *, two_sided: bool = False) -> float:
    """Find the interval of the CUSUM chart that has `run_length` samples between false alarms.

    Args:
        reference: Number subtracted from each sample, in standard deviations, at least 0.
        run_length: Average run length without a shift, in samples.
        two_sided: Whether the chart has two sides.

    Returns:
        Interval, as in `cusum_run_length`.

    Raises:
        ValueError: If the reference is out of range, or no interval gives that run length.
    """
    return _solve(
        lambda interval: cusum_run_length(reference, interval, two_sided=two_sided).mean,
        run_length,
    )


@lru_cache(maxsize=64)
def _unit_legendre(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights on (-1, 1). Shape (count,) each."""
    return roots_legendre(count)


def _legendre(lowest: float, highest: float, deviation: float) -> tuple[Floats, Floats]:
    """Nodes and weights that integrate a Gaussian with that deviation between the ends."""
    # Four nodes a standard deviation give 8 digits or more; multiples of 16 are kept for reuse.
    count = 16 * ceil((32 + 4 * (highest - lowest) / deviation) / 16)
    nodes, weights = _unit_legendre(count)
    half = (highest - lowest) / 2
    return lowest + half * (nodes + 1), half * weights


def _normal(z: Floats) -> Floats:
    """Density of the standard normal distribution."""
    return np.exp(-z * z / 2) / sqrt(2 * pi)


def _mean(first: Floats, moves: Floats) -> float:
    """Average run length of one side."""
    left = np.linalg.solve(np.eye(len(moves)) - moves, np.ones(len(moves)))
    return 1.0 + float(first @ left)


def _solve(mean: Callable[[float], float], run_length: float) -> float:
    """Limit at which the mean run length has the required value."""
    low = high = 0.05
    shortest = mean(low)
    if not shortest <= run_length <= _LONGEST:
        raise ValueError(
            f"run length must lie between {shortest:.4g} and {_LONGEST:g} samples, got {run_length}"
        )
    while mean(high) < run_length:
        low, high = high, 1.3 * high
    if high == low:
        return low
    return float(brentq(lambda limit: log(mean(limit) / run_length), low, high, xtol=1e-9))
