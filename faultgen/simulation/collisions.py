"""Collisions of an arm with itself and with the floor, by MuJoCo's collision detection.

    space = Collisions(load_robot("puma560"))
    space.is_free(pose), space.touching(pose)

The shapes of a link are those that the model lets collide; a link that has none counts with its
visible shapes. A mesh counts as its convex hull. Links that are joined by an axis may touch, and so
may pairs of links, or of a link and the floor, that touch in more than half of all poses, because
then their shapes are larger than the links, as in many wrists. A payload may touch the floor.
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.mjcf.bodies import moving_axes
from faultgen.mjcf.rotors import delete_drives
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.robot import Robot

_ALWAYS = 0.5  # share of random poses in which a pair touches that is no collision: assumed
_POSES = 200  # random poses in which pairs are looked at
_FREE_TURN, _FREE_SLIDE = np.pi, 1.0  # joint positions where the model has no range
FEWEST_FREE = 0.01
"""Share of free poses below which the shapes of a model are of no use: assumed."""

_DEEPEST = 1e-3  # depth of a contact that still counts as touching and not as a collision [m]
_SOLID = (
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_CYLINDER,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)

FLOOR, FLOOR_GEOM = "floor", "floor of the search for collisions"
"""Name of the floor in a pair that touches, and of its shape in the model."""

_LANDS = 2  # bit of the shapes that must not touch the floor


class Collisions:
    """Which poses of an arm are free of collisions.

    Args:
        robot: The robot.
        floor: Height of the floor above the origin of the world, against gravity [m]. None: there
            is no floor.
    """

    def __init__(self, robot: Robot, floor: float | None = None) -> None:
        self._model = _shaped(robot, floor)
        self._data = mujoco.MjData(self._model)
        self._links = _links(self._model, robot.n_axes)
        low, high = robot.joint_range.T
        free = np.where(robot.slides, _FREE_SLIDE, _FREE_TURN)
        low, high = np.where(np.isfinite(low), low, -free), np.where(np.isfinite(high), high, free)
        self._usual: frozenset[tuple[int, int]] = frozenset()
        self._drawn = np.random.default_rng(0).uniform(low, high, (_POSES, robot.n_axes))
        counts: dict[tuple[int, int], int] = {}
        for pose in self._drawn:
            for pair in self._pairs(pose):
                counts[pair] = counts.get(pair, 0) + 1
        self._usual = frozenset(p for p, count in counts.items() if count >= _ALWAYS * _POSES)

    def touching(self, pose: np.ndarray) -> list[tuple[str, str]]:
        """Return what collides in a pose.

        Args:
            pose: Joint positions, shape (n_axes,), in [rad] or [m].

        Returns:
            Pairs: the numbers of the axes that move the links, from 0 for the base, and "floor".
        """
        names = {-1: FLOOR, 0: "base"}
        pairs = sorted(self._pairs(pose))
        return [(names.get(a, f"link {a}"), names.get(b, f"link {b}")) for a, b in pairs]

    def is_free(self, pose: np.ndarray) -> bool:
        """Tell whether nothing collides in a pose.

        Args:
            pose: Joint positions, shape (n_axes,), in [rad] or [m].
        """
        return not self._pairs(pose)

    def share_free(self) -> float:
        """Return the share of random poses in which nothing collides."""
        return float(np.mean([self.is_free(pose) for pose in self._drawn]))

    def _pairs(self, pose: np.ndarray) -> set[tuple[int, int]]:
        """Pairs of links that collide: numbers of their axes, 0 the base, -1 the floor."""
        model, data = self._model, self._data
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        contact = data.contact
        deep = contact.dist < -_DEEPEST
        links = self._links[contact.geom[deep]]
        found = set()
        for one, other in np.unique(np.sort(links, axis=1), axis=0).tolist():
            if other - one > 1 and (one, other) not in self._usual:
                found.add((one, other))
        return found


def _shaped(robot: Robot, floor: float | None) -> mujoco.MjModel:
    """The rigid arm, in which the shapes of all links can collide."""
    spec = robot.spec()
    delete_drives(spec, robot.n_axes)
    with mujoco_warnings():
        model = spec.compile()
    kind = np.isin(model.geom_type, [int(one) for one in _SOLID])
    can = kind & ((model.geom_contype > 0) | (model.geom_conaffinity > 0))
    of = model.body_weldid[model.geom_bodyid]
    for link in np.unique(of):
        if not can[of == link].any():  # visible shapes only
            can |= kind & (of == link)
    payload = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    for geom in list(spec.geoms):
        on_payload = model.geom_bodyid[geom.id] == payload
        geom.contype = 0 if not can[geom.id] else 1 if on_payload else 1 | _LANDS
        geom.conaffinity = int(can[geom.id])
        geom.margin = geom.gap = 0.0
    if floor is not None:
        down = np.array(model.opt.gravity)
        size = float(np.linalg.norm(down))
        up = -down / size if size > 0 else np.array([0.0, 0.0, 1.0])
        plane = spec.worldbody.add_geom(
            name=FLOOR_GEOM, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=floor * up
        )
        plane.alt.zaxis = up
        plane.contype, plane.conaffinity = 0, _LANDS
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    with mujoco_warnings():
        return spec.compile()


def _links(model: mujoco.MjModel, n_axes: int) -> np.ndarray:
    """Number of the axis that moves each geom, 0 for the base, -1 for the floor, shape (ngeom,)."""
    found = moving_axes(model, [f"joint{k + 1}" for k in range(n_axes)])[model.geom_bodyid]
    is_floor = [model.geom(geom).name == FLOOR_GEOM for geom in range(model.ngeom)]
    return np.where(is_floor, -1, found)
