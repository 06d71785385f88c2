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
from faultgen.twin.followed import Course, RobotPlan, State, entry, sentence
from faultgen.twin.naming import verdict_of, widened

_Z = 1.96  # standard deviations from the middle of a 95 % interval to its ends
_EXACT = 1e-12  # width of an interval that counts as exact
_ROUNDED = 1.0  # dates in words are rounded to this time [s]

_Cause = tuple[str, tuple[int, ...]]  # effect and axes


@dataclass(frozen=True, eq=False)
class _Evidence:
    """What the recordings of one program say of a cause."""

    log: float
    """Logarithm of its Bayes factor."""
    severity: np.ndarray
    """Quantiles 0.025, 0.5 and 0.975 of its severity, shape (3,)."""
    unit: str
    """Unit of the severity."""


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
        told = entry(self.sentence(), self.answer, self.course)
        programs = [one.table() for one in self.programs]
        return {"robot": self.robot.name, **told, "programs": programs}


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
    answers = [one.answer for one in states if one.answer is not None]
    alarms = [one for one in answers if one["alarm"]]
    if not alarms:
        return None
    since = min(alarms, key=lambda one: date_of(one["since"]))["since"]
    programs, recordings = [], 0
    evidence: dict[_Cause, list[_Evidence]] = {}
    for one in states:
        count, own = _evidence(one, date_of(since) - _ROUNDED)
        if not count:
            continue
        programs.append(one.of.plan.name)
        recordings += count
        for cause, told in own.items():
            evidence.setdefault(cause, []).append(told)
    return {
        "date": max((one["date"] for one in answers), key=date_of),
        "since": since,
        "recordings": recordings,
        "programs": programs,
        **verdict_of(_named(evidence)),
    }


def _evidence(state: State, since: float) -> tuple[int, dict[_Cause, _Evidence]]:
    """Number of recordings of a program since a date [s], and what they say of each cause."""
    if state.answer is None:
        return 0, {}
    dates, scores = state.of.judge.history()
    own, detector = scores[dates >= since], state.of.detector
    if not len(own):
        return 0, {}
    logs = detector.posterior.evidence(own)
    newest = detector.posterior.judge(scores)  # a fault grows: its severity is the newest one
    low, high = newest.intervals.T
    found: dict[_Cause, _Evidence] = {}
    for (effect, axes, unit), log, *severity in zip(
        detector.causes(), logs, low, newest.severities, high, strict=True
    ):
        told = _Evidence(float(log), np.array(severity), unit)
        cause = effect, tuple(axes)
        if cause not in found or told.log > found[cause].log:  # forms of unknown changes
            found[cause] = told
    return len(own), found


def _named(evidence: dict[_Cause, list[_Evidence]]) -> list[dict[str, Any]]:
    """What `verdict_of` asks for, from the evidence of all programs."""
    total = {cause: sum(one.log for one in own) for cause, own in evidence.items()}
    all_causes = np.logaddexp.reduce(list(total.values()))
    named = []
    for (effect, axes), own in evidence.items():
        log = total[effect, axes]
        severity, low, high = _combined([one.severity for one in own])
        named.append(
            {
                "effect": effect,
                "axes": list(axes),
                "probability": float(np.exp(log - all_causes)),
                "log_odds": log,
                "severity": severity,
                "interval": list(widened(effect, severity, low, high)),
                "unit": own[-1].unit,
            }
        )
    return sorted(named, key=lambda one: -float(one["log_odds"]))


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
