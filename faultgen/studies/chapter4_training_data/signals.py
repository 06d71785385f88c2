"""Signals of thesis chapter 4: 60 days of one robot as input of principal components.

A set consists of 40 days of training and 20 of test, of which the last five are omitted. Each part
is processed alone, and the reference of its histograms is its own first measurement. There are
three signals: raw, absolute differences to the day before, and both combined. Linear trends are
removed from each part, so that the components of one robot can be used for another robot at a
different level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import detrend

from faultgen.analysis.daily import DIVERGENCES, Daily, daily, day_of
from faultgen.analysis.preprocessing import measurements
from faultgen.errors import InputError
from faultgen.fleet.data import Fleet, FleetRobot

SET, TRAIN, TEST = 60, 40, 15
"""Days of a set, of its training part, and of its test part without the last five."""

SIGNALS = ("raw", "difference", "combined")

FAILED, NORMAL = 7, 3
"""Numbers of robots in the thesis' design."""

EVENTS = 13
"""Number of kinds of events that the thesis found with all robots and used."""


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Sixty days of one robot."""

    robot: str
    """Name of the robot."""
    failed: bool
    """Whether it fails on the last of these days."""
    first: int
    """Day of the record with which the set begins, from 0."""
    train: dict[str, np.ndarray]
    """Training rows by signal, shape (rows, columns). Differences have one row less."""
    test: dict[str, np.ndarray]
    """The same of the test part."""
    test_day: dict[str, np.ndarray]
    """Day of each row of the test part by signal, from the part's first, 0. Shape (rows,)."""


def training_sets(fleet: Fleet) -> list[TrainingSet]:
    """Make the thesis' 13 sets of 60 days.

    They are the last days of seven failing robots, and the first and last days of three others.

    Args:
        fleet: The fleet. Its first seven failing and three normal robots are used.

    Returns:
        Seven sets of failing robots, then six of normal ones.

    Raises:
        InputError: There are too few robots or days, or a robot ran on too few of them.
    """
    failing = [robot for robot in fleet.robots if robot.failed][:FAILED]
    normal = [robot for robot in fleet.robots if not robot.failed][:NORMAL]
    if len(failing) < FAILED or len(normal) < NORMAL:
        raise InputError(
            f"fleet: {FAILED} failing and {NORMAL} normal robots are needed, "
            f"got {len(failing)} and {len(normal)}"
        )
    if fleet.days < 2 * SET:
        raise InputError(
            f"fleet: two sets of {SET} days of a robot need {2 * SET} days, got {fleet.days}"
        )
    kinds = _common_events([*failing, *normal])
    last = fleet.days - SET
    return [
        *(_set(robot, last, kinds) for robot in failing),
        *(_set(robot, first, kinds) for robot in normal for first in (0, last)),
    ]


def _common_events(robots: list[FleetRobot]) -> np.ndarray:
    """Kinds of events that all robots have, at most the 13 most frequent."""
    totals = np.array([robot.events.sum(axis=0) for robot in robots])
    common = np.flatnonzero((totals > 0).all(axis=0))
    order = np.argsort(-totals[:, common].sum(axis=0), kind="stable")
    return np.sort(common[order][:EVENTS])


def _set(robot: FleetRobot, first: int, kinds: np.ndarray) -> TrainingSet:
    series = daily(robot)
    day = day_of(robot.day)
    parts, days_of = [], {}
    for start, days in ((first, TRAIN), (first + TRAIN, TEST)):
        kept = (series.day >= start) & (series.day < start + days)
        # A trend and a spread need some rows; a robot that hardly runs has no signal.
        if kept.sum() < days // 2:
            raise InputError(
                f"{robot.name}: ran on {kept.sum()} of days {start + 1} to {start + days}"
            )
        own = Daily(
            day=series.day[kept],
            values={name: value[kept] for name, value in series.values.items()},
            histograms={name: series.histograms[name][kept] for name in DIVERGENCES},
        )
        largest = [
            [column[day == d].max() for column in (robot.production, robot.temperature)]
            for d in own.day
        ]
        parts.append(_signals(own, np.hstack([largest, robot.events[own.day][:, kinds]])))
        days_of = {name: own.day[len(own.day) - len(x) :] - start for name, x in parts[-1].items()}
    train, test = parts
    return TrainingSet(robot.name, robot.failed, first, train, test, days_of)


def _signals(series: Daily, others: np.ndarray) -> dict[str, np.ndarray]:
    """The three signals of a part; `others` are columns without histograms."""
    _, raw = measurements(series, estimates=True, difference=False)
    _, difference = measurements(series, estimates=True, difference=True)
    raw = _without_trend(np.hstack([raw, others]))
    difference = _without_trend(np.hstack([difference, np.abs(np.diff(others, axis=0))]))
    combined = np.hstack([raw[1:], difference])
    return {"raw": raw, "difference": difference, "combined": combined}


def _without_trend(values: np.ndarray) -> np.ndarray:
    """Remove linear trends. What then remains of a constant is rounding, and is set to 0."""
    left = detrend(values, axis=0)
    return np.where(np.abs(left).max(axis=0) > 1e-9 * np.abs(values).max(axis=0), left, 0.0)
