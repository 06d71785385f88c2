"""Interactive charts of a report, drawn in the browser by plotly.js, which the page contains.

A chart is data: traces and axes as plotly.js takes them. It has a caption for everybody, and a
description for those who cannot see it. Its legend stands below the axes, where it covers nothing.

    Chart("Torque", [line("healthy", torque, 0, step=0.004)], x="time [s]", y="torque [N m]",
          caption="...", description="...")
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from faultgen.analysis.plots import MARKERS, colour
from faultgen.report.packing import packed

SYMBOLS = dict(
    zip(
        MARKERS,
        (
            "circle",
            "square",
            "triangle-up",
            "diamond",
            "triangle-down",
            "cross",
            "x",
            "star",
            "triangle-left",
            "triangle-right",
            "pentagon",
            "hexagon",
        ),
        strict=True,
    )
)
"""plotly's name of each of our markers."""

LEGEND = {"orientation": "h", "x": 0, "xanchor": "left", "y": -0.24, "yanchor": "top"}
"""Place of the legend: below the axes and their title."""

_DIVERGING = (  # negative, none, positive; on a light and on a dark background
    [[0, "#5e3c99"], [0.5, "#f7f7f7"], [1, "#b35806"]],
    [[0, "#8a6cc7"], [0.5, "#23262b"], [1, "#d9822b"]],
)


@dataclass(frozen=True, kw_only=True)
class Chart:
    """One chart of a report."""

    title: str
    """What it shows, in a few words."""
    traces: Sequence[dict[str, Any]]
    """Lines, points or maps, from the functions of this module."""
    caption: str
    """How to read it."""
    description: str
    """What a reader would see, in words, with the most important numbers."""
    layout: dict[str, Any] = field(default_factory=dict)
    """Axes and ranges, as plotly.js takes them."""
    over_time: bool = False
    """Whether it shows the motion of the robot in the picture over time [s], so that a line can
    show where the robot is."""

    @property
    def json(self) -> Markup:
        """The chart as JSON that can stand within a script element of a page."""
        layout = {"showlegend": True, "legend": LEGEND} | self.layout
        text = json.dumps({"traces": list(self.traces), "layout": layout}, allow_nan=False)
        return Markup(text.replace("<", "\\u003c"))


def axes(x: str, y: str, **more: Any) -> dict[str, Any]:
    """Layout of a chart with two axes.

    Args:
        x: Title of the horizontal axis.
        y: Title of the vertical axis.
        more: Further entries of the vertical axis, such as type="log".
    """
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}, **more}}


def line(
    name: str,
    y: ArrayLike,
    number: int,
    *,
    x: ArrayLike | None = None,
    start: float = 0.0,
    step: float = 1.0,
    axis: int = 0,
    **more: Any,
) -> dict[str, Any]:
    """A line, or points.

    Args:
        name: Name in the legend.
        y: Values, shape (n,).
        number: Number of its colour.
        x: Places of the values, shape (n,). Default: evenly spaced.
        start: First place, if they are evenly spaced.
        step: Distance between places.
        axis: Axis of the robot for which it is shown, from 1; 0 for all.
        more: Further entries of the trace.

    Returns:
        The trace.
    """
    places = {"x0": start, "dx": step} if x is None else {"x": packed(x)}
    told = {"type": "scatter", "mode": "lines", "name": name, "y": packed(y), **places}
    return {**told, "line": {"width": 1.6}, **more, "meta": {**_colours(number), "axis": axis}}


def path(
    name: str, points: ArrayLike, number: int, *, axis: int = 0, **more: Any
) -> dict[str, Any]:
    """A line in space.

    Args:
        name: Name in the legend.
        points: Shape (n, 3).
        number: Number of its colour.
        axis: Axis of the robot for which it is shown, from 1; 0 for all.
        more: Further entries of the trace.

    Returns:
        The trace.
    """
    x, y, z = (packed(column) for column in np.asarray(points).T)
    told = {"type": "scatter3d", "mode": "lines", "name": name, "x": x, "y": y, "z": z}
    return {**told, "line": {"width": 4}, **more, "meta": {**_colours(number), "axis": axis}}


def square_map(values: ArrayLike, unit: str) -> dict[str, Any]:
    """A map of a square matrix, with the numbers in its cells and 0 in the middle of its colours.

    Args:
        values: Shape (n, n); row i is drawn in row i from the top, counted from 1.
        unit: Unit of the values.

    Returns:
        The trace.
    """
    matrix = np.asarray(values, float)
    largest = max(float(np.abs(matrix).max()), 1e-12)
    numbers = [str(k + 1) for k in range(len(matrix))]
    return {
        "type": "heatmap",
        "x": numbers,
        "y": numbers,
        "z": [[float(f"{value:.4g}") for value in row] for row in matrix],
        "zmin": -largest,
        "zmax": largest,
        "texttemplate": "%{z:.2f}",
        "colorbar": {"title": {"text": unit}, "thickness": 12},
        "meta": {"scale": _DIVERGING, "axis": 0},
    }


def _colours(number: int) -> dict[str, Any]:
    return {"colour": [colour(number), colour(number, dark=True)]}


@lru_cache(maxsize=1)
def library() -> str:
    """plotly.js as the pip package plotly ships it, compressed with gzip, as base64."""
    code = resources.files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()
    return base64.b64encode(gzip.compress(code, 9, mtime=0)).decode()
