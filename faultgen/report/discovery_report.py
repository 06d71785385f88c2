"""The files of a discovery: its result, the model, the next experiment and the report page."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.analysis.plots import COLOURS, legend_beside, style
from faultgen.discovery.physical import GAIN
from faultgen.discovery.workflow import Discovery, dump
from faultgen.effects import get_effect
from faultgen.mjcf.edit import write_model
from faultgen.report.page import image, page
from faultgen.system.files import write_text


def write_discovery(folder: Path, result: dict[str, Any], found: Discovery) -> None:
    """Write ``discovery.json``, ``model.xml``, ``report.html``, and the next experiment if any.

    Args:
        folder: Folder for the files. It is created if it does not exist.
        result: Content of ``discovery.json``.
        found: The discovery from which the result was made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # what was found comes first, so that nothing that fails afterwards loses it
    write_text(folder / "discovery.json", dump(result))
    robot = found.answer.robot
    write_model(folder / "model.xml", robot.xml, robot.assets)
    if found.experiment is not None:
        write_text(folder / "next_experiment.toml", found.experiment.toml)
    write_text(folder / "report.html", _report(result, found))


def _report(result: dict[str, Any], found: Discovery) -> str:
    problem, told = found.problem, found.answer
    of = (
        "Measured torque minus that of the healthy recording"
        if problem.twin
        else ("Measured torque minus that of the model as it was given")
    )
    parts = [
        f"<h1>Verdict: {html.escape(result['verdict'])}</h1>",
        f"<p>{html.escape(result['unexplained'])}</p>",
        _effects_table(result["effects"], "Effects, in the order added"),
        _effects_table(
            result["alternatives"],
            "Other effects that the data do not exclude"
            if result["effects"]
            else "Effects that explain the gap best, but leave too much of it unexplained",
        ),
        _beside_the_model(found),
        _experiment(result["next_experiment"]),
        _gap_tables(result),
        image(
            _steps(result),
            "The gap before and after calibration and after each added effect, on motions that "
            "were used neither to fit nor to choose the effects. A good result ends near the line "
            "of the noise.",
        ),
        image(
            _overlay(found),
            f"{of} (grey), and the part of it that calibration and effects explain (coloured). "
            "Where the two agree, nothing is missing.",
        ),
        image(
            _maps(found),
            "The gap by joint angle and motor speed before (left) and after (right) the effects "
            "were added, in standard deviations of the noise, with one row for each axis. A "
            "pattern that remains on the right has not been explained.",
        ),
        _where_table(result["where"]),
        _calibration(result["calibration"]),
        *(f"<p>{html.escape(text)}</p>" for text in result["warnings"]),
        "<p>Probability that noise alone causes the gap that is left after calibration: "
        f"p = {told.p_value:.2g}. The discovery took {result['seconds']:g} s.</p>",
    ]
    return page("faultgen discover", "\n".join(part for part in parts if part))


def _effects_table(rows: list[dict[str, Any]], title: str) -> str:
    if not rows:
        return ""
    lines = ["<tr><th>effect</th><th>axis</th><th>severity</th><th>confidence</th></tr>"]
    for row in rows:
        parameters = row.get("parameters", {})
        shown = ""
        if parameters:
            low, high = row["interval"]["severity"]
            unit = html.escape(parameters["unit"])
            shown = f"{parameters['severity']:.4g} [{low:.4g}, {high:.4g}], {unit}"
            shown += "".join(
                f"; {name} {value:.4g}"
                for name, value in parameters.items()
                if name not in ("severity", "unit")
            )
        lines.append(
            f"<tr><td>{html.escape(row['effect'])}</td><td>{row['axis']}</td><td>{shown}</td>"
            f"<td>{row['confidence']:.2f}</td></tr>"
        )
    return f"<h2>{title}</h2><table>{''.join(lines)}</table>"


def _beside_the_model(found: Discovery) -> str:
    names = sorted(
        {
            term.name
            for term, _ in found.answer.changes
            if term.is_effect and not (term.name == GAIN or get_effect(term.name).edit)
        }
        & {one.effect for one in found.answer.effects}
    )
    if not names:
        return ""
    return (
        f"<p>MJCF cannot express {', '.join(names)}. model.xml therefore holds all other changes; "
        "<code>faultgen.simulation.plant.assemble</code> adds these.</p>"
    )


def _experiment(experiment: dict[str, Any] | None) -> str:
    if experiment is None:
        return ""
    pair = " and ".join(f"{one['effect']} of axis {one['axis']}" for one in experiment["separates"])
    return (
        f"<h2>Next experiment</h2><p>Task <b>{html.escape(experiment['task'])}</b> "
        f"(next_experiment.toml) separates {html.escape(pair)} by {experiment['distance']:.0f} "
        "standard deviations of the noise, if everything else in the model is right. The present "
        f"recording, with everything else uncertain, separates them by {experiment['now']:.1f}.</p>"
    )


def _gap_tables(result: dict[str, Any]) -> str:
    gap = result["gap"]
    steps = [("before", gap["before"]), ("calibrated", gap["calibrated"])]
    steps += [
        (f"with {one['effect']} of axis {one['axis']}", one["gap_after"])
        for one in result["effects"]
    ]
    steps += [("after", gap["after"]), ("floor (noise)", gap["floor"])]
    rows = "".join(f"<tr><td>{name}</td><td>{value:.4f}</td></tr>" for name, value in steps)
    names = ("axis", "before", "calibrated", "after", "floor")
    axes = "".join(
        "<tr>"
        + "".join(f"<td>{one[n] if n == 'axis' else f'{one[n]:.4f}'}</td>" for n in names)
        + "</tr>"
        for one in gap["per_axis"]
    )
    head = "".join(f"<th>{name}</th>" for name in names)
    return (
        f"<h2>Gap</h2><table>{rows}</table><p>{html.escape(gap['measure'])}</p>"
        f"<table><tr>{head}</tr>{axes}</table>"
    )


def _where_table(rows: list[dict[str, Any]]) -> str:
    if not rows:
        return ""
    lines = [
        "<tr><th>axis</th><th>regime</th><th>share of the gap</th>"
        "<th>density, axis = 1</th><th>p</th></tr>"
    ]
    lines += [
        f"<tr><td>{one['axis']}</td><td>{one['regime']}</td><td>{one['share']:.2f}</td>"
        f"<td>{one['intensity']:.2f}</td><td>{one['p_value']:.2g}</td></tr>"
        for one in rows
    ]
    return (
        "<h2>Where the gap is, after calibration</h2>"
        f"<table>{''.join(lines)}</table><p>A sample can belong to several regimes. At most 5 % of "
        "the rows are expected to be false discoveries.</p>"
    )


def _calibration(values: dict[str, dict[str, float]]) -> str:
    if not values:
        return ""
    rows = "".join(
        f"<tr><td>{name}</td><td>{axis}</td><td>{value:.4g}</td></tr>"
        for name, axes in values.items()
        for axis, value in axes.items()
    )
    return (
        "<h2>Calibration: parameters that differ from the model by more than half of their assumed "
        "uncertainty</h2>"
        f"<table><tr><th>parameter</th><th>axis</th><th>difference</th></tr>{rows}</table>"
    )


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


def _overlay(found: Discovery) -> Figure:
    problem, told = found.problem, found.answer
    gap = problem.residual
    n_axes = gap.shape[1]
    time = np.arange(len(gap)) * problem.recording.sample_period
    explained = gap - told.left_torque
    side = "joint" if problem.recording.side == "joint" else "motor"
    with style():
        figure, grid = plt.subplots(
            n_axes, 1, figsize=(9, 1.6 * n_axes + 0.6), sharex=True, squeeze=False
        )
        for axis, axes in enumerate(grid[:, 0]):
            inside = problem.inside[:, axis]
            axes.plot(
                time, np.where(inside, gap[:, axis], np.nan), color="0.6", lw=0.5, label="gap"
            )
            axes.plot(
                time,
                np.where(inside, explained[:, axis], np.nan),
                color=COLOURS[1],
                lw=0.8,
                label="explained",
            )
            for p in problem.scoring:
                part = problem.parts[p]
                axes.axvspan(time[part.start], time[part.stop - 1], color="0.92", zorder=0)
            axes.set(ylabel=f"axis {axis + 1}")
        grid[0, 0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, fontsize=8)
        grid[-1, 0].set(xlabel="time [s]; grey: motions for scoring only")
        figure.supylabel(f"torque, {side} side [N m]")
    return figure


def _maps(found: Discovery) -> Figure:
    """Mean error over joint angle and motor speed, before and after, in units of the noise."""
    problem, told = found.problem, found.answer
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
                z = torque[rows, axis] / problem.noise.deviation[axis]
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
