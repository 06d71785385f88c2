"""Links of a robot's rigid arm as plain arrays, read once from the compiled model.

chain = read_chain(load_robot("puma560"))
chain.mass, chain.com, chain.inertia  # by link, payload a body of its own
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from faultgen.robot import Robot
from faultgen.simulation.arm import Arm


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A serial arm. Body frames have the joint axis as z; the payload is the last body."""

    rotation: np.ndarray
    """Frame of link i in that of its parent at zero angle, shape (n_axes, 3, 3)."""
    origin: np.ndarray
    """Origin of link i in its parent's frame, shape (n_axes, 3), in [m]."""
    mass: np.ndarray
    """Of links and payload, shape (n_axes + 1,), in [kg]."""
    com: np.ndarray
    """Centres of mass in their link's frame (payload: the last link's), shape (n_axes + 1, 3)."""
    inertia: np.ndarray
    """About the centres of mass, same frames, shape (n_axes + 1, 3, 3), in [kg m^2]."""
    payload_x: np.ndarray
    """Direction of the payload's x, in the last link's frame, shape (3,)."""
    spring: np.ndarray
    """Balancing springs, shape (springs, 10): link, point, link, point, stiffness, rest length."""
    gravity: np.ndarray
    """In the base frame, shape (3,), in [m/s^2]."""

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return len(self.origin)

    def bodies(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, first moment and inertia about the frame's origin of each link, with payload.

        Returns:
            Shapes (n_axes,), (n_axes, 3), (n_axes, 3, 3), in [kg], [kg m], [kg m^2].
        """
        square = np.einsum("bi,bi->b", self.com, self.com)
        about = np.eye(3) * square[:, None, None] - np.einsum("bi,bj->bij", self.com, self.com)
        inertia = self.inertia + self.mass[:, None, None] * about
        moment = self.mass[:, None] * self.com

        def merged(values: np.ndarray) -> np.ndarray:
            links = values[:-1].copy()
            links[-1] += values[-1]
            return links

        return merged(self.mass), merged(moment), merged(inertia)


def _turned(axis: np.ndarray) -> np.ndarray:
    """A rotation that takes z to the axis."""
    z = axis / np.linalg.norm(axis)
    aside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _matrix(quat: np.ndarray) -> np.ndarray:
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, quat / np.linalg.norm(quat))
    return out.reshape(3, 3)


def read_chain(robot: Robot) -> Chain:
    """Read the arm of a robot.

    Args:
        robot: A robot whose arm is a serial chain of hinges, with a body ``payload``.

    Returns:
        The chain, balancing springs (spatial tendons of two sites) included.
    """
    model = Arm(robot).model
    axes = robot.n_axes
    moving = {int(model.jnt_bodyid[j]): j for j in range(axes)}

    # pose of every body in the frame of the link that carries it (-1: the base)
    link, place, turn = {0: -1}, {0: np.zeros(3)}, {0: np.eye(3)}
    rotation, origin = np.empty((axes, 3, 3)), np.empty((axes, 3))
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        at = place[parent] + turn[parent] @ model.body_pos[body]
        turned = turn[parent] @ _matrix(model.body_quat[body])
        if body not in moving:
            link[body], place[body], turn[body] = link[parent], at, turned
            continue
        joint = moving[body]
        if link[parent] != joint - 1:
            raise ValueError(f"robot {robot.name}: the arm is not a serial chain")
        own = _turned(model.jnt_axis[joint])
        origin[joint] = at + turned @ model.jnt_pos[joint]
        rotation[joint] = turned @ own
        link[body] = joint
        turn[body] = own.T
        place[body] = own.T @ -model.jnt_pos[joint]

    mass, com, inertia = np.zeros(axes + 1), np.zeros((axes + 1, 3)), np.zeros((axes + 1, 3, 3))
    for into in range(axes + 1):
        parts = []
        for body in range(1, model.nbody):
            is_payload = model.body(body).name == "payload"
            if (axes if is_payload else link[body]) != into:
                continue
            at = place[body] + turn[body] @ model.body_ipos[body]
            axis = turn[body] @ _matrix(model.body_iquat[body])
            parts.append(
                (model.body_mass[body], at, axis @ np.diag(model.body_inertia[body]) @ axis.T)
            )
        mass[into] = sum(part[0] for part in parts)
        com[into] = sum(part[0] * part[1] for part in parts) / mass[into]
        for m, at, tensor in parts:
            arm = at - com[into]
            inertia[into] += tensor + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))

    springs = []
    for tendon in range(model.ntendon):
        start = model.tendon_adr[tendon]
        ends = []
        for wrap in (start, start + 1):
            site = model.wrap_objid[wrap]
            body = int(model.site_bodyid[site])
            ends += [float(link[body]), *(place[body] + turn[body] @ model.site_pos[site])]
        springs.append(
            [*ends, model.tendon_stiffness[tendon], model.tendon_lengthspring[tendon, 0]]
        )
    return Chain(
        rotation=rotation,
        origin=origin,
        mass=mass,
        com=com,
        inertia=inertia,
        payload_x=turn[model.body("payload").id][:, 0],
        spring=np.array(springs).reshape(-1, 10),
        gravity=np.array(model.opt.gravity),
    )
