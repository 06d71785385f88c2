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
from faultgen.report.chart import Chart, axes, library, line
from faultgen.report.page import image, page
from faultgen.report.robot_picture import robot_picture, shapes_of
from faultgen.report.terms import definitions
from faultgen.robot import Robot

_BINS = 40
_MOST_TIMES = 2000  # samples of a line


def twin_page(
    robot: Robot,
    result: dict[str, Any],
    measured: Sequence[Sequence[np.ndarray]],
    generated: Sequence[np.ndarray],
    *,
    compared: np.ndarray,
    sample_period: float,
    position: np.ndarray,
) -> str:
    """Make the report page of a twin.

    Args:
        robot: The twin.
        result: What was learned, see `faultgen.twin.make`.
        measured: Cycles of each recording, shape (samples, n_axes) each, in [N m].
        generated: Generated cycles, same shape.
        compared: Numbers of the samples that are compared.
        sample_period: Time between samples [s].
        position: Joint positions of the motion, shape (samples, n_axes), in [rad], or [m] for
            slides.

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
    left = np.array(result["remainder_over_rms_torque"])
    most = int(np.argmax(left)) + 1
    picture = robot_picture(
        robot,
        position,
        sample_period,
        shares=dict(enumerate(left / max(left.max(), 1e-12), start=1)),
        texts={k: f"the model lacks {100 * one:.1f} %" for k, one in enumerate(left, start=1)},
        marked=[most],
    )
    return page(
        "twin.html",
        robot_name=robot.name,
        result=result,
        rows=rows,
        picture=picture,
        scenes=shapes_of([picture]),
        axes=range(1, len(left) + 1),
        first=most,
        torque=_torque(real, made, compared * sample_period),
        library=library(),
        terms=definitions(["AUC", "RMS", "PSD"]),
        spectra=image(_spectra(real, made, sample_period)),
        histograms=image(_histograms(real, made)),
    )


def _grid(n_axes: int, xlabel: str, ylabel: str) -> tuple[Figure, list[Axes]]:
    figure, grid = plt.subplots(n_axes, 1, figsize=(9, 1.7 * n_axes + 0.8), squeeze=False)
    for axis, place in enumerate(grid[:, 0]):
        place.set(title=f"axis {axis + 1}", ylabel=ylabel)
    grid[-1, 0].set(xlabel=xlabel)
    return figure, list(grid[:, 0])


def _legend(place: Axes) -> None:
    place.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, fontsize=8)


def _torque(real: np.ndarray, made: np.ndarray, times: np.ndarray) -> Chart:
    """Torque over a cycle: the range of all measured and of all generated cycles."""
    every = -(-len(times) // _MOST_TIMES)
    at = times[::every]
    traces, told = [], []
    for axis in range(1, real.shape[2] + 1):
        for name, cycles, number in (("generated", made, 1), ("measured", real, 0)):
            own = cycles[:, ::every, axis - 1]
            traces.append(line(name, own.min(axis=0), number, x=at, axis=axis, showlegend=False))
            traces.append(line(name, own.max(axis=0), number, x=at, axis=axis, fill="tonexty"))
        gap = real[:, :, axis - 1].mean(axis=0) - made[:, :, axis - 1].mean(axis=0)
        told.append(f"axis {axis} {np.sqrt(np.mean(gap**2)):.3g}")
    return Chart(
        title="Torque over the motion",
        traces=traces,
        layout=axes("time [s]", "motor torque [N m]"),
        over_time=True,
        caption="Range of all measured and of all generated healthy cycles.",
        description="Bands of the motor torque over time, measured and generated. RMS difference "
        f"of their means in N m: {', '.join(told)}.",
    )


def _spectra(real: np.ndarray, made: np.ndarray, period: float) -> Figure:
    """Spectra of the difference of each cycle from the mean of its kind."""
    with style():
        figure, grid = _grid(real.shape[2], "frequency [Hz]", "[N$^2$m$^2$/Hz]")
        for axis, place in enumerate(grid):
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
                place.semilogy(frequency[1:], power.mean(axis=0)[1:], color=colour, label=label)
        _legend(grid[0])
    return figure


def _histograms(real: np.ndarray, made: np.ndarray) -> Figure:
    with style():
        figure, grid = _grid(real.shape[2], "torque [N m]", "share of time")
        for axis, place in enumerate(grid):
            edges = np.histogram_bin_edges(
                np.concatenate([real[:, :, axis].ravel(), made[:, :, axis].ravel()]), _BINS
            )
            for cycles, colour, label in (
                (real, COLOURS[0], "measured"),
                (made, COLOURS[1], "generated"),
            ):
                own = np.histogram(cycles[:, :, axis], edges)[0] / cycles[:, :, axis].size
                place.stairs(own, edges, color=colour, label=label)
        _legend(grid[0])
    return figure
