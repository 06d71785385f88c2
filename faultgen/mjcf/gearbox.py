"""Torque of gearboxes from their twist: thesis eq. 6.2a with dead band and polynomials."""

from __future__ import annotations

import mujoco
import numpy as np


class Gearbox:
    """The law of some gearboxes of a model, read once.

    Args:
        model: The robot as simulated.
        gearbox: Tendon ids, shape (gearboxes,).
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
        """Torque on the joints.

        Args:
            twist: q_motor / n - q_joint, shape (samples, gearboxes), in [rad].
            twist_rate: Its rate, same shape, in [rad/s].

        Returns:
            Torque, same shape, in [N m].
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
    """Power and coefficients of the terms that are there."""
    return [(k, c) for k, c in enumerate(polynomial.T, start=first) if np.any(c)]
