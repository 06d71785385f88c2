"""Runs as recordings of Rerun (``.rrd``), with one time series for each signal and axis.

    motor1/position  [rad]    motor1/velocity  [rad/s]    motor1/torque  [N m]
    joint1/reference_position [rad]
    temperature [degC]   severity   label (a text at the beginning of each cycle)

The timeline ``time`` is 0 at the beginning of the first cycle, and the cycles follow each other
without a pause. The timeline ``cycle`` counts the cycles from 1.

Source: https://rerun.io/docs/howto/logging-and-ingestion/send-columns.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from faultgen.export.cycles import REFERENCE, SIGNALS, Cycle, Source
from faultgen.export.per_run import places
from faultgen.system.tables import optional


def write_rerun(source: Source, out: Path) -> dict[str, Any]:
    """Write runs as recordings of Rerun.

    Args:
        source: The runs.
        out: A folder that gets one file for each run; or one file, if the name ends with .rrd. In a
            file with several runs, the names of the series begin with the id of the run.

    Returns:
        What was written: numbers of files and of values.

    Raises:
        InputError: The package rerun-sdk is not installed, or there is something at this place.
        StorageFailed: A file cannot be written.
    """
    rerun = optional("rerun", "rerun-sdk")
    streams: dict[Path, Any] = {}
    values, run, start = 0, "", 0.0
    with places(source, out, ".rrd") as where:
        for cycle in source.cycles():
            path, prefix = where[cycle.run]
            if path not in streams:
                name = cycle.run if not prefix else "+".join(one.id for one in source.runs)
                streams[path] = rerun.RecordingStream("faultgen", recording_id=name)
                streams[path].save(path)
            if cycle.run != run:
                run, start = cycle.run, 0.0
                _describe(rerun, streams[path], prefix, cycle)
            values += _send(rerun, streams[path], prefix, cycle, start)
            start += cycle.n_samples * cycle.sample_period
        for stream in streams.values():
            stream.flush()
            stream.disconnect()
    return {"out": str(out), "files": len(streams), "values": values}


def _series(cycle: Cycle) -> dict[str, tuple[str, np.ndarray]]:
    """Unit and values of each series, by name."""
    found = {}
    for name, values in cycle.signals.items():
        kind = "joint" if name == REFERENCE else "motor"
        for axis in range(values.shape[1]):
            units = SIGNALS.get(name, "rad")
            found[f"{kind}{axis + 1}/{name}"] = (units, values[:, axis])
    return found


def _describe(rerun: Any, stream: Any, prefix: str, cycle: Cycle) -> None:
    """State the unit of every series, and which robot performs which task."""
    told = {name: units for name, (units, _) in _series(cycle).items()}
    told |= {"temperature": "degC", "severity": cycle.labels["severity_units"]}
    for name, units in told.items():
        stream.log(f"{prefix}/{name}", rerun.SeriesLines(names=f"{name} [{units}]"), static=True)
    text = f"{cycle.robot} performs {cycle.task}; run {cycle.run}"
    stream.log(f"{prefix}/run", rerun.TextDocument(text), static=True)


def _send(rerun: Any, stream: Any, prefix: str, cycle: Cycle, start: float) -> int:
    """Write a cycle; the number of values."""
    times = start + cycle.sample_period * np.arange(cycle.n_samples)
    both = [
        rerun.TimeColumn("time", duration=times),
        rerun.TimeColumn("cycle", sequence=np.full(cycle.n_samples, cycle.number)),
    ]
    count = 0
    for name, (_, values) in _series(cycle).items():
        columns = rerun.Scalars.columns(scalars=values.astype(float))
        stream.send_columns(f"{prefix}/{name}", indexes=both, columns=columns)
        count += len(values)
    stream.set_time("time", duration=start)
    stream.set_time("cycle", sequence=cycle.number)
    for name in ("temperature", "severity"):
        stream.log(f"{prefix}/{name}", rerun.Scalars(float(cycle.labels[name])))
    stream.log(f"{prefix}/label", rerun.TextLog(f"cycle {cycle.number}: {cycle.condition}"))
    return count
