"""Torque of the arm as a linear function of the inertial parameters of its links.

torque = Y(q, q', q'') p, where p holds ten parameters for each link and for the payload: mass [kg],
first moment m c [kg m] in x, y, z, and the moments of inertia xx, yy, zz, xy, xz, yz [kg m^2].
Moments are about the origin of the body's frame, along its axes. MuJoCo computes the motion of the
frames, so that the regressor belongs to exactly the kinematics of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from faultgen.effects.structure import MASSLESS
from faultgen.mjcf.rotations import matrix_of
from faultgen.simulation.arm import Arm

PER_LINK = 10
"""Number of inertial parameters of a link."""

_MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def link_ids(arm: Arm) -> list[int]:
    """Return the ids of the bodies with parameters in the rigid arm.

    They are the links by the number of their joint, and then the payload if it has a mass.
    """
    model = arm.model
    ids = [int(model.joint(f"joint{k + 1}").bodyid[0]) for k in range(arm.robot.n_axes)]
    payload = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    return ids + [payload] * bool(payload >= 0 and model.body_mass[payload] >= MASSLESS)


def link_parameters(arm: Arm) -> np.ndarray:
    """Read the inertial parameters of all links from the model.

    Args:
        arm: The rigid arm.

    Returns:
        Shape (10 bodies,), in the order and units of the top of this module.
    """
    model = arm.model
    found = []
    for body in link_ids(arm):
        frame, centre = matrix_of(model.body_iquat[body]), model.body_ipos[body]
        mass = model.body_mass[body]
        inertia = frame @ np.diag(model.body_inertia[body]) @ frame.T
        inertia += mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        found.append([mass, *(mass * centre), *(inertia[k] for k in _MOMENTS)])
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Motion of the frames of all bodies of `link_ids`, in their own axes."""

    velocity: np.ndarray
    """Angular [rad/s] before linear [m/s], shape (samples, bodies, 6)."""
    acceleration: np.ndarray
    """The same, with gravity: what a body would feel. In [rad/s^2] and [m/s^2]."""
    jacobian: np.ndarray
    """Velocity per velocity of each joint, shape (samples, bodies, 6, n_axes)."""

    def regressor(self) -> np.ndarray:
        """Project the wrenches of unit parameters onto the joints.

        Returns:
            Shape (samples, n_axes, 10 bodies), as from `link_regressor`.
        """
        samples, bodies, _, n = self.jacobian.shape
        wrench = _wrench(self.velocity, self.acceleration)
        torque = np.swapaxes(self.jacobian, 2, 3) @ np.swapaxes(wrench, 2, 3)
        return np.swapaxes(torque, 1, 2).reshape(samples, n, bodies * PER_LINK)


def link_regressor(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Compute the joint torque for each unit of each inertial parameter.

    Args:
        arm: The rigid arm.
        q: Joint angle, shape (samples, n_axes), in [rad].
        qd: Joint velocity, same shape, in [rad/s].
        qdd: Joint acceleration, same shape, in [rad/s^2].

    Returns:
        Shape (samples, n_axes, 10 bodies). The torque of the whole arm is the product with
        `link_parameters`, plus that of springs and of other bodies that are fixed to a link.
    """
    return link_motion(arm, q, qd, qdd).regressor()


def link_motion(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> LinkMotion:
    """Compute the motion of all links.

    Args:
        arm: The rigid arm.
        q: Joint angle, shape (samples, n_axes), in [rad].
        qd: Joint velocity, same shape, in [rad/s].
        qdd: Joint acceleration, same shape, in [rad/s^2].
    """
    model, bodies = arm.model, link_ids(arm)
    data, count = mujoco.MjData(model), len(q)
    place, turned = np.empty((count, len(bodies), 3)), np.empty((count, len(bodies), 9))
    # as MuJoCo states them: angular before linear, at the centre of mass of the whole arm
    velocity, acceleration = np.empty((2, count, len(bodies), 6))
    axes, centre = np.empty((count, model.nv, 6)), np.empty((count, 3))
    root = model.body_rootid[bodies[0]]
    for k in range(count):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)  # accelerations, those of gravity included
        place[k], turned[k] = data.xpos[bodies], data.xmat[bodies]
        velocity[k], acceleration[k] = data.cvel[bodies], data.cacc[bodies]
        axes[k], centre[k] = data.cdof, data.subtree_com[root]
    lever = place - centre[:, None]
    moves = np.array([_joints_before(model, body) for body in bodies])
    shared = np.where(moves[:, :, None], axes[:, None], 0.0)  # (samples, bodies, joints, 6)
    frame = turned.reshape(count, len(bodies), 3, 3)

    def at_body(spatial: np.ndarray, arm: np.ndarray) -> np.ndarray:
        moved = spatial[..., 3:] + np.cross(spatial[..., :3], arm)
        return np.concatenate([spatial[..., :3], moved], axis=-1)

    speed = at_body(velocity, lever)
    felt = at_body(acceleration, lever)
    felt[..., 3:] += np.cross(speed[..., :3], speed[..., 3:])  # of the point, not of space
    own = [
        np.concatenate([vectors[..., :3] @ frame, vectors[..., 3:] @ frame], axis=-1)
        for vectors in (speed[:, :, None], felt[:, :, None], at_body(shared, lever[:, :, None]))
    ]
    return LinkMotion(own[0][:, :, 0], own[1][:, :, 0], np.swapaxes(own[2], 2, 3))


def _joints_before(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Which degrees of freedom move a body, shape (nv,)."""
    moves = np.zeros(model.nv, bool)
    while body:
        first = model.body_dofadr[body]
        moves[first : first + model.body_dofnum[body]] = model.body_dofnum[body] > 0
        body = model.body_parentid[body]
    return moves


def gear_regressor(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Compute the torque of each gearbox for each unit of each inertial parameter.

    It is that of the joints, unless a gearbox also turns with another joint.

    Args:
        arm: The rigid arm.
        q: Joint angle, shape (samples, n_axes), in [rad].
        qd: Joint velocity, same shape, in [rad/s].
        qdd: Joint acceleration, same shape, in [rad/s^2].

    Returns:
        Shape (samples, n_axes, 10 bodies), joint side, as from `link_regressor`.
    """
    to_gears = arm.robot.gearing.torque(np.eye(arm.robot.n_axes))
    return np.asarray(np.einsum("sjp,ji->sip", link_regressor(arm, q, qd, qdd), to_gears))


def _wrench(velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Compute the Newton-Euler wrench of unit parameters.

    Returns:
        Moment before force, shape (samples, bodies, 10, 6).
    """
    rate, turn, push = velocity[..., :3], acceleration[..., :3], acceleration[..., 3:]
    unit = np.eye(3)
    wrench = np.zeros((*rate.shape[:-1], PER_LINK, 6))
    wrench[..., 0, 3:] = push
    for k in range(3):
        arm = unit[k]
        force = np.cross(turn, arm) + np.cross(rate, np.cross(rate, arm))
        wrench[..., 1 + k, 3:] = force
        wrench[..., 1 + k, :3] = np.cross(arm, push)
    for k, (i, j) in enumerate(_MOMENTS):
        moment = np.zeros((3, 3))
        moment[i, j] = moment[j, i] = 1.0
        wrench[..., 4 + k, :3] = turn @ moment + np.cross(rate, rate @ moment)
    return wrench
