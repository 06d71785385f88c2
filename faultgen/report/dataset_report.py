"""The report of a dataset: its content, how wear changes the torque, and the isolators' results."""

from __future__ import annotations

import html
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.analysis.plots import (
    legend_beside,
    plot_accuracy,
    plot_net_transfer_entropy,
    plot_series,
    style,
)
from faultgen.analysis.transfer_entropy import net_transfer_entropy
from faultgen.dataset.reader import Dataset, StoredRun, open_dataset
from faultgen.effects import get_effect
from faultgen.evaluation.isolate import isolate
from faultgen.evaluation.observed_runs import one_series
from faultgen.evaluation.outcomes import Isolation, table
from faultgen.report.page import image, page
from faultgen.system.files import write_text

_LINES = 4  # worn runs drawn for an axis
_WEAR_CAPTION = (
    "Mean |motor torque| of each cycle, as stored, one panel for each axis: the healthy robot and "
    f"up to {_LINES} runs in which that axis wears. Only samples within the speed window of the "
    "dataset count, by default motor speeds of 50 to 120 rad/s. A line that leaves the healthy one "
    "shows wear. A panel is empty if no sample is within the window."
)
_ISOLATION_CAPTION = (
    "Left and middle: net transfer entropy between the axes over all cycles of a healthy and of a "
    "worn run, for one draw of the noise. The axis with the largest row is named as worn; note "
    "that a healthy robot, too, has such an axis. Right: share of runs in which the worn axis is "
    "named, with 95 % intervals, for one effect."
)


def write_report(folder: str | Path, result: Isolation | None = None) -> Path:
    """Write ``report.html`` into a dataset's folder.

    Args:
        folder: Folder of the dataset.
        result: Results of the isolators. By default the isolators are run.

    Returns:
        Path of the page.
    """
    dataset = open_dataset(folder)
    result = result or isolate(dataset, progress=False)
    parts = [f"<h1>Dataset {html.escape(dataset.path.resolve().name)}</h1>", _content(dataset)]
    for robot, task in _places(dataset):
        parts.append(f"<h2>{html.escape(robot)}, {html.escape(task)}</h2>")
        here = _runs_at(dataset, robot, task)
        parts.append(image(_wear_figure(here), _WEAR_CAPTION))
        parts.append(image(_isolation_figure(here, result, robot, task), _ISOLATION_CAPTION))
    parts.append("<h2>Which axis is worn?</h2>" + _markdown_table(table(result)))
    toml = dataset.path / "experiment.toml"
    if toml.is_file():
        parts.append(
            f"<h2>Experiment that made this dataset</h2><pre>{html.escape(toml.read_text())}</pre>"
        )
    path = dataset.path / "report.html"
    write_text(path, page(f"faultgen: {dataset.path.name}", "\n".join(parts)))
    return path


def _content(dataset: Dataset) -> str:
    cycles = sum(int(run["cycles"]) for run in dataset.runs)
    lines = [f"{len(dataset.runs)} of {len(dataset.planned)} runs, {cycles} cycles in all."]
    lines += [f"Failed: {html.escape(reason)}" for reason in dataset.failed.values()]
    return "<p>" + "<br>".join(lines) + "</p>"


def _places(dataset: Dataset) -> list[tuple[str, str]]:
    return list(dict.fromkeys((run["robot"], run["task"]) for run in dataset.runs))


def _runs_at(dataset: Dataset, robot: str, task: str) -> list[StoredRun]:
    return [run for run in dataset.runs if (run["robot"], run["task"]) == (robot, task)]


def _wear_figure(runs: list[StoredRun]) -> Figure:
    """Mean |torque| of each axis, in the healthy run and in runs in which that axis wears."""
    n_axes = runs[0].read("monitoring/mean_abs_torque").shape[1]
    with style():
        columns = min(3, n_axes)
        rows = -(-n_axes // columns)
        figure, grid = plt.subplots(rows, columns, figsize=(9, 2.4 * rows), squeeze=False)
        for axis, axes in enumerate(grid.flat[:n_axes], start=1):
            healthy = [run for run in runs if run["axis"] == 0][:1]
            chosen = healthy + [run for run in runs if axis in run["axes"]][:_LINES]
            for number, run in enumerate(chosen):
                values = run.read("monitoring/mean_abs_torque")[:, axis - 1]
                plot_series(axes, np.arange(1, len(values) + 1), values, _name(run), number)
            axes.set(title=f"axis {axis}", ylabel="mean |torque| [N m]")
            if chosen:
                axes.legend(loc="upper left", fontsize=7)
    return figure


def _name(run: StoredRun) -> str:
    if run["axis"] == 0:
        return "healthy"
    shown = get_effect(run["effect"]).shown(run["severity"])
    return f"{run['effect']} {shown}, seed {run['seed']}"


def _isolation_figure(runs: list[StoredRun], result: Isolation, robot: str, task: str) -> Figure:
    """Net transfer entropy of a healthy and of a worn run, and accuracy by severity."""
    healthy = next((run for run in runs if run["axis"] == 0), None)
    worn = next((run for run in runs if run["axis"] > 0), None)
    with style():
        figure, grid = plt.subplots(1, 3, figsize=(9, 3))
        for axes, run in ((grid[0], healthy), (grid[1], worn)):
            x = None if run is None else np.nan_to_num(one_series(run))
            if run is None or x is None or len(x) < 3:
                axes.axis("off")
                continue
            title = "healthy" if run["axis"] == 0 else f"axis {run['axis']} worn"
            plot_net_transfer_entropy(axes, net_transfer_entropy(x), f"net TE [bit], {title}")
        here = [t for t in result.tallies if (t.robot, t.task) == (robot, task) and t.level > 0]
        first = min((t.effect for t in here), default="")
        for number, method in enumerate(dict.fromkeys(t.method for t in here)):
            cells = [t for t in here if (t.effect, t.method) == (first, method)]
            if cells:
                plot_accuracy(
                    grid[2],
                    [t.level for t in cells],
                    [t.accuracy for t in cells],
                    [t.interval for t in cells],
                    method,
                    number,
                )
        if here:
            legend_beside(grid[2])
        else:
            grid[2].axis("off")
    return figure


def _markdown_table(text: str) -> str:
    """Turn lines of Markdown that contain a table into HTML."""
    out: list[str] = []
    rows = [line for line in text.splitlines() if line.startswith("|")]
    for number, line in enumerate(row for row in rows if not row.startswith("| ---")):
        cell = "th" if number == 0 else "td"
        cells = [part.strip() for part in line.strip("|").split("|")]
        out.append("<tr>" + "".join(f"<{cell}>{html.escape(c)}</{cell}>" for c in cells) + "</tr>")
    said = [html.escape(line) for line in text.splitlines() if line and not line.startswith("|")]
    return "<p>" + "<br>".join(said) + "</p><table>" + "\n".join(out) + "</table>"
