"""One program of one robot that is followed over time: its state, its course, and sentences.

state = State(followed, followed.judge.latest())
state.sentence(), state.course
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from faultgen.analysis import forecast_severity
from faultgen.twin.detector import Detector
from faultgen.twin.judge import Judge
from faultgen.twin.naming import scale_of

DAY = 86400.0
"""Seconds in a day."""

_SMALL = {"rad": (1e3, "mrad"), "m": (1e3, "mm")}
"""Units in which people state a play, and their number in the SI unit."""

_QUANTILES = (0.1, 0.5, 0.9)  # of the time until a limit
_FEWEST = 4  # recordings with a fault from which its course is forecast
_SEED = 0

Name = Annotated[str, Field(min_length=1)]


class ProgramPlan(BaseModel):
    """A program of a robot."""

    model_config = ConfigDict(extra="forbid")
    name: str = ""
    """Name; default: that of its folder."""
    detector: Path
    """Folder of its detector."""
    folder: Path
    """Folder in which its recordings appear."""


class RobotPlan(BaseModel):
    """A robot."""

    model_config = ConfigDict(extra="forbid")
    name: Name
    """Name, which no other robot has."""
    limits: dict[str, Annotated[float, Field(gt=0)]] = {}
    """Severity of effects until which the robot may go on. Default: the largest one in the data
    with which its detector was trained."""
    program: Annotated[list[ProgramPlan], Field(min_length=1)]
    """Its programs."""


class MonitorPlan(BaseModel):
    """What is monitored."""

    model_config = ConfigDict(extra="forbid")
    robot: Annotated[list[RobotPlan], Field(min_length=1)]
    """The robots."""


@dataclass(frozen=True, eq=False)
class Course:
    """How severe a fault was, and how it may go on. Times are in days from the last recording."""

    days: np.ndarray
    """Of the recordings, shape (recordings,); not positive."""
    severities: np.ndarray
    """Quantiles 0.025, 0.5 and 0.975 of each recording alone, shape (recordings, 3)."""
    ahead: np.ndarray
    """Times of the forecast, shape (times,)."""
    forecast: np.ndarray
    """Quantiles 0.1, 0.5 and 0.9 of the severity then, shape (3, times)."""
    limit: float
    """Severity until which the robot may go on."""
    remaining: tuple[float | None, ...]
    """Quantiles 0.1, 0.5 and 0.9 of the time until the limit [d]; None beyond the horizon."""


class Followed:
    """One program of one robot."""

    def __init__(self, robot: RobotPlan, plan: ProgramPlan, judge: Judge) -> None:
        """Put it together.

        Args:
            robot: The robot.
            plan: The program.
            judge: Its detector with its memory.
        """
        self.robot, self.plan, self.judge = robot, plan, judge

    @property
    def detector(self) -> Detector:
        """Its detector."""
        return self.judge.detector

    def course(self, answer: Mapping[str, Any]) -> Course | None:
        """Forecast how a fault goes on.

        Args:
            answer: That to the newest recording, which names the fault.

        Returns:
            None if the answer names none, or there are too few recordings.
        """
        if answer["verdict"] != "fault":
            return None
        dates, scores = self.judge.history()
        found = self.detector.severities(scores, answer["effect"], answer["axes"])
        days = (dates - dates[-1]) / DAY
        largest = self.detector.fault(answer["effect"], answer["axes"]).largest
        limit = self.robot.limits.get(answer["effect"], largest)
        none = Course(days, found, np.zeros(0), np.zeros((3, 0)), limit, (None, None, None))
        if len(days) < _FEWEST or days[0] == days[-1]:
            return none
        errors = np.maximum((found[:, 2] - found[:, 0]) / 3.92, 1e-9)
        rng = np.random.default_rng(_SEED)
        told = forecast_severity(
            days,
            found[:, 1],
            errors,
            limit=limit,
            rng=rng,
            scale_error=scale_of(answer["effect"]),
        )
        remaining = tuple(
            float(x) if np.isfinite(x) else None for x in map(told.remaining, _QUANTILES)
        )
        return Course(days, found, told.times, told.severity(_QUANTILES), limit, remaining)


@dataclass(frozen=True, eq=False)
class State:
    """What is known of one program of one robot."""

    of: Followed
    """The program."""
    answer: dict[str, Any] | None
    """Answer to the newest recording; None if there is none."""

    @cached_property
    def course(self) -> Course | None:
        """How its fault goes on; None if no fault is named."""
        return None if self.answer is None else self.of.course(self.answer)

    @property
    def alarm(self) -> bool:
        """Whether there is an alarm."""
        return self.answer is not None and bool(self.answer["alarm"])

    def table(self) -> dict[str, Any]:
        """Return it as an entry of `TABLE`."""
        names = {"robot": self.of.robot.name, "program": self.of.plan.name}
        return names | entry(self.sentence(), self.answer, self.course)

    def sentence(self) -> str:
        """Say what is known in one sentence."""
        return sentence(f"{self.of.robot.name}, {self.of.plan.name}", self.answer, self.course)


def entry(told: str, answer: dict[str, Any] | None, course: Course | None) -> dict[str, Any]:
    """Return what is known of a robot or of one of its programs, for the table of robots.

    Args:
        told: The sentence about it.
        answer: To the newest recording; None if there is none.
        course: How its fault goes on; None if no fault is named.
    """
    return {
        "sentence": told,
        "answer": answer,
        "limit": course.limit if course else None,
        "days_until_limit": list(course.remaining) if course else None,
    }


def sentence(name: str, answer: Mapping[str, Any] | None, course: Course | None) -> str:
    """Say in one sentence what is known of a robot or of one of its programs.

    Args:
        name: How the sentence begins.
        answer: To the newest recording; None if there is none.
        course: How its fault goes on; None if no fault is named.
    """
    if answer is None:
        return f"{name}: no recording yet"
    if not answer["alarm"]:
        warm = answer["verdict"] == "other temperature"
        more = ", friction of all axes as at another temperature" if warm else ""
        return f"{name}: healthy{more} ({answer['recordings']} recordings)"
    axes = " and ".join(map(str, answer["axes"]))
    where = f"{name}, axis {axes}"
    since = f"since {answer['since'][:10]}"
    if answer["verdict"] != "fault":
        return f"{where}: a change that no known fault explains, {since}"
    size = in_units(answer["severity"], answer["unit"])
    low, high = (in_units(x, answer["unit"]) for x in answer["interval"])
    told = f"{where}: {answer['effect']} of {size} [{low}, {high}], {since}"
    if course is None:
        return told
    limit = in_units(course.limit, answer["unit"])
    early, _, late = course.remaining
    if early is None:
        return f"{told}; the limit of {limit} is not near"
    if early == 0:
        return f"{told}; the limit of {limit} may be reached"
    until = "later" if late is None else f"{late:.0f}"
    return f"{told}; limit of {limit} in {early:.0f} to {until} days"


def in_units(severity: float, unit: str) -> str:
    """Write a severity in a unit that people use: per cent, mrad, mm, or the SI unit.

    Args:
        severity: In the unit.
        unit: "1" for a fraction.
    """
    if unit == "1":
        return f"{100 * severity:.2g} %"
    factor, shown = _SMALL.get(unit, (1.0, unit))
    return f"{factor * severity:.2g} {shown}"
