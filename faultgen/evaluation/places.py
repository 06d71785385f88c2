"""Names of the robots and tasks of a study."""

from __future__ import annotations

from pathlib import Path

from faultgen.robot import load_robot

ROBOTS = ("puma560", "irb6700")
"""The robots that come with faultgen."""

TASKS = ("pick_and_place", "spot_weld", "arc_weld")
"""The tasks of the thesis that both robots can do."""


def place_name(robot: str, task: str) -> tuple[str, str]:
    """Return the names of a robot and a task, which do not depend on where their files are.

    Args:
        robot: Name of the robot, or path of an MJCF file.
        task: Name of the task, or path of a task file.

    Returns:
        Name of the robot and name of the task.

    Raises:
        InputError: There is no such robot.
    """
    return load_robot(robot).name, Path(task).stem
