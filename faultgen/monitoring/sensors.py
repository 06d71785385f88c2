"""Sensors: the noise that they add to a simulated cycle, and how they round it.

`measure` adds noise to a simulated cycle, so that noise can be drawn again without another
simulation. A preset also states how much temperature and payload vary from cycle to cycle. These
change the motion itself; `faultgen.monitoring.environment` draws them.

Sensors can also be a TOML file, whose entries are the fields of `Sensors`. `faultgen twin` writes
such a file with what it has learned from recordings of a robot.
"""

from __future__ import annotations

import hashlib
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from faultgen.errors import InputError, objection
from faultgen.monitoring.autoregression import amplification
from faultgen.system.reading import read_text

FILE = "sensors.toml"
"""Name of the file with its own sensors in a robot's folder."""

_LARGEST = 256.0  # sum of |coefficients| that no steady torque colour of eight coefficients has
_SETTLING = 512  # samples after which a coloured noise no longer depends on its start


@checked(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class Remainder:
    """Torque that a model lacks on one task, by place in the cycle, learned from recordings.

    It is what remains after replay, averaged over recordings. It is only valid for the motion from
    which it was learned.
    """

    task_sha256: str
    """Hash of that task, as run files have it."""
    sample_period: float
    """Time between the values [s]."""
    torque: list[list[float]]
    """Torque of each motor at each place, shape (places, n_axes), in [N m]."""


@checked(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class Sensors:
    """Noise and disturbances. Each of them is switched off by the value 0."""

    description: str
    """Description in one line."""
    torque_noise: float | list[float] = 0.0
    """Standard deviation of the torque noise, as a fraction of the mean |torque| of the axis: one
    number, or one for each axis."""
    torque_correlation: float | list[float] = 0.0
    """Correlation time of the torque noise [s]; 0 means white noise. One number, or one for each
    axis."""
    torque_colour: list[list[float]] = field(default_factory=list)
    """Coefficients of an autoregression for each axis, which replaces `torque_correlation`. They
    hold for `sample_period`."""
    torque_growth: list[list[float]] = field(default_factory=list)
    """Growth of the variance of the torque noise with |motor speed| and |torque|, each divided by
    its mean in the cycle, for each axis; such as [[0.5, 0.2], [0.0, 0.0]]."""
    sample_period: float | None = None
    """Sample period for which the file was made [s]. `faultgen generate` uses it."""
    position_noise: float = 0.0
    """Standard deviation of the measured joint angle, joint side [rad]."""
    velocity_noise: float = 0.0
    """Standard deviation of the measured joint velocity, joint side [rad/s]."""
    quantised: bool = False
    """Whether motor position is rounded to encoder counts, and velocity is their difference."""
    temperature_wander: float = 0.0
    """Standard deviation of the gearbox temperature from cycle to cycle [K]."""
    temperature_memory: float = 30.0
    """Correlation time of the temperature [cycles]."""
    temperature_error: float = 0.0
    """Standard deviation of the temperature sensor's error [K]."""
    payload_scatter: float = 0.0
    """Standard deviation of the payload's mass from cycle to cycle, as a fraction of the mass."""
    run_to_run: Mapping[str, list[float]] = field(default_factory=dict)
    """Standard deviation with which the healthy robot differs from cycle to cycle, as the severity
    of effects: for each effect, one number for each axis. Each cycle stands for a recording of
    another day."""
    remainder: Remainder | None = None
    """Torque that the model lacks on one task."""

    @property
    def changes_motion(self) -> bool:
        """Whether another seed changes the motion, so that it needs another simulation."""
        return self.temperature_wander > 0 or self.payload_scatter > 0 or bool(self.run_to_run)

    def check_axes(self, n_axes: int, where: str) -> None:
        """Refuse sensors that were made for another number of axes.

        Args:
            n_axes: Number of axes of the robot.
            where: Name of the sensors, for the message.

        Raises:
            InputError: An entry has values for another number of axes.
        """
        given = {
            name: getattr(self, name)
            for name in ("torque_noise", "torque_correlation", "torque_colour", "torque_growth")
        }
        given |= dict(self.run_to_run)
        if self.remainder is not None:
            given["remainder"] = self.remainder.torque[0]
        for name, values in given.items():
            if isinstance(values, list) and values and len(values) != n_axes:
                raise InputError(
                    f"sensors {where}: {name} has values for {len(values)} axes, but the robot has "
                    f"{n_axes}"
                )

    def missing_torque(
        self, task_sha256: str, samples: int, sample_period: float
    ) -> np.ndarray | None:
        """Return the torque that the model lacks on a task.

        Args:
            task_sha256: Hash of the task.
            samples: Number of samples in a cycle.
            sample_period: Time between them [s].

        Returns:
            Shape (samples, n_axes), in [N m]; None if it was learned on another task.
        """
        if self.remainder is None or self.remainder.task_sha256 != task_sha256:
            return None
        known = np.array(self.remainder.torque)
        places = np.arange(len(known)) * self.remainder.sample_period
        times = np.arange(samples) * sample_period
        return np.stack([np.interp(times, places, column) for column in known.T], axis=1)

    def to_toml(self) -> str:
        """Return the content of a sensors file."""
        entries = {k: v for k, v in asdict(self).items() if v not in (None, [], {}, 0.0, False)}
        return tomli_w.dumps(entries)

    @property
    def sha256(self) -> str:
        """Hash of the content."""
        return hashlib.sha256(self.to_toml().encode()).hexdigest()


_FORM = TypeAdapter(Sensors)

SENSORS = {
    "none": Sensors(description="what the simulation holds, sampled"),
    "thesis": Sensors(
        description="thesis 3.3.2: white torque disturbance of 1 % of the mean torque, "
        "encoder noise of 1e-4 rad at the joint",
        torque_noise=0.01,
        position_noise=1e-4,
        velocity_noise=1e-4 / 0.5,
    ),
    "realistic": Sensors(
        description="encoder counts, coloured torque noise, gearbox temperature and payload "
        "that change from cycle to cycle",
        torque_noise=0.01,
        torque_correlation=0.02,
        quantised=True,
        temperature_wander=4.0,
        temperature_error=0.5,
        payload_scatter=0.01,
    ),
}
"""The presets by name. The numbers of `realistic` are assumed, except for the payload's 1 %."""


def sensors_of(robots: Sequence[str]) -> str | None:
    """Find the sensors file in the folder of a robot.

    Args:
        robots: Names of robots, or paths of their files or folders.

    Returns:
        The path of the file; None if there are several robots or if theirs has no such file.
    """
    own = [Path(robot) / FILE for robot in robots]
    return str(own[0]) if len(own) == 1 and own[0].is_file() else None


def get_sensors(name_or_path: str | Path) -> Sensors:
    """Return a preset of sensors, or read a sensors file.

    Args:
        name_or_path: A name of `SENSORS`, or the path of a sensors file (TOML).

    Returns:
        The sensors.

    Raises:
        InputError: There is no preset of that name and no such file, or the file is wrong.
    """
    name = str(name_or_path)
    if name in SENSORS:
        return SENSORS[name]
    if not os.path.exists(name):
        raise InputError(
            f"unknown sensors '{name}': choose {', '.join(SENSORS)}, or give the path of a sensors "
            "file"
        )
    return parse_sensors(read_text(name, "sensors file"), name)


def parse_sensors(text: str, where: str) -> Sensors:
    """Read the text of a sensors file.

    Args:
        text: The text.
        where: Name of the file, for messages.

    Returns:
        The sensors.

    Raises:
        InputError: The text is not valid, an entry is unknown, or a value is impossible.
    """
    try:
        content: dict[str, Any] = tomllib.loads(text)
        found: Sensors = _FORM.validate_python({"description": f"file {where}", **content})
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"sensors file {where}: not valid TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        entry = ".".join(str(part) for part in first["loc"][:2])
        said = objection(first["type"], first["msg"])
        raise InputError(f"sensors file {where}: {entry}: {said}") from None
    if not content:
        entries = ", ".join(name for name in asdict(found) if name != "description")
        raise InputError(f"sensors file {where}: has no entry; it may have {entries}")
    _check_numbers(found, where)
    return found


def _check_numbers(found: Sensors, where: str) -> None:
    """Refuse numbers that are negative, not finite, or make no steady noise."""
    for name, value in asdict(found).items():
        parts = value.items() if isinstance(value, dict) else [(name, value)]
        for part, inner in parts:
            if inner is None or isinstance(inner, str | bool):
                continue
            numbers = np.asarray(inner, float)
            signed = name in ("torque_colour", "remainder")
            if not np.isfinite(numbers).all() or (not signed and (numbers < 0).any()):
                raise InputError(
                    f"sensors file {where}: {part} must be finite"
                    + ("" if signed else " and not negative")
                )
    for axis, own in enumerate(found.torque_colour, start=1):
        if np.abs(own).sum() > _LARGEST or (np.abs(np.roots([1, *(-np.array(own))])) >= 1).any():
            raise InputError(
                f"sensors file {where}: torque_colour of axis {axis} is no steady noise"
            )


def torque_noise(
    sensors: Sensors,
    shape: tuple[int, int],
    mean_torque: np.ndarray,
    sample_period: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draw the noise of the logged torque of one cycle.

    Args:
        sensors: The preset.
        shape: Number of samples and of axes.
        mean_torque: Mean |torque| of each axis in the nominal cycle, shape (n_axes,), in [N m].
        sample_period: Time between samples [s].
        rng: Random number generator.

    Returns:
        Noise, shape (samples, n_axes), in [N m].
    """
    from scipy.signal import lfilter  # takes a second, so only when needed

    if sensors.torque_colour:
        noise = _coloured(sensors, shape, sample_period, rng)
        return np.asarray(sensors.torque_noise) * mean_torque * noise
    noise = rng.standard_normal(shape)
    times = np.broadcast_to(np.asarray(sensors.torque_correlation, float), shape[1:])
    for axis in np.flatnonzero(times > 0):
        memory = np.exp(-sample_period / times[axis])
        noise[1:, axis] *= np.sqrt(1 - memory**2)
        noise[:, axis] = lfilter([1.0], [1.0, -memory], noise[:, axis])
    return np.asarray(sensors.torque_noise) * mean_torque * noise


def _coloured(
    sensors: Sensors, shape: tuple[int, int], sample_period: float, rng: np.random.Generator
) -> np.ndarray:
    """Draw autoregressive noise with a standard deviation of 1, shape (samples, n_axes)."""
    from scipy.signal import lfilter  # takes a second, so only when needed

    own = sensors.sample_period
    if own is not None and abs(own - sample_period) > 1e-9:
        raise InputError(
            f"sensors: torque_colour was learned at a sample period of {own:g} s, and the "
            f"experiment has {sample_period:g} s; set sample_period = {own:g}"
        )
    noise = rng.standard_normal((_SETTLING + shape[0], shape[1]))
    for axis, coefficients in enumerate(sensors.torque_colour):
        feedback = [1.0, *(-np.array(coefficients))]
        noise[:, axis] = lfilter([1.0], feedback, noise[:, axis]) / amplification(coefficients)
    return noise[_SETTLING:]


def torque_growth(sensors: Sensors, velocity: np.ndarray, torque: np.ndarray) -> np.ndarray | float:
    """Compute how the torque noise grows with speed and load.

    Args:
        sensors: The preset.
        velocity: Motor velocity, shape (samples, n_axes), in [rad/s].
        torque: Motor torque, same shape, in [N m].

    Returns:
        Factor of each sample, same shape, or 1. Its mean square over the cycle is 1.
    """
    if not sensors.torque_growth:
        return 1.0
    by_speed, by_load = np.array(sensors.torque_growth).T
    variance = np.ones(torque.shape)
    for weight, driver in ((by_speed, np.abs(velocity)), (by_load, np.abs(torque))):
        variance += weight * driver / np.maximum(driver.mean(axis=0), 1e-300)
    return np.asarray(np.sqrt(variance / variance.mean(axis=0)))


@dataclass(frozen=True)
class Measured:
    """What the controller logs in one cycle. Every array has shape (samples, n_axes)."""

    motor_position: np.ndarray
    """Angle of the rotors [rad]."""
    motor_velocity: np.ndarray
    """Velocity of the rotors [rad/s]."""
    motor_torque: np.ndarray
    """Torque of the drives [N m]."""


def measure(
    sensors: Sensors,
    position: np.ndarray,
    velocity: np.ndarray,
    torque: np.ndarray,
    *,
    gear_ratio: np.ndarray,
    encoder_counts: np.ndarray,
    mean_torque: np.ndarray,
    sample_period: float,
    rng: np.random.Generator,
) -> Measured:
    """Measure a simulated cycle.

    Args:
        sensors: The preset.
        position: Motor position, shape (samples, n_axes), in [rad].
        velocity: Motor velocity, same shape, in [rad/s].
        torque: Motor torque, same shape, in [N m].
        gear_ratio: Rotor turns per joint turn, shape (n_axes,).
        encoder_counts: Encoder counts per motor turn, shape (n_axes,); 0 means no quantisation.
        mean_torque: Mean |torque| of each axis in the nominal cycle, shape (n_axes,), in [N m].
        sample_period: Time between samples [s].
        rng: Random number generator.

    Returns:
        The measured cycle. Arrays to which the preset adds nothing are the arrays that were given.
    """
    ratio = np.abs(gear_ratio)
    if np.any(np.asarray(sensors.torque_noise) > 0):
        noise = torque_noise(sensors, torque.shape, mean_torque, sample_period, rng)
        torque = torque + noise * torque_growth(sensors, velocity, torque)
    if sensors.velocity_noise > 0:
        noise = rng.standard_normal(velocity.shape)
        velocity = velocity + sensors.velocity_noise * ratio * noise
    if sensors.position_noise > 0:
        position = position + sensors.position_noise * ratio * rng.standard_normal(position.shape)
    if sensors.quantised:
        # the sample before the first one is where the motor came from at its speed then
        before = position[:1] - velocity[:1] * sample_period
        count = 2 * np.pi / np.where(encoder_counts > 0, encoder_counts, np.inf)
        with_before = np.concatenate([before, position])
        counted = np.where(
            encoder_counts > 0,
            np.round(with_before / np.where(count > 0, count, 1.0)) * count,
            with_before,
        )
        position = counted[1:]
        velocity = np.diff(counted, axis=0) / sample_period
    return Measured(position, velocity, torque)
