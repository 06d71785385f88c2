"""The torque of a gearbox, from its twist."""

from __future__ import annotations

import mujoco
import numpy as np


def gearbox_torque(
    model: mujoco.MjModel, gearbox: np.ndarray, twist: np.ndarray, twist_rate: np.ndarray
) -> np.ndarray:
    """Torque of gearboxes on their joints, thesis eq. 6.2a with MuJoCo's dead band and polynomials.

    Args:
        model: The robot as simulated.
        gearbox: Tendon ids, shape (n_axes,).
        twist: q_motor / n - q_joint, shape (samples, n_axes), in [rad].
        twist_rate: Its rate, same shape, in [rad/s].

    Returns:
        Torque, shape (samples, n_axes), in [N m].
    """
    low, high = model.tendon_lengthspring[gearbox].T
    stretch = twist - np.clip(twist, low, high)
    stiffness = model.tendon_stiffness[gearbox] * stretch
    for power, coefficient in enumerate(model.tendon_stiffnesspoly[gearbox].T, start=2):
        stiffness = stiffness + coefficient * stretch**power
    damping = model.tendon_damping[gearbox] * twist_rate
    for power, coefficient in enumerate(model.tendon_dampingpoly[gearbox].T, start=1):
        damping = damping + coefficient * twist_rate * np.abs(twist_rate) ** power
    return stiffness + damping
