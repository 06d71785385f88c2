"""Draws the pictures of the robots, off screen: python docs/pictures.py (needs EGL or OSMesa)."""

import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import matplotlib.pyplot as plt
import mujoco
import numpy as np

ROOT = Path(__file__).parents[1] / "robots"
POSES = {
    # joint angles [deg], camera: look-at point [m], distance [m], azimuth and elevation [deg]
    "puma560": ([25, 60, -140, 0, -50, 0], (0.15, 0.05, 0.6), 2.2, 130, -14),
    "irb6700": ([20, 15, 10, 0, 60, 0], (0.55, 0.1, 1.05), 4.9, 135, -12),
}


def main() -> None:
    """Write robots/<name>/<name>.png."""
    for name, (pose, look_at, distance, azimuth, elevation) in POSES.items():
        model = mujoco.MjModel.from_xml_path(str(ROOT / name / "scene.xml"))
        data = mujoco.MjData(model)
        for axis, angle in enumerate(np.radians(pose), start=1):
            data.joint(f"joint{axis}").qpos[0] = angle
        mujoco.mj_forward(model, data)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = look_at
        camera.distance, camera.azimuth, camera.elevation = distance, azimuth, elevation
        with mujoco.Renderer(model, 720, 960) as renderer:
            renderer.update_scene(data, camera)
            plt.imsave(ROOT / name / f"{name}.png", renderer.render())


if __name__ == "__main__":
    main()
