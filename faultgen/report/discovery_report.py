"""The files of a discovery: its result, the model, the next experiment and the report page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.analysis.plots import COLOURS, legend_beside, style
from faultgen.discovery.discover import Discovery, dump
from faultgen.discovery.result import MEANINGS
from faultgen.discovery.summary import words_of
from faultgen.mjcf.edit import write_model
from faultgen.report.chart import library
from faultgen.report.discovery_charts import torque_charts
from faultgen.report.laws import laws_image
from faultgen.report.page import image, page
from faultgen.report.robot_picture import RobotPicture, robot_picture, shapes_of
from faultgen.report.terms import definitions
from faultgen.system.files import write_text
from faultgen.system.sums import add_sums, write_listed

_POSSIBLE = 0.4  # colour of an axis that the data do not exclude, where 1 is the full one


def write_discovery(folder: Path, result: dict[str, Any], found: Discovery) -> None:
    """Write ``discovery.json``, the model, ``report.html``, and the next experiment if any.

    Args:
        folder: Folder for the files. It is created if it does not exist.
        result: Content of ``discovery.json``.
        found: The discovery from which the result was made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # what was found comes first, so that nothing that fails afterwards loses it
    write_listed(folder, "discovery.json", dump(result))
    robot = found.answer_.robot
    robot.write(folder / "model")
    add_sums(folder, write_model(folder / "model.xml", robot.xml, robot.assets))
    if found.experiment_ is not None:
        write_listed(folder, "next_experiment.toml", found.experiment_.toml)
    write_text(folder / "report.html", discovery_page(result, found))


def discovery_page(result: dict[str, Any], found: Discovery) -> str:
    """Make the report page of a discovery.

    Args:
        result: Content of ``discovery.json``.
        found: The discovery from which the result was made.

    Returns:
        The HTML of the page.
    """
    picture = _picture(result, found)
    axes = range(1, len(picture.rows) + 1 if picture else 1)
    return page(
        "discovery.html",
        result=result,
        robot_name=found.answer_.robot.name,
        meaning=MEANINGS.get(result["verdict"], ""),
        picture=picture,
        scenes=shapes_of([picture]),
        axes=axes,
        first=(marked_axes(result, found) or [1])[0],
        charts=torque_charts(found),
        library=library(),
        terms=definitions(["confidence", "noise floor", "RMS"]),
        baseline=found.problem_.baseline,
        p_value=found.answer_.p_value,
        beside_the_model=_beside_the_model(found),
        laws=laws_image(found.laws_) if found.laws_ else "",
        steps=image(_steps(result)),
        maps=image(_maps(found)),
    )


def marked_axes(result: dict[str, Any], found: Discovery) -> list[int]:
    """Return the axes of what was found, or else of what the data do not exclude.

    Args:
        result: Content of ``discovery.json``.
        found: The discovery from which the result was made.

    Returns:
        Axes from 1, the surest first.
    """
    named = [one["axis"] for one in result["effects"]]
    unknown = [axis for axis, _ in found.answer_.left] if result["unexplained"] else []
    rivals = [one["axis"] for one in result["alternatives"]]
    return list(dict.fromkeys([*named, *unknown] or rivals))


def _picture(result: dict[str, Any], found: Discovery) -> RobotPicture | None:
    """The robot in the recorded motion; axes with an effect are red, possible ones lighter."""
    recording, robot = found.problem_.recording, found.problem_.robot
    position = robot.gearing.joints(recording.motor_position(robot))
    texts: dict[int, list[str]] = {}
    for one in result["effects"]:
        words = re.sub(rf"^axis {one['axis']}( has|:) ", "", words_of(one))
        texts.setdefault(one["axis"], []).append(words)
    for axis, variable in found.answer_.left if result["unexplained"] else ():
        texts.setdefault(axis, [f"a torque of no known form over the {variable}"])
    shares = dict.fromkeys(texts, 1.0)
    for one in result["alternatives"]:
        name = f"possibly {one['effect'].replace('_', ' ')}"
        texts.setdefault(one["axis"], []).append(name)
        shares.setdefault(one["axis"], _POSSIBLE)
    return robot_picture(
        robot,
        position,
        recording.sample_period,
        shares=shares,
        texts={axis: "; ".join(told) for axis, told in texts.items()},
        marked=marked_axes(result, found),
    )


def _beside_the_model(found: Discovery) -> list[str]:
    """Names of the effects in the robot's folder that MJCF cannot express."""
    return sorted({one.effect for one in found.answer_.robot.effects})


def _steps(result: dict[str, Any]) -> Figure:
    gap = result["gap"]
    names = [
        "before",
        "calibrated",
        *(f"+ {one['effect']} {one['axis']}" for one in result["effects"]),
    ]
    values = [gap["before"], gap["calibrated"], *(one["gap_after"] for one in result["effects"])]
    with style():
        figure, axes = plt.subplots(figsize=(7, 0.5 * len(names) + 1))
        axes.barh(range(len(names)), values, color=COLOURS[0])
        axes.axvline(gap["floor"], color=COLOURS[1], label="noise")
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.set(xlabel="RMS torque error over RMS torque")
        legend_beside(axes)
    return figure


def _maps(found: Discovery) -> Figure:
    """Mean error over joint angle and motor speed, before and after, in units of the noise."""
    problem, told = found.problem_, found.answer_
    motion = problem.motion
    n_axes = problem.residual.shape[1]
    with style():
        figure, grid = plt.subplots(n_axes, 2, figsize=(9, 1.5 * n_axes + 0.6), squeeze=False)
        for axis in range(n_axes):
            rows = problem.inside[:, axis]
            if not rows.any():
                continue
            x = motion.position[rows, axis] / problem.robot.gear_ratio[axis]
            y = motion.velocity[rows, axis]
            edges = [np.linspace(v.min(), v.max() + 1e-9, 25) for v in (x, y)]
            number = np.histogram2d(x, y, edges)[0]
            shown = []
            for torque in (problem.residual, told.left_torque):
                z = torque[rows, axis] / problem.noise.of_samples()[rows, axis]
                total = np.histogram2d(x, y, edges, weights=z)[0]
                shown.append(np.where(number >= 3, total / np.maximum(number, 1), np.nan))
            largest = max(float(np.nanmax(np.abs(shown[0]))), 1e-9)
            for axes, values in zip(grid[axis], shown, strict=True):
                mesh = axes.pcolormesh(*edges, values.T, cmap="PuOr_r", vmin=-largest, vmax=largest)
                axes.grid(False)
            figure.colorbar(mesh, ax=grid[axis].tolist())
            grid[axis, 0].set(ylabel=f"axis {axis + 1}\n[rad/s]")
        for axes in grid[-1]:
            axes.set(xlabel="joint angle [rad]")
    return figure
