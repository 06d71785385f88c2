"""What hooks of an effect get: where it acts, and the state of a simulation between two steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import mujoco
import numpy as np

if TYPE_CHECKING:
    from faultgen.robot import Robot

Temperature: TypeAlias = float | tuple[np.ndarray, np.ndarray] | None
"""Gearbox temperature [deg C]: constant, or (times [s] from the start of the control, values); None
for the temperature at which the model's friction holds. The values have shape (times,), or (times,
n_axes) if every axis has its own."""


def course_of(temperature: tuple[np.ndarray, np.ndarray], axis: int) -> tuple[np.ndarray, ...]:
    """Return the course of the temperature of one axis.

    Args:
        temperature: Times [s] and values, see `Temperature`.
        axis: Axis, from 1.

    Returns:
        Times [s] and temperatures [deg C], shape (times,) each.
    """
    times, values = (np.asarray(part, float) for part in temperature)
    return times, values if values.ndim == 1 else values[:, axis - 1]


Loads: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Inverse dynamics of a robot, see `simulation.arm.loads`."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where an effect acts, and its severity. Hooks get it as an argument."""

    robot: Robot
    """The healthy robot."""
    model: mujoco.MjModel
    """The robot with all its effects, compiled."""
    axis: int
    """From 1."""
    severity: float
    """Severity in the unit of the effect, never 0."""
    parameters: Mapping[str, Any]
    """All parameters, including defaults."""
    loads: Loads
    """Function from joint positions [rad], velocities and accelerations to the load of the motors
    and the torque that they need [N m]; all of shape (samples, n_axes)."""

    def element(self, kind: str, name: str) -> int:
        """Return the id in `model` of an actuator or tendon of the axis.

        Args:
            kind: "actuator" or "tendon".
            name: Name without the number of the axis, such as "gearbox".

        Returns:
            The id.
        """
        return int(self.robot.ids(kind, name, self.model)[self.axis - 1])


@dataclass(eq=False)
class Moment:
    """State and friction of nsim simulations between two steps.

    The arrays are those of the simulation. Hooks change `biasprm`, `dynprm` and `damping`, and must
    not change the state. Before the first hook these three have the values of the model.
    """

    time: float
    """Since the start of the cycle [s]; negative in the lead-in."""
    interval: float
    """Until the next call [s]."""
    qpos: np.ndarray
    """Shape (nsim, nq)."""
    qvel: np.ndarray
    """Shape (nsim, nv)."""
    biasprm: np.ndarray
    """mjModel.actuator_biasprm, shape (nsim, nactuator, 10)."""
    dynprm: np.ndarray
    """mjModel.actuator_dynprm, same shape."""
    damping: np.ndarray
    """mjModel.actuator_damping, shape (nsim, nactuator)."""
    control: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))
    """Mean control until the next call, shape (nsim, n_controls). Hooks must not change it."""


Update = Callable[[Moment], None]
"""Function that changes friction parameters between two steps."""
