"""Two simple numbers from a robot's history, with which trained classifiers can be compared.

    # one row per day, from days up to that one only
    day, rows = plain_history(time, production, torque_histogram)
    untrained_auc(rows_of_robots, failed)  # of each column, without any training

A classifier that is not better than these numbers has learned nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .daily import day_of
from .own_history import FEWEST, LATE, rms_torque

Floats = NDArray[np.floating]
Ints = NDArray[np.int_]

PLAIN = ("last week's torque over the first week's", "unsteadiness of the torque, last 14 days")
"""Columns of `plain_history`."""

_WEEK = 7


def plain_history(
    time: ArrayLike, production: ArrayLike, torque_histogram: ArrayLike
) -> tuple[Ints, Floats]:
    """Compute one row of `PLAIN` for each day. No row uses data of later days.

    Both numbers are computed from the daily mean of the RMS torque of each axis, and each is the
    largest over the axes. The first is the mean of the last seven days on which the robot ran,
    divided by that of the first seven. The second is the standard deviation over the last 14 days,
    divided by their mean.

    Args:
        time: Time of each sample of one robot [d], shape (samples,).
        production: Share of time in which the robot produced, shape (samples,).
        torque_histogram: Share of time in each bin of the torque, whose range is plus and minus the
            largest torque; shape (samples, n_axes, bins).

    Returns:
        Days, from 0, and rows. Shapes (days,) and (days, 2).

    Raises:
        ValueError: The robot ran on fewer than 25 days.
    """
    runs = np.asarray(production) > 0
    days, which = np.unique(day_of(np.asarray(time)[runs]), return_inverse=True)
    if len(days) < FEWEST:
        raise ValueError(f"history needs {FEWEST} days on which the robot ran, got {len(days)}")
    torque = rms_torque(np.asarray(torque_histogram, float)[runs])
    counts = np.bincount(which)
    by_day = np.stack([np.bincount(which, one) / counts for one in torque.T], axis=1)
    first = np.maximum(by_day[:_WEEK].mean(axis=0), 1e-12)
    rows = []
    for end in range(FEWEST, len(days) + 1):
        last, late = by_day[end - _WEEK : end], by_day[end - LATE : end]
        ratio = last.mean(axis=0) / first
        unsteady = late.std(axis=0) / np.maximum(late.mean(axis=0), 1e-12)
        rows.append([ratio.max(), unsteady.max()])
    return days[FEWEST - 1 :], np.array(rows)


def untrained_auc(rows: Sequence[ArrayLike], failed: ArrayLike) -> Floats:
    """Compute the mean AUC of each column over all pairs of robots, if larger values mean failing.

    It is the same measure as in `leave_pair_out`, but for a score without training.

    Args:
        rows: Rows of each robot, shape (its rows, columns).
        failed: Whether each robot fails, shape (robots,).

    Returns:
        AUC. Shape (columns,).

    Raises:
        ValueError: All robots fail, or none.
    """
    fails = np.asarray(failed, dtype=bool)
    if fails.all() or not fails.any():
        raise ValueError("robots that fail and robots that do not are needed")
    arrays = [np.asarray(own, dtype=float) for own in rows]
    pairs = [
        (arrays[i][:, None], arrays[j][None])
        for i in np.flatnonzero(fails)
        for j in np.flatnonzero(~fails)
    ]
    found: Floats = np.mean(
        [np.mean((ill > well) + 0.5 * (ill == well), axis=(0, 1)) for ill, well in pairs], axis=0
    )
    return found
