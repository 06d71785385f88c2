"""Detectors on hourly torque samples. Each gives a score per hour; higher means less normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.analysis.detection import CUSUMChart, EWMAChart
from faultgen.analysis.divergence import HistogramDivergence
from faultgen.analysis.pca import PCAMonitor
from faultgen.studies.chapter3_detection.hourly_torque import HourlyMonitored, Record

KL_Q = "KL + PCA, Q"
KL_BOTH = "KL + PCA, T² and Q"
KL_EWMA = "KL + PCA, EWMA of Q"
TORQUE_PCA = "torques + PCA, T² and Q"
WEAR_CUSUM = "wear of each axis, CUSUM"
WEAR = "wear of each axis, z of 6 h"

DETECTORS = {
    KL_Q: "thesis section 3.4: KL divergence of hourly histograms from healthy ones, PCA, Q",
    KL_BOTH: "the same, but the larger of T² and Q, each divided by its limit",
    KL_EWMA: "an exponentially weighted moving average of the cube root of the same Q",
    TORQUE_PCA: "PCA of the mean torque at each place and the temperature, T² and Q",
    WEAR_CUSUM: "largest cumulative sum (CUSUM) of the hourly severities of the axes",
    WEAR: "largest z (severity over its standard error) of the axes, over six hours",
}
"""Name and idea of every detector."""

_WINDOW = 6
_DAY = 24


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores of a detector for each hour after the training."""

    score: np.ndarray
    """Shape (hours,)."""
    axis: np.ndarray
    """Axis that the detector names, from 0, shape (hours,)."""


@dataclass(frozen=True, eq=False)
class Divergences:
    """The thesis' statistics of a record."""

    divergence: np.ndarray
    """KL of each hour and axis, including the training, shape (hours, n_axes), in [bit]."""
    monitor: PCAMonitor
    """Fitted on the training hours."""

    @classmethod
    def of(cls, record: Record, training: int) -> Divergences:
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
        monitor = PCAMonitor(n_components=0.75).fit(divergence[:training])
        return cls(divergence, monitor)


def score(
    robot: HourlyMonitored, record: Record, training: int, *, temperature_varies: bool
) -> dict[str, Scored]:
    """Score a record with every detector.

    Args:
        robot: The robot, for the directions of wear.
        record: Training and test hours.
        training: Number of training hours at its start.
        temperature_varies: Whether the temperature varies, so that detectors should use it.

    Returns:
        Scores by detector.
    """
    kl = Divergences.of(record, training)
    healthy, test = kl.divergence[:training], kl.divergence[training:]
    q_blame = kl.monitor.q_contributions(test).argmax(axis=1)
    places = record.places
    if temperature_varies:
        places = np.hstack([places, record.temperature[:, None] - robot.reference])
    torques = PCAMonitor(n_components=0.95).fit(places[:training])
    n_axes = record.torque.shape[2]
    by_place = torques.q_contributions(places[training:])
    torque_blame = by_place[:, : places.shape[1] // n_axes * n_axes]
    torque_blame = torque_blame.reshape(len(test), -1, n_axes).sum(axis=1).argmax(axis=1)
    return {
        KL_Q: Scored(kl.monitor.q(test), q_blame),
        KL_BOTH: Scored(-kl.monitor.score_samples(test), q_blame),
        KL_EWMA: Scored(_ewma(kl.monitor.q(healthy), kl.monitor.q(test)), q_blame),
        TORQUE_PCA: Scored(-torques.score_samples(places[training:]), torque_blame),
        **_wear(robot, places, training, temperature_varies),
    }


def _ewma(healthy: np.ndarray, test: np.ndarray) -> np.ndarray:
    """EWMA chart of the cube root of Q, which is nearly Gaussian.

    Args:
        healthy: Q of the training hours, shape (hours,).
        test: Q of the hours to score, shape (hours,).

    Returns:
        The charted statistic over the limit of the chart, shape (hours,). If Q never moved in the
        training, there is no chart, and the hours are scored by Q itself.
    """
    if np.ptp(healthy) == 0:
        return test
    chart = EWMAChart(weight=0.2).fit(np.cbrt(healthy))
    return chart.statistic(np.cbrt(test)) / chart.limit_


def _wear(
    robot: HourlyMonitored, places: np.ndarray, training: int, temperature_varies: bool
) -> dict[str, Scored]:
    isolator = robot.directions.isolator(temperature_varies=temperature_varies, window=_WINDOW)
    isolator.fit([places[:training]])
    ends = range(training + 1, len(places) + 1)
    z = np.array([isolator.isolate(places[k - _WINDOW : k]).z for k in ends])
    z = np.where(robot.turning, z, -np.inf)
    by_hour = isolator.estimate(places)
    sums = np.full(z.shape, -np.inf)
    for axis in np.flatnonzero(robot.turning):
        chart = CUSUMChart(shift=1.0).fit(by_hour[:training, axis])
        sums[:, axis] = chart.statistic(by_hour[training:, axis])
    return {
        WEAR_CUSUM: Scored(sums.max(axis=1), sums.argmax(axis=1)),
        WEAR: Scored(z.max(axis=1), z.argmax(axis=1)),
    }


def alarms(over: np.ndarray) -> int:
    """Count alarms. Hours above the threshold are separate alarms if a day or more apart."""
    count, quiet_until = 0, 0
    for hour in np.flatnonzero(over).tolist():
        if hour >= quiet_until:
            count += 1
            quiet_until = hour + _DAY
    return count


def threshold(healthy: list[np.ndarray], per_month: float) -> float:
    """Find the lowest threshold that gives at most the allowed number of alarms in healthy records.

    Args:
        healthy: Scores of healthy records, shape (hours,) each.
        per_month: Allowed number of alarms in 720 hours.

    Returns:
        The threshold. A score above it is an alarm.
    """
    allowed = per_month * sum(len(s) for s in healthy) / 720
    levels = np.unique(np.concatenate(healthy))
    # the number of alarms falls as the level rises
    low, high = 0, len(levels) - 1
    while low < high:
        middle = (low + high) // 2
        if sum(alarms(s > levels[middle]) for s in healthy) <= allowed:
            high = middle
        else:
            low = middle + 1
    return float(levels[high])
