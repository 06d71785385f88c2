"""Thesis chapter 2 on a fleet: is a pattern in the event log 30 days before a failure real?

Each robot has its own PCA of five components. It is fitted to the daily counts of 67 events in the
first 28 days. T2 and Q of all later days are compared with their limits. The thesis studied one
robot that failed. Here as many robots fail as do not, so that a pattern before a failure can be
compared with what robots show that never fail.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu
from sklearn.metrics import roc_auc_score

from faultgen.analysis.detection import EWMAChart
from faultgen.analysis.pca import PCAMonitor, held_out_q_limit
from faultgen.errors import InputError
from faultgen.evaluation.shares import share
from faultgen.fleet import Fleet, FleetRobot

TRAINING = 28
"""Number of days to which PCA is fitted, as in the thesis."""

COMPONENTS = 5
"""Number of principal components, as in the thesis."""

BEFORE = 32
"""Number of days before failure in which the thesis sees the pattern."""

NEVER = -1
"""Days of warning if there was no warning."""

_SUPERVISED = ("motion_supervision", "motor_torque_limit")  # friction shows in these
_CONFIDENCE = 0.95
_RUN_LENGTH = 730.0  # days between false alarms of a chart, if its assumptions held
_BREAK = 7  # days without alarm that do not end one
_SPARED = 28  # days after training on which the charts are set up


DETECTORS = {
    "T2": "T² above its limit on 3 of 7 days",
    "Q": "Q above its limit on 3 of 7 days",
    "Q, held out": "Q above a limit from training days that were not fitted, on 3 of 7 days",
    "Q, charted": "EWMA of log Q, set up on 28 days that were not fitted",
    "supervision, charted": "EWMA of the square root of the supervisions of the worst axis, "
    "set up on 28 days that were not fitted",
}
"""Detectors that give a warning: the thesis' statistics, and two charts of ours."""


def run_events(fleet: Fleet, *, seed: int = 2026, workers: int = 1) -> dict[str, Any]:
    """Compute statistics and warnings of every robot, and whether failing robots differ.

    Args:
        fleet: Failing robots and others, with more than 88 days.
        seed: Not used, because nothing is random.
        workers: Not used, because it takes only seconds.

    Returns:
        Results for JSON.

    Raises:
        InputError: All robots fail or none does, or the records are too short.
    """
    fails = sum(robot.failed for robot in fleet.robots)
    if not 0 < fails < len(fleet.robots):
        raise InputError("study events: needs robots that fail and robots that do not")
    if fleet.days <= TRAINING + _SPARED + BEFORE:
        raise InputError(
            f"study events: needs more than {TRAINING + _SPARED + BEFORE} days, not {fleet.days}"
        )
    seen = [_look(robot, fleet) for robot in fleet.robots]
    failed = np.array([robot.failed for robot in fleet.robots])
    statistics = {name: np.array([one[name] for one in seen]) for name in ("T2", "Q")}
    return {
        "days": fleet.days,
        "robots": len(seen),
        "failed": failed.tolist(),
        "variance_of_five": float(np.mean([one["explained"] for one in seen])),
        "exceeding": _exceeding(seen, failed),
        "rise": {name: _rise(values, failed) for name, values in statistics.items()},
        "warnings": {name: _warnings(seen, failed, name) for name in DETECTORS},
        "course": {
            name: {
                "failing": np.median(values[failed], axis=0).tolist(),
                "healthy": np.median(values[~failed], axis=0).tolist(),
            }
            for name, values in statistics.items()
        },
        "example": _example(fleet, seen, failed),
    }


def _look(robot: FleetRobot, fleet: Fleet) -> dict[str, Any]:
    """T2, Q and warnings of one robot."""
    counts = robot.events.astype(float)
    monitor = PCAMonitor(n_components=COMPONENTS, confidence=_CONFIDENCE).fit(counts[:TRAINING])
    t2, q = monitor.t2(counts), monitor.q(counts)
    limits = {"T2": monitor.t2_limit_, "Q": monitor.q_limit_}
    held_out = held_out_q_limit(monitor, counts[:TRAINING])
    kinds = np.array([name.rpartition("_")[0] for name in fleet.event_names])
    supervised = np.sum([counts[:, kinds == kind] for kind in _SUPERVISED], axis=0)
    strained = np.sqrt(supervised.max(axis=1))
    alarms = {
        "T2": _often(t2 > limits["T2"]),
        "Q": _often(q > limits["Q"]),
        "Q, held out": _often(q > held_out),
        "Q, charted": _charted(np.log(q + 1e-9)),
        "supervision, charted": _charted(strained),
    }
    variance = monitor.eigenvalues_
    return {
        "T2": t2 / limits["T2"],
        "Q": q / limits["Q"],
        "explained": float(variance[:COMPONENTS].sum() / variance.sum()),
        "alarms": alarms,
        "monitor": monitor,
    }


def _often(above: np.ndarray) -> np.ndarray:
    """Days on which three of the last seven are above the limit; days of training do not count."""
    above = above & (np.arange(len(above)) >= TRAINING)
    recent = np.convolve(above, np.ones(7))[: len(above)]
    return np.asarray(recent >= 3)


def _charted(values: np.ndarray) -> np.ndarray:
    """Days on which a chart is above its limit."""
    spared = values[TRAINING : TRAINING + _SPARED]
    chart = EWMAChart(weight=0.2, in_control_run_length=_RUN_LENGTH).fit(spared)
    above = np.zeros(len(values), bool)
    after = values[TRAINING + _SPARED :]
    above[TRAINING + _SPARED :] = chart.statistic(after) > chart.limit_
    return above


def days_of_warning(above: np.ndarray) -> int:
    """Compute how long before the end an alarm begins that lasts to the end, short breaks aside.

    There is no warning where less than half of the last 32 days are days of alarm.

    Args:
        above: Whether each day is a day of alarm, shape (days,).

    Returns:
        Number of days, or `NEVER`.
    """
    if above[-BEFORE:].mean() < 0.5:
        return NEVER
    days = np.flatnonzero(above)
    breaks = np.flatnonzero(np.diff(days) > _BREAK)
    first = days[breaks[-1] + 1] if len(breaks) else days[0]
    return int(len(above) - first)


def _exceeding(seen: list[dict[str, Any]], failed: np.ndarray) -> dict[str, Any]:
    """Share of days above the limits, in the days before failure and earlier."""
    told = {}
    for name in ("T2", "Q"):
        above = np.array([one[name] for one in seen]) > 1
        told[name] = {
            "failing, last 32 days": float(above[failed, -BEFORE:].mean()),
            "failing, before": float(above[failed, TRAINING:-BEFORE].mean()),
            "healthy, last 32 days": float(above[~failed, -BEFORE:].mean()),
            "healthy, before": float(above[~failed, TRAINING:-BEFORE].mean()),
        }
    return told


def _rise(values: np.ndarray, failed: np.ndarray) -> dict[str, Any]:
    """Rise of a statistic in the last 32 days over earlier days, for failing and healthy robots."""
    log = np.log(values + 1e-9)
    rise = np.median(log[:, -BEFORE:], axis=1) - np.median(log[:, TRAINING:-BEFORE], axis=1)
    return {
        "failing": rise[failed].tolist(),
        "healthy": rise[~failed].tolist(),
        "auc": float(roc_auc_score(failed, rise)),
        "p": float(mannwhitneyu(rise[failed], rise[~failed], alternative="greater").pvalue),
    }


def _warnings(seen: list[dict[str, Any]], failed: np.ndarray, name: str) -> dict[str, Any]:
    """Warnings before failures, and warnings in the same days of robots that do not fail."""
    lead = np.array([days_of_warning(one["alarms"][name]) for one in seen])
    warned = lead != NEVER
    healthy = np.array([one["alarms"][name] for one in seen])[~failed]
    charted = _SPARED if "charted" in name else 0
    return {
        "warned": share(int(warned[failed].sum()), int(failed.sum())),
        "healthy_warned": share(int(warned[~failed].sum()), int((~failed).sum())),
        "days": float(np.median(lead[failed & warned])) if np.any(failed & warned) else None,
        "lead": lead[failed].tolist(),
        "healthy_in_alarm": float(healthy[:, TRAINING + charted :].mean()),
    }


def _example(fleet: Fleet, seen: list[dict[str, Any]], failed: np.ndarray) -> dict[str, Any]:
    """The failing robot whose Q rises like the median one's."""
    rises = [
        np.log(one["Q"][-BEFORE:] + 1e-9).mean() - np.log(one["Q"][TRAINING:-BEFORE] + 1e-9).mean()
        for one in seen
    ]
    candidates = np.flatnonzero(failed)
    order = candidates[np.argsort(np.array(rises)[candidates])]
    chosen = int(order[len(order) // 2])
    one, robot = seen[chosen], fleet.robots[chosen]
    monitor: PCAMonitor = one["monitor"]
    last = robot.events[-7:].astype(float)
    day = int(np.argmax(one["Q"][-7:]))
    return {
        "robot": robot.name,
        "axis": robot.axis,
        "T2": one["T2"].tolist(),
        "Q": one["Q"].tolist(),
        "names": list(fleet.event_names),
        "t2_contributions": monitor.t2_contributions(last)[day].tolist(),
        "q_contributions": monitor.q_contributions(last)[day].tolist(),
    }
