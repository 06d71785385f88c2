"""Runs as tables: one row for each run or cycle, and the arrays of a run for xarray.

These functions need nothing but open run files, so that reading does not need the simulator.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import h5py
import numpy as np
import pandas as pd

from faultgen.dataset.interpolation_error import BOUNDS, interpolation_error
from faultgen.dataset.splits import UNUSED, RunParts, robot_instance
from faultgen.errors import InputError
from faultgen.provenance import Provenance
from faultgen.system.tables import optional

if TYPE_CHECKING:
    import xarray as xr


class OpenRun(Protocol):
    """What is asked of a run: its id, its attributes, and its arrays."""

    @property
    def id(self) -> str:
        """Id of the run."""

    @property
    def path(self) -> Path:
        """The file that holds it."""

    @property
    def attributes(self) -> dict[str, Any]:
        """Its attributes."""

    def open(self) -> AbstractContextManager[h5py.Group]:
        """Open it for reading."""


TEMPERATURE = "temperature"

INDEX = {
    "run": ("", "id of the run"),
    "robot": ("", "name of the robot"),
    "task": ("", "name of the task"),
    "effect": ("", "effect that acts on the run's axes, or 'healthy'"),
    "axis": ("1", "first faulty axis, from 1; 0: none"),
    "axes": ("", "all faulty axes, joined by +"),
    "severity": ("as in severity_units", "severity in the last cycle"),
    "severity_units": ("", "unit of the severity; 1: fraction of the nominal value"),
    "beside": ("", "JSON: further effects in the run"),
    "parameters": ("", "JSON: parameters of the effect that differ from their defaults"),
    "schedule": ("", "wear schedule"),
    "cycles": ("1", "number of cycles"),
    "sensors": ("", "preset of the sensors"),
    "seed": ("1", "seed of the run"),
    "sample_period": ("s", "time between samples"),
    "speed": ("1", "speed override; 1: as programmed"),
    "payload_mass": ("kg", "mass of the payload; nan if the model has none"),
    "mean_temperature": ("degC", "mean temperature of the gearboxes"),
    "fidelity": ("", "stepped, or interpolated between simulated cycles"),
    "interpolation_error": ("1", "bound of the RMS torque error of a run's axis, over its noise"),
    "interpolation_error_cycle": ("1", "the same for the RMS error of any single cycle"),
    "interpolation_error_sample": ("1", "the same for the error of any single sample"),
    "faultgen_version": ("", "version of faultgen that made the run"),
    "mujoco_version": ("", "version of MuJoCo that made the run"),
    "code_sha256": ("", "hash of the code that made the run"),
    "file_sha256": ("", "checksum of the run's own file"),
}
"""Unit and meaning of the columns of the table of runs. Texts have no unit."""

_OPERATION = ("speed", "payload_mass", "mean_temperature")
_KEPT = ("run", "robot", "task", "effect", "axis", "axes", "severity_units", "seed", *_OPERATION)


def runs_table(runs: Iterable[OpenRun], splits: RunParts) -> pd.DataFrame:
    """Make a table with one row for each run.

    Args:
        runs: The runs.
        splits: Ids of the runs of each part, by division.

    Returns:
        Parameters of the runs, and in the columns ``split_...`` their part in each division.
    """
    part_of = _parts(splits)
    return pd.DataFrame([_run_row(run, part_of) for run in runs])


def _parts(splits: RunParts) -> dict[str, dict[str, str]]:
    """The part of each run in each division, by name of the column and id."""
    return {
        f"split_{scheme}": {i: part for part, ids in parts.items() for i in ids}
        for scheme, parts in splits.items()
    }


def _run_row(run: OpenRun, part_of: dict[str, dict[str, str]]) -> dict[str, Any]:
    told = run.attributes
    schedule = told["schedule"]
    return {
        "run": run.id,
        "robot": told["robot"],
        "task": told["task"],
        "effect": told["effect"],
        "axis": int(told["axis"]),
        "axes": "+".join(map(str, told["axes"])),
        "severity": float(told["severity"]),
        "severity_units": told["severity_units"],
        "beside": told["beside"],
        "parameters": told["parameters"],
        "schedule": schedule if isinstance(schedule, str) else "list",
        "cycles": int(told["cycles"]),
        "sensors": told["sensors"],
        "seed": int(told["seed"]),
        "sample_period": float(told["sample_period"]),
        "speed": float(told.get("speed", 1.0)),
        "payload_mass": float(told.get("payload_mass", np.nan)),
        "mean_temperature": float(told.get("mean_temperature", np.nan)),
        "fidelity": told.get("fidelity", "stepped"),
        **{name: interpolation_error(told, of) for of, name in BOUNDS.items()},
        **asdict(Provenance.of(told)),
        **{column: parts.get(run.id, UNUSED) for column, parts in part_of.items()},
    }


def cycles_table(
    runs: Sequence[OpenRun], splits: RunParts, features: str | Sequence[str] | None, where: str
) -> pd.DataFrame:
    """Make a table with one row for each cycle; see `Dataset.to_dataframe`.

    Args:
        runs: The runs.
        splits: Ids of the runs of each part, by division.
        features: Names of arrays under ``/monitoring``, or "temperature"; None for all. One name
            need not be in a list.
        where: Place of the dataset, for messages.

    Returns:
        The table, with the units of its columns and the names of the features in ``attrs``.

    Raises:
        InputError: There is no such feature, or there are no runs.
    """
    if not runs:
        raise InputError(f"{where}: no runs in it; finish it with faultgen generate")
    if isinstance(features, str):
        features = [features]
    units: dict[str, str] = {"axis": "1", "seed": "1", "cycle": "1", TEMPERATURE: "degC"}
    units |= {name: INDEX[name][0] for name in _OPERATION}
    parts = _parts(splits)
    labels, values, axes = [], [], []
    severity_units = set()
    for run in runs:
        with run.open() as group:
            row = _run_row(run, parts)
            count = int(row["cycles"])
            severity_units.add(row["severity_units"])
            columns: dict[str, Any] = {name: np.repeat(row[name], count) for name in _KEPT}
            columns |= {k: np.repeat(v, count) for k, v in row.items() if k.startswith("split_")}
            columns["robot_instance"] = np.repeat(robot_instance(run.attributes), count)
            columns["cycle"] = group["cycle/index"][()]
            columns["severity"] = group["cycle/severity"][()]
            columns[TEMPERATURE] = group["cycle/temperature"][()]
            for effect, array in group.get("cycle/fault_severity", {}).items():
                columns |= _by_axis(f"fault_severity_{effect}", array, units)
            labels.append(pd.DataFrame(columns))
            values.append(pd.DataFrame(_features(group, features, where, units)))
            axes.append(np.full(count, len(group["axis"])))
    units["severity"] = " or ".join(sorted(severity_units))
    left = pd.concat(labels, ignore_index=True)
    n_axes = np.concatenate(axes)
    for name in [name for name in left if name.startswith("fault_severity_")]:
        # a run that does not have the fault has none of it, on every axis of its robot
        has = n_axes >= int(name.rpartition("_")[2])
        left[name] = left[name].where(~(has & left[name].isna()), 0.0)
    right = pd.concat(values, ignore_index=True)
    frame = pd.concat([left, right], axis=1)
    frame.attrs["units"] = {name: units[name] for name in frame if name in units}
    warm = [TEMPERATURE] if features is None or TEMPERATURE in features else []
    frame.attrs["features"] = [*right.columns, *warm]
    return frame


def _features(
    group: h5py.Group, names: Sequence[str] | None, where: str, units: dict[str, str]
) -> dict[str, np.ndarray]:
    stored = group["monitoring"]
    columns: dict[str, np.ndarray] = {}
    for name in stored if names is None else names:
        if name == TEMPERATURE:
            continue
        if name not in stored:
            raise InputError(
                f"features: {where} has no '{name}': choose {', '.join([*stored, TEMPERATURE])}"
            )
        columns |= _by_axis(name, stored[name], units)
    return columns


def _by_axis(name: str, array: h5py.Dataset, units: dict[str, str]) -> dict[str, np.ndarray]:
    """A column for each axis, or for each axis and bin, both counted from 1."""
    values = array[()]
    columns = {}
    for place in np.ndindex(values.shape[1:]):
        column = "_".join([name, *(str(number + 1) for number in place)])
        columns[column] = values[(slice(None), *place)]
        units[column] = str(array.attrs["units"])
    return columns


_COORDINATES = {"cycle_number": "cycle", "time": "time", "axis": "axis", "bin": "bin"}


def run_to_xarray(group: h5py.Group) -> xr.Dataset:
    """Return all arrays of a run as an xarray dataset.

    Args:
        group: The run, open for reading.

    Returns:
        The arrays. Their names are those in the file, with "_" in place of "/", and their
        attributes state the units. The coordinates are cycle, time [s], axis and bin.

    Raises:
        InputError: xarray is not installed.
    """
    xarray = optional("xarray")
    found: dict[str, Any] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not item.is_scale and item.shape:
            dims = [_COORDINATES[dimension.label] for dimension in item.dims]
            found[name.replace("/", "_")] = (dims, item[()], _described(item))

    group.visititems(note)
    scales = {
        new: ([new], group[old][()], _described(group[old])) for old, new in _COORDINATES.items()
    }
    attributes = {
        name: value if isinstance(value, str) else np.asarray(value)
        for name, value in group.attrs.items()
    }
    return xarray.Dataset(found, scales, attributes)


def _described(item: h5py.Dataset) -> dict[str, str]:
    return {name: str(item.attrs[name]) for name in ("units", "long_name")}
