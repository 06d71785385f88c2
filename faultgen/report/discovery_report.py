"""The page that tells what was discovered."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from analysis.plots import COLOURS, style
from faultgen.report.page import image, page
from faultgen.storage import write_text


def write_discovery_report(
    path: Path, result: dict[str, Any], gap: np.ndarray, change: np.ndarray, sample_period: float
) -> None:
    """Write a self-contained HTML page.

    Args:
        path: The file.
        result: Content of ``discovery.json``.
        gap: Torque measured less that of the healthy twin, shape (samples, n_axes), in [N m].
        change: What the effects make of it, same shape.
        sample_period: Time between samples [s].
    """
    parts = [
        f"<h1>Verdict: {html.escape(result['verdict'])}</h1>",
        _effects_table(result["effects"], "Effects, in the order added"),
        _effects_table(result["alternatives"], "Not excluded, or part of what was tried"),
        f"<p>{html.escape(result['unexplained'])}</p>",
        _gap_table(result["gap"]),
        image(
            _overlay(gap, change, sample_period),
            "Torque measured less that of the healthy twin, and what the effects explain of it.",
        ),
        *(f"<p>{html.escape(text)}</p>" for text in result["warnings"]),
    ]
    write_text(path, page("faultgen discover", "\n".join(parts)))


def _effects_table(rows: list[dict[str, Any]], title: str) -> str:
    if not rows:
        return ""
    lines = ["<tr><th>effect</th><th>axis</th><th>severity</th><th>confidence</th></tr>"]
    for row in rows:
        parameters = row.get("parameters", {})
        shown = ""
        if parameters:
            low, high = row["interval"]["severity"]
            unit = html.escape(parameters["unit"])
            shown = f"{parameters['severity']:.4g} [{low:.4g}, {high:.4g}], {unit}"
        lines.append(
            f"<tr><td>{html.escape(row['effect'])}</td><td>{row['axis']}</td><td>{shown}</td>"
            f"<td>{row['confidence']:.2f}</td></tr>"
        )
    return f"<h2>{title}</h2><table>{''.join(lines)}</table>"


def _gap_table(gap: dict[str, Any]) -> str:
    cells = "".join(
        f"<tr><td>{name}</td><td>{gap[name]:.4f}</td></tr>" for name in ("before", "after", "floor")
    )
    return f"<h2>Gap</h2><table>{cells}</table><p>{html.escape(gap['measure'])}</p>"


def _overlay(gap: np.ndarray, change: np.ndarray, period: float) -> Figure:
    n_axes = gap.shape[1]
    time = np.arange(len(gap)) * period
    with style():
        figure, grid = plt.subplots(
            n_axes, 1, figsize=(9, 1.6 * n_axes + 0.6), sharex=True, squeeze=False
        )
        for axis, axes in enumerate(grid[:, 0]):
            axes.plot(time, gap[:, axis], color="0.6", lw=0.5, label="measured difference")
            axes.plot(time, change[:, axis], color=COLOURS[1], lw=1.0, label="effects")
            axes.set(ylabel=f"axis {axis + 1}")
        grid[0, 0].legend(loc="upper right", ncols=2, fontsize=8)
        grid[-1, 0].set(xlabel="time [s]")
        figure.supylabel("torque [N m]")
    return figure
