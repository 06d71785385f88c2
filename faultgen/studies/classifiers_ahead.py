"""How well robots' own histories predict a failure 1 to 25 days ahead, with and without training.

A classifier that is as good 25 days ahead as on the last day recognises a worn gearbox, but does
not know when the gearbox will fail. A column that is as good without training shows how much of the
result comes from the data rather than from the method. The trained method is therefore reported
together with both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.analysis.classification import PairResult, count_pairs, leave_pair_out
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
from faultgen.system.progress import Progress

OWN = "own history"
OWN_EVENTS = "own history and events"
"""Names of our classifiers in place of a combination; they are listed as LR. The second one also
uses the event log, which the thesis' classifiers do not."""

FARTHER = (10, 25)
"""Days ahead that are studied in addition to those of the thesis."""

DAYS = 10
"""Days of data for each horizon, thesis 5.3.3."""

UNTRAINED = (*FEATURES, "events more frequent", *PLAIN)
"""Columns whose AUC is reported without training. The last two need no method."""

Prepared = list[tuple[np.ndarray, np.ndarray]]
"""Days, from 0, and rows of each robot."""


def histories(fleet: Fleet) -> Prepared:
    """Compute the rows of `UNTRAINED` of every robot.

    Args:
        fleet: The robots.

    Returns:
        Days, shape (days,), and rows, shape (days, columns), of each robot.

    Raises:
        InputError: The history of a robot is too short.
    """
    out = []
    for robot in fleet.robots:
        try:
            day, own = history_features(robot)
            changes = event_changes(robot.events, day)
            plain = plain_history(robot.day, robot.production, robot.torque_histogram)[1]
        except ValueError as error:
            raise InputError(f"{robot.name}: {error}") from None
        out.append((day, np.column_stack([own, changes, plain])))
    return out


def rows_before(fleet: Fleet, prepared: Prepared, horizon: int) -> list[np.ndarray]:
    """Select the rows of each robot for one horizon: ten days, `horizon` days before the last day.

    Args:
        fleet: The robots.
        prepared: Days and rows of each robot.
        horizon: Days ahead. The last day that is used is this long before the last day of the
            fleet.

    Returns:
        Rows of each robot, shape (rows, columns) each, in the units of the prepared rows.

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
    """Compute the AUC of both classifiers of robots' own histories, and of each untrained column.

    Args:
        fleet: At least three failing and three normal robots.
        horizons: Days ahead. Those of `FARTHER` are added if the records are long enough.
        seed: Root seed of all random draws.
        workers: Number of processes. It has no effect on the results.

    Returns:
        Results of leaving out pairs, by days ahead and classifier; and for each horizon and column
        of `UNTRAINED` the mean AUC over the same pairs.

    Raises:
        InputError: The history of a robot is too short.
    """
    failed = np.array([robot.failed for robot in fleet.robots])
    prepared = histories(fleet)
    farther = [h for h in FARTHER if h + DAYS + FEWEST <= fleet.days]
    width = {OWN: len(FEATURES), OWN_EVENTS: len(FEATURES) + 1}
    trained, untrained = {}, []
    ahead = (*horizons, *farther)
    pairs = len(ahead) * len(width) * count_pairs(failed)
    with Progress("training on histories", pairs, "pair") as progress:
        for horizon in ahead:
            rows = rows_before(fleet, prepared, horizon)
            for name, columns in width.items():
                trained[horizon, name] = leave_pair_out(
                    [own[:, :columns] for own in rows],
                    failed,
                    make_history_classifier,
                    seed=seed,
                    workers=workers,
                    on_pair=progress.counter,
                )
            untrained += [
                {"horizon": horizon, "column": name, "auc": float(auc)}
                for name, auc in zip(UNTRAINED, untrained_auc(rows, failed), strict=True)
            ]
    return trained, untrained
