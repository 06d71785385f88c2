"""Measured data of a robot: what is read from a file, and in which units.

HDF5 with attributes ``robot`` and ``sample_period`` and arrays of shape (sample, axis), or CSV with
a header of the same names and suffixes _1 to _n:

    motor_position [rad], motor_torque [N m]        motor side, or else
    joint_position [rad], joint_torque [N m]        joint side (m and N for slides)
    motor_current [A]                               instead of the torque, on either side
    motor_velocity or joint_velocity [rad/s], reference_position [rad, joint side]: optional
    temperature [deg C], shape (sample,) or (sample, axis): optional

Attributes ``segments`` (start of each separate recording in the file), ``payload_mass`` [kg],
``torque_sensor`` ("link" for sensors behind the gearbox) and ``date`` (ISO 8601) are optional.
``time`` [s], shape (sample,), may stand instead of the period; a CSV file has it as a column, and
may have ``segment``. Uneven times are resampled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultgen.errors import InputError
from faultgen.importing import arranged, load_map, map_of, table_of_frame
from faultgen.recordings.fields import fields_of
from faultgen.system.arrays import write_arrays
from faultgen.system.dates import in_words

if TYPE_CHECKING:
    import pandas as pd

    from faultgen.robot import Robot

OPTIONAL = ("velocity", "reference_position", "temperature")
"""Arrays that a recording may lack."""

ARRAYS = ("position", "torque", *OPTIONAL)
"""All arrays that files hold; the samples come first in each."""

_SMOOTHING = 0.06  # window of the derivatives [s]


@dataclass(frozen=True, eq=False)
class TorqueConstants:
    """By how much torque follows from the current of each motor."""

    constant: np.ndarray
    """Motor torque over current, shape (n_axes,), in [N m/A]."""
    offset: np.ndarray
    """Current without torque, shape (n_axes,), in [A]."""
    source: str
    """Recording from which they were found."""

    def contract(self) -> list[dict[str, float]]:
        """Return the numbers of each axis, as result files have them."""
        return [
            {"axis": axis, "constant": float(constant), "offset": float(offset)}
            for axis, (constant, offset) in enumerate(
                zip(self.constant, self.offset, strict=True), start=1
            )
        ]

    def __str__(self) -> str:
        each = ", ".join(
            "axis {axis} {constant:.4g} N m/A with {offset:.3g} A at no torque".format(**one)
            for one in self.contract()
        )
        return f"torque constants found from {self.source}: {each}"


@dataclass(frozen=True)
class LogFault:
    """An effect of the catalogue that is seen in the log of one axis, whatever the arm does."""

    effect: str
    """Name."""
    axis: int
    """From 1."""
    severity: float
    """In the unit of the effect."""
    interval: tuple[float, float]
    """Interval that contains the severity with 95 % probability."""

    def contract(self, gap: float) -> dict[str, Any]:
        """Return the fault as an effect of ``discovery.json``.

        Args:
            gap: Relative torque error of the model with all that was found.
        """
        from faultgen.effects import get_effect

        return {
            "effect": self.effect,
            "axis": self.axis,
            "parameters": {"severity": self.severity, "unit": get_effect(self.effect).unit},
            "interval": {"severity": list(self.interval)},
            "confidence": 1.0,
            "gap_after": gap,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A recording, motor side or joint side. Arrays have shape (samples, n_axes)."""

    source: str
    """Name of the file or other origin, for messages."""
    robot: str
    """Name of the robot as stated in the file. May be empty."""
    side: str
    """'motor' or 'joint'."""
    sample_period: float
    """Time between samples [s]."""
    position: np.ndarray
    """[rad], or [m] for slides."""
    torque: np.ndarray
    """[N m], or [N] for slides."""
    velocity: np.ndarray | None = None
    """[rad/s], or None if it was not measured."""
    reference_position: np.ndarray | None = None
    """Commanded position, joint side [rad]."""
    temperature: np.ndarray | None = None
    """Gearbox temperature, shape (samples,) or (samples, n_axes), in [deg C]."""
    segments: tuple[int, ...] = (0,)
    """First sample of each separate recording, ascending from 0."""
    payload_mass: float | None = None
    """[kg], if known."""
    date: float | None = None
    """When it began [s since 1970], if it was stated."""
    link: bool = False
    """Whether the torque was measured by sensors behind the gearbox. Otherwise it is that of the
    motor, on the joint side times the gear ratio. Only on the joint side."""
    current: bool = False
    """Whether `torque` holds motor currents [A], which `motor_current` converts."""
    constants: TorqueConstants | None = None
    """Constants with which the torque was found from motor currents; None if it was measured."""
    notes: tuple[str, ...] = ()
    """One line for each thing that was done to the data when they were read."""
    lost: np.ndarray | None = None
    """Samples that were lost, which are not used, shape (samples, n_axes); None if there are none.
    They hold interpolated values."""
    faults: tuple[LogFault, ...] = ()
    """Faults of the log that were found when it was read."""
    torque_factor: tuple[float, ...] = ()
    """Factor with which the logged torque of each axis was multiplied when the recording was
    accepted; empty before that."""
    left_out: tuple[int, ...] = ()
    """Axes, from 1, whose torque is not used. All of their samples are among those `lost`."""

    def __repr__(self) -> str:
        """One line; the arrays would fill the screen."""
        return (
            f"<Recording {self.source}: {self.side} side, {len(self.position)} samples of "
            f"{self.n_axes} axes, every {self.sample_period:g} s, {len(self.segments)} segments>"
        )

    @classmethod
    def planned(cls, robot: Robot, ways: Sequence[np.ndarray], sample_period: float) -> Recording:
        """Make a recording of motions whose torque is not yet known.

        Args:
            robot: The robot.
            ways: Position of the joints in each motion, shape (samples, n_axes) each, in [rad].
            sample_period: Time between samples [s].

        Returns:
            The motions as separate recordings, motor side, with a torque of 0.
        """
        way = np.concatenate(ways)
        return cls(
            source="plan",
            robot=robot.name,
            side="motor",
            sample_period=sample_period,
            position=robot.gearing.outputs(way) * robot.gear_ratio,
            torque=np.zeros_like(way),
            reference_position=way,
            segments=tuple(int(n) for n in np.cumsum([0, *(len(one) for one in ways[:-1])])),
        )

    @classmethod
    def from_dataframe(
        cls,
        frame: pd.DataFrame,
        mapping: Mapping[str, Any] | str | Path,
        *,
        source: str = "data frame",
    ) -> Recording:
        """Make a recording of a table whose columns a map describes; see docs/importing.md.

        Args:
            frame: A row for each sample. An index with a name is a column too.
            mapping: The content of a map file, or its path. Its entry `preset` may name a preset.
            source: Name of the recording, for messages.

        Returns:
            The recording in SI units, brought to even times.

        Raises:
            InputError: The map is wrong, or does not fit the table. The message is one line.
        """
        given = map_of(mapping) if isinstance(mapping, Mapping) else load_map(mapping)
        made = arranged(table_of_frame(frame, source), given)
        return cls(**fields_of(source, made.named, made.attributes))

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return self.position.shape[1]

    @property
    def parts(self) -> list[slice]:
        """Samples of each separate recording."""
        ends = [*self.segments[1:], len(self.position)]
        return [slice(start, end) for start, end in zip(self.segments, ends, strict=True)]

    @property
    def axis_temperature(self) -> np.ndarray | None:
        """Temperature of the gearbox of each axis; None if it was not measured.

        Returns:
            Shape (samples, n_axes), in [deg C].
        """
        if self.temperature is None or self.temperature.ndim == 2:
            return self.temperature
        return np.broadcast_to(self.temperature[:, None], self.position.shape)

    def joint_position(self, robot: Robot) -> np.ndarray:
        """Return the measured position on the joint side.

        Args:
            robot: The model, for its gearboxes.

        Returns:
            Position, shape (samples, n_axes), in [rad].
        """
        return robot.gearing.joints(self.position) if self.side == "motor" else self.position

    def motor_position(self, robot: Robot) -> np.ndarray:
        """Return the measured position on the motor side.

        Args:
            robot: The model, for its gearboxes.

        Returns:
            Position, shape (samples, n_axes), in [rad].
        """
        if self.side == "motor":
            return self.position
        return robot.gearing.outputs(self.position) * robot.gear_ratio

    def commanded(self, robot: Robot) -> np.ndarray:
        """Return the commanded position on the joint side; the measured one if none was recorded.

        Args:
            robot: The model, for its gearboxes.

        Returns:
            Position, shape (samples, n_axes), in [rad].
        """
        if self.reference_position is not None:
            return self.reference_position
        return self.joint_position(robot)

    def on_motor_side(self, robot: Robot) -> Recording:
        """Convert a recording of a robot whose gearboxes also turn with other joints.

        The torque of such a joint belongs to several motors. Each axis is compared with the model
        on its own, so that such a recording is used on the motor side.

        Args:
            robot: The model.

        Returns:
            Position, velocity and torque of the motors. Currents stay what they are. The same
            recording if it is on the motor side.

        Raises:
            InputError: The torque was measured behind the gearbox.
        """
        if self.side == "motor":
            return self
        if self.link:
            raise InputError(
                f"{self.source}: its torque was measured behind the gearboxes; in {robot.name}, "
                "they also turn with other joints, and then only the torque of the motors can be "
                "compared"
            )
        gearing, ratio = robot.gearing, robot.gear_ratio
        velocity = self.velocity
        spread = (gearing.matrix != 0) | (np.linalg.inv(gearing.matrix).T != 0)
        return replace(
            self,
            side="motor",
            position=self.motor_position(robot),
            velocity=None if velocity is None else gearing.outputs(velocity) * ratio,
            torque=self.torque if self.current else gearing.torque(self.torque) / ratio,
            lost=None if self.lost is None else self.lost @ spread.T,
        )

    def derivatives(self, position: np.ndarray) -> np.ndarray:
        """Compute smoothed position, velocity and acceleration (Savitzky and Golay).

        Args:
            position: Position of this recording, shape (samples, n_axes).

        Returns:
            Shape (3, samples, n_axes), in the unit of the position, and this unit over [s] and
            [s^2]. Parts that are shorter than the window have the position itself and zeros.
        """
        from scipy.signal import savgol_filter

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


def mean_of(recordings: Sequence[Recording]) -> Recording:
    """Average recordings of the same motions.

    Args:
        recordings: At least one; all of the same shape.

    Returns:
        The mean. It has the optional arrays that all recordings have.
    """
    first = recordings[0]
    if len(recordings) == 1:
        return first

    def mean(name: str) -> np.ndarray | None:
        arrays = [getattr(one, name) for one in recordings]
        return None if any(one is None for one in arrays) else np.mean(arrays, axis=0)

    source = f"mean of {len(recordings)} recordings"
    return replace(first, source=source, **{name: mean(name) for name in ARRAYS})  # type: ignore[arg-type]


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording as HDF5.

    Args:
        recording: The recording to write.
        path: The file.
    """
    side = recording.side
    own = {"position", "torque", "velocity"}
    arrays = {
        f"{side}_{name}" if name in own else name: getattr(recording, name)
        for name in ARRAYS
        if getattr(recording, name) is not None
    }
    if recording.current:
        arrays["motor_current"] = arrays.pop(f"{side}_torque")
    attributes: dict[str, Any] = {
        "robot": recording.robot,
        "sample_period": recording.sample_period,
        "segments": recording.segments,
    }
    if recording.link:
        attributes["torque_sensor"] = "link"
    if recording.payload_mass is not None:
        attributes["payload_mass"] = recording.payload_mass
    if recording.date is not None:
        attributes["date"] = in_words(recording.date)
    write_arrays(Path(path), arrays, attributes)
