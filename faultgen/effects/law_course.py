"""The variables of a learned law, on the commanded motion of a robot.

They are known before a simulation. `effects.learned` makes curves over them.

course = Course(robot, motor, step, temperature=None, loads=partial(loads, robot))
course.variable("hysteresis", axis=2, scale=0.1).shape  # (steps,)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from faultgen.effects.hooks import Loads, Temperature, course_of
from faultgen.robot import Robot

SMOOTHING = 0.03
"""Window in which speed and acceleration are computed from the commanded position [s]."""

_REST = 0.1  # speed that counts as rest, over the Stribeck velocity
_EVERY = 0.004  # time between two evaluations of the load [s]

UNITS = {
    "speed": "rad/s",
    "abs_speed": "rad/s",
    "acceleration": "rad/s^2",
    "abs_acceleration": "rad/s^2",
    "push": "rad/s^2",
    "load": "N m",
    "abs_load": "N m",
    "joint_angle": "rad",
    "motor_turn": "rad",
    "temperature": "deg C",
    "since_rest": "s",
    "hysteresis": "1",
    "speed_lag": "rad/s",
    "torque_lag": "N m",
}
"""Variables of a law and their units. All belong to the motor side, except for the joint angle."""

SCALED = ("motor_turn", "hysteresis", "speed_lag", "torque_lag")
"""Variables with a further number ``scale``: the period or the reach of the bristles [rad], or the
time constant of a lag [s]."""

FACTORS = ("", "direction", "load")
"""What a curve can be multiplied by. The empty text stands for nothing."""


@dataclass(frozen=True, eq=False)
class Course:
    """The commanded motion of a robot. Arrays have shape (steps, n_axes), motor side."""

    robot: Robot
    """The robot."""
    motor: np.ndarray
    """Motor angle [rad]."""
    step: float
    """Time from one row to the next [s]."""
    temperature: Temperature
    """Gearbox temperature."""
    loads: Loads
    """Inverse dynamics of the robot."""
    cycles: int = 1
    """Number of equal cycles in the motion. The temperature belongs to one of them."""

    @cached_property
    def _derivatives(self) -> list[np.ndarray]:
        from scipy.signal import savgol_filter  # takes a second, so only when needed

        window = max(5, 2 * round(SMOOTHING / self.step / 2) + 1)
        if len(self.motor) < window:
            return [np.zeros_like(self.motor)] * 2
        return [
            savgol_filter(self.motor, window, 3, deriv=order, delta=self.step, axis=0)
            for order in (1, 2)
        ]

    @property
    def speed(self) -> np.ndarray:
        """Motor speed.

        Returns:
            Shape (steps, n_axes), in [rad/s].
        """
        return self._derivatives[0]

    @property
    def acceleration(self) -> np.ndarray:
        """Motor acceleration.

        Returns:
            Shape (steps, n_axes), in [rad/s^2].
        """
        return self._derivatives[1]

    @cached_property
    def direction(self) -> np.ndarray:
        """Direction of motion, smooth through rest.

        Returns:
            Shape (steps, n_axes), from -1 to 1.
        """
        return np.tanh(self.speed / self._still)

    @cached_property
    def _still(self) -> np.ndarray:
        """Speed below which an axis counts as at rest, shape (n_axes,), in [rad/s]."""
        width = self.robot.stribeck_velocity
        return _REST * np.where(width > 0, width, 1.0)

    @cached_property
    def _needed(self) -> tuple[np.ndarray, np.ndarray]:
        every = max(1, round(_EVERY / self.step))
        rows = np.unique(np.append(np.arange(0, len(self.motor), every), len(self.motor) - 1))
        courses = (self.motor, self.speed, self.acceleration)
        told = self.loads(*(self.robot.gearing.joints(x[rows]) for x in courses))
        at = np.arange(len(self.motor))
        load, torque = (
            np.stack([np.interp(at, rows, one) for one in part.T], axis=1) for part in told
        )
        return load, torque

    @property
    def load(self) -> np.ndarray:
        """Torque of the rigid arm.

        Returns:
            Shape (steps, n_axes), in [N m].
        """
        return self._needed[0]

    @property
    def torque(self) -> np.ndarray:
        """Torque that the model's motors need.

        Returns:
            Shape (steps, n_axes), in [N m].
        """
        return self._needed[1]

    def variable(self, over: str, axis: int, scale: float) -> np.ndarray:
        """Compute one of the variables `UNITS`.

        Args:
            over: Its name.
            axis: Axis, from 1.
            scale: The further number of the variables `SCALED`. Others do not use it.

        Returns:
            Shape (steps,), in the unit of the variable.
        """
        k = axis - 1
        if over == "joint_angle":
            return np.asarray(self.motor[:, k] / self.robot.gear_ratio[k])
        if over == "motor_turn":
            return np.mod(self.motor[:, k], scale)
        if over == "push":  # positive where the axis becomes faster
            return np.asarray(self.acceleration[:, k] * np.sign(self.speed[:, k]))
        if over == "temperature":
            return self._temperatures(axis)
        if over == "since_rest":
            return self._since_rest(k)
        if over == "hysteresis":
            return self._bristle(k, scale)
        if over.endswith("_lag"):
            value = (self.speed if over == "speed_lag" else self.torque)[:, k]
            return value - self._lagged(value, scale)
        value = getattr(self, over.removeprefix("abs_"))[:, k]
        return np.abs(value) if over.startswith("abs_") else value

    def factor(self, times: str, axis: int) -> np.ndarray:
        """Compute one of the factors `FACTORS`.

        Args:
            times: Its name.
            axis: Axis, from 1.

        Returns:
            Shape (steps,).
        """
        if not times:
            return np.ones(len(self.motor))
        return np.asarray((self.direction if times == "direction" else self.load)[:, axis - 1])

    def _temperatures(self, axis: int) -> np.ndarray:
        if self.temperature is None:
            return np.full(len(self.motor), self.robot.friction_temperature)
        if not isinstance(self.temperature, tuple):
            return np.full(len(self.motor), self.temperature)
        times, values = course_of(self.temperature, axis)
        rows = np.arange(len(self.motor)) % (len(self.motor) // self.cycles)
        return np.interp(rows * self.step, times, values)

    def _since_rest(self, k: int) -> np.ndarray:
        """Time since the axis last stood still or turned back; long before the first time."""
        still = np.abs(self.speed[:, k]) < self._still[k]
        still[1:] |= np.diff(np.sign(self.speed[:, k])) != 0
        at = np.arange(len(still))
        last = np.maximum.accumulate(np.where(still, at, -1))
        return np.where(last < 0, at[-1], at - last) * self.step

    def _bristle(self, k: int, reach: float) -> np.ndarray:
        """Deflection of a bristle that slips at its reach, from -1 to 1.

        Source: the stop operator of Prandtl, as in Al-Bender, Lampaert and Swevers (2005).
        """
        moved = np.diff(self.motor[:, k], prepend=self.motor[0, k]) / reach
        out, now = np.empty(len(moved)), 0.0
        for row, delta in enumerate(moved.tolist()):
            now = min(max(now + delta, -1.0), 1.0)
            out[row] = now
        return out

    def _lagged(self, value: np.ndarray, time: float) -> np.ndarray:
        from scipy.signal import lfilter  # takes a second, so only when needed

        keep = math.exp(-self.step / time)
        out = lfilter([1 - keep], [1, -keep], value, zi=[keep * value[0]])[0]
        return np.asarray(out)
