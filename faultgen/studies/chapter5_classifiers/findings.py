"""Findings of the study `classifiers` from its areas under the curve: tests and intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from faultgen.analysis.daily import daily
from faultgen.analysis.preprocessing import COMBINATIONS
from faultgen.analysis.statistics import Comparison, compare, difference_over_robots, levene_p
from faultgen.fleet.data import Fleet
from faultgen.studies.chapter5_classifiers.thesis import HEADLINE, PAIRS

FULL_CHAIN = "+estM+diff+var3+pca"
WITHOUT_DIFFERENCES = "+estM+var3+pca"
LONGER_WINDOWS = "+estM+diff+var5+pca"

Auc = dict[tuple[str, str], np.ndarray]
"""AUC by combination and classifier, shape (failing, normal) each."""


def _groups(auc: Auc, classifier: str) -> dict[str, np.ndarray]:
    """AUC of all pairs by combination of table 5.2."""
    return {
        name: auc[name, classifier].ravel() for name in COMBINATIONS if (name, classifier) in auc
    }


def compared(auc: Auc, classifier: str) -> Comparison:
    """Compare all combinations of table 5.2 by procedure 2.

    Args:
        auc: AUC of all pairs by combination and classifier.
        classifier: Name of the classifier.

    Returns:
        The comparison.
    """
    return compare(_groups(auc, classifier))


def overall(classifier: str, found: Comparison) -> dict[str, Any]:
    """Summarise whether combinations differ at all.

    Args:
        classifier: Name of the classifier.
        found: Its comparison, from `compared`.

    Returns:
        A row for the tables.
    """
    return {
        "classifier": classifier,
        "levene": found.levene,
        "test": "Welch, Games-Howell" if found.variances_differ else "ANOVA, Tukey",
        "f": found.statistic,
        "p": found.p,
    }


def over_control(auc: Auc, classifier: str, found: Comparison) -> list[dict[str, Any]]:
    """Compare each combination with no preprocessing: change of the mean and p of procedure 2.

    Args:
        auc: AUC of all pairs by combination and classifier.
        classifier: Name of the classifier.
        found: Its comparison, from `compared`.

    Returns:
        One row per combination.
    """
    groups = _groups(auc, classifier)
    control = groups["control"]
    return [
        {
            "classifier": classifier,
            "combination": name,
            "p": found.between("control", name) if found.means_differ else 1.0,
            "change": float(own.mean() - control.mean()),
        }
        for name, own in groups.items()
        if name != "control"
    ]


def pairs(auc: Auc, comparisons: Mapping[str, Comparison]) -> list[dict[str, Any]]:
    """Compare combinations with and without each step, as in tables A.2 and A.3.

    Args:
        auc: AUC of all pairs by combination and classifier.
        comparisons: Comparison of each classifier, from `compared`.

    Returns:
        One row per step, pair of combinations and classifier.
    """
    rows = []
    for classifier, found in comparisons.items():
        groups = _groups(auc, classifier)
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


def headlines(auc: Auc, classifiers: Sequence[str], seed: int) -> list[dict[str, Any]]:
    """Compute what each step adds to the thesis' pair, with an interval over robots.

    Args:
        auc: AUC of all pairs by combination and classifier.
        classifiers: Names of the classifiers.
        seed: Seed of the bootstrap.

    Returns:
        One row per step and classifier.
    """
    rows = []
    for step, pair in HEADLINE.items():
        for classifier in classifiers:
            if all((name, classifier) in auc for name in pair):
                before, after = (auc[name, classifier] for name in pair)
                change = difference_over_robots(before, after, seed=seed)
                rows.append({"step": step, "classifier": classifier, **vars(change)})
    return rows


def windows(auc: Auc, classifiers: Sequence[str]) -> list[dict[str, Any]]:
    """Compare windows of three days with windows of five.

    Args:
        auc: AUC of all pairs by combination and classifier.
        classifiers: Names of the classifiers.

    Returns:
        One row per classifier.
    """
    names = (FULL_CHAIN, LONGER_WINDOWS)
    rows = []
    for classifier in classifiers:
        if all((name, classifier) in auc for name in names):
            three, five = (auc[name, classifier].ravel() for name in names)
            p = compare({"three": three, "five": five}).p
            rows.append({"classifier": classifier, "p": p, "change": float((five - three).mean())})
    return rows


def invariance(fleet: Fleet, auc: Auc, classifiers: Sequence[str]) -> list[dict[str, Any]]:
    """Test whether the mean AUC of a robot depends on how fast, or with how much torque, it works.

    Args:
        fleet: The robots.
        auc: AUC of all pairs by combination and classifier.
        classifiers: Names of the classifiers.

    Returns:
        One row per quantity, combination and classifier.
    """
    series = [daily(robot) for robot in fleet.robots]
    failed = np.array([robot.failed for robot in fleet.robots])
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
