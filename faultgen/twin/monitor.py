"""Several robots and programs, judged over time.

    monitor = Monitor(load_monitor(Path("monitor.toml")), Path("out"))
    monitor.look()          # judges what is new
    monitor.write()         # out/index.html and out/robots.json

A configuration lists robots and their programs. Relative paths are those from its own folder:

    [[robot]]
    name = "welder 7"
    limits = { friction_wear = 0.3 }    # severity until which the robot may go on; optional

    [[robot.program]]
    name = "spot weld"                  # optional
    detector = "detectors/welder7"
    folder = "recordings/welder7"
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from faultgen.analysis import forecast_severity
from faultgen.effects import get_effect
from faultgen.errors import InputError, one_line
from faultgen.system.files import write_text
from faultgen.system.reading import read_text
from faultgen.twin.detector import Detector, load_detector
from faultgen.twin.judge import Judge
from faultgen.twin.watching import SETTLED, Watch

STATE, PAGE, TABLE = "monitor.sqlite", "index.html", "robots.json"
"""Files in the folder of the output."""

DAY = 86400.0
"""Seconds in a day."""

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


def load_monitor(path: Path) -> MonitorPlan:
    """Read a configuration.

    Args:
        path: The file (TOML).

    Returns:
        The configuration, with paths that do not depend on the current folder.

    Raises:
        InputError: It is no valid configuration.
    """
    try:
        plan = MonitorPlan.model_validate(tomllib.loads(read_text(path, "monitor file")))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is no valid TOML ({one_line(error)})") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {where}: {first['msg']}") from None
    names = [robot.name for robot in plan.robot]
    for robot in plan.robot:
        if names.count(robot.name) > 1:
            raise InputError(
                f"{path}: robot '{robot.name}' is listed twice; give each its own name"
            )
        for effect in robot.limits:
            get_effect(effect)
        for one in robot.program:
            one.detector, one.folder = path.parent / one.detector, path.parent / one.folder
            one.name = one.name or one.folder.name
        own = [one.name for one in robot.program]
        for name in own:
            if own.count(name) > 1:
                raise InputError(f"{path}: robot '{robot.name}' has two programs '{name}'")
    return plan


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

    def __init__(self, robot: RobotPlan, plan: ProgramPlan, judge: Judge, watch: Watch) -> None:
        """Put it together."""
        self.robot, self.plan, self.judge, self.watch = robot, plan, judge, watch

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
        limit = self.limit(answer["effect"], answer["axes"])
        none = Course(days, found, np.zeros(0), np.zeros((3, 0)), limit, (None, None, None))
        if len(days) < _FEWEST or days[0] == days[-1]:
            return none
        errors = np.maximum((found[:, 2] - found[:, 0]) / 3.92, 1e-9)
        rng = np.random.default_rng(_SEED)
        told = forecast_severity(days, found[:, 1], errors, limit=limit, rng=rng)
        remaining = tuple(
            float(x) if np.isfinite(x) else None for x in map(told.remaining, _QUANTILES)
        )
        return Course(days, found, told.times, told.severity(_QUANTILES), limit, remaining)

    def limit(self, effect: str, axes: list[int]) -> float:
        """Severity of a fault until which the robot may go on."""
        largest = next(
            f.largest for f in self.detector.faults if (f.effect, list(f.axes)) == (effect, axes)
        )
        return self.robot.limits.get(effect, largest)


class Monitor:
    """Robots that are judged, with their memory in a folder. It can be stopped at any time."""

    def __init__(
        self,
        plan: MonitorPlan,
        out: Path,
        *,
        tell: Callable[[str, str, dict[str, Any]], None] | None = None,
        complain: Callable[[str], None] | None = None,
        settled: float = SETTLED,
    ) -> None:
        """Read all detectors.

        Args:
            plan: What is monitored.
            out: Folder of memory, page and table. It is created if it does not exist.
            tell: Called with robot, program and answer of each new recording.
            complain: Called with a line for each file that cannot be judged.
            settled: How long a file without a checksum must not change before it is judged [s].

        Raises:
            InputError: A detector or a folder is missing, or the memory is that of others.
        """
        self.out = out
        self._new = 0
        self._complain = complain or (lambda line: None)
        out.mkdir(parents=True, exist_ok=True)
        detectors: dict[Path, Detector] = {}
        self.followed: list[Followed] = []
        """All programs of all robots."""
        for robot in plan.robot:
            for one in robot.program:
                if not one.folder.is_dir():
                    raise InputError(
                        f"robot '{robot.name}': {one.folder}: no such folder of recordings"
                    )
                if one.detector not in detectors:
                    detectors[one.detector] = load_detector(one.detector)
                judge = Judge(
                    one.detector, out / STATE, robot.name, one.name, detectors[one.detector]
                )
                watch = Watch(
                    judge.judge,
                    one.folder,
                    self._teller(tell, robot.name, one.name),
                    self._complain,
                    settled,
                )
                self.followed.append(Followed(robot, one, judge, watch))

    def _teller(
        self, tell: Callable[[str, str, dict[str, Any]], None] | None, robot: str, program: str
    ) -> Callable[[dict[str, Any]], None]:
        def told(answer: dict[str, Any]) -> None:
            self._new += 1
            if tell is not None:
                tell(robot, program, answer)

        return told

    def look(self) -> int:
        """Judge what is new in all folders.

        Returns:
            Number of recordings that were judged.
        """
        self._new = 0
        for one in self.followed:
            one.watch.look()
        return self._new

    def states(self) -> list[State]:
        """Return what is known of all programs, in the order of the configuration."""
        return [State(one, one.judge.latest()) for one in self.followed]

    def write(self) -> None:
        """Write page and table.

        Raises:
            StorageFailed: They cannot be written. Then the earlier ones are still there.
        """
        from faultgen.report.monitor_report import monitor_page

        states = self.states()
        table = [one.table() for one in states]
        write_text(self.out / TABLE, json.dumps(table, indent=1) + "\n")
        write_text(self.out / PAGE, monitor_page(states))


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
        course = self.course
        return {
            "robot": self.of.robot.name,
            "program": self.of.plan.name,
            "sentence": self.sentence(),
            "answer": self.answer,
            "limit": course.limit if course else None,
            "days_until_limit": list(course.remaining) if course else None,
        }

    def sentence(self) -> str:
        """Say what is known in one sentence."""
        name = f"{self.of.robot.name}, {self.of.plan.name}"
        answer = self.answer
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
        course = self.course
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
    """Write a severity with its unit; fractions in per cent.

    Args:
        severity: In the unit.
        unit: "1" for a fraction.
    """
    return f"{100 * severity:.3g} %" if unit == "1" else f"{severity:.3g} {unit}"
