"""The equation of a servo: its torque from set points and from the measured motion.

    torque = kp (r - q) + ki I + kd (s dr/dt - q') + feed-forward torque + constant

with the motor's commanded position r, its measured position q and speed q', the integral I of
r - q, and a constant in each separate recording, which holds what the integral was before. It is
true whatever the arm is. All signals are smoothed by the same filter, which leaves it true.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from faultgen.discovery.replay.replay import settled
from faultgen.mjcf.dcmotor import INTEGRAL_GAIN, POSITION_GAIN, VELOCITY_GAIN
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.servo import feed_forward

_ORDER = 3  # of the splines through commanded positions


def has_equation(recording: Recording) -> bool:
    """Whether a recording has what the equation needs.

    Args:
        recording: The measured data.
    """
    return (
        recording.reference_position is not None
        and recording.side == "motor"
        and not recording.link
    )


@dataclass(frozen=True, eq=False)
class Made:
    """What a servo makes of its signals. Arrays have shape (samples, n_axes); motor side."""

    torque: np.ndarray
    """Its torque without the constants [N m]."""
    rate: np.ndarray
    """Rate of that part of it which comes from the set points [N m/s]."""
    integral: np.ndarray
    """Gain of the integral, shape (n_axes,)."""


class ServoSignals:
    """What the equation is made of. Arrays have shape (samples, n_axes); motor side."""

    def __init__(self, recording: Recording, robot: Robot) -> None:
        """Smooth the signals.

        Args:
            recording: The measured data, see `has_equation`.
            robot: The model.
        """
        assert recording.reference_position is not None
        self.recording = recording
        self.position, self.speed = recording.derivatives(recording.motor_position(robot))[:2]
        self.torque = recording.derivatives(recording.torque / robot.torque_gain)[0]
        self.motion = np.zeros((3, *recording.torque.shape))
        """Commanded joint position, velocity and acceleration, which is not smoothed."""
        for part in recording.parts:
            times = np.arange(part.stop - part.start) * recording.sample_period
            if len(times) > _ORDER:
                spline = make_interp_spline(times, recording.reference_position[part], k=_ORDER)
                self.motion[:, part] = [spline(times, order) for order in range(3)]
        outputs, ratio = robot.gearing.outputs, robot.gear_ratio
        self.wanted = recording.derivatives(outputs(self.motion[0]) * ratio)[0]
        self.rate = recording.derivatives(outputs(self.motion[1]) * ratio)[0]
        self.integral = self._by_part(np.cumsum, self.wanted - self.position)
        self.integral *= recording.sample_period
        self.number = np.zeros(len(self.position), int)
        for number, part in enumerate(recording.parts):
            self.number[part] = number
        inside = settled(recording, robot)
        if recording.lost is not None:
            inside &= ~recording.lost
        self.rows = [np.flatnonzero(inside[:, axis]) for axis in range(robot.n_axes)]
        """Samples of each axis at which the equation is looked at."""

    def of_servo(self, robot: Robot) -> Made:
        """Compute what the servo of a robot makes of the signals.

        Args:
            robot: The robot.
        """
        drives = robot.model.actuator_gainprm[robot.ids("actuator", "drive")]
        kp, ki, kd = drives[:, [POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN]].T
        points = kp * self.wanted + kd * robot.set_points[1] * self.rate
        points += self.recording.derivatives(feed_forward(Arm(robot), *self.motion))[0]
        made = points - kp * self.position - kd * self.speed + ki * self.integral
        return Made(made, self.rate_of(points, ki), ki)

    def rate_of(self, points: np.ndarray, integral: np.ndarray | float) -> np.ndarray:
        """Compute how fast the part of the torque changes that comes from the set points.

        Args:
            points: That part without the integral, shape (samples, n_axes), in [N m].
            integral: Gain of the integral.

        Returns:
            Same shape, in [N m/s].
        """
        rate = self._by_part(np.gradient, points) / self.recording.sample_period
        return rate + integral * self.wanted

    def regress(
        self, axis: int, columns: np.ndarray, target: np.ndarray, rows: np.ndarray | None = None
    ) -> tuple[np.ndarray, float, float]:
        """Fit columns and the constants of each separate recording.

        Args:
            axis: From 0.
            columns: Shape (rows, columns).
            target: Torque that they are to explain, shape (rows,).
            rows: Samples of the axis. Default: all of `rows`.

        Returns:
            The values of the columns, shape (columns,); the RMS of what is left; and the RMS of the
            target, both beyond the constants.
        """
        rows = self.rows[axis] if rows is None else rows
        apart = (self.number[rows, None] == np.unique(self.number[rows])).astype(float)
        mean = apart / apart.sum(axis=0)
        columns, target = (x - apart @ (mean.T @ x) for x in (columns, target))
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        values = np.linalg.lstsq(columns / size, target, rcond=None)[0] / size
        left = np.sqrt(np.mean((target - columns @ values) ** 2))
        return values, float(left), float(np.sqrt(np.mean(target**2)))

    def _by_part(self, what: Callable[..., np.ndarray], values: np.ndarray) -> np.ndarray:
        """A function of time, within each separate recording."""
        out = np.zeros_like(values)
        for part in self.recording.parts:
            if part.stop - part.start > 1:
                out[part] = what(values[part], axis=0)
        return out
