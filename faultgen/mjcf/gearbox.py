"""Torque of gearboxes, computed from their twist.

The law is eq. 6.2a of the thesis, extended by a dead band (backlash) and by polynomial terms of
stiffness and damping.
"""

from __future__ import annotations

import mujoco
import numpy as np


class Gearbox:
    """The torque law of some gearboxes of a model.

    Args:
        model: The compiled model of the robot.
        gearbox: Ids of the gearboxes' tendons, shape (gearboxes,).
    """

    def __init__(self, model: mujoco.MjModel, gearbox: np.ndarray) -> None:
        low, high = model.tendon_lengthspring[gearbox].T
        self._band = (low, high) if np.any(low) or np.any(high) else None
        self.stiffness = model.tendon_stiffness[gearbox]
        """Linear stiffness, shape (gearboxes,), in [N m/rad]."""
        self._damping = model.tendon_damping[gearbox]
        self._stiffer = _powers(model.tendon_stiffnesspoly[gearbox], 2)
        self._damper = _powers(model.tendon_dampingpoly[gearbox], 1)

    def torque(self, twist: np.ndarray, twist_rate: np.ndarray) -> np.ndarray:
        """Compute the torque of the gearboxes on the joints.

        Args:
            twist: q_motor / n - q_joint, shape (samples, gearboxes), in [rad].
            twist_rate: Rate of change of the twist, same shape, in [rad/s].

        Returns:
            Torque, shape (samples, gearboxes), in [N m].
        """
        stretch = twist if self._band is None else twist - np.clip(twist, *self._band)
        torque = self.stiffness * stretch
        for power, coefficient in self._stiffer:
            torque = torque + coefficient * stretch**power
        damping = self._damping * twist_rate
        for power, coefficient in self._damper:
            damping = damping + coefficient * twist_rate * np.abs(twist_rate) ** power
        return torque + damping


def _powers(polynomial: np.ndarray, first: int) -> list[tuple[int, np.ndarray]]:
    """Power and coefficients of the terms that are not zero."""
    return [(k, c) for k, c in enumerate(polynomial.T, start=first) if np.any(c)]
