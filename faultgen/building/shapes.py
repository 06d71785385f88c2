"""Volume, centre and inertia of what the shapes of a link fill together.

Overlapping shapes count once: every shape is sampled on its own, and a point that lies in n shapes
counts 1/n in each of them. The points are a Sobol sequence, so that the result is always the same.
A mesh counts as its convex hull.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

_GEOM = mujoco.mjtGeom
_POINTS, _FEWEST = 16384, 256  # in the box about a shape: of few shapes, and of many
_TESTS = 2**24  # of points against shapes or against faces of a mesh, at once

Inside = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Filled:
    """What shapes fill together, in the frame of the world."""

    volume: float
    """[m^3]"""
    centre: np.ndarray
    """Shape (3,), in [m]."""
    inertia: np.ndarray
    """About the centre, for a density of 1 kg/m^3, shape (3, 3), in [kg m^2]."""


@dataclass(frozen=True)
class _Shape:
    place: np.ndarray  # of its frame, shape (3,)
    turn: np.ndarray  # of its frame, shape (3, 3)
    low: np.ndarray  # corner of the box about it, in its frame, shape (3,)
    high: np.ndarray
    inside: Inside  # whether points in its frame, shape (n, 3), are in it

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether points in the frame of the world, shape (n, 3), are in it."""
        local = (points - self.place) @ self.turn
        found = ((local >= self.low) & (local <= self.high)).all(axis=1)
        found[found] = self.inside(local[found])
        return found


def fill(model: mujoco.MjModel, data: mujoco.MjData, geoms: Sequence[int]) -> Filled | None:
    """Compute what shapes fill together.

    Args:
        model: The compiled model.
        data: Its state, with the places of all shapes.
        geoms: Numbers of the shapes.

    Returns:
        Volume, centre and inertia; None if the shapes have no volume.
    """
    shapes = [one for one in (_shape(model, data, k) for k in geoms) if one is not None]
    if not shapes:
        return None
    count = int(np.clip(_TESTS / len(shapes) ** 2, _FEWEST, _POINTS))
    from scipy.stats import qmc  # takes most of a second to import, and few models need it

    unit = qmc.Sobol(3, scramble=False).random(2 ** int(np.log2(count)))
    points, weights = [], []
    for shape in shapes:
        local = shape.low + unit * (shape.high - shape.low)
        local = local[shape.inside(local)]
        world = local @ shape.turn.T + shape.place
        shared = np.sum([other.holds(world) for other in shapes], axis=0)
        points.append(world)
        # rounding may put a point on the edge of its own shape outside
        weights.append(np.prod(shape.high - shape.low) / len(unit) / np.maximum(shared, 1))
    at, weight = np.vstack(points), np.concatenate(weights)
    volume = float(weight.sum())
    if volume <= 0:
        return None
    centre = weight @ at / volume
    away = at - centre
    second = (away * weight[:, None]).T @ away
    return Filled(volume, centre, np.trace(second) * np.eye(3) - second)


def has_shape(body: mujoco.MjsBody) -> bool:
    """Tell whether a link has a shape that may fill a volume.

    Args:
        body: The link.
    """
    return any(geom.type in _SOLID or geom.type == _GEOM.mjGEOM_MESH for geom in body.geoms)


def _shape(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> _Shape | None:
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom].copy()
    turn, place = data.geom_xmat[geom].reshape(3, 3).copy(), data.geom_xpos[geom].copy()
    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        start = model.mesh_vertadr[mesh]
        corners = np.array(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], float)
        try:
            faces = ConvexHull(corners).equations
        except (QhullError, ValueError):  # flat, or too few corners
            return None
        return _Shape(place, turn, corners.min(axis=0), corners.max(axis=0), _hull(faces))
    if kind not in _SOLID:
        return None
    half, inside = _SOLID[kind](size)
    return None if (half <= 0).any() else _Shape(place, turn, -half, half, inside)


def _hull(faces: np.ndarray) -> Inside:
    def inside(points: np.ndarray) -> np.ndarray:
        at_once = max(_TESTS // len(faces), 1)
        parts = [
            (points[k : k + at_once] @ faces[:, :3].T <= -faces[:, 3]).all(axis=1)
            for k in range(0, len(points), at_once)
        ]
        return np.concatenate([*parts, np.empty(0, bool)])

    return inside


def _box(size: np.ndarray) -> tuple[np.ndarray, Inside]:
    return size, lambda p: np.ones(len(p), bool)


def _sphere(size: np.ndarray) -> tuple[np.ndarray, Inside]:
    return np.full(3, size[0]), lambda p: (p**2).sum(axis=1) <= size[0] ** 2


def _ellipsoid(size: np.ndarray) -> tuple[np.ndarray, Inside]:
    return size, lambda p: ((p / size) ** 2).sum(axis=1) <= 1


def _cylinder(size: np.ndarray) -> tuple[np.ndarray, Inside]:
    half = np.array([size[0], size[0], size[1]])
    return half, lambda p: (p[:, :2] ** 2).sum(axis=1) <= size[0] ** 2


def _capsule(size: np.ndarray) -> tuple[np.ndarray, Inside]:
    half = np.array([size[0], size[0], size[0] + size[1]])

    def inside(points: np.ndarray) -> np.ndarray:
        beyond = np.maximum(np.abs(points[:, 2]) - size[1], 0.0)
        return (points[:, :2] ** 2).sum(axis=1) + beyond**2 <= size[0] ** 2

    return half, inside


_SOLID = {
    _GEOM.mjGEOM_BOX: _box,
    _GEOM.mjGEOM_SPHERE: _sphere,
    _GEOM.mjGEOM_ELLIPSOID: _ellipsoid,
    _GEOM.mjGEOM_CYLINDER: _cylinder,
    _GEOM.mjGEOM_CAPSULE: _capsule,
}
"""Half sizes of the box about a shape, and what is inside it, by its kind."""
