"""The command that shows a robot at work."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import Json, ShownRobot, ShownTask, app, print_json
from faultgen.cli.checks import existing_robot
from faultgen.errors import InputError
from faultgen.system.terminal import note, say


@app.command()
def view(
    robot: ShownRobot,
    task: ShownTask = None,
    effect: Annotated[
        str | None,
        typer.Option(
            help="Name of an effect. Default: none, or friction_wear if --axis or --severity is "
            "given."
        ),
    ] = None,
    axis: Annotated[
        int | None, typer.Option(help="Axis of the effect. Default: the first that it can act on.")
    ] = None,
    severity: Annotated[
        float | None,
        typer.Option(
            help="Severity, in the unit of the effect: 0.1 means 10 % where the unit is a fraction."
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(help="Write a film of one cycle, .gif or .mp4, instead of opening a window."),
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(help="Write one picture, .png, instead of opening a window."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Watch a robot do its task, healthy or with an effect.

    Without --video and --image, MuJoCo's viewer opens and repeats the cycle until it is closed.
    Films and pictures show the healthy robot and the one with the effect side by side; the link
    behind the faulty axis is red. The motor torque of that axis runs along below. They are drawn
    off screen, by OpenGL if a library for it works, and otherwise in software.

    \b
    faultgen view puma560
    faultgen view irb6700 --task spot_weld --axis 2 --severity 0.5 --video worn.gif
    """  # noqa: D301
    existing_robot(robot)
    _import_mujoco()
    from faultgen.viewing.film import FILMS, PICTURES, save_film, save_picture
    from faultgen.viewing.playback import play
    from faultgen.viewing.window import open_window, require_display

    for path, known in ((video, FILMS), (image, PICTURES)):
        if path is not None and path.suffix.lower() not in known:
            raise InputError(f"{path}: the name must end in {' or '.join(known)}")
        if path is not None and not path.resolve().parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist")
    if video is None and image is None:
        require_display()
    shown = play(robot, task, effect=effect, axis=axis, severity=severity)
    told: dict[str, Any] = {
        "robot": shown[0].robot.name,
        "task": shown[0].task,
        "shown": [one.name for one in shown],
        "duration": float(shown[0].times[-1]),
    }
    if video is None and image is None:
        open_window(shown)
    if video is not None:
        told["drawn_with"] = save_film(shown, video, progress=True)
        told["video"] = str(video)
    if image is not None:
        told["drawn_with"] = save_picture(shown, image)
        told["image"] = str(image)
    if told.get("drawn_with") == "software" and "MUJOCO_GL" not in os.environ:
        note(
            "no OpenGL library works here, so the robots were drawn in software; "
            "install the package libegl1 (or libosmesa6) for smoother pictures"
        )
    if as_json:
        print_json(told)
        return
    for path in (video, image):
        if path is not None:
            say(f"{path}: drawn with {told['drawn_with']}")


def _import_mujoco() -> None:
    """Import MuJoCo also where MUJOCO_GL names a library that is missing, which is told later."""
    asked = os.environ.pop("MUJOCO_GL", None)
    import mujoco  # noqa: F401

    if asked is not None:
        os.environ["MUJOCO_GL"] = asked
