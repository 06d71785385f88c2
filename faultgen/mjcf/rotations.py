"""Rotations as MuJoCo stores them."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike


def matrix_of(quaternion: ArrayLike) -> np.ndarray:
    """Return the rotation matrix of a quaternion.

    Args:
        quaternion: w, x, y, z, shape (4,).

    Returns:
        Shape (3, 3).
    """
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array(quaternion, float))
    return matrix.reshape(3, 3)
