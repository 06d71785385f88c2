"""Measured data of a robot: what is read from a file, and in which units.

HDF5 with attributes ``robot`` and ``sample_period`` and arrays of shape (sample, axis), or CSV with
a header of the same names and suffixes _1 to _n:

    motor_position [rad], motor_torque [N m]        motor side, or else
    joint_position [rad], joint_torque [N m]        joint side (m and N for slides)
    motor_velocity or joint_velocity [rad/s], reference_position [rad, joint side]: optional
    temperature [deg C], shape (sample,): optional

Attributes ``segments`` (start of each separate recording in the file) and ``payload_mass`` [kg] are
optional. A CSV file has a column ``time`` [s] instead of the period, and may have ``segment``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.signal import butter, filtfilt, savgol_filter

from faultgen.errors import InputError
from faultgen.storage import write_arrays

_ARRAYS = ("position", "torque", "velocity", "reference_position", "temperature")
_SMOOTHING = 0.06  # window of the derivatives [s]
_UNEVEN = 0.05  # share of the sample period by which times may scatter


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A recording, motor side or joint side. Arrays have shape (samples, n_axes)."""

    source: str
    """Where it comes from, for messages."""
    robot: str
    """Name of the robot as the file has it; may be empty."""
    side: str
    """'motor' or 'joint'."""
    sample_period: float
    """Time between samples [s]."""
    position: np.ndarray
    """[rad], or [m] for slides."""
    torque: np.ndarray
    """[N m], or [N] for slides."""
    velocity: np.ndarray | None = None
    """[rad/s], or None where it was not measured."""
    reference_position: np.ndarray | None = None
    """Commanded position, joint side [rad]."""
    temperature: np.ndarray | None = None
    """Shape (samples,), in [deg C]."""
    segments: tuple[int, ...] = (0,)
    """First sample of each separate recording, ascending from 0."""
    payload_mass: float | None = None
    """[kg], if known."""

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return self.position.shape[1]

    @property
    def parts(self) -> list[slice]:
        """Samples of each separate recording."""
        ends = [*self.segments[1:], len(self.position)]
        return [slice(start, end) for start, end in zip(self.segments, ends, strict=True)]

    def joint_position(self, gear_ratio: np.ndarray) -> np.ndarray:
        """Measured position, joint side [rad]."""
        return self.position / gear_ratio if self.side == "motor" else self.position

    def motor_position(self, gear_ratio: np.ndarray) -> np.ndarray:
        """Measured position, motor side [rad]."""
        return self.position * gear_ratio if self.side == "joint" else self.position

    def commanded(self, gear_ratio: np.ndarray) -> np.ndarray:
        """Commanded position, joint side [rad]; where there is none, the measured one."""
        if self.reference_position is not None:
            return self.reference_position
        return self.joint_position(gear_ratio)

    def derivatives(self, position: np.ndarray) -> np.ndarray:
        """Smoothed position, velocity and acceleration (Savitzky and Golay).

        Args:
            position: Of this recording, shape (samples, n_axes).

        Returns:
            Shape (3, samples, n_axes); of parts shorter than the window, the position and zeros.
        """
        window = max(5, 2 * round(_SMOOTHING / self.sample_period / 2) + 1)
        out = np.zeros((3, *position.shape))
        out[0] = position
        for part in self.parts:
            if part.stop - part.start >= window:
                for order in range(3):
                    out[order, part] = savgol_filter(
                        position[part], window, 3, deriv=order, delta=self.sample_period, axis=0
                    )
        return out


def read_recording(path: str | Path) -> Recording:
    """Read a measured file.

    Args:
        path: HDF5 (``.h5``, ``.hdf5``) or CSV file.

    Returns:
        The recording.

    Raises:
        InputError: The file cannot be read, lacks something, or something has another shape, in
            one line.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        named, attributes = _read_csv(path) if path.suffix == ".csv" else _read_hdf5(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    sides = [side for side in ("motor", "joint") if f"{side}_position" in named]
    if len(sides) != 1:
        has = "both" if sides else "neither"
        raise InputError(f"{path}: needs motor_position or joint_position, has {has}")
    (side,) = sides
    if f"{side}_torque" not in named:
        raise InputError(f"{path}: has {side}_position, but no {side}_torque")
    arrays = {
        "position": named[f"{side}_position"],
        "torque": named[f"{side}_torque"],
        "velocity": named.get(f"{side}_velocity"),
        "reference_position": named.get("reference_position"),
        "temperature": named.get("temperature"),
    }
    return _checked(path, side, arrays, attributes)


def low_passed(recording: Recording, cut_off: float) -> Recording:
    """Filtered, and thinned to the samples that are left: 2.5 of them a period of the cut-off.

    Position and torque get the same filter (Butterworth, 4th order, forward and back), so that they
    stay in step. For recordings without a reference, whose position is followed.

    Args:
        recording: What to filter.
        cut_off: In [Hz]; at 0.4 times the sample rate or above, nothing is done.
    """
    every = int(1 / (2.5 * cut_off * recording.sample_period) + 1e-9)
    if 2.5 * cut_off * recording.sample_period >= 1:
        return recording
    b, a = butter(4, 2 * cut_off * recording.sample_period)

    def filtered(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        parts = [filtfilt(b, a, values[part], axis=0)[::every] for part in recording.parts]
        return np.concatenate(parts)

    position, torque = filtered(recording.position), filtered(recording.torque)
    assert position is not None and torque is not None
    lengths = [len(range(part.start, part.stop, every)) for part in recording.parts]
    return replace(
        recording,
        sample_period=every * recording.sample_period,
        position=position,
        torque=torque,
        velocity=filtered(recording.velocity),
        temperature=filtered(recording.temperature),
        segments=tuple(int(start) for start in np.cumsum([0, *lengths[:-1]])),
    )


def _checked(
    path: Path, side: str, arrays: dict[str, np.ndarray | None], attributes: dict[str, Any]
) -> Recording:
    position = arrays["position"]
    assert position is not None
    if position.ndim != 2 or not position.size:
        raise InputError(f"{path}: {side}_position must have shape (samples, axes)")
    for name, values in arrays.items():
        if values is None:
            continue
        expected = position.shape[:1] if name == "temperature" else position.shape
        if values.shape != expected:
            raise InputError(f"{path}: {name} has shape {values.shape}, expected {expected}")
        if not np.isfinite(values).all():
            first = int(np.argwhere(~np.isfinite(values))[0][0])
            raise InputError(f"{path}: {name} is not finite in sample {first}")
    period = attributes.get("sample_period")
    if period is None or not np.isfinite(period) or period <= 0:
        raise InputError(f"{path}: sample_period must be a positive time in s, not {period}")
    segments = tuple(int(start) for start in np.atleast_1d(attributes.get("segments", 0)))
    ascending = all(a < b for a, b in zip(segments, (*segments[1:], len(position)), strict=True))
    if segments[:1] != (0,) or not ascending:
        raise InputError(
            f"{path}: segments must ascend from 0 to below {len(position)}, not {list(segments)}"
        )
    mass = attributes.get("payload_mass")
    return Recording(
        source=str(path),
        robot=str(attributes.get("robot", "")),
        side=side,
        sample_period=float(period),
        segments=segments,
        payload_mass=None if mass is None else float(mass),
        **arrays,  # type: ignore[arg-type]
    )


def _read_hdf5(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    with h5py.File(path, "r") as file:
        named = {}
        for name, item in file.items():
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
                named[name] = np.asarray(item[()], float)
        return named, dict(file.attrs)


def _read_csv(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    with path.open() as file:
        header = [name.strip() for name in file.readline().split(",")]
    try:
        values = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: not a table of numbers ({error})") from None
    if values.shape[1] != len(header):
        raise InputError(f"{path}: header has {len(header)} names, rows have {values.shape[1]}")
    columns = dict(zip(header, values.T, strict=True))
    if "time" not in columns:
        raise InputError(f"{path}: no column 'time'")
    named: dict[str, np.ndarray] = {}
    if "temperature" in columns:
        named["temperature"] = columns["temperature"]
    for stem in dict.fromkeys(name.rpartition("_")[0] for name in header):
        axes = [columns.get(f"{stem}_{axis}") for axis in range(1, len(header) + 1)]
        numbers = [axis for axis in axes if axis is not None]
        if numbers and all(axis is not None for axis in axes[: len(numbers)]):
            named[stem] = np.stack(numbers, axis=1)
    attributes: dict[str, Any] = {}
    starts = np.zeros(1, int)
    if "segment" in columns:
        starts = np.concatenate([[0], np.flatnonzero(np.diff(columns["segment"])) + 1])
        attributes["segments"] = starts
    attributes["sample_period"] = _sample_period(path, columns["time"], starts)
    return named, attributes


def _sample_period(path: Path, time: np.ndarray, starts: np.ndarray) -> float:
    """Period of evenly sampled times."""
    steps = np.delete(np.diff(time), starts[1:] - 1)
    if not len(steps):
        raise InputError(f"{path}: one sample is not a recording")
    period = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - period) > _UNEVEN * abs(period))
    if period <= 0 or len(uneven):
        row = int(uneven[0]) + 2 if len(uneven) else 2
        raise InputError(
            f"{path}: times must ascend evenly; step {steps[row - 2]:g} s after row {row}, "
            f"{period:g} s elsewhere: resample, or begin a new segment there"
        )
    return period


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording as HDF5.

    Args:
        recording: What to write.
        path: The file.
    """
    side = recording.side
    own = {"position", "torque", "velocity"}
    arrays = {
        f"{side}_{name}" if name in own else name: getattr(recording, name)
        for name in _ARRAYS
        if getattr(recording, name) is not None
    }
    attributes: dict[str, Any] = {
        "robot": recording.robot,
        "sample_period": recording.sample_period,
        "segments": recording.segments,
    }
    if recording.payload_mass is not None:
        attributes["payload_mass"] = recording.payload_mass
    write_arrays(Path(path), arrays, attributes)
