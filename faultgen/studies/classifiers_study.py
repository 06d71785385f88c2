"""Study `classifiers`, thesis chapter 5: does preprocessing help to foresee gearbox failures?

Robots of a fleet, half of which fail on its last day; ten days of data that end 1, 3 or 5 days
before. Every classifier is trained and tested by leaving out pairs of robots (procedure 1), and
preprocessings are compared by procedure 2; a classifier of our own stands beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from analysis.classification import CLASSIFIERS, PairResult, leave_pair_out, make_classifier
from analysis.own_history import event_changes, history_features, make_history_classifier
from analysis.preprocessing import COMBINATIONS, Combination, daily, prepare
from analysis.statistics import compare, difference_over_robots, levene_p
from faultgen.errors import InputError
from faultgen.fleet.data import Fleet
from faultgen.studies.thesis_classifiers import HEADLINE, PAIRS

DAYS = 10
"""Of data for each horizon, thesis 5.3.3."""

HORIZON = 3
"""Days ahead of which tables and tests tell."""

FULL_CHAIN = "+estM+diff+var3+pca"
WITHOUT_DIFFERENCES = "+estM+var3+pca"
LONGER_WINDOWS = "+estM+diff+var5+pca"
OWN = "own history"
OWN_EVENTS = "own history and events"
"""Names of our classifiers, in place of a combination; told as LR. The second also reads the event
log, which the thesis' classifiers do not."""


@dataclass(frozen=True)
class Size:
    """How much is compared."""

    combinations: tuple[str, ...]
    """At the horizon of the tables."""
    others: tuple[str, ...]
    """At the other horizons."""
    classifiers: tuple[str, ...]
    horizons: tuple[int, ...]
    """Days ahead."""
    robots: int | None
    """Of each kind at most; all, if None."""
    importance: tuple[str, ...]
    """Classifiers whose measurements are shuffled."""


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
        size: How much is compared.
        seed: Root of all draws.
        workers: Processes; no effect on the results, but on the time told.

    Returns:
        Results for JSON.

    Raises:
        InputError: The fleet is too small, or its records too short.
    """
    chosen = _chosen(fleet, size.robots)
    found: dict[tuple[int, str, str], PairResult] = {}
    for horizon in size.horizons:
        names = size.combinations if horizon == HORIZON else size.others
        for name in names:
            rows = horizon_rows(chosen, name, horizon)
            for classifier in size.classifiers:
                make = partial(make_classifier, classifier, Combination.of(name))
                label = f"{classifier} {name}, {horizon} d"
                found[horizon, name, classifier] = leave_pair_out(
                    rows, _failed(chosen), make, seed=seed, workers=workers, label=label
                )
        for name in (OWN, OWN_EVENTS):
            found[horizon, name, "LR"] = leave_pair_out(
                horizon_rows(chosen, name, horizon),
                _failed(chosen),
                make_history_classifier,
                seed=seed,
                workers=workers,
                label=name,
            )
    auc = {key: one.auc for key, one in found.items() if key[0] == HORIZON}
    by_name = {key[1:]: one for key, one in auc.items()}
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
        "overall": [_overall(by_name, classifier) for classifier in size.classifiers],
        "pairs": _pairs(by_name, size.classifiers),
        "headlines": _headlines(by_name, size.classifiers, seed),
        "windows": _windows(by_name, size.classifiers),
        "invariance": _invariance(chosen, by_name, size.classifiers),
        "importance": _importance(chosen, size.importance, seed, workers),
    }


def horizon_rows(fleet: Fleet, name: str, horizon: int) -> list[np.ndarray]:
    """Rows of each robot for one horizon: ten days that end so many days before the last.

    Args:
        fleet: Robots.
        name: Preprocessing, `OWN` or `OWN_EVENTS`.
        horizon: Days ahead, T - horizon being the last day used.

    Raises:
        InputError: A robot has no row in these days.
    """
    rows = []
    for robot in fleet.robots:
        try:
            if name in (OWN, OWN_EVENTS):
                day, values = history_features(robot)
                if name == OWN_EVENTS:
                    values = np.column_stack([values, event_changes(robot.events, day)])
            else:
                day, values = prepare(robot, Combination.of(name))
        except ValueError as error:
            raise InputError(f"{robot.name}: {error}") from None
        ahead = fleet.days - 1 - day
        own = values[(ahead >= horizon) & (ahead < horizon + DAYS)]
        if len(own) == 0:
            raise InputError(f"{robot.name}: no data {horizon} to {horizon + DAYS} days ahead")
        rows.append(own)
    return rows


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


Auc = dict[tuple[str, str], np.ndarray]


def _groups(auc: Auc, classifier: str) -> dict[str, np.ndarray]:
    """AUC of all pairs by combination of table 5.2."""
    return {
        name: auc[name, classifier].ravel() for name in COMBINATIONS if (name, classifier) in auc
    }


def _overall(auc: Auc, classifier: str) -> dict[str, Any]:
    """Procedure 2 over all combinations."""
    found = compare(_groups(auc, classifier))
    return {
        "classifier": classifier,
        "levene": found.levene,
        "test": "Welch, Games-Howell" if found.variances_differ else "ANOVA, Tukey",
        "f": found.statistic,
        "p": found.p,
    }


def _pairs(auc: Auc, classifiers: Sequence[str]) -> list[dict[str, Any]]:
    """Tables A.2 and A.3."""
    rows = []
    for classifier in classifiers:
        groups = _groups(auc, classifier)
        found = compare(groups)
        for step, pairs in PAIRS.items():
            for without, with_step in pairs:
                if without not in groups or with_step not in groups:
                    continue
                before, after = groups[without], groups[with_step]
                rows.append(
                    {
                        "step": step,
                        "without": without,
                        "with": with_step,
                        "classifier": classifier,
                        "variance_p": levene_p(before, after),
                        "variance_ratio": _ratio(after.var(ddof=1), before.var(ddof=1)),
                        "mean_p": found.between(without, with_step) if found.means_differ else 1.0,
                        "mean_change": float(after.mean() - before.mean()),
                    }
                )
    return rows


def _ratio(over: float, under: float) -> float | None:
    return float(over / under) if under > 0 else None


def _headlines(auc: Auc, classifiers: Sequence[str], seed: int) -> list[dict[str, Any]]:
    """What each step adds to the thesis' pair, with an interval over robots."""
    rows = []
    for step, pair in HEADLINE.items():
        for classifier in classifiers:
            if all((name, classifier) in auc for name in pair):
                before, after = (auc[name, classifier] for name in pair)
                change = difference_over_robots(before, after, seed=seed)
                rows.append({"step": step, "classifier": classifier, **vars(change)})
    return rows


def _windows(auc: Auc, classifiers: Sequence[str]) -> list[dict[str, Any]]:
    """Windows of three days against windows of five."""
    names = (FULL_CHAIN, LONGER_WINDOWS)
    rows = []
    for classifier in classifiers:
        if all((name, classifier) in auc for name in names):
            three, five = (auc[name, classifier].ravel() for name in names)
            p = compare({"three": three, "five": five}).p
            rows.append({"classifier": classifier, "p": p, "change": float((five - three).mean())})
    return rows


def _invariance(fleet: Fleet, auc: Auc, classifiers: Sequence[str]) -> list[dict[str, Any]]:
    """Does the mean AUC of a robot depend on how fast, or how hard, it works?"""
    series = [daily(robot) for robot in fleet.robots]
    failed = _failed(fleet)
    rows = []
    for quantity in ("estimated speed", "estimated torque"):
        mean = np.array([one.values[quantity].mean(axis=0) for one in series])
        level = (mean / mean.max(axis=0).clip(1e-300)).mean(axis=1)
        for name in (WITHOUT_DIFFERENCES, FULL_CHAIN):
            for classifier in classifiers:
                if (name, classifier) not in auc:
                    continue
                by_robot = np.empty(len(series))
                by_robot[failed] = auc[name, classifier].mean(axis=1)
                by_robot[~failed] = auc[name, classifier].mean(axis=0)
                line = stats.linregress(level, by_robot)
                rows.append(
                    {
                        "quantity": quantity,
                        "combination": name,
                        "classifier": classifier,
                        "slope": float(line.slope),
                        "r2": float(line.rvalue**2),
                        "p": float(line.pvalue),
                        "level": level.tolist(),
                        "auc": by_robot.tolist(),
                    }
                )
    return rows


def _importance(
    fleet: Fleet, classifiers: Sequence[str], seed: int, workers: int
) -> list[dict[str, Any]]:
    """AUC lost by shuffling a measurement of one axis, and of all axes."""
    combination = Combination.of(FULL_CHAIN)
    n_axes = fleet.robots[0].torque_indicator.shape[1]
    groups = combination.columns(n_axes)
    for name in combination.measurements:
        groups[name, 0] = np.concatenate([groups[name, axis] for axis in range(1, n_axes + 1)])
    rows = horizon_rows(fleet, FULL_CHAIN, HORIZON)
    told = []
    for classifier in classifiers:
        make = partial(make_classifier, classifier, combination)
        found = leave_pair_out(
            rows,
            _failed(fleet),
            make,
            seed=seed,
            workers=workers,
            groups=groups,
            label=f"importance, {classifier}",
        )
        told += [
            {"classifier": classifier, "measurement": name, "axis": axis, "lost": lost}
            for (name, axis), lost in found.importance.items()
        ]
    return told
