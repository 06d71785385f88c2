"""What each joint of an arm moves up to the next joint, as one rigid body.

A rigid body is a 4x4 matrix (pseudo-inertia), the integral of x x' over its mass with x = (place,
1): [[S, h], [h', m]], S = tr(I)/2 - I, with the mass m, h = m times the centre, and the inertia I
about the origin of the frame. Bodies add up as these matrices do, and a change T of the frame turns
P into T P T'.
Source: Wensing, Kim, Slotine 2018, IEEE Robotics and Automation Letters 3(1), 60-67.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from faultgen.mjcf.bodies import moving_axes
from faultgen.mjcf.rotations import matrix_of

PAYLOAD = "payload"
"""Name of the body that is not counted as part of the last link."""


def pseudo_inertia(mass: float, centre: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Return a rigid body as a matrix.

    Args:
        mass: Mass [kg].
        centre: Centre of mass [m], shape (3,).
        inertia: Inertia about the centre of mass [kg m^2], shape (3, 3).

    Returns:
        Shape (4, 4).
    """
    second = np.trace(inertia) / 2 * np.eye(3) - inertia + mass * np.outer(centre, centre)
    first = mass * np.asarray(centre)[:, None]
    return np.block([[second, first], [first.T, np.array([[mass]])]])


def rigid_body(matrix: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre of mass and inertia about it of a rigid body.

    Args:
        matrix: From `pseudo_inertia`, shape (4, 4).

    Returns:
        Mass [kg], centre of shape (3,) in [m], inertia of shape (3, 3) in [kg m^2].
    """
    mass = float(matrix[3, 3])
    centre = matrix[:3, 3] / mass
    second = matrix[:3, :3] - mass * np.outer(centre, centre)
    return mass, centre, np.trace(second) * np.eye(3) - second


def is_possible(matrix: np.ndarray) -> bool:
    """Tell whether a rigid body can exist: a positive mass, and inertias that a mass can have.

    Args:
        matrix: From `pseudo_inertia`, shape (4, 4).
    """
    if matrix[3, 3] <= 0:
        return False
    _, _, inertia = rigid_body(matrix)
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] > 0 and moments[0] + moments[1] >= moments[2] * (1 - 1e-9))


def own_bodies(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Return every body of a model as a matrix in its own frame.

    Args:
        model: The compiled model.

    Returns:
        Shape (4, 4) by name of the body.
    """
    found = {}
    for body in range(1, model.nbody):
        turned = matrix_of(model.body_iquat[body])
        inertia = turned @ np.diag(model.body_inertia[body]) @ turned.T
        matrix = pseudo_inertia(float(model.body_mass[body]), model.body_ipos[body], inertia)
        found[model.body(body).name] = matrix
    return found


def lumps(
    model: mujoco.MjModel,
    joints: Sequence[str],
    own: Mapping[str, np.ndarray],
    pose: np.ndarray | None = None,
) -> list[np.ndarray]:
    """Return what each joint moves up to the next one, without the payload.

    Args:
        model: The compiled model.
        joints: Names of the axes, from the base to the tool.
        own: Each body in its own frame, from `own_bodies`.
        pose: Positions of all joints, shape (nq,). Default: those of the model.

    Returns:
        One matrix for each axis, shape (4, 4), in the frame of the body of its joint.
    """
    data = mujoco.MjData(model)
    if pose is not None:
        data.qpos[:] = pose
    mujoco.mj_kinematics(model, data)
    links = [int(model.joint(name).bodyid[0]) for name in joints]
    found = [np.zeros((4, 4)) for _ in joints]
    for body, axis in enumerate(moving_axes(model, joints)):
        name = model.body(body).name
        if axis and name != PAYLOAD:
            change = np.linalg.inv(_frame(data, links[axis - 1])) @ _frame(data, body)
            found[axis - 1] += change @ own[name] @ change.T
    return found


def rest_pose(model: mujoco.MjModel) -> np.ndarray:
    """Return where joints that are no axes were locked.

    Args:
        model: The compiled model.

    Returns:
        Positions of all joints, shape (nq,): those of the keyframe ``home``; without it, those of
        the model, within the limits.
    """
    home = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "home")
    if home >= 0:
        return np.array(model.key_qpos[home])
    pose = model.qpos0.copy()
    for joint in np.flatnonzero(model.jnt_limited):
        at = model.jnt_qposadr[joint]
        pose[at] = np.clip(pose[at], *model.jnt_range[joint])
    return pose


def _frame(data: mujoco.MjData, body: int) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return frame


def differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Tell whether two rigid bodies differ by more than rounding.

    Args:
        one: From `pseudo_inertia`, shape (4, 4).
        other: The same of the other one.
    """
    return bool(np.abs(one - other).max() > 1e-9 * max(np.abs(one).max(), np.abs(other).max()))
