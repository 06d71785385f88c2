"""What a recording consists of, checked: named arrays and attributes, whatever their origin.

named = {"motor_position": position, "motor_torque": torque}
recording = Recording(**fields_of("measured.h5", named, {"sample_period": 0.004}))
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.recordings.resampling import FEWEST, evened
from faultgen.system.dates import date_of

FASTEST, SLOWEST = 1e-5, 1.0
"""Sample periods that a recording may have [s]."""

LARGEST = 1e9
"""Largest plausible position, velocity or torque, in any unit."""

_LONGEST_NAME = 100


def fields_of(
    source: str, named: Mapping[str, np.ndarray], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Check arrays and attributes, and bring uneven samples to even times.

    Args:
        source: Name of the file or other origin, for messages.
        named: Arrays by the names that recordings have in files.
        attributes: Attributes by the names that they have there. Missing ones may be None.

    Returns:
        The fields of `Recording` by name. Arrays have shape (samples, n_axes).

    Raises:
        InputError: Something is missing, or an array has another shape or impossible values. The
            message is one line.
    """
    sides = [side for side in ("motor", "joint") if f"{side}_position" in named]
    if len(sides) != 1:
        has = "both" if sides else "neither"
        raise InputError(f"{source}: needs motor_position or joint_position, has {has}")
    (side,) = sides
    current = f"{side}_torque" not in named
    if current and "motor_current" not in named:
        raise InputError(
            f"{source}: has {side}_position, but no {side}_torque, and no motor_current [A] instead"
        )
    arrays = {
        "position": named[f"{side}_position"],
        "torque": named["motor_current" if current else f"{side}_torque"],
        "velocity": named.get(f"{side}_velocity"),
        "reference_position": named.get("reference_position"),
        "temperature": named.get("temperature"),
    }
    _check_arrays(source, side, arrays)
    segments = _segments(source, attributes.get("segments", 0), len(named[f"{side}_position"]))
    notes: tuple[str, ...] = ()
    period = attributes.get("sample_period")
    if period is None and "time" in named:
        _check_time(source, named["time"], len(named[f"{side}_position"]))
        even = evened(source, named["time"], arrays, segments)
        arrays, period, segments, notes = even.arrays, even.period, even.segments, even.notes
        if not FASTEST <= period <= SLOWEST:
            raise InputError(
                f"{source}: its times are {period:g} s apart, but a recording needs {FASTEST:g} to "
                f"{SLOWEST:g} s; check the unit of time, which must be s in a recording, and is "
                "time.unit in the map of an import"
            )
    return {
        "source": source,
        "robot": _robot(source, attributes.get("robot", "")),
        "side": side,
        "sample_period": _sample_period(source, period),
        "segments": segments,
        "payload_mass": _payload(source, attributes.get("payload_mass")),
        "date": _date(source, attributes.get("date")),
        "link": _is_link(source, attributes.get("torque_sensor", "motor"), side, current),
        "current": current,
        "notes": notes,
        **arrays,
    }


def _check_time(source: str, time: np.ndarray, count: int) -> None:
    if time.shape != (count,):
        raise InputError(f"{source}: time has shape {time.shape}, expected {(count,)}")
    wrong = ~np.isfinite(time)
    if wrong.any():
        raise InputError(f"{source}: time is not finite in sample {int(np.argmax(wrong))}")


def _check_arrays(source: str, side: str, arrays: dict[str, np.ndarray | None]) -> None:
    position = arrays["position"]
    assert position is not None
    if position.ndim != 2 or not position.size:
        raise InputError(f"{source}: {side}_position must have shape (samples, axes)")
    for name, values in arrays.items():
        if values is None:
            continue
        allowed = [position.shape]
        if name == "temperature":  # of the whole robot
            allowed.insert(0, position.shape[:1])
        if values.shape not in allowed:
            expected = " or ".join(map(str, allowed))
            raise InputError(f"{source}: {name} has shape {values.shape}, expected {expected}")
        for wrong, what in (
            (~np.isfinite(values), "is not finite"),
            (np.abs(values) > LARGEST, f"is larger than {LARGEST:g}"),
        ):
            if wrong.any():
                raise InputError(f"{source}: {name} {what} in sample {np.argwhere(wrong)[0][0]}")


def _number(value: Any) -> float | None:
    """A single real number, also if it is in an array of one element; None for anything else."""
    values = np.asarray(value)
    if values.size != 1 or values.dtype.kind not in "fiu":
        return None
    return float(values.reshape(())[()])


def _sample_period(source: str, value: Any) -> float:
    period = _number(value)
    if period is None or not FASTEST <= period <= SLOWEST:
        raise InputError(
            f"{source}: sample_period must be a positive time in s, one number from {FASTEST:g} to "
            f"{SLOWEST:g}, not {_shown(value)}"
        )
    return period


def _segments(source: str, value: Any, count: int) -> tuple[int, ...]:
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
            f"{source}: segments must ascend from 0 to below {count}, the first sample of each "
            f"separate recording, not {_shown(value)}"
        )
    lengths = np.diff([*starts.tolist(), count])
    if lengths.min() < FEWEST:
        at = int(np.argmin(lengths))
        raise InputError(
            f"{source}: the separate recording from sample {starts[at]} has {lengths[at]} samples; "
            f"it needs at least {FEWEST}"
        )
    return tuple(starts.tolist())


def _payload(source: str, value: Any) -> float | None:
    if value is None:
        return None
    mass = _number(value)
    if mass is None or not 0 <= mass <= LARGEST:
        raise InputError(
            f"{source}: payload_mass must be one number in kg, 0 or more, not {_shown(value)}"
        )
    return mass


def _date(source: str, value: Any) -> float | None:
    if value is None:
        return None
    text = value.decode(errors="replace") if isinstance(value, bytes) else value
    if not isinstance(text, str):
        raise InputError(
            f"{source}: date must be text such as 2026-03-12T08:30, not {_shown(value)}"
        )
    return date_of(text, f"{source}: date")


def _is_link(source: str, value: Any, side: str, current: bool) -> bool:
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    if not isinstance(value, str) or value not in ("motor", "link"):
        raise InputError(f"{source}: torque_sensor must be 'motor' or 'link', not {_shown(value)}")
    if value == "link" and (side == "motor" or current):
        has = "motor_current" if current else "motor_torque"
        raise InputError(
            f"{source}: torque_sensor is 'link', but it has {has}; sensors behind the gearbox "
            "measure joint_torque, with joint_position"
        )
    return value == "link"


def _robot(source: str, value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    if not isinstance(value, str) or len(value) > _LONGEST_NAME or not value.isprintable():
        raise InputError(
            f"{source}: robot must be a name of at most {_LONGEST_NAME} characters, "
            f"not {_shown(value)}"
        )
    return value


def _shown(value: Any) -> str:
    """A value as it appears in a message: one short line."""
    text = " ".join(
        repr(value.tolist() if isinstance(value, np.ndarray | np.generic) else value).split()
    )
    return text if len(text) <= 60 else f"{text[:57]}..."
