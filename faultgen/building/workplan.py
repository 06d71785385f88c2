"""Tasks for a robot that was built: the usual three, where the arm can do them.

robot, home, notes = plan_tasks(robot, None)
robot.tasks["spot_weld"]  # text of a task file
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice

import numpy as np
import tomli_w

from faultgen.building.joint_motions import joint_tasks
from faultgen.building.motions import Content, arc_weld, pick_and_place, spot_weld
from faultgen.building.workspace import Workspace
from faultgen.errors import InputError
from faultgen.robot import Robot
from faultgen.simulation.motion import plan
from faultgen.system.progress import Progress
from faultgen.tasks import load_task

_TRIES = 24  # poses about which a task is tried
_PLANS = 6  # motions of the tool that are planned before joints move instead
_SIZES = (0.25, 0.15, 0.08)  # of a panel over the reach
_SHRINK = (1.0, 0.7, 0.5, 0.3)  # of joint motions
_LOOK = 0.05  # time between the poses of a motion in which collisions are looked for [s]
_LEAST = 6  # axes with which a tool can have every pose


def plan_tasks(robot: Robot, home: np.ndarray | None) -> tuple[Robot, np.ndarray, list[str]]:
    """Give a robot the tasks ``pick_and_place``, ``spot_weld`` and ``arc_weld``.

    Arms with six or more hinges get motions of the tool. Others, and those for which no such motion
    is found, get motions of the joints.

    Args:
        robot: The robot.
        home: Pose near which it should work, shape (n_axes,), in [rad] or [m]. None: anywhere.

    Returns:
        The robot with its tasks; its home pose, shape (n_axes,), by default the start of a task;
        and one line for each task that is no motion of the tool.
    """
    with Progress("looking for tasks that the arm can do", None):
        return _plan_tasks(robot, home)


def _plan_tasks(robot: Robot, home: np.ndarray | None) -> tuple[Robot, np.ndarray, list[str]]:
    space = Workspace(robot, home)
    found: dict[str, str] = {}
    notes = list(space.notes)
    if robot.n_axes >= _LEAST and not robot.slides.any():
        down, out = (space.best(downward, _TRIES) for downward in (True, False))
        options: dict[str, Callable[[], Iterable[Content | None]]] = {
            "pick_and_place": lambda: (pick_and_place(space, pose) for pose in down),
            "spot_weld": lambda: (spot_weld(space, p, size) for size in _SIZES for p in out),
            "arc_weld": lambda: (arc_weld(space, p, size) for size in _SIZES for p in out),
        }
        for name, contents in options.items():
            reached = islice(filter(None, contents()), _PLANS)
            text = next(filter(None, (_planned(space, name, one) for one in reached)), None)
            if text is not None:
                found[name] = text
            else:
                notes.append(f"task {name}: no such motion of the tool was found; joints move")
    else:
        why = "it has an axis that slides" if robot.slides.any() else "it has fewer than six axes"
        notes.append(f"tasks: joints move and not the tool along lines, because {why}")
    if len(found) < 3:
        found = {**_joint_tasks(space), **found}
    missing = {"pick_and_place", "spot_weld", "arc_weld"} - found.keys()
    if missing:
        notes.append(
            f"tasks {', '.join(sorted(missing))}: no motion was found that keeps all limits; "
            "raise torque_limit or make the payload lighter in drives.toml"
        )
    robot = replace(robot, tasks=dict(sorted(found.items())))
    if home is None:
        home = space.poses[0]
        if found:
            first = load_task(robot.name, next(iter(sorted(found, reverse=True))), robot.tasks)
            assert first.start.joints is not None
            home = robot.from_degrees(first.start.joints)
    return robot, home, notes


def _planned(space: Workspace, name: str, content: Content) -> str | None:
    """Text of a task file; None if the robot cannot do it, or collides on its way."""
    text, robot = tomli_w.dumps(content), space.robot
    try:
        motion = plan(load_task(robot.name, name, {name: text}), robot)
    except InputError:
        return None
    way, _, _ = motion(np.arange(0, motion.period, _LOOK))
    return text if all(space.is_free(pose) for pose in way) else None


def _joint_tasks(space: Workspace) -> dict[str, str]:
    """Those of the three tasks that the robot can do as motions of its joints."""
    best: dict[str, str] = {}
    middles = [] if space.home is None else [space.home]
    for middle in [*middles, *space.best(True, _TRIES)]:
        for size in _SHRINK:
            contents = joint_tasks(space, middle, size)
            if contents is None:
                continue
            texts = {name: _planned(space, name, one) for name, one in contents.items()}
            found = {name: text for name, text in texts.items() if text is not None}
            if len(found) > len(best):
                best = found
            if len(best) == len(contents):
                return best
    return best
