"""What a simulated cycle holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cycle:
    """What happened in one cycle, free of noise. Arrays have shape (samples, n_axes), SI units."""

    motor_position: np.ndarray
    """[rad], motor side."""
    motor_velocity: np.ndarray
    """[rad/s], motor side."""
    motor_torque: np.ndarray
    """Torque of the drive, which a controller logs [N m]."""
    friction_torque: np.ndarray
    """Friction on the rotor, against the motion [N m]."""
    gear_torque: np.ndarray
    """Torque of the gearbox on the joint, arm side [N m]."""
    joint_position: np.ndarray
    """[rad], arm side."""
    joint_velocity: np.ndarray
    """[rad/s], arm side."""
