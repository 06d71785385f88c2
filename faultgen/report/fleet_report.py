"""The report of a fleet: its robots, and the torque indicator of the axes that fail or age."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from faultgen.analysis.plots import plot_series, style
from faultgen.errors import InputError
from faultgen.evaluation.markdown import table
from faultgen.fleet.data import Fleet, open_fleet
from faultgen.report.page import image, markdown, page
from faultgen.report.robot_picture import RobotPicture, robot_picture, shapes_of
from faultgen.robot import load_robot
from faultgen.simulation.nominal import nominal
from faultgen.system.files import write_text
from faultgen.system.words import in_series
from faultgen.viewing.playback import SAMPLE_PERIOD, first_task

_MOST = 12  # robots whose indicator is drawn
_MOST_MODELS = 3  # that are drawn
_MOST_PLACES = 3  # that the sentence names


def write_fleet_report(folder: str | Path) -> Path:
    """Write ``report.html`` into the folder of a fleet.

    Args:
        folder: Folder of the fleet.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder has no complete fleet.
    """
    fleet = open_fleet(folder)
    rows = [
        [
            one.name,
            one.robot,
            "fails" if one.failed else "does not fail",
            int(one.truth["damaged_axis"][0]),
            one.split,
            len(one.day),
            f"{one.production.mean():.2f}",
            f"{one.truth['damage'][-1]:.2f}",
            f"{one.events.sum(axis=1).mean():.1f}",
        ]
        for one in fleet.robots
    ]
    head = ["robot", "model", "end", "damaged axis", "part", "samples", "production", "last damage"]
    pictures = _pictures(fleet)
    text = page(
        "fleet.html",
        name=Path(folder).resolve().name,
        summary=summary(fleet),
        pictures=pictures,
        scenes=shapes_of([picture for _, picture in pictures]),
        most=_MOST,
        figure_=image(_figure(fleet)),
        table=markdown(table([*head, "events a day"], rows)),
        attributes={"seed": fleet.seed, **fleet.attributes},
    )
    path = Path(folder) / "report.html"
    write_text(path, text)
    return path


def summary(fleet: Fleet) -> str:
    """Say in one sentence how many robots fail, and where.

    Args:
        fleet: The fleet.

    Returns:
        The sentence, with its full stop.
    """
    count, failing = len(fleet.robots), [one for one in fleet.robots if one.failed]
    robots = f"{count} robot{'' if count == 1 else 's'}"
    if not failing:
        return f"None of the {robots} fails within {fleet.days} days."
    by_axis = Counter((one.robot, one.axis) for one in failing)
    places = sorted(by_axis.items(), key=lambda one: (-one[1], one[0]))
    named = [
        f"axis {axis} of {model}{f' ({number} robots)' if number > 1 else ''}"
        for (model, axis), number in places[:_MOST_PLACES]
    ]
    if len(places) > _MOST_PLACES:
        named.append(f"{len(places) - _MOST_PLACES} other places")
    verb = "fails" if len(failing) == 1 else "fail"
    return f"{len(failing)} of {robots} {verb} at the end of {fleet.days} days: {in_series(named)}."


def _pictures(fleet: Fleet) -> list[tuple[str, RobotPicture]]:
    """Each model in a motion of its own; axes are coloured by the number of robots that fail."""
    found = []
    for model in list(dict.fromkeys(one.robot for one in fleet.robots))[:_MOST_MODELS]:
        own = [one for one in fleet.robots if one.robot == model]
        failed = Counter(one.axis for one in own if one.failed)
        largest = max(failed.values(), default=1)
        try:
            robot = load_robot(model)
            motion = nominal(model, first_task(robot), SAMPLE_PERIOD)
        except InputError:  # it is not here any more, or has no task
            continue
        picture = robot_picture(
            robot,
            motion.position,
            SAMPLE_PERIOD,
            shares={axis: count / largest for axis, count in failed.items()},
            texts={axis: f"fails in {n} of {len(own)} robots" for axis, n in failed.items()},
            marked=[axis for axis, n in sorted(failed.items()) if n == largest],
        )
        if picture is not None:
            found.append((model, picture))
    return found


def _figure(fleet: Fleet) -> Figure:
    """Torque indicator of the damaged axis of each robot, those that fail first."""
    shown = sorted(fleet.robots, key=lambda one: not one.failed)[:_MOST]
    with style():
        rows = -(-len(shown) // 3)
        figure, grid = plt.subplots(rows, 3, figsize=(9, 2.2 * rows), squeeze=False)
        for axes, one in zip(grid.flat, shown, strict=False):
            axis = int(one.truth["damaged_axis"][0])
            values = one.torque_indicator[:, max(axis - 1, 0)]
            plot_series(axes, one.day, values, one.name, 0)
            what = "fails" if one.failed else "does not fail"
            axes.set(title=f"{one.name}, axis {axis}: {what}", ylabel="indicator [N m]")
            axes.set_xlabel("time [d]")
        for axes in grid.flat[len(shown) :]:
            axes.axis("off")
    return figure
