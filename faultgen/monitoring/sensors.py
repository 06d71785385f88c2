"""Sensors: the noise that they add to a simulated cycle, and how they round it.

`measure` adds noise to a simulated cycle, so that noise can be drawn again without another
simulation. A preset also states how much temperature and payload vary from cycle to cycle. These
change the motion itself; `faultgen.monitoring.environment` draws them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from faultgen.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Noise and disturbances. Each of them is switched off by the value 0."""

    description: str
    """Description in one line."""
    torque_noise: float = 0.0
    """Standard deviation of the torque noise, as a fraction of the mean |torque| of the axis."""
    torque_correlation: float = 0.0
    """Correlation time of the torque noise [s]; 0 means white noise."""
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

    @property
    def changes_motion(self) -> bool:
        """Whether another seed changes the motion, so that it needs another simulation."""
        return self.temperature_wander > 0 or self.payload_scatter > 0


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


def get_sensors(name: str) -> Sensors:
    """Return a preset of sensors.

    Args:
        name: A name of `SENSORS`.

    Returns:
        The preset.

    Raises:
        InputError: There is no preset of that name.
    """
    if name not in SENSORS:
        raise InputError(f"unknown sensors '{name}': choose {', '.join(SENSORS)}")
    return SENSORS[name]


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
    noise = rng.standard_normal(shape)
    if sensors.torque_correlation > 0:
        memory = np.exp(-sample_period / sensors.torque_correlation)
        noise[1:] *= np.sqrt(1 - memory**2)
        noise = lfilter([1.0], [1.0, -memory], noise, axis=0)
    return sensors.torque_noise * mean_torque * noise


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
    if sensors.torque_noise > 0:
        torque = torque + torque_noise(sensors, torque.shape, mean_torque, sample_period, rng)
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
