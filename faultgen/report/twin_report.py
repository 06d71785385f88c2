"""The report page of a twin: measured and generated data side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from faultgen.analysis.plots import COLOURS, style
from faultgen.report.page import image, page

_BINS = 40


def twin_page(
    robot: str,
    result: dict[str, Any],
    measured: Sequence[Sequence[np.ndarray]],
    generated: Sequence[np.ndarray],
    compared: np.ndarray,
    sample_period: float,
) -> str:
    """Make the report page of a twin.

    Args:
        robot: Name of the robot.
        result: What was learned, see `faultgen.twin.make`.
        measured: Cycles of each recording, shape (samples, n_axes) each, in [N m].
        generated: Generated cycles, same shape.
        compared: Numbers of the samples that are compared.
        sample_period: Time between samples [s].

    Returns:
        The HTML of the page.
    """
    real = np.stack([cycle[compared] for own in measured for cycle in own])
    made = np.stack([cycle[compared] for cycle in generated])
    shares = result["noise"]["over_rms_torque"], result["remainder_over_rms_torque"]
    rows = [
        {
            "axis": axis + 1,
            "noise": f"{100 * level:.2f}",
            "remainder": f"{100 * left:.2f}",
            "measured": f"{np.abs(real[:, :, axis]).mean():.4g}",
            "generated": f"{np.abs(made[:, :, axis]).mean():.4g}",
        }
        for axis, (level, left) in enumerate(zip(*shares, strict=True))
    ]
    return page(
        "twin.html",
        robot=robot,
        result=result,
        rows=rows,
        torque=image(_torque(real, made, sample_period)),
        spectra=image(_spectra(real, made, sample_period)),
        histograms=image(_histograms(real, made)),
    )


def _grid(n_axes: int, xlabel: str, ylabel: str) -> tuple[Figure, list[Axes]]:
    figure, grid = plt.subplots(n_axes, 1, figsize=(9, 1.7 * n_axes + 0.8), squeeze=False)
    for axis, axes in enumerate(grid[:, 0]):
        axes.set(title=f"axis {axis + 1}", ylabel=ylabel)
    grid[-1, 0].set(xlabel=xlabel)
    return figure, list(grid[:, 0])


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, fontsize=8)


def _torque(real: np.ndarray, made: np.ndarray, period: float) -> Figure:
    """Torque over a cycle: the range of all measured and of all generated cycles."""
    time = np.arange(real.shape[1]) * period
    with style():
        figure, grid = _grid(real.shape[2], "time [s]", "torque [N m]")
        for axis, axes in enumerate(grid):
            for cycles, colour, label in (
                (made, COLOURS[1], "generated"),
                (real, COLOURS[0], "measured"),
            ):
                own = cycles[:, :, axis]
                axes.fill_between(
                    time, own.min(axis=0), own.max(axis=0), color=colour, alpha=0.6, label=label
                )
        _legend(grid[0])
    return figure


def _spectra(real: np.ndarray, made: np.ndarray, period: float) -> Figure:
    """Spectra of the difference of each cycle from the mean of its kind."""
    with style():
        figure, grid = _grid(real.shape[2], "frequency [Hz]", "[N$^2$m$^2$/Hz]")
        for axis, axes in enumerate(grid):
            for cycles, colour, label in (
                (real, COLOURS[0], "measured"),
                (made, COLOURS[1], "generated"),
            ):
                own = cycles[:, :, axis]
                if len(own) > 1:
                    own = (own - own.mean(axis=0)) / np.sqrt(1 - 1 / len(own))
                else:
                    own = np.diff(own, axis=1)
                length = min(256, own.shape[1])
                frequency, power = welch(own, fs=1 / period, nperseg=length, axis=1)
                axes.semilogy(frequency[1:], power.mean(axis=0)[1:], color=colour, label=label)
        _legend(grid[0])
    return figure


def _histograms(real: np.ndarray, made: np.ndarray) -> Figure:
    with style():
        figure, grid = _grid(real.shape[2], "torque [N m]", "share of time")
        for axis, axes in enumerate(grid):
            edges = np.histogram_bin_edges(
                np.concatenate([real[:, :, axis].ravel(), made[:, :, axis].ravel()]), _BINS
            )
            for cycles, colour, label in (
                (real, COLOURS[0], "measured"),
                (made, COLOURS[1], "generated"),
            ):
                own = np.histogram(cycles[:, :, axis], edges)[0] / cycles[:, :, axis].size
                axes.stairs(own, edges, color=colour, label=label)
        _legend(grid[0])
    return figure
