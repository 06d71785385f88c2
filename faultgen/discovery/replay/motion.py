"""What effects on rotors need to know about a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Motion:
    """What effects on the rotors need to know about a motion.

    Arrays have shape (samples, n_axes).
    """

    angle: np.ndarray
    """Of the motors [rad]."""
    speed: np.ndarray
    """Of the motors [rad/s]."""
    acceleration: np.ndarray
    """Of the motors [rad/s^2]."""
    joint: np.ndarray
    """Position of the joints [rad]."""
    gear: np.ndarray
    """Torque of the gearboxes, joint side [N m]."""
    torque: np.ndarray
    """Logged torque of the motors [N m]."""
    rate: np.ndarray
    """Its rate of change [N m/s]."""


def beside(at: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps before and after steps.

    Args:
        at: The steps.
        count: Number of steps that there are.

    Returns:
        Both of the shape of `at`.
    """
    return np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)


def slope(values: np.ndarray, at: np.ndarray, timestep: float) -> np.ndarray:
    """Compute central differences over time at some steps, as those of `numpy.gradient`.

    Args:
        values: Shape (all steps, ...).
        at: The steps, shape (steps,).
        timestep: Time between steps [s].

    Returns:
        Shape (steps, ...), in the unit of the values per second.
    """
    before, after = beside(at, len(values))
    return np.asarray((values[after] - values[before]) / ((after - before)[:, None] * timestep))
