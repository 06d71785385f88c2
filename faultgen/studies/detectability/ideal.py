"""The ideal detector: a matched filter that knows how an effect changes the logged signals.

It weighs the change of every sample by the noise, and does not see what healthy cycles at other
temperatures, with other payloads and after other cycles look like. No detector that gets the same
logs can do better, as long as noise and changes are normally distributed (Kay, Fundamentals of
Statistical Signal Processing II, 1998, section 4.4).

    view = View(name="torque", sensors=sensors)
    ideal = matched_filter(view, robot, healthy, drawn, mean_torque, step=0.001)
    ideal.distance(worn - healthy)        # d': change over its standard deviation, of one cycle
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from scipy.stats import norm

from faultgen.errors import InputError
from faultgen.monitoring.autoregression import amplification
from faultgen.monitoring.sensors import Sensors, torque_growth
from faultgen.robot import Robot

LOGGED = 8
"""Cycles that are logged in a day: assumed. A cycle every three hours."""

BASELINE = 120
"""Healthy cycles with which a robot is compared."""

FALSE_ALARM = 1 / 30
"""Probability of a false alarm on a day: one a month."""

DETECTED = 0.95
"""Share of days on which a detectable fault gives an alarm."""

NEEDED = float(norm.isf(FALSE_ALARM) + norm.ppf(DETECTED))
"""Distance d' of the mean of a day that is detected at these rates."""


@dataclass(frozen=True, kw_only=True)
class View:
    """What is logged, and how well."""

    name: str
    """Name in tables."""
    sensors: Sensors
    """Noise and disturbances."""
    sample_period: float = 0.004
    """Time between logged samples [s]."""
    encoder: bool = False
    """Whether the motors' positions are logged beside their torques."""
    finer: float = 1.0
    """Counts of the encoder over those of the robot."""
    thermometer: bool = True
    """Whether the temperature of the gearboxes is measured."""

    @property
    def knows_temperature(self) -> bool:
        """Whether a measured temperature tells more than the mean."""
        return self.thermometer and self.sensors.temperature_error < self.sensors.temperature_wander


@dataclass(frozen=True, eq=False)
class MatchedFilter:
    """Noise and disturbances of one robot, task and view."""

    every: int
    """Every so many-th simulated sample is logged."""
    torque_noise: np.ndarray
    """Standard deviation of the noise of each logged torque, shape (samples, n_axes), in [N m]."""
    feedback: list[np.ndarray]
    """Coefficients of the autoregression of the torque noise of each axis."""
    amplification: list[float]
    """Standard deviation of this noise over that of its innovations, for each axis."""
    position_noise: np.ndarray
    """Standard deviation of each logged motor position, shape (n_axes,), in [rad]; 0 where none is
    logged."""
    basis: np.ndarray
    """Whitened changes whose outer products add up to the covariance of the disturbances, shape
    (changes, samples)."""

    def whiten(self, change: np.ndarray) -> np.ndarray:
        """Divide a change by the noise, so that noise alone has a standard deviation of 1.

        Args:
            change: Change of position [rad], velocity [rad/s] and torque [N m] of the motors, shape
                (3, simulated samples, n_axes).

        Returns:
            Shape (whitened samples,), without unit.
        """
        logged = change[:, :: self.every]
        parts = []
        for axis in range(logged.shape[2]):
            own = self.feedback[axis]
            level = self.torque_noise[:, axis]
            if (level > 0).all():
                white = lfilter([1.0, *(-own)], [1.0], logged[2, :, axis] / level)[len(own) :]
                parts.append(white * self.amplification[axis])
            if self.position_noise[axis] > 0:
                parts.append(logged[0, :, axis] / self.position_noise[axis])
        return np.concatenate(parts) if parts else np.zeros(0)

    def distance(self, change: np.ndarray) -> float:
        """Compute d' of a change in one logged cycle.

        Args:
            change: As for `whiten`.

        Returns:
            Change over its standard deviation along the best direction.
        """
        x = self.whiten(change)
        if not len(self.basis):
            return float(np.sqrt(x @ x))
        return float(np.sqrt(max(x @ self.weighed(x), 0.0)))

    def weighed(self, x: np.ndarray) -> np.ndarray:
        """Divide a whitened change by the covariance of noise and disturbances.

        Args:
            x: Whitened change, shape (whitened samples,).

        Returns:
            Weights of the best statistic for this change, shape (whitened samples,).
        """
        inner = np.eye(len(self.basis)) + self.basis @ self.basis.T
        return x - self.basis.T @ np.linalg.solve(inner, self.basis @ x)


def of_day(distance: float) -> float:
    """Return d' of the mean of a day against the healthy baseline, from d' of one cycle."""
    return distance / float(np.sqrt(1 / LOGGED + 1 / BASELINE))


def matched_filter(
    view: View,
    robot: Robot,
    healthy: np.ndarray,
    disturbances: Sequence[np.ndarray],
    mean_torque: np.ndarray,
    *,
    step: float,
) -> MatchedFilter:
    """Prepare the ideal detector of one robot, task and view.

    Args:
        view: What is logged.
        robot: The robot.
        healthy: A healthy cycle: position [rad], velocity [rad/s] and torque [N m] of the motors,
            shape (3, samples, n_axes).
        disturbances: Changes by what differs from cycle to cycle, each of the same shape. The sum
            of their outer products is the covariance: each is either independent of all others and
            of one standard deviation, or one of n drawn changes, divided by the root of n.
        mean_torque: Mean |torque| of each axis in the nominal cycle, shape (n_axes,), in [N m].
        step: Time between simulated samples [s].

    Returns:
        The detector.

    Raises:
        InputError: The sensors have no torque noise, so that everything could be detected.
    """
    sensors, n_axes = view.sensors, robot.n_axes
    level = np.broadcast_to(np.asarray(sensors.torque_noise, float), (n_axes,))
    if not (level > 0).all():
        raise InputError(
            "study detectability: the sensors have no torque noise; choose thesis, realistic or a "
            "sensors file with torque_noise"
        )
    every = max(1, round(view.sample_period / step))
    logged = healthy[:, ::every]
    growth = torque_growth(sensors, logged[1], logged[2])
    position = np.zeros(n_axes)
    if view.encoder:
        counts = robot.encoder_counts * view.finer
        rounded = np.where(counts > 0, 2 * np.pi / np.where(counts > 0, counts, 1.0), 0.0)
        rounded = rounded / np.sqrt(12) if sensors.quantised else 0 * rounded
        position = np.hypot(rounded, sensors.position_noise * np.abs(robot.gear_ratio))
    feedback = _feedback(sensors, n_axes, every * step)
    bare = MatchedFilter(
        every,
        np.broadcast_to(level * mean_torque * growth, logged[2].shape),
        feedback,
        [amplification(own) for own in feedback],
        position,
        np.zeros((0, 0)),
    )
    if not len(disturbances):
        return bare
    return replace(bare, basis=np.array([bare.whiten(change) for change in disturbances]))


def _feedback(sensors: Sensors, n_axes: int, period: float) -> list[np.ndarray]:
    """The autoregression of the torque noise of each axis."""
    if sensors.torque_colour:
        return [np.array(own) for own in sensors.torque_colour]
    times = np.broadcast_to(np.asarray(sensors.torque_correlation, float), (n_axes,)).tolist()
    return [np.array([np.exp(-period / time)]) if time > 0 else np.zeros(0) for time in times]
