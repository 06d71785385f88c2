"""Runs as MCAP files, which Foxglove and other tools for robot logs play back.

Each run has three topics with messages in JSON. The first two have the schema
``foxglove.JointStates``, the third has a schema of its own, ``faultgen.Label``.

    /motors    position [rad], velocity [rad/s] and torque ("effort") [N m] of each motor
    /command   commanded positions of the joints [rad]
    /label     what is true of the cycle that begins: effect, axis, severity, …

Time is 0 at the beginning of the first cycle, and the cycles follow each other without a pause. The
attributes of the run are the metadata record ``run``.

Source: https://mcap.dev/spec and https://docs.foxglove.dev/docs/sdk/schemas/joint-states.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.export.cycles import LABELS, REFERENCE, SIGNALS, Cycle, Source
from faultgen.export.per_run import places
from faultgen.system.tables import optional

_NUMBER = {"type": "number"}
_JOINT = {
    "type": "object",
    "properties": {
        "name": {"type": "string", "description": "Name of the motor or joint"},
        "position": _NUMBER | {"description": "Position [rad; m for slides]"},
        "velocity": _NUMBER | {"description": "Velocity [rad/s; m/s for slides]"},
        "effort": _NUMBER | {"description": "Torque [N m; force in N for slides]"},
    },
}
JOINT_STATES = {
    "title": "foxglove.JointStates",
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "joints": {"type": "array", "items": _JOINT},
    },
}
"""JSON schema of the states of motors and joints."""

_TYPES = {"effect": "string", "axis": "integer", "severity_units": "string", "healthy": "boolean"}
LABEL = {
    "title": "faultgen.Label",
    "type": "object",
    "properties": {"cycle": {"type": "integer"}}
    | {
        name: {"type": _TYPES.get(name, "number"), "description": text}
        for name, (_, text) in LABELS.items()
    },
}
"""JSON schema of the label of a cycle. A value that is not defined is left out."""

_FIELDS = {"position": "position", "velocity": "velocity", "torque": "effort"}


def write_mcap(source: Source, out: Path) -> dict[str, Any]:
    """Write runs as MCAP files.

    Args:
        source: The runs.
        out: A folder that gets one file for each run; or one file, if the name ends with .mcap. In
            a file with several runs, the names of the topics begin with the id of the run.

    Returns:
        What was written: numbers of files and messages.

    Raises:
        InputError: The package mcap is not installed, or there is something at this place.
        StorageFailed: A file cannot be written.
    """
    writers = optional("mcap.writer", "mcap")
    files: dict[Path, Any] = {}
    runs: dict[str, _Run] = {}
    with places(source, out, ".mcap") as where, ExitStack() as opened:
        for run in source.runs:
            path, prefix = where[run.id]
            if path not in files:
                writer = writers.Writer(opened.enter_context(path.open("wb")))
                writer.start(profile="", library="faultgen")
                opened.callback(writer.finish)
                files[path] = writer
            runs[run.id] = _Run(files[path], prefix, run.attributes)
        for cycle in source.cycles():
            runs[cycle.run].write(cycle)
    return {
        "out": str(out),
        "files": len(files),
        "messages": sum(run.messages for run in runs.values()),
    }


class _Run:
    """Writes the messages of a run."""

    def __init__(self, writer: Any, prefix: str, attributes: dict[str, Any]) -> None:
        self._writer, self._prefix, self._start = writer, prefix, 0
        self._channels: dict[str, int] = {}
        self.messages = 0
        text = {name: _text(value) for name, value in attributes.items()}
        writer.add_metadata(name=f"run{prefix}", data=text)

    def write(self, cycle: Cycle) -> None:
        """Write the messages of a cycle, in the order of time."""
        label = {"cycle": cycle.number, **cycle.labels}
        known = {name: value for name, value in label.items() if value == value}  # not nan
        self._message("label", LABEL, self._start, json.dumps(known))
        step = round(cycle.sample_period * 1e9)
        times = self._start + step * np.arange(cycle.n_samples)
        topics = [("motors", "motor", {_FIELDS[n]: cycle.signals.get(n) for n in SIGNALS})]
        topics.append(("command", "joint", {"position": cycle.signals.get(REFERENCE)}))
        texts = [(topic, _states(kind, arrays)) for topic, kind, arrays in topics]
        for number, time in enumerate(times.tolist()):
            for topic, text in texts:
                if text is not None:
                    self._message(topic, JOINT_STATES, time, text(number, time))
        self._start += step * cycle.n_samples

    def _message(self, topic: str, schema: dict[str, Any], time: int, text: str) -> None:
        if topic not in self._channels:
            registered = self._writer.register_schema(
                name=schema["title"], encoding="jsonschema", data=json.dumps(schema).encode()
            )
            self._channels[topic] = self._writer.register_channel(
                topic=f"{self._prefix}/{topic}", message_encoding="json", schema_id=registered
            )
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=time,
            publish_time=time,
            sequence=self.messages,
            data=text.encode(),
        )
        self.messages += 1


def _states(kind: str, arrays: dict[str, np.ndarray | None]) -> Callable[[int, int], str] | None:
    """A function that writes the message of a sample; None if there is no array."""
    there = {field: values for field, values in arrays.items() if values is not None}
    if not there:
        return None
    n_axes = next(iter(there.values())).shape[1]
    # the message is text with places for numbers: `json.dumps` of each one takes five times as long
    joints = ",".join(
        f'{{"name":"{kind}{axis}",' + ",".join(f'"{field}":%.9g' for field in there) + "}"
        for axis in range(1, n_axes + 1)
    )
    form = f'{{"timestamp":{{"sec":%d,"nsec":%d}},"joints":[{joints}]}}'
    rows = np.stack(list(there.values()), axis=2).reshape(-1, n_axes * len(there)).tolist()
    return lambda number, time: form % (*divmod(time, 1_000_000_000), *rows[number])


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    return json.dumps(value.tolist() if isinstance(value, np.ndarray) else value)
