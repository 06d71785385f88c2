"""Study `classifiers`, thesis chapter 5: does preprocessing help to predict gearbox failures?

Half of the robots of a fleet fail on its last day. The data are ten days that end 1, 3 or 5 days
before. Every classifier is trained and tested by leaving out pairs of robots (procedure 1), and
preprocessings are compared by procedure 2. A classifier of our own is reported for comparison.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import faultgen.studies.chapter5_classifiers.findings as findings
from faultgen.analysis.classification import (
    CLASSIFIERS,
    PairResult,
    count_pairs,
    leave_pair_out,
    make_classifier,
)
from faultgen.analysis.preprocessing import COMBINATIONS, Combination, prepare
from faultgen.errors import InputError
from faultgen.fleet.data import Fleet
from faultgen.studies.chapter5_classifiers.findings import (
    FULL_CHAIN,
    LONGER_WINDOWS,
    WITHOUT_DIFFERENCES,
)
from faultgen.studies.classifiers_ahead import days_ahead, rows_before
from faultgen.system.progress import Progress

HORIZON = 3
"""Days ahead for the tables and tests."""


@dataclass(frozen=True)
class Size:
    """Amount of comparisons."""

    combinations: tuple[str, ...]
    """Combinations at the horizon of the tables."""
    others: tuple[str, ...]
    """Combinations at the other horizons."""
    classifiers: tuple[str, ...]
    """Names of the classifiers."""
    horizons: tuple[int, ...]
    """Days ahead."""
    robots: int | None
    """Largest number of robots of each kind; None for all."""
    importance: tuple[str, ...]
    """Classifiers for which the importance of measurements is computed."""


FULL = Size(
    combinations=(*COMBINATIONS, "+estM+diff+var3", LONGER_WINDOWS),
    others=("control", "+estM+diff", WITHOUT_DIFFERENCES, FULL_CHAIN),
    classifiers=CLASSIFIERS,
    horizons=(1, 3, 5),
    robots=None,
    importance=("LR", "RF"),
)
QUICK = Size(
    combinations=("control", "+diff", WITHOUT_DIFFERENCES, FULL_CHAIN),
    others=(),
    classifiers=("LR", "SVM"),
    horizons=(1, 3, 5),
    robots=6,
    importance=("LR",),
)


def run_classifiers(
    fleet: Fleet, *, size: Size = FULL, seed: int = 2026, workers: int = 1
) -> dict[str, Any]:
    """Run the study on a fleet.

    Args:
        fleet: At least three failing and three normal robots.
        size: Amount of comparisons.
        seed: Root seed of all random draws.
        workers: Number of processes. It affects only the reported time.

    Returns:
        Results for JSON.

    Raises:
        InputError: The fleet is too small, or its records too short.
    """
    chosen = _chosen(fleet, size.robots)
    found: dict[tuple[int, str, str], PairResult] = {}
    columns = [
        (horizon, name)
        for horizon in size.horizons
        for name in (size.combinations if horizon == HORIZON else size.others)
    ]
    failed = _failed(chosen)
    cells = len(columns) * len(size.classifiers)
    with Progress("training classifiers", cells * count_pairs(failed), "pair") as progress:
        for horizon, name in columns:
            rows = horizon_rows(chosen, name, horizon)
            for classifier in size.classifiers:
                make = partial(make_classifier, classifier, Combination.of(name))
                found[horizon, name, classifier] = leave_pair_out(
                    rows, failed, make, seed=seed, workers=workers, on_pair=progress.counter
                )
    trained, untrained = days_ahead(chosen, size.horizons, seed=seed, workers=workers)
    found |= {(horizon, name, "LR"): one for (horizon, name), one in trained.items()}
    auc = {key: one.auc for key, one in found.items() if key[0] == HORIZON}
    by_name = {key[1:]: one for key, one in auc.items()}
    compared = {name: findings.compared(by_name, name) for name in size.classifiers}
    return {
        "seed": seed,
        "fleet": {
            "seed": fleet.seed,
            "days": fleet.days,
            "failed": int(_failed(chosen).sum()),
            "normal": int((~_failed(chosen)).sum()),
        },
        "cells": [
            {
                "horizon": horizon,
                "combination": name,
                "classifier": classifier,
                "mean": float(one.auc.mean()),
                "deviation": float(one.auc.std(ddof=1)),
                "seconds": one.seconds,
                "auc": one.auc.tolist(),
            }
            for (horizon, name, classifier), one in found.items()
        ],
        "untrained": untrained,
        "overall": [findings.overall(name, one) for name, one in compared.items()],
        "over_control": [
            row
            for name, one in compared.items()
            for row in findings.over_control(by_name, name, one)
        ],
        "pairs": findings.pairs(by_name, compared),
        "headlines": findings.headlines(by_name, size.classifiers, seed),
        "windows": findings.windows(by_name, size.classifiers),
        "invariance": findings.invariance(chosen, by_name, size.classifiers),
        "importance": _importance(chosen, size.importance, seed, workers),
    }


def horizon_rows(fleet: Fleet, name: str, horizon: int) -> list[np.ndarray]:
    """Compute the rows of each robot for one horizon: ten days, `horizon` days before the last day.

    Args:
        fleet: The robots.
        name: Name of the preprocessing.
        horizon: Days ahead. The last day that is used is this long before the last day of the
            fleet.

    Returns:
        Rows of each robot, shape (rows, columns) each, see `prepare` for the units.

    Raises:
        InputError: A robot has no row in these days.
    """
    prepared = []
    for robot in fleet.robots:
        try:
            prepared.append(prepare(robot, Combination.of(name)))
        except ValueError as error:
            raise InputError(f"{robot.name}: {error}") from None
    return rows_before(fleet, prepared, horizon)


def _chosen(fleet: Fleet, most: int | None) -> Fleet:
    """The first robots of each kind."""
    kept = [
        one
        for kind in (True, False)
        for one in [robot for robot in fleet.robots if robot.failed == kind][:most]
    ]
    for kind, name in ((True, "failing"), (False, "normal")):
        if sum(robot.failed == kind for robot in kept) < 3:
            raise InputError(f"fleet: at least three {name} robots are needed")
    if len({robot.torque_indicator.shape[1] for robot in kept}) > 1:
        raise InputError("fleet: all robots must have the same number of axes")
    return Fleet(tuple(kept), fleet.event_names, fleet.days, fleet.seed, fleet.attributes)


def _failed(fleet: Fleet) -> np.ndarray:
    return np.array([robot.failed for robot in fleet.robots])


def _importance(
    fleet: Fleet, classifiers: Sequence[str], seed: int, workers: int
) -> list[dict[str, Any]]:
    """Loss of AUC if a measurement of one axis, or of all axes, is shuffled."""
    combination = Combination.of(FULL_CHAIN)
    n_axes = fleet.robots[0].torque_indicator.shape[1]
    groups = combination.columns(n_axes)
    for name in combination.measurements:
        groups[name, 0] = np.concatenate([groups[name, axis] for axis in range(1, n_axes + 1)])
    rows = horizon_rows(fleet, FULL_CHAIN, HORIZON)
    told = []
    failed = _failed(fleet)
    pairs = len(classifiers) * count_pairs(failed)
    with Progress("shuffling measurements", pairs, "pair") as progress:
        for classifier in classifiers:
            make = partial(make_classifier, classifier, combination)
            found = leave_pair_out(
                rows,
                failed,
                make,
                seed=seed,
                workers=workers,
                groups=groups,
                on_pair=progress.counter,
            )
            told += [
                {"classifier": classifier, "measurement": name, "axis": axis, "lost": lost}
                for (name, axis), lost in found.importance.items()
            ]
    return told
