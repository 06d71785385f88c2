"""Figures of a study, as files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from faultgen.analysis.plots import style

Figures = dict[str, Callable[[dict[str, Any]], Figure]]
"""What draws each figure of a study's result, by name."""


def draw(figures: Figures, result: dict[str, Any], folder: Path) -> None:
    """Draw all figures of a study.

    Args:
        figures: What draws each.
        result: Of the study.
        folder: Where the PNG files go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in figures.items():
        with style():
            figure = make(result)
            figure.savefig(folder / f"{name}.png", dpi=150)
            plt.close(figure)
