"""What a fleet's monitoring has stored, and the files that hold it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.system.arrays import read_arrays

STORED = (
    "day",
    "production",
    "torque_histogram",
    "speed_histogram",
    "angle_histogram",
    "torque_indicator",
    "speed_indicator",
    "temperature",
    "events",
)
"""Arrays of a robot's file that a monitoring system has; the others are in the group ``truth``."""


@dataclass(frozen=True, eq=False)
class FleetRobot:
    """One robot of a fleet, as its monitoring sees it."""

    name: str
    """In the fleet."""
    robot: str
    """Model, as of `faultgen.load_robot`."""
    failed: bool
    """Whether it fails at the end of the last day."""
    axis: int
    """Axis of the gearbox that fails, from 1; 0 where none does."""
    day: np.ndarray
    """Time of each sample since the start of the record [d], shape (samples,)."""
    production: np.ndarray
    """Share of the time since the sample before in which the robot ran, shape (samples,)."""
    torque_histogram: np.ndarray
    """Share of production time by motor torque, shape (samples, n_axes, 12)."""
    speed_histogram: np.ndarray
    """The same by motor speed."""
    angle_histogram: np.ndarray
    """The same by joint angle."""
    torque_indicator: np.ndarray
    """Torque weighted by speed with the exponent 10/3, over production, times the share of
    production to the power 0.3 [N m]; shape (samples, n_axes)."""
    speed_indicator: np.ndarray
    """Mean |motor speed| over all time [rad/s], shape (samples, n_axes)."""
    temperature: np.ndarray
    """Of the controller's cabinet [deg C], shape (samples,)."""
    events: np.ndarray
    """Number of each event on each day, shape (days, events)."""
    truth: Mapping[str, np.ndarray] = field(default_factory=dict)
    """What no monitoring knows: see docs/fleet.md."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """Robots, and what their records have in common."""

    robots: tuple[FleetRobot, ...]
    """By name."""
    event_names: tuple[str, ...]
    """Of the columns of `FleetRobot.events`."""
    days: int
    """Recorded; a robot that fails does so at the end of the last."""
    seed: int
    """Root of all draws."""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    """Of the files: versions, hash of the plan."""


def read_robot(path: Path) -> tuple[FleetRobot, dict[str, Any]]:
    """Read the file of one robot, and its attributes.

    Raises:
        InputError: It is no such file, or damaged.
    """
    arrays, told = read_arrays(path)
    try:
        stored: dict[str, Any] = {name: arrays.pop(name) for name in STORED}
        truth = {name.removeprefix("truth/"): values for name, values in arrays.items()}
        own: dict[str, Any] = {name: told.pop(name) for name in ("name", "robot", "failed", "axis")}
        return FleetRobot(**own, **stored, truth=truth), told
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: not the record of a robot (no {error})") from None


def open_fleet(folder: str | Path) -> Fleet:
    """Read a fleet.

    Args:
        folder: Where `generate_fleet` wrote it.

    Raises:
        InputError: There is no fleet, one that is not complete, or a damaged file.
    """
    folder = Path(folder)
    paths = sorted((folder / "robots").glob("robot*.h5"))
    if not paths:
        raise InputError(f"{folder}: no fleet here; make one with 'faultgen fleet FLEET.toml -o'")
    read = [read_robot(path) for path in paths]
    told = read[0][1]
    if len(read) != told["robots"]:
        raise InputError(
            f"{folder}: {len(read)} of {told['robots']} robots are there; "
            "run 'faultgen fleet' again"
        )
    if len({one["plan_sha256"] for _, one in read}) > 1:
        raise InputError(f"{folder}: its robots are of different plans; make the fleet anew")
    names = tuple(str(told.pop("event_names")).split())
    return Fleet(
        robots=tuple(robot for robot, _ in read),
        event_names=names,
        days=int(told.pop("days")),
        seed=int(told.pop("seed")),
        attributes=told,
    )
