"""Monitoring of one robot with one row a day, thesis 5.3.2.

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
"""Power of the share of production in the torque indicator, 1 / (10 / 3)."""

INDICATORS = ("speed indicator", "torque indicator")
ESTIMATES = ("estimated speed", "estimated torque")
DIVERGENCES = ("KL speed", "KL angle", "KL torque")


class Record(Protocol):
    """Monitoring of one robot; see the function `daily` for shapes and units."""

    @property
    def day(self) -> np.ndarray: ...  # noqa: D102
    @property
    def production(self) -> np.ndarray: ...  # noqa: D102
    @property
    def torque_histogram(self) -> np.ndarray: ...  # noqa: D102
    @property
    def speed_histogram(self) -> np.ndarray: ...  # noqa: D102
    @property
    def angle_histogram(self) -> np.ndarray: ...  # noqa: D102
    @property
    def torque_indicator(self) -> np.ndarray: ...  # noqa: D102
    @property
    def speed_indicator(self) -> np.ndarray: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Daily:
    """A record with one row a day."""

    day: Ints
    """From 0; days without a sample are missing. Shape (days,)."""
    values: dict[str, Floats]
    """Indicators and estimates by name, shape (days, n_axes)."""
    histograms: dict[str, Floats]
    """Shares by the name of their divergence, shape (days, n_axes, bins)."""


def daily(record: Record) -> Daily:
    """One row a day: the largest of each value over the day's samples, thesis 5.3.2.

    Estimates invert the indicators, torque = indicator / production^0.3 and speed = indicator /
    production. A sample in which the robot did not run has neither these nor histograms; a day of
    such samples only takes those of the running day before (days before the first take the first).
    The largest of each bin over a day no longer sums to 1 and is normalised again.

    Args:
        record: Arrays `day` (time of each sample [d], shape (samples,); one at 2.0 belongs to the
            day that ends then), `production` (share of time, same shape), `torque_indicator` [N m]
            and `speed_indicator` [rad/s] of shape (samples, n_axes), and the three histograms, of
            shape (samples, n_axes, bins).

    Returns:
        The record by days.

    Raises:
        ValueError: There is no sample in which the robot ran, or arrays differ in samples.
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
    """Day of each sample, from 0: one at midnight tells of the day that ends.

    Args:
        time: Since the start of the record [d]. Shape (samples,).
    """
    return np.maximum(np.ceil(np.round(np.asarray(time, dtype=float), 6)).astype(int) - 1, 0)


def daily_maximum(day: ArrayLike, values: ArrayLike) -> Floats:
    """Largest value of each day; nan counts only where there is nothing else.

    Args:
        day: Day of each sample, whole numbers. Shape (samples,).
        values: Shape (samples, ...).

    Returns:
        Shape (days, ...), for the days that occur, in their order.

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
    """Rows of nan replaced by the row before, or the first that is none."""
    known = ~np.isnan(values).reshape(len(values), -1).any(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, np.argmax(known), last)]
