"""The robot of a report: a picture that everybody sees, and its motion where scripts run.

picture = robot_picture(robot, position, 0.004, shares={2: 1.0}, texts={2: "20 % more friction"})
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from faultgen.errors import InputError
from faultgen.report.scene import Scene
from faultgen.robot import Robot
from faultgen.viewing.painter import Painter
from faultgen.viewing.stage import FAULTY, NO_FAULT, Stage

_SIZE = 440  # width and height of the picture [pixels]
_RATE = 15.0  # poses in a second
_POSES = 25  # of a motion, of which one is shown where scripts do not run
_COLOURS = 96  # of the picture
_NOTHING = "nothing"
_ASIDE = ((8, -6), (-8, -6), (8, 6), (-8, 6))
"""Places of numbers beside their joints [% of the width of the picture]."""


@dataclass(frozen=True, kw_only=True)
class RobotPicture:
    """A robot whose links are coloured by the severities of their axes."""

    still: str
    """Address that contains the picture itself."""
    description: str
    """What is seen, in words."""
    rows: Sequence[Mapping[str, Any]]
    """Axis, colour and text of each axis."""
    marks: Sequence[Mapping[str, Any]]
    """Of each mark its axis, the place of its joint and that of its number [% of the width]."""
    id: str
    """Name of the shapes; pictures of the same robot share it."""
    shapes: Markup
    """The shapes as JSON that can stand within a script element of a page."""
    motion: Markup
    """What else the motion needs, likewise; empty if there is none."""


def robot_picture(
    robot: Robot,
    position: np.ndarray,
    period: float,
    *,
    shares: Mapping[int, float],
    texts: Mapping[int, str],
    marked: Collection[int] = (),
    moves: bool = True,
) -> RobotPicture | None:
    """Draw a robot.

    Args:
        robot: The robot.
        position: Joint positions, shape (samples, n_axes), in [rad], or [m] for slides.
        period: Time between the samples [s].
        shares: Severity of axes, from 0 to 1, where 1 is the largest one.
        texts: What is said of axes. Of the others, "nothing".
        marked: Axes that are meant. They get their number in the picture.
        moves: Whether the page shows the motion too.

    Returns:
        The picture; None if the robot has nothing that can be drawn.
    """
    try:
        scene = Scene(robot, position)
    except InputError:
        return None
    stage = scene.stage
    _pose_widely(stage, position, robot.n_axes)
    told = scene.told()
    of_axes = [float(shares.get(axis, 0.0)) for axis in range(1, robot.n_axes + 1)]
    stage.shade(of_axes)
    drawn = Painter(stage, _SIZE, _SIZE).draw()
    joints = [stage.model.joint(f"joint{axis}").id for axis in marked]
    places = 100 * stage.seen(stage.data.xanchor[joints].reshape(-1, 3))
    rows = [
        {"axis": axis, "colour": colour_of(share), "text": texts.get(axis, _NOTHING)}
        for axis, share in enumerate(of_axes, start=1)
    ]
    said = ", ".join(f"axis {one['axis']} {one['text']}" for one in rows)
    motion: dict[str, Any] = {}
    shapes = {name: told.pop(name) for name in ("shapes", "axes", "places", "colours")}
    text = _json(shapes)
    name = f"robot-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    if moves:
        motion = {
            **told,
            "scene": name,
            "poses": scene.poses(position, period, _RATE),
            "shares": dict(enumerate(of_axes, start=1)),
            "marked": list(marked),
            "aside": _ASIDE,
        }
    return RobotPicture(
        still=_png(drawn),
        description=f"The robot {robot.name}, its links coloured by severity: {said}.",
        rows=rows,
        marks=[
            {"axis": axis, "x": x, "y": y, "u": round(x + dx, 1), "v": round(y + dy, 1)}
            for axis, (x, y), (dx, dy) in zip(
                marked, places.round(1).tolist(), cycle(_ASIDE), strict=False
            )
        ],
        id=name,
        shapes=Markup(text),
        motion=Markup(_json(motion) if moves else ""),
    )


def _pose_widely(stage: Stage, position: np.ndarray, n_axes: int) -> None:
    """Put the robot into that pose of a motion in which its joints are spread most."""
    joints = [stage.model.joint(f"joint{axis}").id for axis in range(1, n_axes + 1)]

    def spread(row: int) -> float:
        stage.pose(position[row])
        return float(np.ptp(stage.seen(stage.data.xanchor[joints]), axis=0).sum())

    rows = np.linspace(0, len(position) - 1, _POSES).astype(int).tolist()
    stage.pose(position[max(rows, key=spread)])


def shapes_of(pictures: Sequence[RobotPicture | None]) -> dict[str, Markup]:
    """Collect the shapes that some pictures need, each once.

    Args:
        pictures: The pictures of a page.

    Returns:
        The shapes by name.
    """
    return {one.id: one.shapes for one in pictures if one is not None and one.motion}


def colour_of(share: float) -> str:
    """Return the colour of a severity.

    Args:
        share: From 0 for no fault to 1 for the largest severity.

    Returns:
        The colour as CSS takes it.
    """
    mixed = np.array(NO_FAULT) + np.clip(share, 0, 1) * (np.array(FAULTY) - np.array(NO_FAULT))
    return "#" + "".join(f"{round(255 * one):02x}" for one in mixed)


def _png(drawn: np.ndarray) -> str:
    buffer = io.BytesIO()
    Image.fromarray(drawn).quantize(_COLOURS).save(buffer, "png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _json(content: dict[str, Any]) -> str:
    return json.dumps(content, allow_nan=False).replace("<", "\\u003c")
