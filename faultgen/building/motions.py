"""The three usual tasks for any arm, as the content of task files.

Each function makes one task out of a pose, and returns None where the arm does not reach what the
task needs there. Whether a task keeps all limits is found out by planning it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from faultgen.building.workspace import Place, Workspace
from faultgen.robot import Robot

Content = dict[str, Any]

_STROKE = 0.12  # way down to a part, over the reach
_RETRACT = 0.06  # way back from a panel, over the reach
_TURN = np.radians(75.0)  # of the first axis from one station to the other
_ROLL = np.radians(12.0)  # of the wrist along a seam
_SEAM_SPEED = 0.2  # tool speed on a seam, reaches a second
_STEPS = 8  # in which a line is followed


def listed(robot: Robot, pose: np.ndarray) -> list[float]:
    """Return joint positions as task files have them: in [deg], or [m] for slides.

    Args:
        robot: The robot.
        pose: Joint positions, shape (n_axes,), in [rad] or [m].
    """
    values = robot.to_degrees(pose)
    return [round(float(value), 5) for value in values]


def _tool(space: Workspace, place: Place) -> Content:
    """A pose of the tool."""
    return {
        "position": [round(float(x), 6) for x in place.point],
        "rpy": [round(float(x), 5) for x in place.turned.as_euler("xyz", degrees=True)],
        "near": listed(space.robot, place.pose),
    }


def _aimed(space: Workspace, pose: np.ndarray, goal: np.ndarray) -> Place | None:
    """A place close to a pose where the tool's z axis has a direction exactly."""
    place = space.place(pose)
    x = place.turned.as_matrix()[:, 0]
    x = x - (x @ goal) * goal
    if np.linalg.norm(x) < 0.1:
        return None
    x /= np.linalg.norm(x)
    turned = Rotation.from_matrix(np.stack([x, np.cross(goal, x), goal], axis=1))
    return space.at(place.point, turned, pose)


def _line(space: Workspace, start: Place, end: np.ndarray) -> Place | None:
    """The end of a straight line of the tool, followed step by step."""
    place: Place | None = start
    for s in np.linspace(0, 1, _STEPS + 1)[1:]:
        assert place is not None
        place = space.at(start.point + s * (end - start.point), start.turned, place.pose)
        if place is None:
            return None
    return place


def pick_and_place(space: Workspace, pose: np.ndarray) -> Content | None:
    """Move a load between two stations, and every axis between them.

    Args:
        space: What the arm reaches.
        pose: Joint positions close to the first station, shape (n_axes,).

    Returns:
        Content of the task file; None if the arm does not reach it.
    """
    first = _aimed(space, pose, space.down)
    second = None if first is None else _second_station(space, first)
    if first is None or second is None:
        return None
    moves: list[Content] = []
    stops = [first, second]
    for here, there in zip(stops, stops[::-1], strict=True):
        low = _line(space, here, here.point + _STROKE * space.reach * space.down)
        back = None if low is None else _line(space, low, here.point)
        between = space.far_from(here.pose, there.pose, 1)
        if low is None or back is None or not between:
            return None
        moves += [
            {**_tool(space, low), "path": "line", "speed": 0.4, "dwell": 0.3},
            {**_tool(space, back), "path": "line", "speed": 0.4},
            {"joints": listed(space.robot, between[0])},
            {"joints": listed(space.robot, there.pose)},
        ]
    return {
        "description": "Picks and places a load at two stations, and turns every axis in between",
        "start": {"joints": listed(space.robot, first.pose)},
        "move": moves,
    }


def _second_station(space: Workspace, first: Place) -> Place | None:
    """A place like the first one, with the first axis turned; else any other one."""
    for turn in (1, -1, 0.6, -0.6, 0.3, -0.3):
        pose = first.pose.copy()
        pose[0] += turn * _TURN
        if not space.is_safe(pose):
            continue
        place = space.place(pose)
        if place.turned.as_matrix()[:, 2] @ space.down > 0.999:
            return place
    for pose in space.best(downward=True, count=40):
        other = _aimed(space, pose, space.down)
        if other and np.linalg.norm(other.point - first.point) > 0.3 * space.reach:
            return other
    return None


@dataclass(frozen=True, eq=False)
class _Panel:
    """An upright panel in front of the arm."""

    middle: Place
    """Its middle, with the tool at right angles to it."""
    goal: np.ndarray
    """Direction towards the panel, shape (3,)."""
    along: np.ndarray
    """Horizontal direction along it."""
    up: np.ndarray
    """Direction upwards."""

    @classmethod
    def before(cls, space: Workspace, pose: np.ndarray) -> _Panel | None:
        """The panel at which the tool points in some pose; None if the arm does not reach it."""
        outward = space.outward(space.place(pose).point)
        middle = _aimed(space, pose, outward)
        if middle is None:
            return None
        return cls(
            middle, middle.turned.as_matrix()[:, 2], np.cross(space.down, outward), -space.down
        )

    def point(self, side: float, height: float) -> np.ndarray:
        """A point of the panel by its distances from the middle [m], shape (3,)."""
        return self.middle.point + side * self.along + height * self.up


def spot_weld(space: Workspace, pose: np.ndarray, size: float) -> Content | None:
    """Weld eight points in two rows, at full acceleration between stops.

    Args:
        space: What the arm reaches.
        pose: Joint positions close to the middle of the panel, shape (n_axes,).
        size: Half the width of the panel over the reach.

    Returns:
        Content of the task file; None if the arm does not reach it.
    """
    panel = _Panel.before(space, pose)
    if panel is None:
        return None
    half = size * space.reach
    start = _line(space, panel.middle, panel.middle.point - _RETRACT * space.reach * panel.goal)
    if start is None:
        return None
    here: Place = start
    moves: list[Content] = []
    rows = [[(x, 0.5) for x in (-1, -1 / 3, 1 / 3, 1)], [(x, -0.5) for x in (1, 1 / 3, -1 / 3, -1)]]
    for row in rows:
        for x, y in row:
            there = space.at(panel.point(half * x, half * y), panel.middle.turned, here.pose)
            if there is None or not space.is_clear(here.pose, there.pose):
                return None
            moves.append({**_tool(space, there), "dwell": 0.35})
            here = there
        away = space.at(here.point - _RETRACT * space.reach * panel.goal, here.turned, here.pose)
        if away is None:
            return None
        moves.append(_tool(space, away))
        here = away
    moves.append({"joints": listed(space.robot, start.pose)})
    return {
        "description": "Welds eight points of an upright panel, full acceleration between stops",
        "start": {"joints": listed(space.robot, start.pose)},
        "move": moves,
    }


def arc_weld(space: Workspace, pose: np.ndarray, size: float) -> Content | None:
    """Weld a closed seam at constant speed; the wrist turns on the way.

    Args:
        space: What the arm reaches.
        pose: Joint positions close to the middle of the seam, shape (n_axes,).
        size: Half the width of the seam over the reach.

    Returns:
        Content of the task file; None if the arm does not reach it.
    """
    panel = _Panel.before(space, pose)
    if panel is None:
        return None
    half = size * space.reach
    places = []
    here = panel.middle
    for angle in np.linspace(0, 2 * np.pi, 9):
        side, height = np.cos(angle), 0.6 * np.sin(angle)
        turned = Rotation.from_rotvec(_ROLL * side * panel.up) * panel.middle.turned
        turned = Rotation.from_rotvec(_ROLL * height * panel.along) * turned
        there = space.at(panel.point(half * side, half * height), turned, here.pose)
        if there is None or not space.is_clear(here.pose, there.pose):
            return None
        places.append(there)
        here = there
    first, last = places[0], places[-1]
    start = _line(space, first, first.point - _RETRACT * space.reach * panel.goal)
    if start is None:
        return None
    speed = round(_SEAM_SPEED * space.reach, 4)
    via = [
        {key: value for key, value in _tool(space, place).items() if key != "near"}
        for place in places[1:-1]
    ]
    moves = [
        {**_tool(space, first), "path": "line", "tool_speed": speed, "dwell": 0.2},
        {**_tool(space, last), "path": "spline", "via": via, "tool_speed": speed, "dwell": 0.2},
        {"joints": listed(space.robot, start.pose)},
    ]
    return {
        "description": "Welds a closed seam at constant speed, the wrist turning on the way",
        "start": {"joints": listed(space.robot, start.pose)},
        "move": moves,
    }
