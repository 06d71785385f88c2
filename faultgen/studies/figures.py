"""Files with the figures of a study."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from faultgen.analysis.plots import style
from faultgen.system.files import write_bytes

Figures = dict[str, Callable[[dict[str, Any]], Figure]]
"""Functions that draw each figure of a study's result, by name."""


def draw(figures: Figures, result: dict[str, Any], folder: Path) -> None:
    """Draw all figures of a study.

    Args:
        figures: Function that draws each figure.
        result: Result of the study.
        folder: Folder for the PNG files.

    Raises:
        StorageFailed: A file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in figures.items():
        with style():
            figure, drawn = make(result), io.BytesIO()
            figure.savefig(drawn, format="png", dpi=150)
            plt.close(figure)
        write_bytes(folder / f"{name}.png", drawn.getvalue())
