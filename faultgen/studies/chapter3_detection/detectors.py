"""The detectors of hours of the study `detection`. Each is a class and one line of a table.

Detectors of other packages join them if hours have the features that they need.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from faultgen.analysis.detection import CUSUMChart, EWMAChart
from faultgen.analysis.divergence import HistogramDivergence
from faultgen.analysis.isolation import ChangeIsolator
from faultgen.analysis.pca import PCAMonitor
from faultgen.errors import InputError
from faultgen.evaluation.detectors import DETECTORS as OF_CYCLES
from faultgen.evaluation.methods import HOURS, Detector, class_name
from faultgen.studies.chapter3_detection.hourly_torque import HOURLY, HourlyTorque

COMPONENTS = 0.75
"""Share of the variance of the divergences that the components exceed, as in the thesis."""

_WINDOW = 6  # hours


@dataclass(frozen=True, eq=False)
class Divergences:
    """The thesis' statistics of a record."""

    divergence: np.ndarray
    """KL of each hour and axis, including the training, shape (hours, n_axes), in [bit]."""
    monitor: PCAMonitor
    """Fitted on the training hours."""

    @classmethod
    def of(cls, record: HourlyTorque, training: int) -> Divergences:
        """Compute histograms and PCA of thesis 3.4.

        Args:
            record: Training and test hours.
            training: Number of training hours at its start.

        Returns:
            The statistics.
        """
        torque = record.torque
        healthy = torque[:training].reshape(-1, torque.shape[2])
        histograms = HistogramDivergence(bins=12).fit(healthy)
        divergence = np.array([histograms.divergence(hour) for hour in torque])
        monitor = PCAMonitor(n_components=COMPONENTS).fit(divergence[:training])
        return cls(divergence, monitor)


class DivergenceQ(Detector):
    """The thesis' statistic: Q of a PCA of the divergences."""

    name = "KL + PCA, Q"
    idea = "thesis section 3.4: KL divergence of hourly histograms from healthy ones, PCA, Q"
    features = ("kl_divergence",)
    rows = (HOURS,)
    components: ClassVar[float] = COMPONENTS

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the components.

        Args:
            healthy: Divergences of the training hours.
        """
        self.monitor = PCAMonitor(n_components=self.components).fit(np.vstack(healthy[0]))
        self.limit_ = self.monitor.q_limit_

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute Q of each hour.

        Returns:
            Shape (hours,).
        """
        return self.monitor.q(features[0])

    def blame(self, *features: np.ndarray) -> np.ndarray:
        """Name the axis that contributes most to Q.

        Returns:
            From 0. Shape (hours,).
        """
        return self.monitor.q_contributions(features[0]).argmax(axis=1)


class DivergenceBoth(DivergenceQ):
    """The larger of T² and Q, each divided by its limit."""

    name = "KL + PCA, T² and Q"
    idea = "the same, but the larger of T² and Q, each divided by its limit"

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the components.

        Args:
            healthy: Divergences of the training hours.
        """
        super().fit(*healthy)
        self.limit_ = 1.0

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the larger of both statistics of each hour, each over its limit.

        Returns:
            Shape (hours,).
        """
        return -self.monitor.score_samples(features[0])


class ChartOfQ:
    """An EWMA chart of the cube root of Q, which is nearly Gaussian.

    If Q never moved in the training, there is no chart, and the hours are scored by Q itself.
    """

    def fit(self, q: np.ndarray) -> ChartOfQ:
        """Learn the chart.

        Args:
            q: Q of the training hours, shape (hours,).

        Returns:
            The chart.
        """
        self.chart = None if np.ptp(q) == 0 else EWMAChart(weight=0.2).fit(np.cbrt(q))
        return self

    def score(self, q: np.ndarray) -> np.ndarray:
        """Compute the charted statistic over its limit.

        Args:
            q: Q of the hours to score, shape (hours,).

        Returns:
            Shape (hours,). Above 1 is an alarm.
        """
        return q if self.chart is None else self.chart.statistic(np.cbrt(q)) / self.chart.limit_


class DivergenceEWMA(DivergenceQ):
    """A chart of the same Q."""

    name = "KL + PCA, EWMA of Q"
    idea = "an exponentially weighted moving average of the cube root of the same Q"

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the components and the chart.

        Args:
            healthy: Divergences of the training hours.
        """
        super().fit(*healthy)
        self.chart = ChartOfQ().fit(self.monitor.q(np.vstack(healthy[0])))
        self.limit_ = 1.0

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the charted statistic of each hour over the limit of the chart.

        Returns:
            Shape (hours,).
        """
        return self.chart.score(self.monitor.q(features[0]))


class PlacePCA(Detector):
    """A PCA of the mean torques at each place of the cycle."""

    name = "torques + PCA, T² and Q"
    idea = "PCA of the mean torque at each place and the temperature, T² and Q"
    features = ("torque_by_place", "temperature")
    rows = (HOURS,)

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the components.

        Args:
            healthy: Mean torques and temperature of the training hours.
        """
        columns = np.vstack([self._columns(*one) for one in zip(*healthy, strict=True)])
        self.monitor = PCAMonitor(n_components=0.95).fit(columns)
        self.limit_ = 1.0

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the larger of T² and Q of each hour, each over its limit.

        Returns:
            Shape (hours,).
        """
        return -self.monitor.score_samples(self._columns(*features))

    def blame(self, *features: np.ndarray) -> np.ndarray:
        """Name the axis whose places contribute most to Q.

        Returns:
            From 0. Shape (hours,).
        """
        by_column = self.monitor.q_contributions(self._columns(*features))
        by_place = by_column[:, : features[0].shape[1]]
        n_axes = self.setting.n_axes
        return by_place.reshape(len(by_place), -1, n_axes).sum(axis=1).argmax(axis=1)

    def _columns(self, places: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        if not self.setting.temperature_varies:
            return places
        return np.hstack([places, temperature[:, None] - self.setting.reference_temperature])


class Wear(PlacePCA):
    """The severity of each axis by the model, over its standard error.

    The hours that are scored follow the training hours, whose last ones are part of the first
    windows.
    """

    name = "wear of each axis, z of 6 h"
    idea = "largest z (severity over its standard error) of the axes, over six hours"

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the healthy spread.

        Args:
            healthy: Mean torques and temperature of the training hours.
        """
        columns = np.vstack([self._columns(*one) for one in zip(*healthy, strict=True)])
        self.isolator: ChangeIsolator = self.setting.directions["torque_by_place"].isolator(
            temperature_varies=self.setting.temperature_varies, window=_WINDOW
        )
        self.isolator.fit([columns])
        self._before = columns[1 - _WINDOW :]
        turning = self.setting.turning
        self._turning = np.ones(self.setting.n_axes, bool) if turning is None else turning
        self.limit_ = self.isolator.limit_

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the largest statistic of the axes in each hour.

        Returns:
            Shape (hours,).
        """
        return self.statistics(*features).max(axis=1)

    def blame(self, *features: np.ndarray) -> np.ndarray:
        """Name the axis with the largest statistic.

        Returns:
            From 0. Shape (hours,).
        """
        return self.statistics(*features).argmax(axis=1)

    def statistics(self, *features: np.ndarray) -> np.ndarray:
        """Compute the z of each axis over six hours.

        Args:
            features: Mean torques and temperature.

        Returns:
            Shape (hours, n_axes); -inf for an axis that does not turn.
        """
        columns = np.vstack([self._before, self._columns(*features)])
        ends = range(_WINDOW, len(columns) + 1)
        z = np.array([self.isolator.isolate(columns[k - _WINDOW : k]).z for k in ends])
        return np.where(self._turning, z, -np.inf)


class WearCUSUM(Wear):
    """A chart of the severity of each axis by the model."""

    name = "wear of each axis, CUSUM"
    idea = "largest cumulative sum (CUSUM) of the hourly severities of the axes"

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the healthy spread and the charts.

        Args:
            healthy: Mean torques and temperature of the training hours.
        """
        super().fit(*healthy)
        columns = np.vstack([self._columns(*one) for one in zip(*healthy, strict=True)])
        by_hour = self.isolator.estimate(columns)
        self.charts = {
            int(axis): CUSUMChart(shift=1.0).fit(by_hour[:, axis])
            for axis in np.flatnonzero(self._turning)
        }
        self.limit_ = max((chart.limit_ for chart in self.charts.values()), default=np.inf)

    def statistics(self, *features: np.ndarray) -> np.ndarray:
        """Compute the cumulative sum of each axis.

        Args:
            features: Mean torques and temperature.

        Returns:
            Shape (hours, n_axes); -inf for an axis that does not turn.
        """
        by_hour = self.isolator.estimate(self._columns(*features))
        sums = np.full(by_hour.shape, -np.inf)
        for axis, chart in self.charts.items():
            sums[:, axis] = chart.statistic(by_hour[:, axis])
        return sums


WEAR = Wear.name
"""Name of the best detector."""

_OWN: tuple[type[Detector], ...] = (
    DivergenceQ,
    DivergenceBoth,
    DivergenceEWMA,
    PlacePCA,
    WearCUSUM,
    Wear,
)
_OTHERS = [one for one in OF_CYCLES.values() if HOURS in one.rows]
for _one in _OTHERS:
    if _one.name in {own.name for own in _OWN}:
        raise InputError(f"{class_name(_one)}: study detection has a detector '{_one.name}'")

DETECTORS = {
    one.name: one for one in (*_OWN, *(one for one in _OTHERS if set(one.features) <= set(HOURLY)))
}
"""Every detector of hours by its name, in the order of the tables."""

LEFT_OUT = {
    one.name: ", ".join(sorted(set(one.features) - set(HOURLY)))
    for one in _OTHERS
    if one.name not in DETECTORS
}
"""Detectors of other packages that cannot judge hours, and the features that hours lack."""
