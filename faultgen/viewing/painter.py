"""Drawing in software: works on every machine, without OpenGL, and needs only NumPy.

Every shape becomes triangles. Each pixel keeps the triangle that is nearest to the camera (a depth
buffer), shaded by its angle to the light.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from faultgen.viewing.stage import FLOOR, LIGHT, LINE, Stage

_FINE = 2  # pixels are drawn at this many times the size, and then averaged
_SIDES = 24  # of round shapes
_MOST_FACES = 1500  # of a mesh; a finer one is simplified
_CELLS = (64, 48, 36, 27, 20, 15, 11, 8)  # of a simplified mesh along its longest side
_SKY = np.array([0.93, 0.95, 0.97])
_SHADOW = 0.82  # brightness of the floor in the shadow of the robot
_HALF_LINE = 0.006  # half the width of a line of the floor, as a share of the grid
_FADING = 12.0  # times the grid, the distance at which its lines are gone
_NEAR = 0.01  # of the camera's distance; triangles nearer than that are left out


class Painter:
    """Draws a stage in software."""

    name = "software"

    def __init__(self, stage: Stage, width: int, height: int) -> None:
        """Turn the stage's shapes into triangles.

        Args:
            stage: What is drawn.
            width: Width of the pictures [pixels].
            height: Height of the pictures [pixels].
        """
        self._stage = stage
        self._width, self._height = _FINE * width, _FINE * height
        kinds = stage.model.geom_type
        self._shapes = {
            int(geom): triangles(stage.model, int(geom))
            for geom in stage.shown()
            if kinds[geom] != mujoco.mjtGeom.mjGEOM_PLANE
        }

    def draw(self) -> np.ndarray:
        """Draw the stage as it is now.

        Returns:
            Shape (height, width, 3), of type uint8.
        """
        stage = self._stage
        corners, colours = [], []
        for geom, shape in self._shapes.items():
            turned = stage.data.geom_xmat[geom].reshape(3, 3)
            corners.append(shape @ turned.T + stage.data.geom_xpos[geom])
            material = stage.model.geom_matid[geom]
            rgba = stage.model.geom_rgba[geom]
            if material >= 0 and np.allclose(rgba, 0.5 * np.array([1, 1, 1, 2])):
                rgba = stage.model.mat_rgba[material]  # MuJoCo's rule for geoms with a material
            colours.append(np.broadcast_to(rgba[:3], (len(shape), 3)))
        points, rgb = np.concatenate(corners), np.concatenate(colours)
        normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        shade = 0.45 + 0.35 * np.clip(normal @ np.array(LIGHT), 0, 1)
        axes = stage.view_axes()
        eye = stage.camera.lookat + stage.camera.distance * axes[2]
        shade = shade + 0.25 * np.abs(normal @ axes[2])  # a lamp beside the camera
        seen = self._projected((points.reshape(-1, 3) - eye) @ axes.T).reshape(-1, 3, 3)
        image = self._background(axes, eye)
        if stage.floor is not None and eye[2] > stage.floor.height:
            lit = points[normal @ np.array(LIGHT) > 0]
            high = lit[..., 2:] - stage.floor.height
            dark = lit - high * np.array(LIGHT) / LIGHT[2]
            shadow = self._projected((dark.reshape(-1, 3) - eye) @ axes.T).reshape(-1, 3, 3)
            image[self._covered(shadow)] *= _SHADOW
        self._fill(image, seen, rgb * shade[:, None])
        fine = image.reshape(self._height // _FINE, _FINE, self._width // _FINE, _FINE, 3)
        return (255 * np.clip(fine.mean(axis=(1, 3)), 0, 1)).astype(np.uint8)

    def _scale(self) -> float:
        """Pixels that a length of 1 has at a distance of 1."""
        angle = np.radians(self._stage.model.vis.global_.fovy)
        return self._height / 2 / np.tan(angle / 2)

    def _projected(self, points: np.ndarray) -> np.ndarray:
        """Columns, rows [pixels] and distances [m] of points in the axes of the camera."""
        distance = -points[:, 2]
        safe = np.maximum(distance, 1e-9)
        column = self._width / 2 + self._scale() * points[:, 0] / safe
        row = self._height / 2 - self._scale() * points[:, 1] / safe
        return np.stack([column, row, distance], axis=1)

    def _background(self, axes: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """Sky above the horizon, floor below it: shape (height, width, 3)."""
        rows = (self._height / 2 - np.arange(self._height) - 0.5) / self._scale()
        fall = rows * axes[1, 2] - axes[2, 2]  # of the ray of each row, per length ahead
        down = fall < 0  # rays that meet the floor
        column = np.where(down[:, None], np.array(FLOOR), _SKY)
        image = np.repeat(column[:, None], self._width, axis=1)
        floor = self._stage.floor
        if floor is None or eye[2] <= floor.height:
            return image
        ahead = ((floor.height - eye[2]) / fall[down])[:, None]  # distance along the camera's axis
        across = (np.arange(self._width) + 0.5 - self._width / 2) / self._scale()
        lines = np.zeros(ahead.shape[:1] + across.shape)
        pixel = ahead / self._scale() * np.hypot(1, ahead / (eye[2] - floor.height))
        for k in range(2):
            place = eye[k] + ahead * (
                rows[down][:, None] * axes[1, k] - axes[2, k] + across * axes[0, k]
            )
            off = np.abs(place / floor.grid - np.round(place / floor.grid)) * floor.grid
            half = np.maximum(_HALF_LINE * floor.grid, pixel / 2)
            lines = np.maximum(lines, np.clip((half - off) / pixel + 0.5, 0, 1))
        lines *= np.clip(1.3 - ahead / (_FADING * floor.grid + self._stage.camera.distance), 0, 1)
        image[down] += lines[..., None] * (np.array(LINE) - np.array(FLOOR))
        return image

    def _covered(self, seen: np.ndarray) -> np.ndarray:
        """Pixels that triangles cover, from whichever side: shape (height, width).

        Args:
            seen: Columns, rows and distances of the corners, shape (triangles, 3, 3).
        """
        found = np.zeros((self._height, self._width), bool)
        near = _NEAR * self._stage.camera.distance
        for k in np.flatnonzero(seen[..., 2].min(axis=1) > near):
            (ax, ay), (bx, by), (cx, cy) = seen[k, :, :2]
            area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
            left, right = max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 1, self._width)
            top, bottom = max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, self._height)
            if abs(area) < 1e-9 or right <= left or bottom <= top:
                continue
            x, y = np.arange(left, right) + 0.5, np.arange(top, bottom)[:, None] + 0.5
            first = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
            second = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
            found[top:bottom, left:right] |= (first >= 0) & (second >= 0) & (first + second <= 1)
        return found

    def _fill(self, image: np.ndarray, seen: np.ndarray, colours: np.ndarray) -> None:
        """Draw triangles into an image, the nearest on top.

        Args:
            image: Shape (height, width, 3), changed in place.
            seen: Columns, rows and distances of the corners, shape (triangles, 3, 3).
            colours: Shape (triangles, 3).
        """
        depth = np.full(image.shape[:2], np.inf)
        near = _NEAR * self._stage.camera.distance
        low = np.maximum(np.floor(seen[..., :2].min(axis=1)).astype(int), 0)
        high = np.ceil(seen[..., :2].max(axis=1)).astype(int) + 1
        high = np.minimum(high, [self._width, self._height])
        (ax, ay), (bx, by), (cx, cy) = seen[:, :, :2].transpose(1, 2, 0)
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        fits = (high > low).all(axis=1) & (seen[..., 2].min(axis=1) > near)
        front = area < 0  # rows count downwards, so faces towards the camera run clockwise
        for k in np.flatnonzero(fits & front & (np.abs(area) > 1e-9)):
            x = np.arange(low[k, 0], high[k, 0]) + 0.5
            y = np.arange(low[k, 1], high[k, 1])[:, None] + 0.5
            first = ((bx[k] - x) * (cy[k] - y) - (cx[k] - x) * (by[k] - y)) / area[k]
            second = ((cx[k] - x) * (ay[k] - y) - (ax[k] - x) * (cy[k] - y)) / area[k]
            third = 1 - first - second
            inside = (first >= 0) & (second >= 0) & (third >= 0)
            # between corners, not the distance but its inverse changes evenly
            inverse = first / seen[k, 0, 2] + second / seen[k, 1, 2] + third / seen[k, 2, 2]
            part = slice(low[k, 1], high[k, 1]), slice(low[k, 0], high[k, 0])
            with np.errstate(divide="ignore"):
                distance = np.where(inside & (inverse > 0), 1 / inverse, np.inf)
            nearer = distance < depth[part]
            depth[part][nearer] = distance[nearer]
            image[part][nearer] = colours[k]


def triangles(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Turn the shape of a geom into triangles.

    Args:
        model: The model.
        geom: Id of the geom.

    Returns:
        Corners of the triangles in the frame of the geom, counter-clockwise as seen from outside,
        shape (triangles, 3, 3), in [m].
    """
    kind, size = model.geom_type[geom], model.geom_size[geom]
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == kinds.mjGEOM_BOX:
        points = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3) * size
        return _outside(points)
    if kind == kinds.mjGEOM_CYLINDER:
        return _turned(
            np.array([[0, -size[1]], [size[0], -size[1]], [size[0], size[1]], [0, size[1]]])
        )
    angle = np.linspace(-np.pi / 2, np.pi / 2, _SIDES // 2)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if kind == kinds.mjGEOM_CAPSULE:
        return _turned(profile * size[0] + np.outer(np.sign(profile[:, 1]), [0, size[1]]))
    if kind == kinds.mjGEOM_SPHERE:
        return _turned(profile * size[0])
    if kind == kinds.mjGEOM_ELLIPSOID:
        return _turned(profile) * size
    return np.empty((0, 3, 3))


def _turned(profile: np.ndarray) -> np.ndarray:
    """Triangles of the body that a profile sweeps around z; profile of radius and height."""
    around = np.linspace(0, 2 * np.pi, _SIDES + 1)
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    points = np.empty((len(profile), _SIDES + 1, 3))
    points[..., :2] = profile[:, None, :1] * ring
    points[..., 2] = profile[:, None, 1]
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    found = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)
    normal = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    return found[np.linalg.norm(normal, axis=1) > 0]  # at the poles, half of them are lines


def _outside(points: np.ndarray) -> np.ndarray:
    """Triangles of the convex hull of points, counter-clockwise as seen from outside."""
    hull = ConvexHull(points)
    found = points[hull.simplices]
    normal = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    found[inward] = found[inward][:, ::-1]
    return found


def _mesh(model: mujoco.MjModel, mesh: int) -> np.ndarray:
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = model.mesh_vert[start : start + count].astype(float)
    first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    corners = model.mesh_face[first : first + faces]
    for cells in _CELLS if faces > _MOST_FACES else ():
        fewer, left = _joined(points, corners, cells)
        if len(left) <= _MOST_FACES:
            return fewer[left]
    return points[corners] if faces <= _MOST_FACES else _outside(points)


def _joined(points: np.ndarray, faces: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Simplify a mesh: all points within a cell of a grid become one, their mean.

    Source: J. Rossignac and P. Borrel, Multi-resolution 3D approximations for rendering complex
    scenes, 1993.

    Args:
        points: Shape (n, 3).
        faces: Numbers of the corners of each triangle, shape (m, 3).
        cells: Number of cells along the longest side.

    Returns:
        Points and triangles that are left, each once.
    """
    low = points.min(axis=0)
    size = max(float(np.ptp(points, axis=0).max()) / cells, 1e-12)
    _, number = np.unique(np.floor((points - low) / size), axis=0, return_inverse=True)
    number = number.ravel()
    count = np.bincount(number)
    means = np.stack([np.bincount(number, one) / count for one in points.T], axis=1)
    kept = number[faces]
    differ = (kept != np.roll(kept, 1, axis=1)).all(axis=1)
    kept = kept[differ]
    # the same triangle may come from several; its corners begin with the smallest number
    first = np.argmin(kept, axis=1)[:, None]
    turned = np.take_along_axis(kept, (first + np.arange(3)) % 3, axis=1)
    return means, np.unique(turned, axis=0)
