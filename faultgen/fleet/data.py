"""What a fleet's monitoring has stored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.dataset import plain_value
from faultgen.errors import InputError


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
    truth: dict[str, np.ndarray]
    """What no monitoring knows; methods do not use it."""


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
    attributes: dict[str, Any]
    """Of the files."""


def open_fleet(folder: str | Path) -> Fleet:
    """Read a fleet: a file ``robots/robot*.h5`` for each robot.

    Raises:
        InputError: There is no fleet, or a damaged file.
    """
    paths = sorted((Path(folder) / "robots").glob("robot*.h5"))
    if not paths:
        raise InputError(f"{folder}: no fleet here")
    robots, told = [], {}
    for path in paths:
        try:
            with h5py.File(path, "r") as file:
                told = {name: plain_value(value) for name, value in file.attrs.items()}
                own = {name: told.pop(name) for name in ("name", "robot", "failed", "axis")}
                arrays = {k: v[()] for k, v in file.items() if isinstance(v, h5py.Dataset)}
                truth = {name: value[()] for name, value in file["truth"].items()}
                robots.append(FleetRobot(**own, **arrays, truth=truth))
        except (OSError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not the record of a robot ({error})") from None
    return Fleet(
        robots=tuple(robots),
        event_names=tuple(str(told.pop("event_names")).split()),
        days=int(told.pop("days")),
        seed=int(told.pop("seed")),
        attributes=told,
    )
