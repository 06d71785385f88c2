"""Study `training-data`, thesis chapter 4: whose data, and which signal, should PCA learn from?

Principal components of 40 days of one robot are applied to 15 days of another (one to many, OTM) or
of the same robot (one to one, OTO). Q is what the components do not explain. Three descriptors of Q
are compared between failing and normal robots by a factorial ANOVA and by GLMs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from faultgen.analysis.glm import Family, sequence, terms
from faultgen.analysis.pca import PCAMonitor, held_out_q_limit
from faultgen.analysis.statistics import SIGNIFICANT, anova, tukey
from faultgen.errors import InputError
from faultgen.fleet.data import Fleet
from faultgen.studies.chapter4_training_data.signals import (
    SIGNALS,
    TEST,
    TrainingSet,
    training_sets,
)
from faultgen.studies.chapter4_training_data.thesis import FACTORS

SHARE = 0.90
"""Share of the variance that the components explain."""

CONFIDENCE = 0.95
"""Confidence of the limit of Q."""

DESCRIPTORS: dict[str, Family] = {"variation": "gamma", "above": "poisson", "lead": "poisson"}
"""Family of the GLM of each descriptor: coefficient of variation of Q, number of days above its
limit, and days that remain when the first of these occurs (0 if there is none; the five omitted
days are added)."""

CUTS = (10, 12, 13, TEST)
"""Days of the test part, from its first."""

_QUICK_CUTS = (10, TEST)


def run_training(
    fleet: Fleet, *, quick: bool = False, seed: int = 2026, workers: int = 1
) -> dict[str, Any]:
    """Run the study on a fleet.

    Args:
        fleet: At least seven failing and three normal robots, 120 days.
        quick: Whether to use two lengths of the test part instead of four.
        seed: Not used, because nothing is random.
        workers: Not used, because it takes only seconds.

    Returns:
        Results for JSON.

    Raises:
        InputError: The fleet is too small or its records are too short.
    """
    sets = training_sets(fleet)
    cases = [case for signal in SIGNALS for case in _cases(sets, signal)]
    frame = pd.DataFrame([_row(case, TEST) for case in cases])
    names = list(DESCRIPTORS)
    return {
        "seed": seed,
        "fleet": {"seed": fleet.seed, "days": fleet.days},
        "columns": {signal: sets[0].train[signal].shape[1] for signal in SIGNALS},
        "sets": [
            {"robot": one.robot, "failed": one.failed, "first_day": one.first + 1} for one in sets
        ],
        "cases": frame.to_dict("records"),
        "groups": _groups(frame),
        "healthy_above": _healthy_above(cases),
        "anova": {name: anova(frame, name, FACTORS) for name in names},
        "models": {name: sequence(frame, name, FACTORS, law) for name, law in DESCRIPTORS.items()},
        "terms": {
            # As the thesis does: model 4 for the first, model 8 for the others.
            name: terms(frame, name, FACTORS, law, main_only=name == "variation")
            for name, law in DESCRIPTORS.items()
        },
        "cuts": [
            cut
            for days in (_QUICK_CUTS if quick else CUTS)
            for cut in _contrasts(pd.DataFrame([_row(case, days) for case in cases]), days)
        ],
        "other_robots": _contrasts(frame[(frame.source == "OTO") | ~frame.same_robot], TEST),
        "example": _example(sets),
    }


def _cases(sets: list[TrainingSet], signal: str) -> list[dict[str, Any]]:
    """Q of every test part under every model that table 4.1 counts, for one signal.

    One to many, failing: models of the seven failing robots' healthy days, each tested on the other
    six: 42. Normal: models of the six normal sets, each tested on all six: 36, the number that
    table 4.1 has, so that a set's own later days, and the other set of its robot, are among them.
    One to one: each on its own.
    """
    cases = []
    for trained in sets:
        monitor = PCAMonitor(n_components=SHARE, confidence=CONFIDENCE).fit(trained.train[signal])
        limit = held_out_q_limit(monitor, trained.train[signal])
        for tested in sets:
            if tested.failed != trained.failed:
                continue
            same = tested is trained
            sources = [
                *(["OTM"] if not same or not tested.failed else []),
                *(["OTO"] if same else []),
            ]
            q = monitor.q(tested.test[signal])
            for source in sources:
                cases.append(
                    {
                        "source": source,
                        "signal": signal,
                        "condition": "failure" if tested.failed else "normal",
                        "trained": f"{trained.robot}, day {trained.first + 1}",
                        "tested": f"{tested.robot}, day {tested.first + 1}",
                        "same_robot": trained.robot == tested.robot,
                        "components": int(monitor.n_components_),
                        "limit": limit,
                        "gaussian_limit": monitor.q_limit_,
                        "q": q,
                        "day": tested.test_day[signal],
                    }
                )
    return cases


def _row(case: dict[str, Any], days: int) -> dict[str, Any]:
    """Descriptors of a case whose test part has so many days."""
    kept = {key: value for key, value in case.items() if key not in ("q", "day")}
    return kept | describe(case["q"], case["day"], case["limit"], days)


def describe(q: np.ndarray, day: np.ndarray, limit: float, days: int) -> dict[str, float | int]:
    """Compute the three descriptors of a series of Q.

    Args:
        q: Q, shape (rows,).
        day: Day of each row, from 0. Same shape.
        limit: Limit of Q.
        days: Number of days that are used.

    Returns:
        "variation", "above" and "lead", see `DESCRIPTORS`.

    Raises:
        InputError: Q is always zero, or never varies.
    """
    counted = q[day < days]
    if len(counted) < 2 or np.ptp(counted) == 0:
        raise InputError("fleet: Q of a robot does not vary; its records hold no information")
    over = day[(q > limit) & (day < days)]
    return {
        "variation": float(counted.std(ddof=1) / counted.mean()),
        "above": len(over),
        "lead": int(days - 1 - over[0]) if len(over) else 0,
    }


def _groups(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Mean and standard error of each descriptor in each of the 12 groups, figures 4-4 to 4-6."""
    rows = []
    for key, own in frame.groupby(list(FACTORS), sort=False):
        row: dict[str, Any] = {**dict(zip(FACTORS, key, strict=True)), "cases": len(own)}
        for name in DESCRIPTORS:
            row[name] = float(own[name].mean())
            row[f"{name}_error"] = float(own[name].sem())
        rows.append(row)
    return rows


def _healthy_above(cases: list[dict[str, Any]]) -> dict[str, float]:
    """Share of days of normal robots above either limit of their own model."""
    own = [case for case in cases if (case["source"], case["condition"]) == ("OTO", "normal")]
    return {
        name: float(np.mean(np.concatenate([case["q"] > case[name] for case in own])))
        for name in ("limit", "gaussian_limit")
    }


def _contrasts(frame: pd.DataFrame, days: int) -> list[dict[str, Any]]:
    """Failing against normal robots for each source and signal, Tukey's test over all 12 groups."""
    rows = []
    for name in DESCRIPTORS:
        groups = {
            "/".join(key): own[name].to_numpy(float)
            for key, own in frame.groupby(list(FACTORS), sort=False)
        }
        p = tukey(groups) if any(np.ptp(own) > 0 for own in groups.values()) else {}
        for source in ("OTM", "OTO"):
            for signal in SIGNALS:
                ill, well = (f"{source}/{signal}/{kind}" for kind in ("failure", "normal"))
                found = p.get((ill, well), p.get((well, ill), 1.0))
                rows.append(
                    {
                        "days": days,
                        "descriptor": name,
                        "source": source,
                        "signal": signal,
                        "failure": float(groups[ill].mean()),
                        "normal": float(groups[well].mean()),
                        "p": found,
                        "found": bool(
                            found < SIGNIFICANT and groups[ill].mean() > groups[well].mean()
                        ),
                    }
                )
    return rows


def _example(sets: list[TrainingSet]) -> dict[str, Any]:
    """Share of the variance over components, figure 4-3: differences of the first set."""
    monitor = PCAMonitor(n_components=SHARE, confidence=CONFIDENCE)
    monitor.fit(sets[0].train["difference"])
    share = np.cumsum(monitor.eigenvalues_) / monitor.eigenvalues_.sum()
    return {"explained": share[: len(sets[0].train["difference"])].tolist()}
