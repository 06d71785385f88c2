"""Pictures of a stage off screen, by OpenGL where it works and in software where it does not.

The environment variable MUJOCO_GL chooses as in MuJoCo: egl or osmesa name one OpenGL library, and
disable means that none is used. Without it, both are tried.

    with open_canvas(stage, width=480, height=360) as canvas:
        image = canvas.draw()
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Protocol

import mujoco
import numpy as np

from faultgen.errors import InputError
from faultgen.viewing.painter import Painter
from faultgen.viewing.stage import Stage

_OFF = ("disable", "disabled", "off", "false", "0")
_LIBRARIES = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa"}
_NATIVE = {"darwin": "mujoco.cgl", "win32": "mujoco.glfw"}
_MOST_GEOMS = 10_000


class Canvas(Protocol):
    """What draws pictures."""

    name: str
    """Name of the method, such as 'egl'."""

    def draw(self) -> np.ndarray:
        """Draw the stage as it is now.

        Returns:
            Shape (height, width, 3), of type uint8.
        """


@contextmanager
def open_canvas(stage: Stage, *, width: int, height: int) -> Iterator[Canvas]:
    """Find a way to draw off screen.

    Args:
        stage: What is drawn.
        width: Width of the pictures [pixels].
        height: Height of the pictures [pixels].

    Yields:
        The canvas: OpenGL, or the painter if no OpenGL library works.

    Raises:
        InputError: MUJOCO_GL names a library that does not work, or that cannot draw off screen.
    """
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in _OFF:
        yield Painter(stage, width, height)
        return
    if asked and asked not in (*_LIBRARIES, "cgl", "glfw", "wgl", "glx", "enable", "on", "true"):
        raise InputError(f"MUJOCO_GL: must be egl, osmesa or disable, not {asked}")
    modules = [_LIBRARIES[asked]] if asked in _LIBRARIES else list(_LIBRARIES.values())
    if sys.platform in _NATIVE:
        modules = [_NATIVE[sys.platform]]
    for module in modules:
        try:
            canvas = _OpenGL(stage, width, height, module)
        # a missing library shows as any of many errors, depending on what is missing
        except Exception:  # noqa: S112
            continue
        try:
            yield canvas
        finally:
            canvas.close()
        return
    if asked in _LIBRARIES:
        library = {"egl": "libegl1", "osmesa": "libosmesa6"}[asked]
        raise InputError(
            f"MUJOCO_GL={asked}: this OpenGL library cannot be used here; install the package "
            f"{library}, or set MUJOCO_GL=disable to draw without OpenGL"
        )
    yield Painter(stage, width, height)


class _OpenGL:
    """Draws with MuJoCo's own renderer."""

    def __init__(self, stage: Stage, width: int, height: int, module: str) -> None:
        self.name = module.rpartition(".")[2]
        self._stage = stage
        self._context: Any = import_module(module).GLContext(width, height)
        self._context.make_current()
        self._drawing = mujoco.MjrContext(stage.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._drawing)
        self._scene = mujoco.MjvScene(stage.model, maxgeom=_MOST_GEOMS)
        self._option, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._place = mujoco.MjrRect(0, 0, width, height)

    def draw(self) -> np.ndarray:
        stage = self._stage
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            stage.model, stage.data, self._option, self._perturb, stage.camera, every, self._scene
        )
        mujoco.mjr_render(self._place, self._scene, self._drawing)
        image = np.empty((self._place.height, self._place.width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, self._place, self._drawing)
        return image[::-1]  # OpenGL counts rows from below

    def close(self) -> None:
        """Free the memory of the graphics library."""
        self._drawing.free()
        self._context.free()
