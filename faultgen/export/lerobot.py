"""Datasets as LeRobotDataset v3.0, the format of the package lerobot.

The folder holds ``meta/info.json`` (features with names, and the frame rate), ``meta/stats.json``
(of all frames), ``meta/tasks.parquet`` (texts of the tasks by number), ``meta/episodes/…`` (where
each episode is, with its own statistics) and ``data/…`` (one row for each frame, one row group for
each episode).

Source: https://huggingface.co/docs/lerobot/lerobot-dataset-v3, and the reader of lerobot 0.4.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.export.cycles import REFERENCE, SIGNALS, Cycle, Source
from faultgen.export.places import new_folder
from faultgen.export.shards import Shards, column, table, vectors
from faultgen.export.statistics import Statistics
from faultgen.system.tables import optional

VERSION = "v3.0"
EPISODES = ("cycle", "run")
SIDES = ("motor", "joint")

_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_CHUNK = 1000  # files of a folder
_SIZE = 100  # MB of a file
_TOGETHER = 1000  # episodes of a row group

_STATE, _ACTION, _TEMPERATURE = "observation.state", "action", "observation.temperature"
_LABELS = {
    "label.effect": ("effect", "string"),
    "label.axis": ("axis", "int64"),
    "label.severity": ("severity", "float32"),
    "label.healthy": ("healthy", "bool"),
}
_INDICES = ("frame_index", "episode_index", "index", "task_index")


def write_lerobot(
    source: Source, out: Path, *, episode: str = "cycle", side: str = "motor"
) -> dict[str, Any]:
    """Write runs as a LeRobotDataset v3.0.

    Args:
        source: The runs. All must be of robots with the same number of axes, and have the same
            signals and sample period.
        out: The folder.
        episode: "cycle" or "run": what an episode is.
        side: "motor" for the logged signals; "joint" to convert them to the joint side of the
            gearboxes, taken for rigid. The commanded positions are always on the same side.

    Returns:
        What was written: numbers of episodes and frames, and the frame rate.

    Raises:
        InputError: The runs differ, lack the commanded positions, or pyarrow is not installed.
        StorageFailed: The folder cannot be written.
    """
    optional("pyarrow")
    for name, value, known in (("episode", episode, EPISODES), ("side", side, SIDES)):
        if value not in known:
            raise InputError(f"{name}: must be {' or '.join(known)}, not '{value}'")
    advice = "a LeRobotDataset has one of each; give the run files of one"
    n_axes = source.only("n_axes", advice)
    rate = _rate(source.only("sample_period", advice))
    if REFERENCE not in source.signals:
        raise InputError(f"{source.name}: its runs hold no commanded positions, which are actions")
    state = [name for name in source.signals if name in SIGNALS]
    with new_folder(out) as folder:
        written = _Writer(folder, state, side, rate)
        with written:
            for cycles in _episodes(source, episode):
                written.add(cycles)
        _write_meta(folder, written, n_axes, source)
    return {"folder": str(out), **written.counts, "fps": rate}


class _Writer:
    """Writes the episodes one after another."""

    def __init__(self, folder: Path, state: list[str], side: str, rate: float) -> None:
        self._state, self.side, self.rate = state, side, rate

        def place(where: str) -> Any:
            return lambda k: (
                folder / where / _FILE.format(chunk_index=k // _CHUNK, file_index=k % _CHUNK)
            )

        self.data = Shards(place("data"), _SIZE * 2**20)
        self._episodes = Shards(place("meta/episodes"), _SIZE * 2**20)
        self._rows: list[dict[str, Any]] = []
        self.tasks: dict[str, int] = {}
        self.statistics = Statistics()
        self.state_names: list[str] = []

    @property
    def counts(self) -> dict[str, int]:
        return {
            "episodes": self._episodes.rows + len(self._rows),
            "frames": self.data.rows,
            "tasks": len(self.tasks),
        }

    def add(self, cycles: list[Cycle]) -> None:
        """Write an episode."""
        frames, vector = [], {}
        first, episode = self.data.rows, self.counts["episodes"]
        texts = list(dict.fromkeys(_text(cycle) for cycle in cycles))
        start = 0
        for cycle in cycles:
            signals, count = cycle.on_side(self.side), cycle.n_samples
            vector = {
                _STATE: np.hstack([signals[name] for name in self._state]).astype(np.float32),
                _ACTION: signals[REFERENCE].astype(np.float32),
            }
            task = self.tasks.setdefault(_text(cycle), len(self.tasks))
            frame = np.arange(start, start + count)
            columns = {name: vectors(values) for name, values in vector.items()}
            temperature = np.full(count, cycle.labels["temperature"], np.float32)
            columns[_TEMPERATURE] = temperature
            for name, (label, kind) in _LABELS.items():
                columns[name] = _constant(cycle.labels[label], kind, count)
            columns["timestamp"] = (frame / self.rate).astype(np.float32)
            columns["frame_index"] = frame
            columns["episode_index"] = np.full(count, episode)
            columns["index"] = frame + first
            columns["task_index"] = np.full(count, task)
            frames.append((table(columns), vector | {n: columns[n] for n in _numbers(columns)}))
            start += count
        whole = optional("pyarrow").concat_tables([one for one, _ in frames])
        file = self.data.write(whole.combine_chunks())
        told = Statistics()
        for name in frames[0][1]:
            told.add(name, np.concatenate([np.asarray(values[name]) for _, values in frames]))
        self.statistics.join(told)
        row = {
            "episode_index": episode,
            "tasks": texts,
            "length": start,
            "data/chunk_index": file // _CHUNK,
            "data/file_index": file % _CHUNK,
            "dataset_from_index": first,
            "dataset_to_index": first + start,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            "run": cycles[0].run,
            "cycle": cycles[0].number,
            "split": cycles[0].part,
        }
        flat = {
            f"stats/{name}/{kind}": v
            for name, one in told.told().items()
            for kind, v in one.items()
        }
        self._rows.append(row | flat)
        if len(self._rows) == _TOGETHER:
            self._write_rows()

    def __enter__(self) -> _Writer:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        with self.data, self._episodes:
            if kind is None and self._rows:
                self._write_rows()

    def _write_rows(self) -> None:
        """Write what is known of the latest episodes, with the number of the file that has it."""
        file = self._episodes.next_file
        for row in self._rows:
            row["meta/episodes/chunk_index"] = file // _CHUNK
            row["meta/episodes/file_index"] = file % _CHUNK
        self._episodes.write(optional("pyarrow").Table.from_pylist(self._rows))
        self._rows = []


def _numbers(columns: dict[str, Any]) -> list[str]:
    """Names of the columns with one number, in the order of the statistics."""
    labels = [name for name, (_, kind) in _LABELS.items() if kind != "string"]
    return [_TEMPERATURE, *labels, "timestamp", *_INDICES]


def _constant(value: Any, kind: str, count: int) -> Any:
    return column(value, count) if kind == "string" else np.full(count, value, np.dtype(kind))


def _rate(period: float) -> float:
    """Frames per second; a whole number, if it is one, because lerobot declares one."""
    rate = 1 / period
    return round(rate) if abs(rate - round(rate)) < 1e-6 * rate else rate


def _text(cycle: Cycle) -> str:
    """What the robot does and has, as the text of a task."""
    return f"{cycle.robot} performs {cycle.task}; {cycle.condition}"


def _episodes(source: Source, episode: str) -> Iterator[list[Cycle]]:
    """The cycles of each episode."""
    together: list[Cycle] = []
    for cycle in source.cycles():
        if together and (episode == "cycle" or cycle.run != together[0].run):
            yield together
            together = []
        together.append(cycle)
    yield together


def _write_meta(folder: Path, written: _Writer, n_axes: int, source: Source) -> None:
    arrow, parquet = optional("pyarrow"), optional("pyarrow.parquet")
    tasks = {"task_index": list(written.tasks.values()), "task": list(written.tasks)}
    pandas_index = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {
                "name": "task_index",
                "field_name": "task_index",
                "pandas_type": "int64",
                "numpy_type": "int64",
                "metadata": None,
            },
            {
                "name": "task",
                "field_name": "task",
                "pandas_type": "unicode",
                "numpy_type": "object",
                "metadata": None,
            },
        ],
        "pandas_version": "2.0.0",
    }
    listed = arrow.table(tasks).replace_schema_metadata({"pandas": json.dumps(pandas_index)})
    (folder / "meta").mkdir(exist_ok=True)
    parquet.write_table(listed, folder / "meta/tasks.parquet")
    _write_json(folder / "meta/stats.json", written.statistics.told())
    robots = list(dict.fromkeys(source.frame["robot"]))
    counts = written.counts
    info = {
        "codebase_version": VERSION,
        "robot_type": robots[0] if len(robots) == 1 else None,
        "total_episodes": counts["episodes"],
        "total_frames": counts["frames"],
        "total_tasks": counts["tasks"],
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": _SIZE,
        "video_files_size_in_mb": 2 * _SIZE,
        "fps": written.rate,
        "splits": {"train": f"0:{counts['episodes']}"},
        "data_path": f"data/{_FILE}",
        "video_path": None,
        "features": _features(written, n_axes, [n for n in source.signals if n in SIGNALS]),
    }
    _write_json(folder / "meta/info.json", info)


def _features(written: _Writer, n_axes: int, state: list[str]) -> dict[str, Any]:
    """Type, shape, names and units of every column."""
    where = f"{written.side}{{axis}}.{{name}}"

    def names(signals: list[str]) -> list[str]:
        axes = range(1, n_axes + 1)
        return [where.format(axis=axis, name=name) for name in signals for axis in axes]

    def one(kind: str, units: str = "", name: str | None = None) -> dict[str, Any]:
        told = {"dtype": kind, "shape": [1], "names": None if name is None else [name]}
        return told | ({"units": [units]} if units else {})

    units = [SIGNALS[name] for name in state for _ in range(n_axes)]
    found: dict[str, Any] = {
        _STATE: {"dtype": "float32", "shape": [len(units)], "names": names(state), "units": units},
        _ACTION: {
            "dtype": "float32",
            "shape": [n_axes],
            "names": names(["position"]),
            "units": ["rad"] * n_axes,
        },
        _TEMPERATURE: one("float32", "degC", "temperature"),
        **{name: one(kind, name=label) for name, (label, kind) in _LABELS.items()},
        "timestamp": one("float32", "s"),
        **{name: one("int64") for name in _INDICES},
    }
    return found


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n")
