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
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from faultgen.effects import EFFECTS
from faultgen.errors import InputError, one_line
from faultgen.system.files import write_text
from faultgen.system.reading import read_text
from faultgen.twin.detector import Detector, load_detector
from faultgen.twin.followed import Followed, MonitorPlan, State
from faultgen.twin.judge import Judge
from faultgen.twin.monitor_page import monitor_page
from faultgen.twin.together import RobotState, robot_states
from faultgen.twin.watching import SETTLED, Watch

STATE, PAGE, TABLE = "monitor.sqlite", "index.html", "robots.json"
"""Files in the folder of the output."""


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
            if effect not in EFFECTS:
                raise InputError(
                    f"{path}: limits of robot '{robot.name}': unknown effect '{effect}'"
                )
        for one in robot.program:
            one.detector, one.folder = path.parent / one.detector, path.parent / one.folder
            one.name = one.name or one.folder.name
        own = [one.name for one in robot.program]
        for name in own:
            if own.count(name) > 1:
                raise InputError(f"{path}: robot '{robot.name}' has two programs '{name}'")
    return plan


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
        self._complain = complain or (lambda line: None)
        detectors: dict[Path, Detector] = {}
        self.followed: list[Followed] = []
        """All programs of all robots."""
        self._watches: list[Watch] = []
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
                    partial(tell, robot.name, one.name) if tell else lambda answer: None,
                    self._complain,
                    settled,
                )
                self._watches.append(watch)
                self.followed.append(Followed(robot, one, judge))
        out.mkdir(parents=True, exist_ok=True)

    def look(self) -> int:
        """Judge what is new in all folders.

        Returns:
            Number of recordings that were judged.
        """
        return sum(watch.look() for watch in self._watches)

    def robots(self) -> list[RobotState]:
        """Return what is known of all robots, in the order of the configuration."""
        return robot_states([State(one, one.judge.latest()) for one in self.followed])

    def write(self) -> None:
        """Write page and table.

        Raises:
            StorageFailed: They cannot be written. Then the earlier ones are still there.
        """
        robots = self.robots()
        table = [one.table() for one in robots]
        write_text(self.out / TABLE, json.dumps(table, indent=1) + "\n")
        write_text(self.out / PAGE, monitor_page(robots))
