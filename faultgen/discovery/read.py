"""Reading of measured files. All claims of a file are checked before its data are used.

recording = read_recording("measured.h5")
recording.torque.shape  # (samples, n_axes)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.read_csv import read_csv
from faultgen.discovery.read_hdf5 import read_hdf5
from faultgen.discovery.recording import Recording
from faultgen.discovery.resampling import FEWEST, evened
from faultgen.errors import InputError

FASTEST, SLOWEST = 1e-5, 1.0
"""Sample periods that a recording may have [s]."""

LARGEST = 1e9
"""Largest plausible position, velocity or torque, in any unit."""

_LONGEST_NAME = 100


def read_recording(path: str | Path) -> Recording:
    """Read a measured file.

    Args:
        path: HDF5 (``.h5``, ``.hdf5``) or CSV file.

    Returns:
        The recording.

    Raises:
        InputError: The file cannot be read, lacks something, or an array has another shape. The
            message is one line.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")
    is_csv = path.suffix.lower() == ".csv"
    try:
        named, attributes = read_csv(path) if is_csv else read_hdf5(path)
    except InputError:
        raise
    # a damaged file can make h5py raise any of these
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, MemoryError) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    sides = [side for side in ("motor", "joint") if f"{side}_position" in named]
    if len(sides) != 1:
        has = "both" if sides else "neither"
        raise InputError(f"{path}: needs motor_position or joint_position, has {has}")
    (side,) = sides
    current = f"{side}_torque" not in named
    if current and "motor_current" not in named:
        raise InputError(
            f"{path}: has {side}_position, but no {side}_torque, and no motor_current [A] instead"
        )
    arrays = {
        "position": named[f"{side}_position"],
        "torque": named["motor_current" if current else f"{side}_torque"],
        "velocity": named.get(f"{side}_velocity"),
        "reference_position": named.get("reference_position"),
        "temperature": named.get("temperature"),
    }
    _check_arrays(path, side, arrays)
    segments = _segments(path, attributes.get("segments", 0), len(named[f"{side}_position"]))
    notes: tuple[str, ...] = ()
    period = attributes.get("sample_period")
    if period is None and "time" in named:
        _check_time(path, named["time"], len(named[f"{side}_position"]))
        even = evened(str(path), named["time"], arrays, segments)
        arrays, period, segments, notes = even.arrays, even.period, even.segments, even.notes
    return Recording(
        source=str(path),
        robot=_robot(path, attributes.get("robot", "")),
        side=side,
        sample_period=_sample_period(path, period),
        segments=segments,
        payload_mass=_payload(path, attributes.get("payload_mass")),
        link=_is_link(path, attributes.get("torque_sensor", "motor"), side, current),
        current=current,
        notes=notes,
        **arrays,  # type: ignore[arg-type]
    )


def _check_time(path: Path, time: np.ndarray, count: int) -> None:
    if time.shape != (count,):
        raise InputError(f"{path}: time has shape {time.shape}, expected {(count,)}")
    wrong = ~np.isfinite(time)
    if wrong.any():
        raise InputError(f"{path}: time is not finite in sample {int(np.argmax(wrong))}")


def _check_arrays(path: Path, side: str, arrays: dict[str, np.ndarray | None]) -> None:
    position = arrays["position"]
    assert position is not None
    if position.ndim != 2 or not position.size:
        raise InputError(f"{path}: {side}_position must have shape (samples, axes)")
    for name, values in arrays.items():
        if values is None:
            continue
        allowed = [position.shape]
        if name == "temperature":  # of the whole robot
            allowed.insert(0, position.shape[:1])
        if values.shape not in allowed:
            expected = " or ".join(map(str, allowed))
            raise InputError(f"{path}: {name} has shape {values.shape}, expected {expected}")
        for wrong, what in (
            (~np.isfinite(values), "is not finite"),
            (np.abs(values) > LARGEST, f"is larger than {LARGEST:g}"),
        ):
            if wrong.any():
                raise InputError(f"{path}: {name} {what} in sample {np.argwhere(wrong)[0][0]}")


def _number(value: Any) -> float | None:
    """A single real number, also if it is in an array of one element; None for anything else."""
    values = np.asarray(value)
    if values.size != 1 or values.dtype.kind not in "fiu":
        return None
    return float(values.reshape(())[()])


def _sample_period(path: Path, value: Any) -> float:
    period = _number(value)
    if period is None or not FASTEST <= period <= SLOWEST:
        raise InputError(
            f"{path}: sample_period must be a positive time in s, one number from {FASTEST:g} to "
            f"{SLOWEST:g}, not {_shown(value)}"
        )
    return period


def _segments(path: Path, value: Any, count: int) -> tuple[int, ...]:
    starts = np.atleast_1d(np.asarray(value))
    usable = starts.ndim == 1 and starts.size > 0 and starts.dtype.kind in "fiu"
    if usable:
        whole = np.isfinite(starts) & (starts == np.round(starts)) & (np.abs(starts) < 2**53)
        usable = bool(whole.all())
    if usable:
        starts = starts.astype(np.int64)
        usable = starts[0] == 0 and bool(np.all(np.diff([*starts.tolist(), count]) > 0))
    if not usable:
        raise InputError(
            f"{path}: segments must ascend from 0 to below {count}, the first sample of each "
            f"separate recording, not {_shown(value)}"
        )
    lengths = np.diff([*starts.tolist(), count])
    if lengths.min() < FEWEST:
        at = int(np.argmin(lengths))
        raise InputError(
            f"{path}: the separate recording from sample {starts[at]} has {lengths[at]} samples; "
            f"it needs at least {FEWEST}"
        )
    return tuple(starts.tolist())


def _payload(path: Path, value: Any) -> float | None:
    if value is None:
        return None
    mass = _number(value)
    if mass is None or not 0 <= mass <= LARGEST:
        raise InputError(
            f"{path}: payload_mass must be one number in kg, 0 or more, not {_shown(value)}"
        )
    return mass


def _is_link(path: Path, value: Any, side: str, current: bool) -> bool:
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    if not isinstance(value, str) or value not in ("motor", "link"):
        raise InputError(f"{path}: torque_sensor must be 'motor' or 'link', not {_shown(value)}")
    if value == "link" and (side == "motor" or current):
        has = "motor_current" if current else "motor_torque"
        raise InputError(
            f"{path}: torque_sensor is 'link', but it has {has}; sensors behind the gearbox "
            "measure joint_torque, with joint_position"
        )
    return value == "link"


def _robot(path: Path, value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    if not isinstance(value, str) or len(value) > _LONGEST_NAME or not value.isprintable():
        raise InputError(
            f"{path}: robot must be a name of at most {_LONGEST_NAME} characters, "
            f"not {_shown(value)}"
        )
    return value


def _shown(value: Any) -> str:
    """A value as it appears in a message: one short line."""
    text = " ".join(
        repr(value.tolist() if isinstance(value, np.ndarray | np.generic) else value).split()
    )
    return text if len(text) <= 60 else f"{text[:57]}..."
