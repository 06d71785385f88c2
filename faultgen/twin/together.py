"""What is known of a robot, from all of its programs.

A robot has an alarm if one of its programs has one. What the fault is follows from the recordings
of all its programs since then: programs are recorded one after another, so that their noise is
independent, and the logarithms of their Bayes factors add up. A program that does not know an
effect says nothing about it. The severity is the mean of what the programs say now, weighed by
their intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from faultgen.system.dates import date_of
from faultgen.twin.detector import verdict_of, widened
from faultgen.twin.followed import Course, RobotPlan, State, sentence

_Z = 1.96  # standard deviations from the middle of a 95 % interval to its ends
_EXACT = 1e-12  # width of an interval that counts as exact
_ROUNDED = 1.0  # dates in words are rounded to this time [s]

_Cause = tuple[str, tuple[int, ...]]  # effect and axes


@dataclass(frozen=True, eq=False)
class RobotState:
    """What is known of one robot."""

    robot: RobotPlan
    """The robot."""
    programs: list[State]
    """Of its programs, in the order of the configuration."""

    @cached_property
    def answer(self) -> dict[str, Any] | None:
        """Answer of all programs together; None if there is no recording."""
        seen = [one.answer for one in self.programs if one.answer is not None]
        if len(self.programs) == 1 or not seen:
            return seen[0] if seen else None
        found = together(self.programs)
        if found is not None:
            return found
        newest = max(seen, key=lambda one: date_of(one["date"]))
        return {**newest, "recordings": sum(one["recordings"] for one in seen)}

    @property
    def alarm(self) -> bool:
        """Whether there is an alarm."""
        return self.answer is not None and bool(self.answer["alarm"])

    @cached_property
    def leading(self) -> State | None:
        """The program with the most evidence of those that name the same fault as the robot."""
        answer = self.answer
        if answer is None or answer["verdict"] != "fault":
            return None
        same = [
            one
            for one in self.programs
            if one.answer is not None
            and (one.answer["effect"], one.answer["axes"]) == (answer["effect"], answer["axes"])
        ]
        return max(same, key=lambda one: (one.answer or {})["log_odds"], default=None)

    @property
    def course(self) -> Course | None:
        """How its fault goes on, by the leading program; None if no fault is named."""
        return None if self.leading is None else self.leading.course

    def sentence(self) -> str:
        """Say what is known in one sentence."""
        if len(self.programs) == 1:
            return self.programs[0].sentence()
        return sentence(self.robot.name, self.answer, self.course)

    def table(self) -> dict[str, Any]:
        """Return it as an entry of the table of robots."""
        course = self.course
        return {
            "robot": self.robot.name,
            "sentence": self.sentence(),
            "answer": self.answer,
            "limit": course.limit if course else None,
            "days_until_limit": list(course.remaining) if course else None,
            "programs": [one.table() for one in self.programs],
        }


def robot_states(states: Sequence[State]) -> list[RobotState]:
    """Put the programs of each robot together.

    Args:
        states: Of all programs of all robots.

    Returns:
        The robots, in the order in which they come first.
    """
    of: dict[str, list[State]] = {}
    for one in states:
        of.setdefault(one.of.robot.name, []).append(one)
    return [RobotState(own[0].of.robot, own) for own in of.values()]


def together(states: Sequence[State]) -> dict[str, Any] | None:
    """Combine the answers to the newest recordings of all programs of a robot.

    Args:
        states: Of its programs.

    Returns:
        An answer with the entries of that of one program, as far as they apply, and `programs`,
        the names of those whose recordings count; None if no program has an alarm.
    """
    alarms = [one.answer for one in states if one.alarm and one.answer is not None]
    if not alarms:
        return None
    since = min(alarms, key=lambda one: date_of(one["since"]))["since"]
    evidence: dict[_Cause, list[tuple[float, np.ndarray]]] = {}
    units: dict[_Cause, str] = {}
    programs, recordings = [], 0
    for one in states:
        if one.answer is None:
            continue
        dates, scores = one.of.judge.history()
        own = scores[dates >= date_of(since) - _ROUNDED]
        if not len(own):
            continue
        programs.append(one.of.plan.name)
        recordings += len(own)
        detector = one.of.detector
        logs = detector.posterior.evidence(own)
        newest = detector.posterior.judge(scores)  # a fault grows: its severity is the newest one
        low, high = newest.intervals.T
        severities = np.stack([low, newest.severities, high], axis=1)
        best: dict[_Cause, tuple[float, np.ndarray]] = {}
        for (effect, axes, unit), log, size in zip(
            detector.causes(), logs, severities, strict=True
        ):
            key = (effect, tuple(axes))
            units[key] = unit
            if key not in best or log > best[key][0]:  # forms of unknown changes
                best[key] = (float(log), size)
        for key, told in best.items():
            evidence.setdefault(key, []).append(told)
    named: list[dict[str, Any]] = []
    total = {key: sum(log for log, _ in of) for key, of in evidence.items()}
    all_causes = np.logaddexp.reduce(list(total.values()))
    for key, of in evidence.items():
        effect, axes = key[0], list(key[1])
        severity, low, high = _combined([size for _, size in of])
        named.append(
            {
                "effect": effect,
                "axes": axes,
                "probability": float(np.exp(total[key] - all_causes)),
                "log_odds": total[key],
                "severity": severity,
                "interval": list(widened(effect, severity, low, high)),
                "unit": units[key],
            }
        )
    named.sort(key=lambda one: -one["log_odds"])
    date = max((one.answer["date"] for one in states if one.answer), key=date_of)
    return {
        "date": date,
        "since": since,
        "recordings": recordings,
        "programs": programs,
        **verdict_of(named),
    }


def _combined(severities: Sequence[np.ndarray]) -> tuple[float, float, float]:
    """Estimate and ends of the interval of a severity that several programs estimate.

    Args:
        severities: Quantiles 0.025, 0.5 and 0.975 of each, shape (3,).
    """
    if len(severities) == 1:
        low, middle, high = severities[0]
        return float(middle), float(low), float(high)
    middle = np.array([size[1] for size in severities])
    width = np.array([max((size[2] - size[0]) / (2 * _Z), _EXACT) for size in severities])
    weight = width**-2 / np.sum(width**-2)
    mean, error = float(weight @ middle), float(np.sum(width**-2) ** -0.5)
    low = mean - _Z * error
    return mean, (max(low, 0.0) if min(s[0] for s in severities) >= 0 else low), mean + _Z * error
