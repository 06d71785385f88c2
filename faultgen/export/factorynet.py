"""Datasets with the columns of FactoryNet: set points, effort, feedback and context.

``data/faultgen_000.parquet``, … have one row for each sample; an episode is a cycle.
``data/faultgen_episode_metadata.parquet`` has one row for each episode.

What was relied on: the four groups and the column names ``setpoint_pos_0`` …, ``setpoint_vel_0`` …
and ``effort_motor_torque_0`` … of the paper (K. Othman et al., FactoryNet, arXiv:2605.09081), and
the columns ``feedback_pos_…``, ``feedback_vel_…``, ``ctx_…``, ``episode_id``, ``time_s``,
``dataset_source``, ``machine_type``, ``ctx_anomaly_label`` and ``ctx_anomaly_category`` that public
descriptions of its files name. Their types are not documented, and assumed here. Columns count axes
from 0: axis 1 of faultgen is ``…_0``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.dataset.card import LICENCE
from faultgen.errors import InputError
from faultgen.export.cycles import REFERENCE, Cycle, Source
from faultgen.export.hub_card import description, title
from faultgen.export.places import new_folder
from faultgen.export.shards import Shards, column, table
from faultgen.system.tables import optional

COLUMNS = {
    "setpoint_pos": ("rad", "commanded joint position"),
    "setpoint_vel": ("rad/s", "commanded joint velocity: the difference quotient of the position"),
    "effort_motor_torque": ("N m", "logged torque, on the motor side of the gearbox"),
    "feedback_pos": ("rad", "logged motor position, converted to the joint side"),
    "feedback_vel": ("rad/s", "logged motor velocity, converted to the joint side"),
}
"""Unit and meaning of the columns that exist for each axis."""

CONTEXT = {
    "ctx_temp": ("degC", "gearbox temperature that the sensor shows"),
    "ctx_payload_mass": ("kg", "mass of the payload; null if the model has none"),
    "ctx_speed_override": ("1", "speed override; 1: as programmed"),
    "ctx_task": ("", "name of the task"),
    "ctx_anomaly_label": ("", "whether something is worn"),
    "ctx_anomaly_category": ("", "effect that is worn, or 'healthy'"),
    "ctx_anomaly_axis": ("", "first worn axis, from 0; -1 while nothing is worn"),
    "ctx_anomaly_severity": ("as in the metadata", "true severity of the fault"),
}
"""Unit and meaning of the columns that describe the circumstances and the truth."""


def write_factorynet(source: Source, out: Path) -> dict[str, Any]:
    """Write runs with the columns of FactoryNet.

    Args:
        source: The runs. All must be of robots with the same number of axes.
        out: The folder.

    Returns:
        What was written: numbers of episodes and rows.

    Raises:
        InputError: The runs differ in their number of axes, lack the commanded positions, or
            pyarrow is not installed.
        StorageFailed: The folder cannot be written.
    """
    arrow, parquet = optional("pyarrow"), optional("pyarrow.parquet")
    source.only("n_axes", "the columns are those of one of them; give the run files of one")
    if REFERENCE not in source.signals:
        raise InputError(f"{source.name}: its runs hold no commanded positions, the set points")
    told = {run.id: run.attributes for run in source.runs}
    episodes: list[dict[str, Any]] = []
    with new_folder(out) as folder:
        shards = Shards(lambda k: folder / f"data/faultgen_{k:03d}.parquet")
        with shards:
            for cycle in source.cycles():
                file = shards.write(_rows(cycle, told[cycle.run]))
                episodes.append(_episode(cycle, told[cycle.run], f"faultgen_{file:03d}.parquet"))
        metadata = arrow.Table.from_pylist(episodes)
        parquet.write_table(metadata, folder / "data/faultgen_episode_metadata.parquet")
        (folder / "README.md").write_text(_readme(source))
    return {"folder": str(out), "episodes": len(episodes), "rows": shards.rows}


def _name(cycle: Cycle) -> str:
    return f"{cycle.run}_{cycle.number:06d}"


def _rows(cycle: Cycle, told: dict[str, Any]) -> Any:
    """One row for each sample."""
    arrow = optional("pyarrow")
    count, labels, joints = cycle.n_samples, cycle.labels, cycle.on_side("joint")
    command = joints[REFERENCE]
    arrays = {
        "setpoint_pos": command,
        "setpoint_vel": np.gradient(command, cycle.sample_period, axis=0),
        "effort_motor_torque": cycle.signals.get("torque"),
        "feedback_pos": joints.get("position"),
        "feedback_vel": joints.get("velocity"),
    }
    columns: dict[str, Any] = {
        "episode_id": column(_name(cycle), count),
        "time_s": cycle.sample_period * np.arange(count),
        "dataset_source": column("faultgen", count),
        "machine_type": column(cycle.robot, count),
    }
    for name, values in arrays.items():
        if values is not None:
            for axis in range(values.shape[1]):
                columns[f"{name}_{axis}"] = values[:, axis].astype(np.float32)
    mass = float(told.get("payload_mass", np.nan))
    context = {
        "ctx_temp": float(labels["temperature"]),
        "ctx_payload_mass": arrow.scalar(None if np.isnan(mass) else mass, arrow.float64()),
        "ctx_speed_override": float(told.get("speed", 1.0)),
        "ctx_task": cycle.task,
        "ctx_anomaly_label": not labels["healthy"],
        "ctx_anomaly_category": labels["effect"],
        "ctx_anomaly_axis": labels["axis"] - 1,
        "ctx_anomaly_severity": float(labels["severity"]),
    }
    return table(columns | {name: column(value, count) for name, value in context.items()})


def _episode(cycle: Cycle, told: dict[str, Any], file: str) -> dict[str, Any]:
    return {
        "episode_id": _name(cycle),
        "file": file,
        "machine_type": cycle.robot,
        "machine_instance": cycle.robot_instance,
        "task": cycle.task,
        "run": cycle.run,
        "cycle": cycle.number,
        "split": cycle.part,
        "n_samples": cycle.n_samples,
        "sample_period_s": cycle.sample_period,
        "anomaly_severity_units": cycle.labels["severity_units"],
        "attributes": json.dumps(
            {name: told[name] for name in ("effect", "schedule", "sensors", "faultgen_version")},
            default=str,
        ),
    }


def _readme(source: Source) -> str:
    from tabulate import tabulate

    rows = [[f"`{name}_0` …", *told] for name, told in COLUMNS.items()]
    rows += [[f"`{name}`", *told] for name, told in CONTEXT.items()]
    listed = tabulate(rows, ["column", "unit", "content"], tablefmt="github", disable_numparse=True)
    return (
        "---\nlicense: cc-by-4.0\nconfigs:\n- config_name: default\n  data_files: "
        "data/faultgen_[0-9]*.parquet\n- config_name: episodes\n  data_files: "
        f"data/faultgen_episode_metadata.parquet\n---\n\n# {title(source)}\n\n"
        f"{description(source)} The columns are those of FactoryNet (arXiv:2605.09081): set "
        "points, effort, feedback and context. An episode is a work cycle. Columns count axes from "
        "0.\n\n"
        f"{listed}\n\nEverything is simulated. Licence: CC BY 4.0, {LICENCE}.\n"
    )
