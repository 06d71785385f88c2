"""Hourly torque samples of a robot on a one-minute task, as in thesis 3.4.

Torque is sampled every ten seconds in the first ten minutes of an hour: ten cycles at six places.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from faultgen.errors import InputError
from faultgen.evaluation.features import Features
from faultgen.evaluation.methods import Setting
from faultgen.evaluation.wear_model import Directions, turning_axes, wear_points, wear_slopes
from faultgen.monitoring.environment import surroundings
from faultgen.monitoring.sensors import Sensors
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.surrogate import Surrogate
from faultgen.tasks import load_task

SAMPLE_PERIOD = 10.0
"""Time between samples of a one-minute task [s]."""

_MINUTE = 60.0  # a cycle begins every minute [s]
_PLACES = 6  # of a cycle, at which it is sampled

_CYCLES_SAMPLED = 10
_CYCLES_AN_HOUR = 60


@dataclass(frozen=True, eq=False)
class HourlyTorque:
    """Torque samples of some hours."""

    torque: np.ndarray
    """Motor torque, shape (hours, samples, n_axes), in [N m]."""
    temperature: np.ndarray
    """Measured gearbox temperature, mean of each hour, shape (hours,), in [deg C]."""

    @property
    def places(self) -> np.ndarray:
        """Mean torque of each hour at each place of the cycle, shape (hours, places * n_axes)."""
        hours, samples, n_axes = self.torque.shape
        by_cycle = self.torque.reshape(hours, _CYCLES_SAMPLED, samples // _CYCLES_SAMPLED, n_axes)
        return by_cycle.mean(axis=1).reshape(hours, -1)

    def features(self, divergence: np.ndarray) -> Features:
        """Return the features of each hour.

        Args:
            divergence: Kullback-Leibler divergence of each hour, shape (hours, n_axes), in [bit].

        Returns:
            The features by name; arrays have shape (cycles, ...).
        """
        return {
            "kl_divergence": divergence,
            "torque_by_place": self.places,
            "mean_abs_torque": np.abs(self.torque).mean(axis=1),
            "motor_torque": self.torque,
            "temperature": self.temperature,
        }


HOURLY = ("kl_divergence", "torque_by_place", "mean_abs_torque", "motor_torque", "temperature")
"""Names of the features of an hour."""


@dataclass(frozen=True, eq=False)
class HourlyMonitored:
    """A robot and a one-minute task."""

    surrogate: Surrogate
    """Cycles free of noise, sampled every ten seconds."""
    reference: float
    """Gearbox temperature at which the model's friction holds [deg C]."""
    directions: Directions
    """Change of `HourlyTorque.places` with the severity of each axis."""
    turning: np.ndarray
    """Axes that turn at some sample of the cycle. The friction of the others cannot be observed.
    Shape (n_axes,)."""

    def setting(self, *, temperature_varies: bool) -> Setting:
        """Return what detectors may know before they see data.

        Args:
            temperature_varies: Whether the temperature varies.

        Returns:
            The setting.
        """
        return Setting(
            n_axes=self.surrogate.n_axes,
            samples=_CYCLES_SAMPLED * self.surrogate.nodes.shape[2],
            temperature_varies=temperature_varies,
            reference_temperature=self.reference,
            directions={"torque_by_place": self.directions},
            turning=self.turning,
        )

    def record(
        self, sensors: Sensors, severity: np.ndarray, rng: np.random.Generator
    ) -> HourlyTorque:
        """Record consecutive hours.

        Args:
            sensors: Noise and disturbance. Samples are ten seconds apart, so that the torque noise
                of each is independent whatever its correlation time.
            severity: In each hour, shape (hours, n_axes).
            rng: Source of randomness.

        Returns:
            The record.
        """
        hours, n_axes = severity.shape
        rng_surroundings, rng_noise = rng.spawn(2)
        around = surroundings(sensors, hours * _CYCLES_AN_HOUR, self.reference, rng_surroundings)
        first = np.arange(hours)[:, None] * _CYCLES_AN_HOUR
        sampled = (first + np.arange(_CYCLES_SAMPLED)).ravel()
        weights = self.surrogate.weights(
            around.temperature[sampled],
            around.payload_factor[sampled],
            np.repeat(severity, _CYCLES_SAMPLED, axis=0),
        )
        nodes = self.surrogate.nodes[:, 2]
        torque = (weights @ nodes.reshape(len(nodes), -1)).reshape(hours, -1, n_axes)
        noise = rng_noise.standard_normal(torque.shape)
        return HourlyTorque(
            torque=torque + sensors.torque_noise * self.surrogate.mean_torque * noise,
            temperature=around.measured_temperature[sampled].reshape(hours, -1).mean(axis=1),
        )


def sample_period(robot: str, task: str) -> float:
    """Choose the time between samples, so that each cycle is sampled at six places.

    Args:
        robot: Name of the robot, or path of an MJCF file.
        task: Name of the task, or path of a task file.

    Returns:
        Time between samples [s], a multiple of the robot's time step: 10 s for a task of one
        minute. A shorter task is repeated every minute, too, and sampled while it runs.

    Raises:
        InputError: There is no such robot or task, or the task takes longer than one minute.
    """
    model = load_robot(robot)
    period = plan(load_task(model.name, task), model).period
    if period > _MINUTE + SAMPLE_PERIOD / 2:
        raise InputError(
            f"study detection: a cycle begins every minute, but task {task} takes {period:.1f} s; "
            "give a shorter task"
        )
    if abs(period - _MINUTE) < SAMPLE_PERIOD / 2:
        return SAMPLE_PERIOD
    timestep = model.model.opt.timestep
    return float(np.ceil(period / _PLACES / timestep) * timestep)


@lru_cache(maxsize=4)
def hourly_monitored(path: Path) -> HourlyMonitored:
    """Load a robot and task from the file of its surrogate."""
    surrogate = Surrogate.load(path)
    robot = load_robot(surrogate.robot_path)
    cycles = surrogate.at(wear_points(robot, surrogate.effect))
    _, nominal, *_ = cycles
    places = np.stack([cycle[2].ravel() for cycle in cycles])
    return HourlyMonitored(
        surrogate=surrogate,
        reference=robot.friction_temperature,
        directions=wear_slopes(places[1:]),
        turning=turning_axes(robot, nominal[1]),
    )
