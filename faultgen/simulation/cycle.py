"""The channels of one simulated cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cycle:
    """What happened in one cycle, without noise. Every array has shape (samples, n_axes)."""

    motor_position: np.ndarray
    """Angle of the rotors [rad]."""
    motor_velocity: np.ndarray
    """Velocity of the rotors [rad/s]."""
    motor_torque: np.ndarray
    """Torque of the drives, which a controller logs [N m]."""
    friction_torque: np.ndarray
    """Friction torque on the rotors, against the motion [N m]."""
    gear_torque: np.ndarray
    """Torque of the gearboxes on the joints [N m]."""
    joint_position: np.ndarray
    """Angle of the joints [rad]."""
    joint_velocity: np.ndarray
    """Velocity of the joints [rad/s]."""
