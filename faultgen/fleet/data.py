"""The data that a fleet's monitoring has stored, and how to read its files."""

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
"""Arrays of a robot's file that a monitoring system would store. All other arrays are in the group
``truth``."""


@dataclass(frozen=True, eq=False)
class FleetRobot:
    """The record of one robot of a fleet, as its monitoring stores it."""

    name: str
    """Name of the robot in the fleet."""
    robot: str
    """Name of its model, for `faultgen.load_robot`."""
    failed: bool
    """Whether it fails at the end of the last day."""
    axis: int
    """Axis of the gearbox that fails, from 1; 0 if none fails."""
    day: np.ndarray
    """Time of each sample since the start of the record [d], shape (samples,)."""
    production: np.ndarray
    """Share of the time since the previous sample in which the robot ran, shape (samples,)."""
    torque_histogram: np.ndarray
    """Share of production time by motor torque, shape (samples, n_axes, 12)."""
    speed_histogram: np.ndarray
    """Share of production time by motor speed, shape (samples, n_axes, 12)."""
    angle_histogram: np.ndarray
    """Share of production time by joint angle, shape (samples, n_axes, 12)."""
    torque_indicator: np.ndarray
    """Mean motor torque in production time, weighted by speed with the exponent 10/3, multiplied by
    the share of production to the power of 0.3 [N m]; shape (samples, n_axes)."""
    speed_indicator: np.ndarray
    """Mean |motor speed| over all time [rad/s], shape (samples, n_axes)."""
    temperature: np.ndarray
    """Temperature of the controller's cabinet [deg C], shape (samples,)."""
    events: np.ndarray
    """Number of events of each kind on each day, shape (days, events)."""
    truth: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Arrays that a monitoring system cannot know, by name; docs/fleet.md lists them."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """The robots of a fleet, and what their records have in common."""

    robots: tuple[FleetRobot, ...]
    """The robots, sorted by name."""
    event_names: tuple[str, ...]
    """Names of the columns of `FleetRobot.events`."""
    days: int
    """Number of recorded days. A robot that fails does so at the end of the last day."""
    seed: int
    """Seed of all random numbers."""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    """Further attributes of the files, such as the versions and the hash of the plan."""


def read_robot(path: Path) -> tuple[FleetRobot, dict[str, Any]]:
    """Read the file of one robot.

    Args:
        path: The file.

    Returns:
        The robot, and the attributes of the file that all robots of the fleet share.

    Raises:
        InputError: The file is not the record of a robot, or is damaged.
    """
    arrays, told = read_arrays(path)
    try:
        stored: dict[str, Any] = {name: arrays.pop(name) for name in STORED}
        truth = {name.removeprefix("truth/"): values for name, values in arrays.items()}
        own: dict[str, Any] = {name: told.pop(name) for name in ("name", "robot", "failed", "axis")}
        return FleetRobot(**own, **stored, truth=truth), told
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: is not the record of a robot (it has no {error})") from None


def open_fleet(folder: str | Path) -> Fleet:
    """Read a fleet.

    Args:
        folder: Folder that `generate_fleet` wrote.

    Returns:
        The fleet.

    Raises:
        InputError: The folder has no fleet, robots are missing, robots have different plans, or a
            file is damaged.
    """
    folder = Path(folder)
    paths = sorted((folder / "robots").glob("robot*.h5"))
    if not paths:
        raise InputError(
            f"{folder}: is not a fleet; make one with 'faultgen fleet FLEET.toml -o {folder}'"
        )
    read = [read_robot(path) for path in paths]
    told = read[0][1]
    if len(read) != told["robots"]:
        raise InputError(
            f"{folder}: only {len(read)} of {told['robots']} robots are there; "
            "run 'faultgen fleet' again to make the others"
        )
    if len({one["plan_sha256"] for _, one in read}) > 1:
        raise InputError(
            f"{folder}: its robots were made from different plans; make the fleet again in a new "
            "folder"
        )
    names = tuple(str(told.pop("event_names")).split())
    return Fleet(
        robots=tuple(robot for robot, _ in read),
        event_names=names,
        days=int(told.pop("days")),
        seed=int(told.pop("seed")),
        attributes=told,
    )
