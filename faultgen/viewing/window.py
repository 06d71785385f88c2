"""A window in which a robot does its task, again and again, until it is closed."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence

import mujoco
import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.viewing.playback import Playback
from faultgen.viewing.stage import Stage

_RATE = 50.0  # pictures in a second
_POINTS = 500  # of a curve; MuJoCo draws at most 1000
_COLOURS = ((0.75, 0.78, 0.82), (0.95, 0.25, 0.20))  # healthy, worn: on MuJoCo's dark panels
_PANEL = (0.45, 0.28)  # width and height of the curves, as shares of the window


def require_display() -> None:
    """Refuse to go on without a display.

    Raises:
        InputError: There is none.
    """
    linux = sys.platform.startswith("linux")
    if linux and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("there is no display here; give --video out.gif or --image out.png")


def open_window(shown: Sequence[Playback]) -> None:
    """Show the last of some robots in MuJoCo's viewer, with the torque of all of them.

    Args:
        shown: From `play`: the healthy robot, and perhaps the faulty one.

    Raises:
        InputError: There is no display, or the viewer cannot be opened.
    """
    require_display()
    try:
        import mujoco.viewer
    except (ImportError, RuntimeError) as error:
        raise InputError(f"MuJoCo's viewer cannot be used here ({_line(error)})") from None
    robot = shown[-1]
    stage = Stage(robot.robot, robot.position)
    stage.pose(robot.position[0])
    stage.paint(robot.axis)
    try:
        handle = mujoco.viewer.launch_passive(
            stage.model, stage.data, show_left_ui=False, show_right_ui=False
        )
    except (RuntimeError, mujoco.FatalError) as error:  # on macOS, it needs mjpython
        raise InputError(f"MuJoCo's viewer cannot be opened ({_line(error)})") from None
    with handle as viewer:
        if viewer.is_running():
            viewer.cam.lookat[:] = stage.camera.lookat
            viewer.cam.distance = stage.camera.distance
            viewer.cam.azimuth, viewer.cam.elevation = stage.camera.azimuth, stage.camera.elevation
        started = time.monotonic()
        while viewer.is_running():
            now = (time.monotonic() - started) % robot.times[-1]
            row = int(np.searchsorted(robot.times, now))
            with viewer.lock():
                stage.pose(robot.position[row])
            _draw_curves(viewer, shown, row)
            viewer.sync()
            time.sleep(1 / _RATE)


def _line(error: BaseException) -> str:
    return one_line(error)


def _draw_curves(viewer: mujoco.viewer.Handle, shown: Sequence[Playback], row: int) -> None:
    """Draw the motor torque up to a sample: of the faulty axis, or of all axes."""
    whole = viewer.viewport
    if whole is None:
        return
    figure = mujoco.MjvFigure()
    mujoco.mjv_defaultFigure(figure)
    axis = shown[-1].axis
    curves = [one.torque[:, axis - 1] for one in shown] if axis else [*shown[0].torque.T]
    colours = _COLOURS if axis else [None] * len(curves)
    of = f"axis {axis}" if axis else "all axes"
    figure.title = f"motor torque of {of} [N m]"
    figure.xlabel = "time [s]"
    figure.flg_extend = 0
    span = np.array([np.min(curves), np.max(curves)])
    figure.range[0] = 0, shown[0].times[-1]
    figure.range[1] = span + np.array([-0.05, 0.05]) * max(np.ptp(span), 1e-9)
    rows = np.unique(np.linspace(0, row, _POINTS).astype(int))
    for number, (curve, colour) in enumerate(zip(curves, colours, strict=True)):
        points = np.stack([shown[0].times[rows], curve[rows]], axis=1).ravel()
        figure.linedata[number, : len(points)] = points
        figure.linepnt[number] = len(rows)
        if colour is not None:
            figure.linergb[number] = colour
    width, height = round(_PANEL[0] * whole.width), round(_PANEL[1] * whole.height)
    place = mujoco.MjrRect(whole.width - width, 0, width, height)
    viewer.set_figures((place, figure))
