"""Scores of the detectors of hours, and the alarms that follow from a threshold.

Detectors are compared at the same rate of false alarms. The threshold of each is therefore the
lowest with which healthy records give at most an allowed number of alarms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.evaluation.calls import blame, create, fit, score
from faultgen.studies.chapter3_detection.detectors import DETECTORS, Divergences
from faultgen.studies.chapter3_detection.hourly_torque import HourlyMonitored, HourlyTorque

_DAY = 24  # hours


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores of a detector for each hour after the training."""

    score: np.ndarray
    """Shape (hours,)."""
    axis: np.ndarray | None
    """Axis that the detector names, from 0, shape (hours,); None if it cannot tell."""


def scores(
    robot: HourlyMonitored, record: HourlyTorque, training: int, *, temperature_varies: bool
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
    setting = robot.setting(temperature_varies=temperature_varies)
    seen = record.features(Divergences.of(record, training).divergence)
    healthy = {name: values[:training] for name, values in seen.items()}
    test = {name: values[training:] for name, values in seen.items()}
    found = {}
    for name, made in DETECTORS.items():
        detector = create(made, setting)
        fit(detector, [healthy])
        found[name] = Scored(score(detector, test), blame(detector, test))
    return found


def separate_alarms(over: np.ndarray) -> int:
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
        if sum(separate_alarms(s > levels[middle]) for s in healthy) <= allowed:
            high = middle
        else:
            low = middle + 1
    return float(levels[high])
