"""Figures of the study `isolation`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from faultgen.analysis.plots import legend_beside, plot_accuracy, plot_net_transfer_entropy
from faultgen.evaluation.isolate import LEVELS
from faultgen.evaluation.isolators import FRICTION, CrossCorrelation, TransferEntropy5
from faultgen.studies.chapter6_isolation.series import NOISES
from faultgen.studies.chapter6_isolation.tables import pooled
from faultgen.studies.figures import Figures

_NOT_SHOWN = (TransferEntropy5.name, CrossCorrelation.name)  # each has a line much like its own


def _heat_maps(result: dict[str, Any]) -> Figure:
    """Figure 6-4: IRB 6700, task 1, thesis' noise."""
    rows = [
        row
        for row in result["net_transfer_entropy"]
        if (row["robot"], row["task"], row["noise"]) == ("irb6700", "pick_and_place", "thesis")
    ]
    figure, axes = plt.subplots(1, len(rows), figsize=(11, 4.2))
    largest = max(abs(value) for row in rows for line in row["net"] for value in line)
    for place, row in zip(axes, rows, strict=True):
        title = "healthy" if row["case"] == "healthy" else f"axis 1 worn by {row['case']}"
        title = f"net TE [bit], {title}"
        plot_net_transfer_entropy(place, row["net"], title, largest)
    return figure


def _bins(result: dict[str, Any]) -> Figure:
    """Figure 6-5: accuracy against the number of bins, IRB 6700, task 1."""
    figure, panels = plt.subplots(1, len(NOISES), figsize=(11, 3.6), sharey=True)
    for axes, noise in zip(panels, NOISES, strict=True):
        for number, level in enumerate(LEVELS):
            rows = [
                row
                for row in result["bins"]
                if row["robot"] == "irb6700"
                and row["task"] == "pick_and_place"
                and row["noise"] == noise
                and row["level"] == level
            ]
            plot_accuracy(
                axes,
                [row["bins"] / 100 for row in rows],
                [row["share"] for row in rows],
                [(row["low"], row["high"]) for row in rows],
                f"{100 * level:g} % wear",
                number,
            )
        axes.axhline(100 / 6, color="0.3", lw=1.0, ls=":", label="chance")
        axes.set(xlabel="bins", title=f"IRB 6700, task 1, noise: {noise}")
        if axes is not panels[0]:
            axes.set(ylabel="")
    legend_beside(panels[-1])
    return figure


def _accuracy(result: dict[str, Any]) -> Figure:
    """Accuracy against wear for each noise, all robots, tasks and axes."""
    names = dict.fromkeys(row["method"] for row in result["isolation"])
    shown = [name for name in names if name not in _NOT_SHOWN]
    figure, panels = plt.subplots(1, len(NOISES), figsize=(11, 3.8), sharey=True)
    for axes, noise in zip(panels, NOISES, strict=True):
        for number, method in enumerate(shown):
            rows = [
                pooled(result["isolation"], noise=noise, method=method, level=level)
                for level in LEVELS
            ]
            plot_accuracy(
                axes,
                LEVELS,
                [row["share"] for row in rows],
                [(row["low"], row["high"]) for row in rows],
                method,
                number,
            )
        axes.axhline(100 / 6, color="0.3", lw=1.0, ls=":", label="chance")
        axes.set(title=f"noise: {noise}", xticks=[100 * level for level in LEVELS])
        if axes is not panels[0]:
            axes.set(ylabel="")
    legend_beside(panels[-1])
    return figure


def _severity(result: dict[str, Any]) -> Figure:
    """RMS error of the severity against wear, best method."""
    figure, panels = plt.subplots(1, len(NOISES), figsize=(11, 3.6), sharey=True)
    places = list(dict.fromkeys((row["robot"], row["task"]) for row in result["severity"]))
    for axes, noise in zip(panels, NOISES, strict=True):
        for number, (robot, task) in enumerate(places):
            rows = [
                row
                for row in result["severity"]
                if (row["robot"], row["task"]) == (robot, task)
                and row["noise"] == noise
                and row["method"] == FRICTION
            ]
            axes.plot(
                [100 * row["severity"] for row in rows],
                [100 * row["rms_error"] for row in rows],
                marker="os^DvP"[number],
                label=f"{robot} {task}",
                lw=1.2,
            )
        axes.axhline(1.0, color="0.3", lw=0.9, ls="--", label="goal")
        axes.set(xlabel="wear [%]", title=f"noise: {noise}", yscale="log")
        axes.set_xticks([100 * level for level in LEVELS])
    panels[0].set_ylabel("RMS error of severity [percentage points]")
    legend_beside(panels[-1])
    return figure


FIGURES: Figures = {
    "net_transfer_entropy": _heat_maps,
    "bins": _bins,
    "accuracy": _accuracy,
    "severity": _severity,
}
"""Functions that draw each figure, by name."""
