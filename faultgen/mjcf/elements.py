"""The elements of a model by their names: those of axis i end with the number i.

A model that was built from another file also states how that file names the joint of axis i, in the
``text`` element ``joint{i}``.
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.errors import InputError

KINDS = {
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
}
"""Types of elements in MuJoCo by the names that are used here."""


def element_ids(model: mujoco.MjModel, kind: str, name: str, n_axes: int) -> np.ndarray:
    """Find the ids of the elements ``name1`` ... ``name{n_axes}``.

    Args:
        model: The compiled model.
        kind: One of `KINDS`.
        name: Name of the elements without the number of the axis.
        n_axes: Number of axes.

    Returns:
        Ids, shape (n_axes,).

    Raises:
        InputError: The model lacks one of the elements.
    """
    names = [f"{name}{axis}" for axis in range(1, n_axes + 1)]
    ids = np.array([mujoco.mj_name2id(model, KINDS[kind], one) for one in names])
    if (ids < 0).any():
        raise InputError(f"no {kind} named '{names[int(np.argmax(ids < 0))]}'")
    return ids


def stated_name(model: mujoco.MjModel, axis: int) -> str:
    """Return the name that the joint of an axis has in the file from which the model was built.

    Args:
        model: The compiled model.
        axis: Axis, from 1.

    Returns:
        The name; empty if the model states none.
    """
    return text_of(model, f"joint{axis}")


def text_of(model: mujoco.MjModel, name: str) -> str:
    """Return the content of a ``text`` element.

    Args:
        model: The compiled model.
        name: Name of the element.

    Returns:
        The text; empty if the model has no such element.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, name)
    if index < 0:
        return ""
    start = model.text_adr[index]
    content = bytes(model.text_data[start : start + model.text_size[index] - 1])
    return content.decode(errors="replace")
