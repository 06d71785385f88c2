"""The three usual tasks in joint positions, for arms that cannot bring a tool into every pose."""

from __future__ import annotations

import numpy as np

from faultgen.building.motions import Content, listed
from faultgen.building.workspace import Workspace

_LARGEST = (np.radians(60.0), 0.4)  # change of a hinge [rad], and of a slide [m]
_SHARE = 0.35  # of the range of a joint
_POINTS = 8  # weld points


def joint_tasks(space: Workspace, middle: np.ndarray, size: float) -> dict[str, Content] | None:
    """Make the tasks about a pose.

    Args:
        space: What the arm reaches.
        middle: Joint positions in the middle of the motions, shape (n_axes,).
        size: Factor of all changes.

    Returns:
        Content of the task files by name; None if the arm would touch the floor.
    """
    robot = space.robot
    low, high = robot.joint_range.T
    room = np.minimum(middle - low, high - middle)
    most = np.where(robot.slides, _LARGEST[1], _LARGEST[0])
    change = size * np.minimum(np.minimum(_SHARE * space.span, most), 0.95 * room)
    axes = np.arange(robot.n_axes)
    signs = np.where(axes % 2, -1.0, 1.0)
    stroke = np.where(axes == min(1, len(axes) - 1), 0.3, 0.1)  # mostly of one axis
    slides = np.flatnonzero(robot.slides)
    if len(slides):
        stroke = np.where(axes == slides[-1], 0.3, 0.0)
    stations = [middle + change * signs * 0.7, middle - change * signs * 0.7]
    between = [middle + change, middle - change]
    first: list[tuple[np.ndarray, Content]] = []
    for k, station in enumerate(stations):
        inward = station - np.sign(station - middle) * change * stroke
        first += [
            (inward, {"speed": 0.4, "dwell": 0.3}),
            (station, {"speed": 0.4}),
            (between[k], {}),
            (stations[1 - k], {}),
        ]
    angles = 2 * np.pi * np.arange(_POINTS) / _POINTS
    points = [middle + 0.4 * change * np.cos(a * (1 + axes % 2) + axes) for a in angles]
    second: list[tuple[np.ndarray, Content]] = [
        (point, {"dwell": 0.35}) for point in [*points[1:], points[0]]
    ]
    third: list[tuple[np.ndarray, Content]] = [
        (middle + 0.8 * change * np.cos(a * (1 + axes % 2) + axes), {"speed": 0.25})
        for a in [*angles[2::2], angles[0]]
    ]
    whats = {
        "pick_and_place": (first, "Joint moves between two stations, through much of the range"),
        "spot_weld": (second, "Eight points near each other, full acceleration between stops"),
        "arc_weld": (third, "A slow closed path in joint positions"),
    }
    found = {}
    for name, (moves, what) in whats.items():
        here = moves[-1][0]
        for there, _ in moves:
            if not space.is_clear(here, there):
                return None
            here = there
        found[name] = {
            "description": what,
            "start": {"joints": listed(robot, moves[-1][0])},
            "move": [{"joints": listed(robot, pose), **more} for pose, more in moves],
        }
    return found
