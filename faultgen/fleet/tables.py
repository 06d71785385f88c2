"""Fleets as tables, with fixed training and test robots, and in the layout of N-CMAPSS.

N-CMAPSS is a public set of simulated jet engines that run to failure (Arias Chao et al., Data 6(1),
5, 2021, https://doi.org/10.3390/data6010005). Programs that read its files also read those that
`write_ncmapss` writes: arrays W (working conditions), X_s (sensors), X_v (virtual sensors), T
(health parameters), A (unit, cycle, class, state) and Y (remaining useful life), each with the
endings _dev (training units), _test (test units) and, for all but Y, _var (names of the columns).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from faultgen.dataset.splits import TEST, TRAIN, drawn
from faultgen.errors import InputError
from faultgen.system.files import publish, temporary_name
from faultgen.system.hdf5 import new_hdf5

if TYPE_CHECKING:
    import pandas as pd

FLEET_ARRAYS = {
    "day": ("d", "time since the start of the record"),
    "production": ("1", "share of the time since the previous sample in which the robot ran"),
    "torque_histogram": ("1", "share of production time by motor torque"),
    "speed_histogram": ("1", "share of production time by motor speed"),
    "angle_histogram": ("1", "share of production time by joint angle"),
    "torque_indicator": ("N m", "mean torque weighted by speed, times production to the power 0.3"),
    "speed_indicator": ("rad/s", "mean |motor speed| over all time"),
    "temperature": ("degC", "temperature of the controller's cabinet"),
    "events": ("1", "number of events of each kind on each day"),
    "truth/gearbox_temperature": ("degC", "temperature of each gearbox"),
    "truth/damage": ("1", "damage of the gearbox that fails or ages; 1 at failure"),
    "truth/shown_damage": ("1", "damage as it shows on that day"),
    "truth/remaining_life": ("d", "time until the gearbox fails"),
    "truth/mix": ("1", "share of each program on that day"),
    "truth/payload": ("1", "payload over that of the model"),
    "truth/friction": ("1", "relative change of friction by lubricant and service"),
    "truth/services": ("d", "days of services"),
    "truth/changes": ("d", "days on which the shares of the programs change"),
    "truth/damaged_axis": ("1", "axis of the gearbox that fails or ages, from 1; 0: none"),
    "truth/severity_at_failure": ("1, rad, N m", "gain of friction, backlash and torque ripple"),
}
"""SI unit and meaning of every array of a robot's file."""

_FEATURES = (
    "torque_indicator",
    "speed_indicator",
    "torque_histogram",
    "speed_histogram",
    "angle_histogram",
)
_BY_SAMPLE = ("damage", "shown_damage", "remaining_life")


Recorded: TypeAlias = Any
"""A `faultgen.fleet.FleetRobot`, whose module imports this one."""


def divide(fails: Sequence[bool], seed: int) -> list[str]:
    """Draw the robots of the training part and of the test part.

    About 30 % of the robots that fail, and of those that do not, become test robots.

    Args:
        fails: Whether each robot fails.
        seed: Seed of the fleet.

    Returns:
        "train" or "test" for each robot.
    """
    rng = np.random.default_rng([seed, *b"split"])
    parts = [TRAIN] * len(fails)
    for kind in (True, False):
        for number in drawn([number for number, one in enumerate(fails) if one == kind], rng):
            parts[number] = TEST
    return parts


def samples_table(robots: Sequence[Recorded]) -> pd.DataFrame:
    """Make a table with one row for each sample of every robot.

    Args:
        robots: The robots of a fleet.

    Returns:
        The table. ``frame.attrs`` has the ``units`` of the columns and the names of the
        ``features``.
    """
    import pandas as pd  # takes a while, and most commands need none

    units: dict[str, str] = {"axis": "1", "damaged_axis": "1"}
    tables = []
    features: dict[str, None] = {}
    for one in robots:
        count = len(one.day)
        columns: dict[str, object] = {
            "unit": np.repeat(one.name, count),
            "robot": np.repeat(one.robot, count),
            "failed": np.repeat(one.failed, count),
            "axis": np.repeat(one.axis, count),
            "split": np.repeat(one.split, count),
        }
        if "damaged_axis" in one.truth:
            columns["damaged_axis"] = np.repeat(one.truth["damaged_axis"], count)
        columns |= {name: one.truth[name] for name in _BY_SAMPLE if name in one.truth}
        columns["day"] = one.day
        for name in ("production", "temperature", *_FEATURES):
            values = getattr(one, name)
            for place in np.ndindex(values.shape[1:]):
                column = "_".join([name, *(str(number + 1) for number in place)])
                columns[column] = values[(slice(None), *place)]
                units[column] = FLEET_ARRAYS[name][0]
                features[column] = None
        tables.append(pd.DataFrame(columns))
    frame = pd.concat(tables, ignore_index=True)
    units |= {name: FLEET_ARRAYS[f"truth/{name}"][0] for name in _BY_SAMPLE}
    units["day"] = FLEET_ARRAYS["day"][0]
    frame.attrs["units"] = {name: units[name] for name in frame if name in units}
    frame.attrs["features"] = list(features)
    return frame


def samples_and_labels(
    frame: pd.DataFrame, split: str | None, label: str
) -> tuple[pd.DataFrame, np.ndarray, np.ndarray]:
    """Take features, labels and groups out of a table of samples.

    Args:
        frame: Table from `samples_table`.
        split: "train" or "test"; None for all robots.
        label: Name of a column.

    Returns:
        Features, shape (samples, columns); labels, shape (samples,), in the unit of the column; and
        the name of the robot, shape (samples,), by which cross-validation must divide.

    Raises:
        InputError: There is no such part or column.
    """
    if split not in (None, TRAIN, TEST):
        raise InputError(f"split: must be '{TRAIN}' or '{TEST}', not '{split}'")
    if label not in frame:
        known = [str(name) for name in frame if name not in frame.attrs["features"]]
        raise InputError(f"label: there is no '{label}': choose {', '.join(known)}")
    rows = np.ones(len(frame), bool) if split is None else (frame["split"] == split).to_numpy()
    x = frame.loc[rows, frame.attrs["features"]].reset_index(drop=True)
    return x, frame[label].to_numpy()[rows], frame["unit"].to_numpy()[rows]


HEALTHY_BELOW = 0.1
"""Damage below which the health state of N-CMAPSS is 1: assumed."""


def ncmapss_arrays(robots: Sequence[Recorded]) -> dict[str, np.ndarray]:
    """Arrange the robots that run to failure in the layout of N-CMAPSS.

    Args:
        robots: The robots of a fleet. Those that do not fail are left out.

    Returns:
        Arrays by name. W, X_s, X_v, T and A have shape (samples, columns), Y has shape
        (samples, 1), in [d]; the units of the columns are in their names.

    Raises:
        InputError: No robot fails in one of the two parts, or the robots have different numbers of
            axes.
    """
    failing = [(number, one) for number, one in enumerate(robots, start=1) if one.failed]
    axes = {one.torque_indicator.shape[1] for _, one in failing}
    if len(axes) > 1:
        raise InputError("fleet: its robots have different numbers of axes, which one table cannot")
    models = sorted({one.robot for _, one in failing})
    found: dict[str, np.ndarray] = {}
    names: dict[str, list[str]] = {}
    for part, ending in ((TRAIN, "dev"), (TEST, "test")):
        here = [(number, one) for number, one in failing if one.split == part]
        if not here:
            raise InputError(
                f"fleet: no robot of its {part} part fails; make a fleet with at least two robots "
                "that fail"
            )
        parts = [_unit(number, one, models.index(one.robot) + 1) for number, one in here]
        for group in parts[0]:
            found[f"{group}_{ending}"] = np.vstack(
                [np.column_stack(list(columns[group].values())) for columns in parts]
            )
            names[group] = list(parts[0][group])
    for group, columns in names.items():
        if group != "Y":
            found[f"{group}_var"] = np.array([name.encode() for name in columns])
    return found


def _unit(number: int, one: Recorded, kind: int) -> dict[str, dict[str, np.ndarray]]:
    """Columns of one robot by group and name."""
    n_axes = one.torque_indicator.shape[1]
    damage = one.truth["damage"]
    axis = int(one.truth["damaged_axis"][0])

    def by_axis(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
        return {f"{name}_{k + 1}": values[:, k] for k in range(n_axes)}

    torque = by_axis("torque_indicator", one.torque_indicator)
    histograms = one.torque_histogram
    shares = {
        f"torque_histogram_{k + 1}_{b + 1}": histograms[:, k, b]
        for k in range(n_axes)
        for b in range(histograms.shape[2])
    }
    speed = by_axis("speed_indicator", one.speed_indicator)
    worn = np.zeros((len(damage), n_axes))
    worn[:, axis - 1] = damage
    return {
        "W": {"production": one.production, "cabinet_temperature": one.temperature},
        "X_s": {**torque, **speed, **shares},
        "X_v": by_axis("gearbox_temperature", one.truth["gearbox_temperature"]),
        "T": by_axis("damage", worn),
        "A": {
            "unit": np.full(len(damage), float(number)),
            # a sample that ends at midnight belongs to the day before
            "cycle": np.ceil(one.day),
            "Fc": np.full(len(damage), float(kind)),
            "hs": (damage < HEALTHY_BELOW).astype(float),
        },
        "Y": {"RUL": one.truth["remaining_life"]},
    }


def write_ncmapss(robots: Sequence[Recorded], path: Path) -> dict[str, np.ndarray]:
    """Write run-to-failure data in the layout of N-CMAPSS, with a checksum beside the file.

    Args:
        robots: The robots of a fleet.
        path: The HDF5 file. Its folder is created if it does not exist.

    Returns:
        The arrays that were written, with the shapes of `ncmapss_arrays`.

    Raises:
        InputError: As `ncmapss_arrays`.
        StorageFailed: The file cannot be written, or does not hold what was written.
    """
    arrays = ncmapss_arrays(robots)
    path.parent.mkdir(parents=True, exist_ok=True)
    with new_hdf5(path) as (file, sink):
        for name, values in arrays.items():
            file[name] = values
    publish(temporary_name(path), path, sink.checksum)
    return arrays
