"""Monitoring data of one robot, reduced to one row per day, thesis 5.3.2.

series = daily(record)
series.day, series.values["estimated torque"], series.histograms["KL torque"]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

TORQUE_EXPONENT = 0.3
"""Exponent of the share of production in the torque indicator, 1 / (10 / 3)."""

INDICATORS = ("speed indicator", "torque indicator")
ESTIMATES = ("estimated speed", "estimated torque")
DIVERGENCES = ("KL speed", "KL angle", "KL torque")


class Record(Protocol):
    """Monitoring data of one robot: any object with these arrays."""

    @property
    def day(self) -> np.ndarray:
        """Time of each sample [d], shape (samples,); a sample at 2.0 belongs to the day before."""

    @property
    def production(self) -> np.ndarray:
        """Share of time in which the robot produced, shape (samples,)."""

    @property
    def torque_histogram(self) -> np.ndarray:
        """Share of time in each bin of the torque, shape (samples, n_axes, bins)."""

    @property
    def speed_histogram(self) -> np.ndarray:
        """Share of time in each bin of the speed, shape (samples, n_axes, bins)."""

    @property
    def angle_histogram(self) -> np.ndarray:
        """Share of time in each bin of the angle, shape (samples, n_axes, bins)."""

    @property
    def torque_indicator(self) -> np.ndarray:
        """Torque indicator [N m], shape (samples, n_axes)."""

    @property
    def speed_indicator(self) -> np.ndarray:
        """Speed indicator [rad/s], shape (samples, n_axes)."""


@dataclass(frozen=True, eq=False)
class Daily:
    """A record with one row per day."""

    day: Ints
    """Day from 0; days without a sample are missing. Shape (days,)."""
    values: dict[str, Floats]
    """Indicators [N m or rad/s] and estimates by name, shape (days, n_axes)."""
    histograms: dict[str, Floats]
    """Shares of the bins by the name of their divergence, shape (days, n_axes, bins)."""


def daily(record: Record) -> Daily:
    """Reduce a record to one row per day: the largest value of each day's samples, thesis 5.3.2.

    Estimates invert the indicators: torque = indicator / production^0.3 and speed = indicator /
    production. A sample in which the robot did not run has no estimates and no histograms. A day
    that contains only such samples gets those of the last day before on which the robot ran, or of
    the first such day. The largest values of the bins of a day no longer sum to 1, so that they are
    normalised again.

    Args:
        record: Monitoring data, with the arrays of `Record`.

    Returns:
        The record by days.

    Raises:
        ValueError: The robot did not run in any sample, or the arrays differ in samples.
    """
    production = np.asarray(record.production, float)
    runs = production > 0
    if not runs.any():
        raise ValueError("the robot ran in no sample")
    which = day_of(record.day)
    share = np.where(runs, production, np.nan)[:, None]
    speed, torque = record.speed_indicator, record.torque_indicator
    values = {
        "speed indicator": np.asarray(speed, float),
        "torque indicator": np.asarray(torque, float),
        "estimated speed": speed / share,
        "estimated torque": torque / share**TORQUE_EXPONENT,
    }
    histograms = {
        name: np.where(runs[:, None, None], own, np.nan)
        for name, own in zip(
            DIVERGENCES,
            (record.speed_histogram, record.angle_histogram, record.torque_histogram),
            strict=True,
        )
    }
    largest = {name: _filled(daily_maximum(which, own)) for name, own in histograms.items()}
    return Daily(
        day=np.unique(which),
        values={name: _filled(daily_maximum(which, own)) for name, own in values.items()},
        histograms={name: own / own.sum(axis=-1, keepdims=True) for name, own in largest.items()},
    )


def day_of(time: ArrayLike) -> Ints:
    """Compute the day of each sample. A sample at midnight belongs to the day that ends.

    Args:
        time: Time since the start of the record [d]. Shape (samples,).

    Returns:
        Day from 0. Shape (samples,).
    """
    return np.maximum(np.ceil(np.round(np.asarray(time, dtype=float), 6)).astype(int) - 1, 0)


def daily_maximum(day: ArrayLike, values: ArrayLike) -> Floats:
    """Compute the largest value of each day. It is nan only if the day has no other values.

    Args:
        day: Day of each sample, whole numbers. Shape (samples,).
        values: Shape (samples, ...).

    Returns:
        Shape (days, ...), in the unit of the values, for the days that occur, in ascending order.

    Raises:
        ValueError: day and values differ in samples.
    """
    day, values = np.asarray(day), np.asarray(values, dtype=float)
    if day.ndim != 1 or values.shape[:1] != day.shape:
        raise ValueError(f"day has shape {day.shape}, values {values.shape}")
    days, which = np.unique(day, return_inverse=True)
    out = np.full((len(days), *values.shape[1:]), np.nan)
    np.fmax.at(out, which, values)
    return out


def _filled(values: Floats) -> Floats:
    """Replace rows of nan by the row before, or by the first row that is not nan."""
    known = ~np.isnan(values).reshape(len(values), -1).any(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, np.argmax(known), last)]
