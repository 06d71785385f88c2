"""The report of a dataset: its content, how wear changes the torque, and the isolators' results."""

from __future__ import annotations

from collections.abc import Iterator
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
from faultgen.report.page import image, markdown, page
from faultgen.system.files import write_text

_LINES = 4  # worn runs drawn for an axis


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
    toml = dataset.path / "experiment.toml"
    text = page(
        "dataset.html",
        name=dataset.path.resolve().name,
        found=len(dataset.runs),
        planned=len(dataset.planned),
        cycles=sum(int(run["cycles"]) for run in dataset.runs),
        failed=list(dataset.failed.values()),
        lines=_LINES,
        places=[
            {
                "robot": robot,
                "task": task,
                "wear": image(_wear_figure(here)),
                "isolation": image(_isolation_figure(here, result, robot, task)),
            }
            for robot, task, here in _places(dataset)
        ],
        answers=markdown(table(result)),
        experiment=toml.read_text(encoding="utf-8") if toml.is_file() else None,
    )
    path = dataset.path / "report.html"
    write_text(path, text)
    return path


def _places(dataset: Dataset) -> Iterator[tuple[str, str, list[StoredRun]]]:
    """Each robot and task with its runs."""
    for place in dict.fromkeys((run["robot"], run["task"]) for run in dataset.runs):
        yield *place, [run for run in dataset.runs if (run["robot"], run["task"]) == place]


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
        here = [t for t in result.outcomes if (t.robot, t.task) == (robot, task) and t.level > 0]
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
