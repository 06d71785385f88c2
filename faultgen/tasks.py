"""Tasks: what a robot does in one cycle, as described in a TOML file.

A task is a start pose and a list of moves. Each move leads to a pose of the tool in the base frame,
and the last one ends at the start pose. `faultgen.simulation.motion` turns a task into a motion.

    task = load_task("irb6700", "spot_weld")
"""

from __future__ import annotations

import hashlib
import os
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from faultgen.errors import InputError, objection
from faultgen.system.reading import read_text

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]


class Pose(BaseModel):
    """A pose of the tool, or of the joints."""

    model_config = ConfigDict(extra="forbid")

    position: Vector | None = None
    """Tool position in the base frame [m]."""
    rpy: Vector | None = None
    """Tool roll, pitch, yaw about the base axes x, y, z [deg]."""
    near: list[float] | None = None
    """Joint positions from which inverse kinematics starts, [deg], or [m] for slides. Default:
    those of the previous pose."""
    joints: list[float] | None = None
    """Joint positions, [deg], or [m] for slides, which replace the pose of the tool."""


class Move(Pose):
    """A move to a pose, followed by a pause."""

    path: Literal["joint", "line", "spline", "sampled"] = "joint"
    """"joint" is a straight line in joint angles, "line" is a straight line of the tool, "spline"
    is a smooth curve of the tool through the poses `via`, and "sampled" is a recorded motion, which
    `samples` holds. It keeps its own timing and needs no pose."""
    samples: Annotated[list[list[float]], Field(min_length=4)] | None = None
    """Joint positions of a sampled path, [deg], or [m] for slides. The motion begins and ends at
    rest."""
    sample_period: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Time between the samples of a sampled path [s]."""
    via: list[Pose] = []
    """Poses of the tool that a spline passes through."""
    speed: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Fraction of the speed, acceleration and jerk limits."""
    tool_speed: Annotated[float, Field(gt=0)] | None = None
    """Upper limit of the tool's speed on a line or spline [m/s]."""
    duration: Annotated[float, Field(gt=0)] | None = None
    """Shortest duration of the move [s]."""
    dwell: Annotated[float, Field(ge=0)] = 0.0
    """Pause after the move [s]."""


class Task(BaseModel):
    """The content of a task file."""

    model_config = ConfigDict(extra="forbid")

    name: str
    """Name of the task."""
    robot: str
    """Name of the robot that does it."""
    description: str
    """What the robot does, in one sentence."""
    start: Pose
    """Pose in which a cycle begins and ends."""
    move: Annotated[list[Move], Field(min_length=1)]
    """Moves of a cycle, one after another."""

    @property
    def sha256(self) -> str:
        """Hash of the content."""
        # a move without samples has the hash that it had before there were sampled paths
        own = {"samples", "sample_period"}
        without = {k: own for k, move in enumerate(self.move) if move.samples is None}
        text = self.model_dump_json(exclude={"move": without} if without else None)
        return hashlib.sha256(text.encode()).hexdigest()


def task_names(robot: str, own: Mapping[str, str] = MappingProxyType({})) -> list[str]:
    """List the names of a robot's tasks.

    Args:
        robot: Name of the robot.
        own: Text of the tasks in the robot's folder, by name: `Robot.tasks`.

    Returns:
        The names of these tasks, and of those that come with a robot of this name.
    """
    folder = resources.files("faultgen.robots").joinpath(robot, "tasks")
    files = folder.iterdir() if folder.is_dir() else ()
    return sorted({*own, *(f.name[:-5] for f in files if f.name.endswith(".toml"))})


def task_text(robot: str, name: str, own: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return the text of one of a robot's tasks.

    Args:
        robot: Name of the robot.
        name: One of `task_names`.
        own: Text of the tasks in the robot's folder, by name: `Robot.tasks`.
    """
    if name in own:
        return own[name]
    return resources.files("faultgen.robots").joinpath(robot, "tasks", f"{name}.toml").read_text()


def load_task(
    robot: str, name_or_path: str | Path, own: Mapping[str, str] = MappingProxyType({})
) -> Task:
    """Load a task of a robot by its name, or from a TOML file.

    Args:
        robot: Name of the robot that the task is for.
        name_or_path: One of `task_names`, or the path of a task file.
        own: Text of the tasks in the robot's folder, by name: `Robot.tasks`.

    Returns:
        The task.

    Raises:
        InputError: There is no such task, or its file is wrong.
    """
    name = str(name_or_path)
    if name in task_names(robot, own):
        text = task_text(robot, name, own)
    else:
        path = Path(name_or_path)
        if not os.path.exists(path):
            known = ", ".join(task_names(robot, own)) or "none"
            raise InputError(
                f"unknown task '{name}' for robot {robot}: choose {known}, "
                "or give the path of a task file"
            )
        text, name = read_text(path, "task file"), path.stem
    try:
        return Task(**{"name": name, "robot": robot, **tomllib.loads(text)})
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"task file {name}: not valid TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"task file {name}: {where}: {objection(first['type'], first['msg'])}"
        ) from None
