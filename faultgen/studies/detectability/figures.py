"""Figures of the study `detectability`: the map."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from faultgen.effects import EFFECTS
from faultgen.studies.detectability.tables import of_train
from faultgen.studies.detectability.units import in_plant_units, shown
from faultgen.studies.figures import Figures

_LOW, _HIGH = 1e-3, 100.0  # ends of the colours: smallest severity over the default one


def _map(result: dict[str, Any], value: Any, title: str) -> Figure:
    """Smallest severity of every effect, task and axis, over the default one."""
    rows = result["rows"]
    effects = list(dict.fromkeys(row["effect"] for row in rows))
    places = list(dict.fromkeys((row["robot"], row["task"]) for row in rows))
    columns = [
        (robot, task, axis)
        for robot, task in places
        for axis in sorted({r["axis"] for r in rows if (r["robot"], r["task"]) == (robot, task)})
    ]
    grid = np.full((len(effects), len(columns)), np.nan)
    text: dict[tuple[int, int], str] = {}
    for row in rows:
        at = (
            effects.index(row["effect"]),
            columns.index((row["robot"], row["task"], row["axis"])),
        )
        severity = value(row)
        text[at] = shown(severity, row["unit"]).split(" ")[0] if severity is not None else "x"
        grid[at] = severity / EFFECTS[row["effect"]].default if severity is not None else np.inf
    size = (2.6 + 0.62 * len(columns), 1.6 + 0.28 * len(effects))
    figure, axes = plt.subplots(figsize=size)
    colours = plt.get_cmap("viridis_r").with_extremes(over="0.75", bad="white")
    image = axes.imshow(
        np.ma.masked_invalid(np.where(np.isinf(grid), 10 * _HIGH, grid)),
        aspect="auto",
        cmap=colours,
        norm=LogNorm(_LOW, _HIGH),
    )
    for (row_at, column_at), words in text.items():
        dark = grid[row_at, column_at] > 1 and np.isfinite(grid[row_at, column_at])
        axes.text(
            column_at,
            row_at,
            words,
            ha="center",
            va="center",
            fontsize=5.5,
            color="white" if dark else "black",
        )
    units = {row["effect"]: in_plant_units(0.0, row["unit"])[1] for row in rows}
    labels = [f"{name.replace('_', ' ')} [{units[name]}]" for name in effects]
    axes.set_yticks(range(len(effects)), labels)
    axes.set_xticks(range(len(columns)), [str(axis) for _, _, axis in columns])
    axes.set_xlabel("axis")
    start = 0
    for robot, task in places:
        count = sum((r, t) == (robot, task) for r, t, _ in columns)
        axes.text(
            start + (count - 1) / 2,
            -0.7,
            f"{robot}\n{task.replace('_', ' ')}",
            ha="center",
            va="bottom",
            fontsize=7,
        )
        if start:
            axes.axvline(start - 0.5, color="white", lw=2)
        start += count
    axes.set_title(title, pad=30, fontsize=9)
    axes.grid(visible=False)
    figure.colorbar(image, label="smallest severity / default severity", pad=0.01)
    return figure


def _ideal(result: dict[str, Any]) -> Figure:
    return _map(
        result, lambda row: row["ideal"], "Smallest severity that an ideal detector sees (x: none)"
    )


def _train(result: dict[str, Any]) -> Figure:
    return _map(
        result, of_train, "Smallest severity that the detector of faultgen train sees (x: none)"
    )


FIGURES: Figures = {"detectability_ideal": _ideal, "detectability_train": _train}
"""Function that draws each figure, by name."""
