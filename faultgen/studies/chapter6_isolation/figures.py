"""Figures of the study `isolation`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from faultgen.analysis.plots import legend_beside, marker, plot_accuracy, plot_net_transfer_entropy
from faultgen.evaluation.isolate import LEVELS
from faultgen.evaluation.isolators import FRICTION, CrossCorrelation, TransferEntropy5
from faultgen.studies.chapter6_isolation.series import NOISES
from faultgen.studies.chapter6_isolation.tables import pooled
from faultgen.studies.figures import Figures

_NOT_SHOWN = (TransferEntropy5.name, CrossCorrelation.name)  # each has a line much like its own


_THESIS = ("irb6700", "pick_and_place")


def _place(result: dict[str, Any]) -> tuple[str, str]:
    """The robot and task of the thesis' figures, or the first one of the study."""
    places = [(row["robot"], row["task"]) for row in result["bins"]]
    return _THESIS if _THESIS in places else places[0]


def _chance(result: dict[str, Any], place: tuple[str, str] | None = None) -> float:
    """How often a guess is right [%], for one robot and task or as a mean over all."""
    axes = [
        len(row["mean"])
        for row in result["table_6_1"]
        if row["worn"] == 0 and place in (None, (row["robot"], row["task"]))
    ]
    return 100 * sum(1 / n for n in axes) / len(axes)


def _heat_maps(result: dict[str, Any]) -> Figure:
    """Figure 6-4: IRB 6700, task 1, thesis' noise."""
    place = _place(result)
    rows = [
        row
        for row in result["net_transfer_entropy"]
        if (row["robot"], row["task"], row["noise"]) == (*place, "thesis")
    ]
    figure, axes = plt.subplots(1, len(rows), figsize=(11, 4.2))
    largest = max(abs(value) for row in rows for line in row["net"] for value in line)
    for panel, row in zip(axes, rows, strict=True):
        title = "healthy" if row["case"] == "healthy" else f"axis 1 worn by {row['case']}"
        title = f"net TE [bit], {title}"
        plot_net_transfer_entropy(panel, row["net"], title, largest)
    return figure


def _bins(result: dict[str, Any]) -> Figure:
    """Figure 6-5: accuracy against the number of bins, IRB 6700, task 1."""
    place = _place(result)
    name = "IRB 6700, task 1" if place == _THESIS else ", ".join(place)
    figure, panels = plt.subplots(1, len(NOISES), figsize=(11, 3.6), sharey=True)
    for axes, noise in zip(panels, NOISES, strict=True):
        for number, level in enumerate(LEVELS):
            rows = [
                row
                for row in result["bins"]
                if (row["robot"], row["task"]) == place
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
        axes.axhline(_chance(result, place), color="0.3", lw=1.0, ls=":", label="chance")
        axes.set(xlabel="bins", title=f"{name}, noise: {noise}")
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
        axes.axhline(_chance(result), color="0.3", lw=1.0, ls=":", label="chance")
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
                marker=marker(number),
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
