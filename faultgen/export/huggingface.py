"""Datasets as folders that `datasets.load_dataset` and the Hugging Face Hub read.

The folder has two configurations, each as Parquet files by part: ``signals`` with one row for each
cycle, whose logged signals are lists, one column for each signal and axis; and ``features`` with
the table of `Dataset.to_dataframe`. A row is a cycle because that is what has a label: users of
`datasets` expect that a row is an example. ``README.md`` is the data card, and ``croissant.json``
describes the files in the vocabulary Croissant 1.0.

Source: https://huggingface.co/docs/hub/datasets-cards and
https://huggingface.co/docs/hub/datasets-manual-configuration.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from faultgen.dataset.splits import PARTS, robot_instance
from faultgen.errors import InputError
from faultgen.export.croissant import write_croissant
from faultgen.export.cycles import LABELS, REFERENCE, SIGNALS, Cycle, Source
from faultgen.export.hub_card import write_card
from faultgen.export.hub_tables import Tables
from faultgen.export.places import new_folder
from faultgen.export.shards import vectors
from faultgen.system.tables import optional

_LABEL_TYPES = {
    "axis": "int64",
    "severity": "float64",
    "healthy": "bool_",
    "remaining_life": "float64",
    "remaining_cycles": "int64",
    "temperature": "float64",
}


def write_huggingface(source: Source, out: Path, *, by: str = "run") -> dict[str, Any]:
    """Write runs as a folder for `datasets.load_dataset`.

    Args:
        source: The runs.
        out: The folder.
        by: Name of the division whose parts become the splits "train", "validation" and "test".
            Single run files have no division, and all become "train".

    Returns:
        What was written: numbers of rows by configuration and split.

    Raises:
        InputError: The dataset has no such division, or pyarrow is not installed.
        StorageFailed: The folder cannot be written.
    """
    optional("pyarrow")
    source.check_division(by)
    with new_folder(out) as folder:
        tables = Tables(folder)
        if source.has_signals:
            _write_signals(source, tables, by)
        _write_features(source, tables, by)
        tables.close()
        if not tables.rows:
            raise InputError(f"{source.name}: no run belongs to a part of the division by {by}")
        write_card(folder, tables, source, by)
        write_croissant(folder, tables, source)
    return {"folder": str(out), "rows": tables.rows}


_TOGETHER = 50  # cycles of a row group
_LEFT_OUT = ("axes", "seed")


def _write_signals(source: Source, tables: Tables, by: str) -> None:
    """Write one row for each cycle."""
    arrow = optional("pyarrow")
    n_axes = source.all("n_axes")
    n_samples = source.all("n_samples")
    length = n_samples[0] if len(n_samples) == 1 else -1
    fields = [arrow.field("run", arrow.string()), arrow.field("cycle", arrow.int64())]
    fields += [arrow.field(name, arrow.string()) for name in ("robot", "task", "robot_instance")]
    for name, (units, _) in LABELS.items():
        kind = _LABEL_TYPES.get(name)
        fields.append(arrow.field(name, arrow.string() if kind is None else getattr(arrow, kind)()))
        if units:
            tables.units[name] = units
    fields.append(arrow.field("sample_period", arrow.float64()))
    tables.units["sample_period"] = "s"
    for name in source.signals:
        for axis in range(1, max(n_axes) + 1):
            column = _column(name, axis)
            fields.append(arrow.field(column, arrow.list_(arrow.float32(), length)))
            tables.units[column] = (SIGNALS | {REFERENCE: "rad"})[name]
    schema = arrow.schema(fields)
    waiting: dict[str, list[dict[str, Any]]] = {}
    for cycle in source.cycles(by):
        rows = waiting.setdefault(cycle.part, [])
        rows.append(_row(cycle, max(n_axes)))
        if len(rows) == _TOGETHER:
            tables.write("signals", cycle.part, _as_table(rows, schema))
            rows.clear()
    for part, rows in waiting.items():
        if rows:
            tables.write("signals", part, _as_table(rows, schema))


def _column(signal: str, axis: int) -> str:
    return f"{signal}_{axis}" if signal == REFERENCE else f"motor_{signal}_{axis}"


def _row(cycle: Cycle, n_axes: int) -> dict[str, Any]:
    row: dict[str, Any] = {"run": cycle.run, "cycle": cycle.number, "robot": cycle.robot}
    row |= {"task": cycle.task, "robot_instance": cycle.robot_instance}
    row |= {**cycle.labels, "sample_period": cycle.sample_period}
    for name, values in cycle.signals.items():
        for axis in range(n_axes):
            there = axis < values.shape[1]
            row[_column(name, axis + 1)] = values[:, axis].astype(np.float32) if there else None
    return row


def _as_table(rows: list[dict[str, Any]], schema: Any) -> Any:
    """Make a table of rows. Values that are not defined are null."""
    arrow = optional("pyarrow")
    columns = []
    for field in schema:
        values = [row[field.name] for row in rows]
        if not arrow.types.is_nested(field.type):
            columns.append(arrow.array(values, field.type, from_pandas=True))
        elif any(value is None for value in values) or arrow.types.is_list(field.type):
            columns.append(arrow.array(values, field.type))
        else:
            columns.append(vectors(np.stack(values)))
    return arrow.Table.from_arrays(columns, schema=schema)


def _write_features(source: Source, tables: Tables, by: str) -> None:
    """Write the table of features, by part."""
    arrow = optional("pyarrow")
    frame = source.features
    tables.units |= frame.attrs["units"] | {n: u for n, (u, _) in LABELS.items() if u}
    split = f"split_{by}"
    parts = frame[split] if split in frame else [PARTS[0]] * len(frame)
    first = ["run", "cycle", "robot", "task", "robot_instance", *LABELS]
    instances = {run.id: robot_instance(run.attributes) for run in source.runs}
    plain = frame.assign(robot_instance=frame["run"].map(instances), **source.labels)
    others = [name for name in plain if name not in first and name not in _LEFT_OUT]
    plain = plain[first + [name for name in others if not name.startswith("split_")]]
    plain.attrs = {}
    table = arrow.Table.from_pandas(plain, preserve_index=False).replace_schema_metadata(None)
    for part in PARTS:
        rows = np.flatnonzero(np.asarray(parts) == part)
        if len(rows):
            tables.write("features", part, table.take(rows))
