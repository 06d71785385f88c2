"""How long a cycle of each task takes that comes with the package, without planning its motion.

Planning all tasks takes two seconds of processor time. The table `planned_cycles.json` beside the
robots holds what it gives, with a checksum of the robot and the task, and a test compares both.

    planned_cycle("puma560", "arc_weld")  # None if the robot or the task is another one

`python -m faultgen.planned_cycles` writes the table again, after a change of a robot, a task or the
planning.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from faultgen.robot_names import robot_names
from faultgen.tasks import load_task, task_names, task_text

_FILE = "planned_cycles.json"


@dataclass(frozen=True)
class PlannedCycle:
    """What is listed of the planned motion of a task."""

    period: float
    """Duration of a cycle, rounded to 0.01 [s]."""
    window_share: tuple[int, ...]
    """Share of the cycle that each motor turns at the usual speeds of monitoring [%]."""


def planned_cycle(robot: str, task: str) -> PlannedCycle | None:
    """Look up the cycle of a task.

    Args:
        robot: Name of a robot.
        task: Name of one of its tasks.

    Returns:
        The cycle; None if the robot does not come with the package, or a file has changed.
    """
    if robot not in robot_names():
        return None
    told = json.loads(_table().read_text(encoding="utf-8")).get(f"{robot}/{task}", {})
    if told.pop("sha256", None) != _checksum(robot, task):
        return None
    return PlannedCycle(told["period"], tuple(told["window_share"]))


def plan_cycle(robot: str, task: str) -> PlannedCycle:
    """Plan a task, and round what is listed of it.

    Args:
        robot: Name or path of a robot.
        task: Name of one of its tasks.
    """
    from faultgen.robot import load_robot
    from faultgen.simulation.motion import plan

    machine = load_robot(robot)
    motion = plan(load_task(machine.name, task, machine.tasks), machine)
    return PlannedCycle(
        round(motion.period, 2), tuple(round(100 * float(one)) for one in motion.window_share)
    )


def write_table() -> None:
    """Write the table of all robots that come with the package."""
    out = {
        f"{robot}/{task}": {"sha256": _checksum(robot, task), **asdict(plan_cycle(robot, task))}
        for robot in robot_names()
        for task in task_names(robot)
    }
    Path(str(_table())).write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")


def _table() -> Traversable:
    return resources.files("faultgen.robots") / _FILE


def _checksum(robot: str, task: str) -> str:
    xml = resources.files("faultgen.robots").joinpath(robot, f"{robot}.xml").read_bytes()
    return hashlib.sha256(xml + task_text(robot, task).encode()).hexdigest()


if __name__ == "__main__":
    write_table()
