"""Recordings made from runs of a dataset, as if a controller had logged them.

recording = recording_of(["out/runs/0123456789abcdef.h5"])
write_recording(recording, "measured.h5")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.recordings.recording import Recording

_REFERENCE = "command/reference_position"


def recording_of(files: Sequence[str | Path], cycle: int | None = None) -> Recording:
    """Make a recording from one cycle of each of some runs.

    Args:
        files: Run files of one robot. Each becomes a segment of the recording.
        cycle: Number of the cycle, from 1. None: the last cycle of each run.

    Returns:
        The recording, motor side. It holds no label.

    Raises:
        InputError: A file is no run, lacks the signals or the cycle, or the runs do not fit
            together.
    """
    runs = [StoredRun.at(Path(file)) for file in files]
    parts = [_part(run, cycle) for run in runs]
    names = set.intersection(*(set(part) for part in parts))
    for what in ("robot", "sample_period", "payload_mass"):
        told = {str(_of(run, what)) for run in runs}
        if len(told) > 1:
            raise InputError(f"runs: must have the same {what}, not {' and '.join(sorted(told))}")
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in names}
    starts = np.cumsum([0, *(len(part["position"]) for part in parts[:-1])])
    return Recording(
        source=", ".join(str(run.path) for run in runs),
        robot=str(runs[0]["robot"]),
        side="motor",
        sample_period=float(_of(runs[0], "sample_period")),
        position=arrays["position"],
        torque=arrays["torque"],
        velocity=arrays.get("velocity"),
        reference_position=arrays.get("reference_position"),
        temperature=arrays.get("temperature"),
        segments=tuple(starts.tolist()),
    )


def _of(run: StoredRun, what: str) -> str | float:
    """Attribute of a run; the period is that of the samples which are stored."""
    if "schema_version" not in run.attributes:
        raise InputError(
            f"{run.path}: is not a run; give DATASET/runs/ID.h5, also if "
            "only dataset.h5 holds the runs; 'faultgen info DATASET' lists their IDs"
        )
    if what == "sample_period":
        return float(run["sample_period"]) * int(run["thin"])
    return str(run.attributes.get(what))


def _part(run: StoredRun, cycle: int | None) -> dict[str, np.ndarray]:
    """Arrays of one cycle of a run."""
    _of(run, "robot")
    count = int(run["cycles"])
    if cycle is not None and not 1 <= cycle <= count:
        raise InputError(f"cycle: must be from 1 to {count} for {run.path}, not {cycle}")
    index = count - 1 if cycle is None else cycle - 1
    arrays = {}
    for name in ("position", "torque", "velocity"):
        stored = f"signals/motor_{name}"
        if stored in run:
            arrays[name] = run.read(stored, index).astype(float)
        elif name != "velocity":
            raise InputError(
                f"{run.path}: holds no '{stored}'; generate the dataset with this signal"
            )
    if _REFERENCE in run:
        arrays["reference_position"] = run.read(_REFERENCE).astype(float)
    warm = float(run.read("cycle/temperature", index))
    arrays["temperature"] = np.full(len(arrays["position"]), warm)
    return arrays
