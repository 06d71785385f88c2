"""The command that shows a robot on a page with sliders."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from faultgen.cli.app import Json, ShownRobot, ShownTask, app
from faultgen.cli.checks import existing_robot
from faultgen.system.terminal import note, say


@app.command()
def explore(
    robot: ShownRobot,
    task: ShownTask = None,
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="Port of the page. Default: any free one."),
    ] = 0,
    browser: Annotated[
        bool,
        typer.Option("--browser/--no-browser", help="Whether to open the page in the browser."),
    ] = True,
    as_json: Json = False,
) -> None:
    """Explore on a page in the browser what faults do to the signals of a robot.

    The page shows the robot at its task. Sliders choose effect, axis, severity, speed, payload and
    temperature. Torque, friction and histograms stand beside those of the healthy robot, with the
    answers of the isolators, and with the 'faultgen generate' command that makes these data.

    Only programs of this machine can open the page, it needs no network, and it writes no file.
    Press Ctrl-C to end. With --json, the command prints {"url": ...} when the page is ready.

    \b
    faultgen explore puma560
    faultgen explore my_arm --task spot_weld --port 8000 --no-browser
    """  # noqa: D301
    existing_robot(robot)
    from faultgen.exploring.server import ExploreServer

    with ExploreServer(robot, task, port) as server:
        if as_json:
            import json

            print(json.dumps({"url": server.url}), flush=True)
        else:
            say(f"{server.url}  (press Ctrl-C to end)", flush=True)
        if browser:
            _open(server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            note("ended")


def _open(url: str) -> None:
    """Open a page in the browser, or say that there is none."""
    import webbrowser

    linux = sys.platform.startswith("linux")
    shown = not linux or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not shown or not webbrowser.open(url):
        note("no browser can be opened here; open the address in one of this machine")
