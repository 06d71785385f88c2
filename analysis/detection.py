"""Control charts: alarms in a series, with a known mean number of samples between false alarms.

    chart = EWMAChart(in_control_run_length=1000).fit(healthy)  # values of a healthy robot
    chart.first_alarm(values)  # index of the first alarm, or None
    chart.average_run_length(0.5)  # samples until a shift of half a standard deviation is found
    chart.run_length().probability_within(720)  # of a false alarm within 720 samples

Values of condition monitoring, temperatures above all, depend on the values before them. Limits for
independent samples then give many times too many false alarms. These charts therefore watch the
one-step residuals of a first-order autoregression. If that model holds, the residuals are
independent, and the exact run lengths of independent samples apply. No simulation and no seed are
needed. A chart of the values themselves, with limits widened by simulation, finds shifts about as
early at an autocorrelation of 0.5. At 0.9 it finds a shift of one deviation after 59 samples. The
residuals find it after 77 samples, or after 59 if the weight is 0.03 instead of 0.1.

The limits depend on the healthy values from which they were learned. If charts are fitted to 100
independent samples for 500 samples between false alarms, a quarter of them gives less than 280 and
a quarter more than 1500. At an autocorrelation of 0.9, a quarter gives less than 170. With 1000
samples, half of the charts lie between 350 and 650. Fit to as many samples as there are.

The limits hold for Gaussian values. T², Q and other sums of squares are skewed: T² of three
components gives 245 instead of 500 samples with EWMAChart, and 142 with CUSUMChart. Chart the cube
root of such values, which is nearly Gaussian (Wilson and Hilferty 1931): it gives about 470.
"""

from abc import ABC, abstractmethod
from math import sqrt
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter
from sklearn.base import BaseEstimator

from .run_length import (
    RunLength,
    cusum_interval,
    cusum_run_length,
    ewma_run_length,
    ewma_width,
)
from .symbols import Floats, finite

_FEWEST = 10  # healthy samples
_LARGEST = 0.99  # autocorrelation; beyond it a mean cannot be learned


class _Chart(BaseEstimator, ABC):
    """Common part of the charts: the healthy model, standard residuals and alarms."""

    two_sided: bool
    in_control_run_length: float

    def fit(self, x: ArrayLike, y: object = None) -> Self:
        """Learn mean, deviation, autocorrelation and control limit from healthy values.

        Learns `mean_` and `std_` of the values, `autocorrelation_` between neighbours,
        `residual_std_` of the autoregression, and `limit_`, in standard deviations of a residual.
        The autocorrelation is corrected for the bias of short series, (1 + 3 r) / n.

        Source: Kendall (1954), Note on bias in the estimation of autocorrelation.

        Args:
            x: Values of the healthy robot. Shape (samples,), in any unit.
            y: Not used.

        Returns:
            The chart.

        Raises:
            ValueError: If x is not a finite series of at least 10 samples, or is constant, or the
                settings of the chart are out of range.
        """
        values = finite(x, "x", "(samples,)", 1)
        n = len(values)
        if n < _FEWEST:
            raise ValueError(f"at least {_FEWEST} samples are needed, got {n}")
        if np.ptp(values) == 0:
            raise ValueError(f"x is constant at {values[0]}")
        limit = self._limit()
        centred = values - values.mean()
        r = float(centred[1:] @ centred[:-1] / (centred @ centred))
        self.mean_ = float(values.mean())
        self.std_ = float(values.std(ddof=1))
        self.autocorrelation_ = min(r + (1 + 3 * r) / n, _LARGEST)
        residuals = centred[1:] - self.autocorrelation_ * centred[:-1]
        self.residual_std_ = sqrt(residuals @ residuals / (n - 3))
        self.limit_ = limit
        return self

    def statistic(self, x: ArrayLike) -> Floats:
        """Compute the charted statistic after each sample.

        Args:
            x: Values in the order of time. Shape (samples,), in the unit of the healthy ones.

        Returns:
            Statistic, in standard deviations of a residual. It is 0 before the first sample. Shape
            (samples,).

        Raises:
            ValueError: If x is not a finite series, or the chart is not fitted.
        """
        if not hasattr(self, "limit_"):
            raise ValueError("the chart is not fitted; call fit with healthy values first")
        centred = finite(x, "x", "(samples,)", 1) - self.mean_
        # Nothing is known before the first value, which is a draw from the distribution of all.
        residuals = centred / self.std_
        residuals[1:] = (centred[1:] - self.autocorrelation_ * centred[:-1]) / self.residual_std_
        return self._statistic(residuals)

    def predict(self, x: ArrayLike) -> NDArray[np.int_]:
        """Find the samples that are in alarm, marked as scikit-learn marks outliers.

        Args:
            x: Values in the order of time. Shape (samples,), in the unit of the healthy ones.

        Returns:
            -1 for samples in alarm, 1 for others. Shape (samples,). The chart continues after an
            alarm without a reset.

        Raises:
            ValueError: As `statistic`.
        """
        return np.where(self._exceeds(self.statistic(x)), -1, 1)

    def first_alarm(self, x: ArrayLike) -> int | None:
        """Find the first sample in alarm.

        Args:
            x: Values in the order of time. Shape (samples,), in the unit of the healthy ones.

        Returns:
            Index from 0, or None without an alarm.

        Raises:
            ValueError: As `statistic`.
        """
        alarms = np.flatnonzero(self._exceeds(self.statistic(x)))
        return int(alarms[0]) if len(alarms) else None

    def run_length(self, shift: float = 0.0) -> RunLength:
        """Compute the run length if the mean of the values is shifted from the first sample on.

        From the second sample on, the residuals are shifted by sqrt((1 - r) / (1 + r)) times as
        many of their standard deviations, where r is the autocorrelation. The learned mean,
        deviation and autocorrelation are assumed to be exact.

        Args:
            shift: Shift of the mean, in standard deviations of the values.

        Returns:
            Run length.

        Raises:
            ValueError: If the chart is not fitted.
        """
        if not hasattr(self, "limit_"):
            raise ValueError("the chart is not fitted; call fit with healthy values first")
        r = self.autocorrelation_
        return self._run_length(shift * sqrt((1 - r) / (1 + r)), shift)

    def average_run_length(self, shift: float = 0.0) -> float:
        """Mean of `run_length`, in samples."""
        return self.run_length(shift).mean

    def _exceeds(self, statistic: Floats) -> NDArray[np.bool_]:
        """Which values of the statistic are in alarm."""
        return (np.abs(statistic) if self.two_sided else statistic) > self.limit_

    @abstractmethod
    def _limit(self) -> float:
        """Control limit for the in-control run length, in standard deviations of a residual."""

    @abstractmethod
    def _statistic(self, residuals: Floats) -> Floats:
        """The charted statistic of standard residuals."""

    @abstractmethod
    def _run_length(self, shift: float, first_shift: float) -> RunLength:
        """Run length of standard residuals with the given means."""


class EWMAChart(_Chart):
    """Exponentially weighted moving average, E = weight z + (1 - weight) E, of residuals z.

    An alarm is raised when E exceeds `limit_`. The limit is constant, and the run length is exact
    for it. A limit that widens from the first sample on would find earlier only those shifts that
    exist at the start.

    Source: Roberts (1959), Control chart tests based on geometric moving averages; Lucas and
    Saccucci (1990), Exponentially weighted moving average control schemes.

    Args:
        weight: Weight of the newest sample. Small weights find small shifts.
        in_control_run_length: Mean number of samples between false alarms.
        two_sided: Whether a decrease raises an alarm, too.
    """

    def __init__(
        self,
        *,
        weight: float = 0.1,
        in_control_run_length: float = 500.0,
        two_sided: bool = False,
    ) -> None:
        self.weight = weight
        self.in_control_run_length = in_control_run_length
        self.two_sided = two_sided

    def _limit(self) -> float:
        width = ewma_width(self.weight, self.in_control_run_length, two_sided=self.two_sided)
        return width * sqrt(self.weight / (2 - self.weight))

    def _statistic(self, residuals: Floats) -> Floats:
        return lfilter([self.weight], [1.0, self.weight - 1.0], residuals)

    def _run_length(self, shift: float, first_shift: float) -> RunLength:
        width = self.limit_ / sqrt(self.weight / (2 - self.weight))
        return ewma_run_length(
            self.weight, width, shift, two_sided=self.two_sided, first_shift=first_shift
        )


class CUSUMChart(_Chart):
    """Cumulative sum, C = max(0, C + z - shift / 2), of residuals z.

    An alarm is raised when C exceeds `limit_`. A chart with two sides has a second sum for -z, and
    the statistic is the larger of the two.

    Source: Page (1954), Continuous inspection schemes.

    Args:
        shift: Shift of the residuals that is to be found earliest, in their standard deviations.
        in_control_run_length: Mean number of samples between false alarms.
        two_sided: Whether a decrease raises an alarm, too.
    """

    def __init__(
        self,
        *,
        shift: float = 1.0,
        in_control_run_length: float = 500.0,
        two_sided: bool = False,
    ) -> None:
        self.shift = shift
        self.in_control_run_length = in_control_run_length
        self.two_sided = two_sided

    def _limit(self) -> float:
        return cusum_interval(self.shift / 2, self.in_control_run_length, two_sided=self.two_sided)

    def _statistic(self, residuals: Floats) -> Floats:
        upper = self._sum(residuals)
        return np.maximum(upper, self._sum(-residuals)) if self.two_sided else upper

    def _sum(self, residuals: Floats) -> Floats:
        # The sum that restarts at 0 is the plain sum above its lowest value so far.
        plain = np.cumsum(residuals - self.shift / 2)
        return plain - np.minimum(np.minimum.accumulate(plain), 0.0)

    def _run_length(self, shift: float, first_shift: float) -> RunLength:
        return cusum_run_length(
            self.shift / 2, self.limit_, shift, two_sided=self.two_sided, first_shift=first_shift
        )
