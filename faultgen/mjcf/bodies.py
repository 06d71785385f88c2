"""Which axis moves each body of a model."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np


def moving_axes(model: mujoco.MjModel, joints: Sequence[str]) -> np.ndarray:
    """Find the axis that moves each body: the last one between the base and the body.

    Args:
        model: The compiled model.
        joints: Names of the axes, from the base to the tool.

    Returns:
        Its number from 1, shape (nbody,); 0 for bodies that no axis moves.
    """
    own = {int(model.joint(name).bodyid[0]): k for k, name in enumerate(joints, start=1)}
    found = np.zeros(model.nbody, int)
    for body in range(1, model.nbody):  # parents come first
        found[body] = own.get(body, found[model.body_parentid[body]])
    return found
