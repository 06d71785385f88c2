"""The robot as triangles, and its poses in a motion, for `scripts/robot.js`, which draws it."""

from __future__ import annotations

import threading
from typing import Any

import mujoco
import numpy as np

from faultgen.mjcf.rotations import matrix_of
from faultgen.report.packing import packed
from faultgen.robot import Robot
from faultgen.viewing.painter import triangles
from faultgen.viewing.playback import SAMPLE_PERIOD
from faultgen.viewing.stage import FAULTY, NO_FAULT, Stage

_RATE = 20.0  # poses in a second
_MOST_POSES = 500  # in a motion


class Scene:
    """A robot that a page draws."""

    def __init__(self, robot: Robot, position: np.ndarray) -> None:
        """Make the triangles of all shapes, and place the camera.

        Args:
            robot: The robot.
            position: Joint positions of its motion, shape (samples, n_axes), in [rad], or [m].

        Raises:
            InputError: The robot cannot be drawn.
        """
        self.stage = Stage(robot, position)
        self._lock = threading.Lock()
        model = self.stage.model
        plane = int(mujoco.mjtGeom.mjGEOM_PLANE)
        shown = [int(k) for k in self.stage.shown() if model.geom_type[k] != plane]
        moved = {int(model.joint(f"joint{k}").bodyid[0]) for k in range(1, self._n_axes() + 1)}
        self._bodies = sorted({int(model.geom_bodyid[k]) for k in shown} | moved)
        self._shapes = [(k, triangles(model, k)) for k in shown]

    def told(self) -> dict[str, Any]:
        """Describe the shapes and the camera.

        Returns:
            For each shape the number of its body, its colour, and the corners of its triangles in
            the frame of the body, in [m]; the camera; for each body the axis that moves it; the
            place of each axis in the frame of its body; and the colours of no and of the largest
            severity.
        """
        model, camera = self.stage.model, self.stage.camera
        shapes = []
        for geom, corners in self._shapes:
            placed = corners @ matrix_of(model.geom_quat[geom]).T + model.geom_pos[geom]
            rgba, material = model.geom_rgba[geom], model.geom_matid[geom]
            if material >= 0 and np.allclose(rgba, [0.5, 0.5, 0.5, 1]):
                rgba = model.mat_rgba[material]  # MuJoCo's rule for geoms with a material
            shapes.append(
                {
                    "body": self._bodies.index(int(model.geom_bodyid[geom])),
                    "colour": [round(float(one), 3) for one in rgba[:3]],
                    "corners": packed(placed.ravel()),
                }
            )
        joints = [model.joint(f"joint{k}") for k in range(1, self._n_axes() + 1)]
        axes = {int(joint.bodyid[0]): k + 1 for k, joint in enumerate(joints)}
        places = [
            {
                "axis": k + 1,
                "body": self._bodies.index(int(joint.bodyid[0])),
                "at": joint.pos.tolist(),
            }
            for k, joint in enumerate(joints)
        ]
        return {
            "shapes": shapes,
            "axes": [axes.get(body, 0) for body in self._bodies],
            "places": places,
            "colours": [list(NO_FAULT), list(FAULTY)],
            "floor": {"height": self.stage.floor.height, "grid": self.stage.floor.grid},
            "camera": {
                "lookat": camera.lookat.tolist(),
                "distance": float(camera.distance),
                "azimuth": float(camera.azimuth),
                "elevation": float(camera.elevation),
                "angle": float(model.vis.global_.fovy),
            },
        }

    def poses(
        self, position: np.ndarray, period: float = SAMPLE_PERIOD, rate: float = _RATE
    ) -> dict[str, Any]:
        """Compute where the bodies are in the course of a motion.

        Args:
            position: Joint positions, shape (samples, n_axes), in [rad], or [m] where the joint
                slides.
            period: Time between the samples [s].
            rate: Poses in a second, at most.

        Returns:
            The number of poses, the time between them [s], and for each pose and body its place
            [m] and the rows of its rotation matrix: 12 numbers.
        """
        samples = len(position)
        every = max(1, round(1 / (rate * period)), -(-samples // _MOST_POSES))
        told = []
        with self._lock:
            for row in position[::every]:
                self.stage.pose(row)
                data = self.stage.data
                told.append(np.hstack([data.xpos[self._bodies], data.xmat[self._bodies]]))
        return {
            "count": len(told),
            "period": every * period,
            "duration": samples * period,
            "bodies": packed(np.ravel(told)),
        }

    def _n_axes(self) -> int:
        names = [self.stage.model.joint(k).name for k in range(self.stage.model.njnt)]
        return sum(name.startswith("joint") and name[5:].isdigit() for name in names)
