"""The model that is drawn: the robot with floor and light, and a camera that sees all of it.

stage = Stage(robot, position)
stage.pose(position[0])
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.robot import Robot

LARGEST_PICTURE = 1280
"""Largest width and height of a picture [pixels]."""

FAULTY, NO_FAULT = (0.85, 0.16, 0.14), (0.70, 0.72, 0.75)
"""Colours of a link whose axis has a fault, and, where severities are shown, of one without."""

LIGHT = (0.34, -0.42, 0.84)
"""Direction to the light."""

FLOOR, LINE = (0.84, 0.86, 0.88), (0.75, 0.77, 0.80)
"""Colours of the floor and of its grid."""

_GRIDS = (0.05, 0.1, 0.25, 0.5, 1.0)  # distances between lines of the floor [m]
_SHOWN_GROUPS = 3  # of geoms; MuJoCo hides the others, such as rotors
_POSES = 25  # of a motion, among which the camera looks for the outermost points
_AZIMUTHS = (130.0, 110.0, 150.0, 90.0, 170.0)  # of the camera; the first one is usual [deg]
_ELEVATION = -16.0  # of the camera [deg]
_NEARER = 0.93  # of the camera's distance, for which another azimuth than the usual one is taken
_ANGLE = 35.0  # of the camera's view, upright [deg]
_MARGIN = 1.05  # of the camera's distance, so that nothing touches the border
_STICK = (0.75, 0.77, 0.80, 1.0)  # colour of links that have no shape of their own


@dataclass(frozen=True)
class Floor:
    """The floor under a robot."""

    height: float
    """In [m]."""
    grid: float
    """Distance between the lines of its grid [m]."""


class Stage:
    """A robot that can be drawn in any pose. Its drivetrain is not simulated here."""

    def __init__(self, robot: Robot, position: np.ndarray) -> None:
        """Build the model and place the camera.

        Args:
            robot: The robot.
            position: Joint positions of the motion that will be shown, shape (samples, n_axes), in
                [rad], or [m] for slides.

        Raises:
            InputError: The robot cannot be drawn.
        """
        spec = robot.spec()
        _dress(spec)
        try:
            self.model = spec.compile()
        except ValueError as error:
            line = one_line(error)
            raise InputError(f"robot {robot.name}: cannot be drawn ({line})") from None
        self.data = mujoco.MjData(self.model)
        joints = self.model.jnt_qposadr[robot.ids("joint", "joint", self.model)]
        self._joints = joints.tolist()
        points = self._outline(position)
        height = min(0.0, float(points[:, 2].min()))
        width = float(np.ptp(points[:, :2], axis=0).max())
        self.floor = Floor(height, max((g for g in _GRIDS if g <= width / 4), default=_GRIDS[0]))
        self.model.geom_pos[self.model.geom("faultgen_floor").id, 2] = height
        self.model.mat_texrepeat[self.model.material("faultgen_grid").id] = 1 / self.floor.grid
        self.camera = mujoco.MjvCamera()
        self.camera.elevation = _ELEVATION
        self._look_at(points)
        self._colours = self.model.geom_rgba.copy()
        self._materials = self.model.geom_matid.copy()

    def pose(self, position: np.ndarray) -> None:
        """Put the robot into a pose.

        Args:
            position: Joint positions, shape (n_axes,), in [rad], or [m] for slides.
        """
        self.data.qpos[self._joints] = position
        mujoco.mj_forward(self.model, self.data)

    def paint(self, axis: int) -> None:
        """Paint the link behind an axis red, and all other links in their own colours.

        Args:
            axis: From 1; 0 paints no link.
        """
        self.model.geom_rgba[:] = self._colours
        self.model.geom_matid[:] = self._materials
        if axis:
            link = self.model.joint(f"joint{axis}").bodyid[0]
            own = self.model.geom_bodyid == link
            self.model.geom_rgba[own] = (*FAULTY, 1.0)
            self.model.geom_matid[own] = -1

    def shade(self, shares: Sequence[float]) -> None:
        """Colour the link behind each axis by a severity: from grey to red. All else is grey.

        Args:
            shares: Of each axis, 0 for no fault to 1 for the largest severity.
        """
        none, most = np.array(NO_FAULT), np.array(FAULTY)
        robot = self.shown()
        robot = robot[self.model.geom_type[robot] != mujoco.mjtGeom.mjGEOM_PLANE]
        self.model.geom_matid[robot] = -1
        self.model.geom_rgba[robot] = (*NO_FAULT, 1.0)
        for axis, share in enumerate(shares, start=1):
            own = self.model.geom_bodyid[robot] == self.model.joint(f"joint{axis}").bodyid[0]
            self.model.geom_rgba[robot[own], :3] = none + share * (most - none)

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Find where points are in a square picture.

        Args:
            points: Shape (n, 3), in [m].

        Returns:
            Shares of the width from the left and of the height from the top, shape (n, 2).
        """
        axes = self.view_axes()
        eye = self.camera.lookat + self.camera.distance * axes[2]
        right, up, back = ((points - eye) @ axes.T).T
        half = np.tan(np.radians(_ANGLE / 2)) * np.maximum(-back, 1e-9)
        return np.stack([0.5 + 0.5 * right / half, 0.5 - 0.5 * up / half], axis=1)

    def shown(self) -> np.ndarray:
        """Find the geoms that are drawn.

        Returns:
            Their ids, shape (geoms,).
        """
        model = self.model
        opaque = model.geom_rgba[:, 3] > 0
        return np.flatnonzero((model.geom_group < _SHOWN_GROUPS) & opaque)

    def view_axes(self) -> np.ndarray:
        """Compute the axes of the camera.

        Returns:
            Rows that point right, up, and towards the viewer, shape (3, 3).
        """
        azimuth, elevation = np.radians([self.camera.azimuth, self.camera.elevation])
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        ahead = np.cos(elevation) * flat + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        return np.array([right, np.cross(right, ahead), -ahead])

    def _outline(self, position: np.ndarray) -> np.ndarray:
        """Corners of the boxes around all shapes in poses of a motion, shape (n, 3), in [m]."""
        corners = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
        geoms = [k for k in self.shown() if self.model.geom_type[k] != mujoco.mjtGeom.mjGEOM_PLANE]
        if not geoms:
            raise InputError("the model has no shapes that could be drawn")
        found = []
        for row in np.linspace(0, len(position) - 1, _POSES).astype(int):
            self.pose(position[row])
            for geom in geoms:
                centre, half = self.model.geom_aabb[geom].reshape(2, 3)
                turned = self.data.geom_xmat[geom].reshape(3, 3)
                found.append((centre + corners * half) @ turned.T + self.data.geom_xpos[geom])
        return np.concatenate(found)

    def _look_at(self, points: np.ndarray) -> None:
        """Put the camera where the points fill most of a square picture."""
        places = []
        for azimuth in _AZIMUTHS:
            self.camera.azimuth = azimuth
            places.append((azimuth, *_nearest(points, self.view_axes())))
        usual, best = places[0], min(places, key=lambda place: place[1])
        chosen = best if best[1] < _NEARER * usual[1] else usual
        self.camera.azimuth, self.camera.distance = chosen[0], _MARGIN * chosen[1]
        self.camera.lookat[:] = chosen[2]


def _nearest(points: np.ndarray, axes: np.ndarray) -> tuple[float, np.ndarray]:
    """Distance and point to look at of a camera as near as all points of a square picture allow."""
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    for _ in range(3):  # what is near needs more room: the middle moves towards it
        middle = (low + high) / 2
        away = seen - middle
        slope = np.tan(np.radians(_ANGLE / 2))
        distance = (np.abs(away[:, :2]).max(axis=1) / slope + away[:, 2]).max()
        shown = away[:, :2] / (distance - away[:, 2:])
        shift = (shown.max(axis=0) + shown.min(axis=0)) / 2 * distance
        low[:2], high[:2] = low[:2] + shift, high[:2] + shift
    return float(distance), middle @ axes


def _dress(spec: mujoco.MjSpec) -> None:
    """Add floor, light and sky to a robot, and sticks if its links have no shapes, or only spheres.

    Of a link with shapes to look at and others for collisions, only those to look at are shown.

    Only links that carry another body count: the last one may be a payload that faultgen added.
    """
    for body in spec.bodies:
        _hide_collision_shapes(body)
    links = [body for body in spec.bodies if body.bodies and body.name != "world"]
    # a sphere may show where a mass is, but no link
    if not any(
        _is_shown(geom) and geom.type != mujoco.mjtGeom.mjGEOM_SPHERE
        for body in links
        for geom in body.geoms
    ):
        _add_sticks(spec)
    spec.visual.global_.offwidth = spec.visual.global_.offheight = LARGEST_PICTURE
    spec.visual.global_.fovy = _ANGLE
    spec.visual.headlight.ambient = [0.35] * 3
    spec.visual.headlight.diffuse = [0.45] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.add_texture(
        name="faultgen_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.97, 0.98, 1.0],
        rgb2=[0.86, 0.89, 0.93],
        width=64,
        height=64,
    )
    spec.add_texture(
        name="faultgen_grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=FLOOR,
        markrgb=LINE,
        width=128,
        height=128,
    )
    grid = spec.add_material(name="faultgen_grid", texuniform=True)
    grid.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "faultgen_grid"
    spec.visual.quality.shadowsize = 4096
    spec.worldbody.add_light(
        pos=[4 * one for one in LIGHT],
        dir=[-one for one in LIGHT],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.5] * 3,
        castshadow=True,
    )
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:  # two floors at one height would flicker
            geom.material, geom.rgba = "", [0.0] * 4
    spec.worldbody.add_geom(
        name="faultgen_floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],  # without end
        material="faultgen_grid",
        rgba=[1, 1, 1, 1],
        contype=0,
        conaffinity=0,
    )


def _is_shown(geom: mujoco.MjsGeom) -> bool:
    return bool(geom.group < _SHOWN_GROUPS and geom.rgba[3] > 0)


def _hide_collision_shapes(body: mujoco.MjsBody) -> None:
    """Hide shapes that can touch something if there are others, and those of rotors."""
    shapes = [one for one in body.geoms if one.type != mujoco.mjtGeom.mjGEOM_PLANE]
    visual = [one for one in shapes if one.contype == 0 and one.conaffinity == 0]
    hulls = [one for one in shapes if one not in visual]
    if body.name.startswith("rotor"):  # they turn within a gearbox
        hulls = shapes
    elif not any(_is_shown(one) for one in visual):
        return
    for one in hulls:
        one.group = _SHOWN_GROUPS


def _add_sticks(spec: mujoco.MjSpec) -> None:
    """Draw each link as a stick from its body to the bodies that it carries."""
    for body in list(spec.bodies):
        for child in body.bodies:
            if child.name.startswith("rotor") or not np.linalg.norm(child.pos) > 0:
                continue
            length = float(np.linalg.norm(child.pos))
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0, 0, 0, *child.pos],
                size=[0.1 * length, 0, 0],
                rgba=_STICK,
                mass=0,
                contype=0,
                conaffinity=0,
            )
