"""What the drives see of an arm: inertias and weight over many poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

GRAVITY = 9.81
"""Acceleration with which weights are compared, however the arm is mounted [m/s^2]."""


@dataclass(frozen=True)
class Seen:
    """What the drive of one axis sees of the arm, with payload, over many poses. Joint side."""

    slide: bool
    """Whether the axis slides."""
    most: float
    """Largest inertia about the axis [kg m^2]; the mass [kg] of a slide."""
    least: float
    """Smallest inertia."""
    gravity: float
    """Largest torque that holds the arm against gravity [N m]."""
    weight: float = 0.0
    """Largest torque of the weight of all that the axis carries, if it lay horizontally [N m]; 0
    for slides."""
    arm_weight: float = 0.0
    """The largest such torque of all axes of the arm [N m]."""
    stated: Mapping[str, float] = field(default_factory=dict)
    """What the plain model states, by name: some of `faultgen.building.plain.STATED_UNITS`."""
    disbelief: str = ""
    """Why the torque limit that the plain model states is not used; empty if it is."""


@dataclass(frozen=True)
class Loads:
    """Inertias and weight about each axis over many poses."""

    inertia: np.ndarray
    """Shape (n_poses, n_axes), in [kg m^2], or [kg] for slides."""
    gravity: np.ndarray
    """Torque that holds the arm, shape (n_poses, n_axes), in [N m] or [N]."""
    weight: np.ndarray
    """Largest torque of the weight of all that the axis carries, if it lay horizontally, shape
    (n_axes,), in [N m]; 0 for slides."""


def mass_from(model: mujoco.MjModel, body: int) -> float:
    """Return the mass of a link and of all that it carries, without the body ``payload`` [kg].

    Args:
        model: The compiled arm.
        body: Number of the link.
    """
    payload = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    mass = float(model.body_subtreemass[body])
    return mass - (float(model.body_subtreemass[payload]) if payload >= 0 else 0.0)


def loads(model: mujoco.MjModel, poses: np.ndarray, back: np.ndarray | None = None) -> Loads:
    """Look at an arm in many poses.

    Args:
        model: The compiled arm, which has no other joints than its axes.
        poses: Joint positions, shape (n_poses, n_axes), in [rad] or [m].
        back: How the joints turn with the outputs of the gearboxes, shape (n_axes, n_axes).
            Default: as they do.

    Returns:
        What the outputs of the gearboxes see.
    """
    data = mujoco.MjData(model)
    back = np.eye(model.nv) if back is None else back
    hinge = model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)
    carried = model.body_subtreemass[model.jnt_bodyid]
    inertia, gravity, lever = np.empty((3, *poses.shape))
    for k, pose in enumerate(poses):
        data.qpos[:], data.qvel[:] = pose, 0.0
        mujoco.mj_forward(model, data)
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        inertia[k] = np.diag(back.T @ matrix @ back)
        gravity[k] = back.T @ (data.qfrc_bias - data.qfrc_passive)
        away = data.subtree_com[model.jnt_bodyid] - data.xanchor
        lever[k] = np.linalg.norm(np.cross(data.xaxis, away), axis=1)
    weight = np.where(hinge, GRAVITY * carried * lever.max(axis=0), 0.0)
    return Loads(inertia, gravity, weight)
