"""What robots' own histories say 1 to 25 days before a failure: trained, and column by column.

A classifier that is as good 25 days ahead as on the last day recognises a worn gearbox; it does not
know when the gearbox will fail. A column that is as good without training shows how much of the
result is in the data rather than in the method. So both stand beside the trained method.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.analysis.classification import PairResult, leave_pair_out
from faultgen.analysis.own_history import (
    FEATURES,
    FEWEST,
    event_changes,
    history_features,
    make_history_classifier,
)
from faultgen.analysis.plain_history import PLAIN, plain_history, untrained_auc
from faultgen.errors import InputError
from faultgen.fleet.data import Fleet

OWN = "own history"
OWN_EVENTS = "own history and events"
"""Names of our classifiers, in place of a combination; listed as LR. The second also reads the
event log, which the thesis' classifiers do not."""

FARTHER = (10, 25)
"""Days ahead beyond those of the thesis."""

DAYS = 10
"""Of data for each horizon, thesis 5.3.3."""

UNTRAINED = (*FEATURES, "events more frequent", *PLAIN)
"""Columns whose AUC is given without training; the last two need no method."""

Prepared = list[tuple[np.ndarray, np.ndarray]]
"""Days, from 0, and rows of each robot."""


def histories(fleet: Fleet) -> Prepared:
    """Rows of `UNTRAINED` of every robot.

    Raises:
        InputError: A robot has too short a history.
    """
    out = []
    for robot in fleet.robots:
        try:
            day, own = history_features(robot)
            changes = event_changes(robot.events, day)
            plain = plain_history(robot)[1]
        except ValueError as error:
            raise InputError(f"{robot.name}: {error}") from None
        out.append((day, np.column_stack([own, changes, plain])))
    return out


def rows_before(fleet: Fleet, prepared: Prepared, horizon: int) -> list[np.ndarray]:
    """Rows of each robot for one horizon: ten days that end so many days before the last.

    Args:
        fleet: Robots.
        prepared: Their rows.
        horizon: Days ahead; the last day minus this is the last day used.

    Raises:
        InputError: A robot has no row in these days.
    """
    rows = []
    for robot, (day, values) in zip(fleet.robots, prepared, strict=True):
        ahead = fleet.days - 1 - day
        own = values[(ahead >= horizon) & (ahead < horizon + DAYS)]
        if len(own) == 0:
            raise InputError(f"{robot.name}: no data {horizon} to {horizon + DAYS} days ahead")
        rows.append(own)
    return rows


def days_ahead(
    fleet: Fleet, horizons: tuple[int, ...], *, seed: int, workers: int = 1
) -> tuple[dict[tuple[int, str], PairResult], list[dict[str, Any]]]:
    """AUC of both classifiers of robots' own histories, and of each of their columns untrained.

    Args:
        fleet: At least three failing and three normal robots.
        horizons: Days ahead; those of `FARTHER` are added where the records are long enough.
        seed: Root of all draws.
        workers: Processes; no effect on the results.

    Returns:
        Pairs left out, by days ahead and classifier; and of each column of `UNTRAINED` and horizon
        the mean AUC over the same pairs.

    Raises:
        InputError: A robot has too short a history.
    """
    failed = np.array([robot.failed for robot in fleet.robots])
    prepared = histories(fleet)
    farther = [h for h in FARTHER if h + DAYS + FEWEST <= fleet.days]
    width = {OWN: len(FEATURES), OWN_EVENTS: len(FEATURES) + 1}
    trained, untrained = {}, []
    for horizon in (*horizons, *farther):
        rows = rows_before(fleet, prepared, horizon)
        for name, columns in width.items():
            trained[horizon, name] = leave_pair_out(
                [own[:, :columns] for own in rows],
                failed,
                make_history_classifier,
                seed=seed,
                workers=workers,
                label=f"{name}, {horizon} d",
            )
        untrained += [
            {"horizon": horizon, "column": name, "auc": float(auc)}
            for name, auc in zip(UNTRAINED, untrained_auc(rows, failed), strict=True)
        ]
    return trained, untrained
