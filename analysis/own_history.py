"""Failing robots recognised by their own history: by how much the torque of an axis has grown.

    day, rows = history_features(record)  # one row per day, from days up to that one only
    rows = np.column_stack([rows, event_changes(events, day)])  # if there is an event log
    found = leave_pair_out(rows_of_robots, failed, make_history_classifier)

A robot's torque changes with its program, its payload, its temperature and its lubricant. Most of
these changes are larger than those of a gearbox that begins to fail. Each axis is therefore
regressed on what the robot's own record contains about these causes, together with a growth that
becomes steeper towards the day in question:

    r_a(t) = b0 + b1 temperature + b2 production + b3 log production + c' m(t) + d f_a(t) + g_a u(t)

r is the mean of the RMS torque from the torque histogram and the estimated torque, each divided by
its median. Both are needed: the bins of a histogram are too wide for an axis that hardly uses its
motor, and the estimate mostly depends on the largest torques. m are the principal components of the
speed and angle histograms. They describe the mix of programs, since the histogram of a mix is the
mix of the histograms. f_a is the first component of the other axes' residuals; a payload moves all
of these at once. u(t) is exp(3 t) standardised, with t from 0 to 1 over the record so far. g_a is
the growth, and the residuals averaged by day are the unsteadiness. A small ridge penalty keeps the
coefficients finite.

The features are those of the axis that grew most. The feature of an event log is the mean increase
in frequency of the five kinds of events that increased most.

The constants were chosen on fleets with other seeds than those in docs/.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from .daily import TORQUE_EXPONENT, Record, day_of

Floats = NDArray[np.floating]
Ints = NDArray[np.int_]

FEATURES = ("growth", "growth over others", "unsteadiness", "growth over early spread")
"""Columns of `history_features`. All except the second are natural logarithms."""

FEWEST = 25
"""Number of days of history before the first row."""

LATE = 14
"""Number of last days over which the unsteadiness is measured."""

_STEEPNESS = 3.0  # of growth over the record so far
_RIDGE = 0.1  # over the number of samples
_COMPONENTS = 3  # of the mix of programs
_NO_COMPONENT = 1e-3  # standard deviation of shares below which there is none
_EARLY = 20  # first days whose spread is a measure
_LEAST_GROWTH = 0.002  # share of the torque: smaller growth is none
_LEAST_RATIO = 0.05
_LEAST_SPREAD = 1e-6
_KINDS = 5  # of events, those that became more frequent by most
_PENALTY = 0.03  # C of the classifier


class HistoryRecord(Record, Protocol):
    """The arrays of `Record`, and the temperature of the cabinet."""

    @property
    def temperature(self) -> np.ndarray:
        """Temperature of the cabinet [deg C], shape (samples,)."""


def history_features(record: HistoryRecord) -> tuple[Ints, Floats]:
    """Compute one row of `FEATURES` for each day. No row uses data of later days.

    Args:
        record: Monitoring data of one robot, with the arrays of `HistoryRecord`.

    Returns:
        Days, from 0, and rows. Shapes (days,) and (days, 4).

    Raises:
        ValueError: The robot ran on fewer than 25 days.
    """
    runs = np.asarray(record.production) > 0
    day = day_of(record.day[runs])
    days = np.unique(day)
    if len(days) < FEWEST:
        raise ValueError(f"history needs {FEWEST} days on which the robot ran, got {len(days)}")
    production, temperature = record.production[runs], record.temperature[runs]
    surroundings = np.column_stack([temperature, production, np.log(production)])
    by_bins = rms_torque(record.torque_histogram[runs])
    estimated = record.torque_indicator[runs] / production[:, None] ** TORQUE_EXPONENT
    shares = np.concatenate([record.speed_histogram[runs], record.angle_histogram[runs]], axis=1)
    shares = shares.reshape(len(day), -1)
    rows = []
    for last in days[FEWEST - 1 :]:
        kept = day <= last
        torque = (_relative(by_bins[kept]) + _relative(estimated[kept])) / 2
        rows.append(
            _row(record.day[runs][kept], day[kept], torque, surroundings[kept], shares[kept])
        )
    return days[FEWEST - 1 :], np.array(rows)


def rms_torque(histogram: Floats) -> Floats:
    """Compute the RMS torque from histograms whose range is plus and minus the largest torque.

    Args:
        histogram: Shares. Shape (..., bins).

    Returns:
        RMS torque as a share of the largest torque. Shape (...).
    """
    bins = histogram.shape[-1]
    centres = (2 * np.arange(bins) + 1 - bins) / bins
    return np.asarray(np.sqrt(histogram @ centres**2), dtype=float)


def growth(
    time: Floats, day: Ints, response: Floats, surroundings: Floats, shares: Floats
) -> tuple[Floats, Floats]:
    """Compute the growth of each axis, and the residuals of each day.

    Args:
        time: Time of each sample [d]. Shape (samples,).
        day: Day of each sample. Shape (samples,).
        response: Torque of each axis, any unit. Shape (samples, n_axes).
        surroundings: Other quantities that change the torque. Shape (samples, quantities).
        shares: Histograms that depend on the mix of programs. Shape (samples, bins).

    Returns:
        Growth over the record so far, as a standard deviation divided by the median torque, shape
        (n_axes,), and residuals averaged by day, divided by the median torque, shape (days,
        n_axes).
    """
    relative = _relative(response)
    steep = np.exp(_STEEPNESS * (time - time[0]) / (time[-1] - time[0]))
    steep = _standard(steep[:, None])
    known = np.hstack([_standard(surroundings), _components(shares)])
    first = _residuals(np.hstack([known, steep]), relative)
    which = np.unique(day, return_inverse=True)[1]
    gains, left = [], []
    for axis in range(relative.shape[1]):
        others = np.delete(first, axis, axis=1)
        common = np.linalg.svd(others, full_matrices=False)[0][:, :1] * np.sqrt(len(others))
        columns = np.hstack([known, common, steep])
        coefficients = _ridge(columns, relative[:, axis])
        rest = relative[:, axis] - _with_one(columns) @ coefficients
        gains.append(coefficients[-1])
        left.append(np.bincount(which, rest) / np.bincount(which))
    return np.array(gains), np.array(left).T


def event_changes(events: Floats, days: Ints) -> Floats:
    """Compute how much more frequent events have become: mean of the five largest changes.

    The change of a kind of event is that of log(1 + events per day), from the first 20 days to the
    last 14.

    Args:
        events: Counts of each day and kind, from the record's first day. Shape (days, kinds).
        days: Days for which the change is computed, from 0. No later days are used.

    Returns:
        Mean change, without unit. Shape (days,).

    Raises:
        ValueError: There are fewer than five kinds of events, or no counts of a day.
    """
    counts = np.asarray(events, dtype=float)
    if counts.ndim != 2 or counts.shape[1] < _KINDS:
        raise ValueError(f"events of at least {_KINDS} kinds are needed, got shape {counts.shape}")
    if len(days) and days[-1] >= len(counts):
        raise ValueError(f"no events of day {days[-1] + 1}: there are {len(counts)} days")
    changes = [
        np.log1p(counts[max(day + 1 - LATE, 0) : day + 1].mean(axis=0))
        - np.log1p(counts[: min(_EARLY, day + 1)].mean(axis=0))
        for day in days
    ]
    return np.sort(np.array(changes), axis=1)[:, -_KINDS:].mean(axis=1)


def _row(time: Floats, day: Ints, torque: Floats, around: Floats, shares: Floats) -> list[float]:
    gain, left = growth(time, day, torque, around, shares)
    early = np.maximum(left[:_EARLY].std(axis=0), _LEAST_SPREAD)
    late = np.maximum(left[-LATE:].std(axis=0), _LEAST_SPREAD)
    return [
        float(np.log(max(gain.max(), _LEAST_GROWTH))),
        float(gain.max() - np.median(gain)),
        float(np.log(late.max())),
        float(np.log(max((gain / early).max(), _LEAST_RATIO))),
    ]


def _relative(values: Floats) -> Floats:
    """Values divided by their medians."""
    return values / np.maximum(np.median(values, axis=0), 1e-12)


def _standard(columns: Floats) -> Floats:
    """Mean 0 and standard deviation 1; constant columns are 0."""
    spread = columns.std(axis=0)
    return (columns - columns.mean(axis=0)) / np.where(spread > 1e-12, spread, 1.0)


def _components(shares: Floats) -> Floats:
    """Principal components of histograms, standardised. Shape (samples, components)."""
    left, size, _ = np.linalg.svd(shares - shares.mean(axis=0), full_matrices=False)
    kept = np.flatnonzero(size > _NO_COMPONENT * np.sqrt(len(shares)))[:_COMPONENTS]
    return left[:, kept] * np.sqrt(len(shares))


def _with_one(columns: Floats) -> Floats:
    return np.hstack([np.ones((len(columns), 1)), columns])


def _ridge(columns: Floats, values: Floats) -> Floats:
    """Coefficients. The first is the constant, which has no penalty."""
    X = _with_one(columns)
    penalty = _RIDGE * len(X) * np.eye(X.shape[1])
    penalty[0, 0] = 0.0
    solved: Floats = np.linalg.solve(X.T @ X + penalty, X.T @ values)
    return solved


def _residuals(columns: Floats, values: Floats) -> Floats:
    return values - _with_one(columns) @ _ridge(columns, values)


def make_history_classifier(
    n_columns: int, splits: list[tuple[Ints, Ints]], seed: int
) -> BaseEstimator:
    """Make a logistic regression on standardised features, with a strong ridge penalty.

    Nothing is tuned; the arguments are those that `leave_pair_out` passes.

    Args:
        n_columns: Not used.
        splits: Not used.
        seed: Not used.

    Returns:
        The classifier, not yet fitted.
    """
    return make_pipeline(StandardScaler(), LogisticRegression(C=_PENALTY))
