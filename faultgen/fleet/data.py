"""The data that a fleet's monitoring has stored, and how to read its files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultgen.dataset.manifest import FLEET as PLAN
from faultgen.errors import InputError
from faultgen.fleet.tables import samples_and_labels, samples_table, write_ncmapss
from faultgen.system.arrays import read_arrays

if TYPE_CHECKING:
    import pandas as pd

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
    split: str = "train"
    """Fixed part of the fleet to which the robot belongs, "train" or "test"."""


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

    def __repr__(self) -> str:
        """One line; the arrays would fill the screen."""
        failed = sum(robot.failed for robot in self.robots)
        return f"<Fleet of {len(self.robots)} robots, {failed} of which fail, {self.days} days>"

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table with one row for each sample of every robot.

        Its first columns are labels: the robot (``unit``), its model, whether it fails, its part
        (``split``), the damage and the remaining life [d]. The others are what the monitoring
        stores, one column for each axis, or for each axis and bin.

        Returns:
            The table. ``frame.attrs["units"]`` has the SI unit of each column.
        """
        return samples_table(self.robots)

    def to_xy(
        self, *, split: str | None = None, label: str = "remaining_life"
    ) -> tuple[pd.DataFrame, np.ndarray, np.ndarray]:
        """Return features and labels as scikit-learn wants them.

        Args:
            split: "train" or "test" for one part of the robots; by default all.
            label: Name of a column of `to_dataframe`, such as "remaining_life" or "failed".

        Returns:
            Features, shape (samples, columns); labels, shape (samples,), in the unit of the column;
            and the names of the robots, shape (samples,), by which cross-validation must divide.

        Raises:
            InputError: There is no such part or label.
        """
        return samples_and_labels(self.to_dataframe(), split, label)

    def to_parquet(self, path: str | Path) -> None:
        """Write the table of `to_dataframe` to a Parquet file.

        Args:
            path: The file.

        Raises:
            InputError: pyarrow is not installed.
            StorageFailed: The file cannot be written.
        """
        from faultgen.system.tables import write_parquet

        write_parquet(self.to_dataframe(), Path(path))

    def to_ncmapss(self, path: str | Path) -> None:
        """Write the robots that fail as run-to-failure data in the layout of N-CMAPSS.

        Args:
            path: The HDF5 file.

        Raises:
            InputError: No robot fails in one of the two parts.
            StorageFailed: The file cannot be written.
        """
        write_ncmapss(self.robots, Path(path))


def fleet_state(folder: Path) -> list[dict[str, Any]]:
    """Read every file of a fleet, and say whether it is intact.

    Args:
        folder: Folder of the fleet.

    Returns:
        One row for each planned robot: its name, and its state, "ok", "missing" or the damage; of
        an intact one also what it is.

    Raises:
        InputError: The plan cannot be read.
    """
    try:
        count = int(json.loads((folder / PLAN).read_bytes())["robots"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{folder / PLAN}: damaged ({' '.join(str(error).split())})") from None
    rows: list[dict[str, Any]] = []
    for number in range(1, count + 1):
        row: dict[str, Any] = dict.fromkeys(
            ("name", "robot", "failed", "axis", "split", "samples"), ""
        )
        row["name"] = f"robot{number:03d}"
        path = folder / "robots" / f"{row['name']}.h5"
        try:
            one = read_robot(path)[0] if path.is_file() else None
            row["state"] = "missing" if one is None else "ok"
            if one is not None:
                row |= {"robot": one.robot, "failed": one.failed, "axis": one.axis}
                row |= {"split": one.split, "samples": len(one.day)}
        except InputError as error:
            row["state"] = str(error)
        rows.append(row)
    return rows


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
        own["split"] = told.pop("split", "train")  # files of older versions have none
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
