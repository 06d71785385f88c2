"""Recordings made from logs of robot controllers.

made = import_log("log.csv", load_map("columns.toml"))
write_recording(made.recording, "measured.h5")
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from faultgen.importing import ColumnMap, Row, arranged, read_log
from faultgen.recordings.rates import slow

if TYPE_CHECKING:
    from faultgen.recordings.recording import Recording

_SHORTEST = 5e-5  # usual sample periods of controllers are longer [s]
_FAR = 15.0  # more than two turns of a joint: unusual [rad or m]


@dataclass(frozen=True, eq=False)
class Imported:
    """A recording, and how the log was understood."""

    recording: Recording
    """The recording in SI units, at even times."""
    rows: tuple[Row, ...]
    """How each column was read."""
    jitter: float
    """Largest difference between a step of the log's times and a whole number of periods [s]."""
    gaps: tuple[float, ...]
    """Times without a sample that begin a new segment [s]."""
    missing: int
    """Number of samples that the log lacks elsewhere, and that were interpolated."""
    notes: tuple[str, ...]
    """One line for each decision that the map did not state."""


def import_log(path: str | Path, column_map: ColumnMap, program: str | None = None) -> Imported:
    """Make a recording of a log.

    Uneven times are resampled as those of any recording (`evened`): here, because a recording in a
    file has one sample period, and because the user then sees at once what was done.

    Args:
        path: The log.
        column_map: What its columns mean.
        program: Name of the program whose rows are taken. None: all rows.

    Returns:
        The recording.

    Raises:
        InputError: The log cannot be read, or the map does not fit it. The message is one line.
    """
    made = arranged(read_log(path, column_map.file, column_map.axes), column_map, program)
    # after the log was read: a refusal does not wait for HDF5
    from faultgen.recordings.fields import fields_of
    from faultgen.recordings.recording import Recording
    from faultgen.recordings.resampling import irregular

    recording = Recording(**fields_of(str(path), made.named, made.attributes))
    jitter, gaps, missing = 0.0, np.zeros(0), 0
    if "time" in made.named:
        starts = np.atleast_1d(made.attributes.get("segments", 0))
        period = recording.sample_period
        jitter, gaps, missing = irregular(made.named["time"], starts.tolist(), period)
    notes = (*made.notes, *recording.notes, *_doubts(recording))
    return Imported(recording, made.rows, jitter, tuple(gaps.tolist()), missing, notes)


def _doubts(recording: Recording) -> Iterator[str]:
    """What a wrong unit or side would explain. `check_recording` knows the robot and sees more."""
    period = recording.sample_period
    if period < _SHORTEST:
        yield f"warning: {1 / period:.4g} Hz is an unusual sample rate; check time.unit in the map"
    what = slow(period)
    if what is not None:
        yield f"{what}; if the log is not so slow, correct time.unit in the map"
    largest = np.abs(recording.position).max(axis=0)
    if recording.side == "joint" and largest.max() > _FAR:
        far = np.flatnonzero(largest > _FAR).tolist()
        reach = ", ".join(f"{largest[k]:.4g}" for k in far)
        axes = ", ".join(str(k + 1) for k in far)
        yield (
            f"warning: axis {axes} reaches {reach} (rad, or m for a slide); check position.unit in "
            "the map, and whether this is the position of the motor"
        )
    from faultgen.recordings.torque_doubts import torque_doubts

    still = [str(k + 1) for k in np.flatnonzero(np.ptp(recording.torque, axis=0) == 0)]
    for axis, text, _ in torque_doubts(recording):
        yield f"warning: axis {axis}: {text}"
    if still:
        what = "current" if recording.current else "torque"
        yield f"warning: the {what} of axis {', '.join(still)} never changes; check its column"
