"""Figures of the study `classifiers`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.analysis.plots import COLOURS, legend_beside
from faultgen.analysis.preprocessing import COMBINATIONS
from faultgen.evaluation.markdown import stars
from faultgen.studies.chapter5_classifiers.findings import FULL_CHAIN
from faultgen.studies.chapter5_classifiers.study import HORIZON
from faultgen.studies.classifiers_ahead import OWN, OWN_EVENTS
from faultgen.studies.figures import Figures

_STYLES = {"control": ":", FULL_CHAIN: "--", OWN: "-.", OWN_EVENTS: "-"}


def _boxes(result: dict[str, Any]) -> Figure:
    """Figure 5-7: mean, one standard deviation, least and largest AUC of the pairs."""
    shown = list(dict.fromkeys(row["classifier"] for row in result["overall"]))
    figure, panels = plt.subplots(
        len(shown), 1, figsize=(9, 2.2 * len(shown) + 1.2), sharex=True, squeeze=False
    )
    names = [
        name
        for name in [*COMBINATIONS, OWN, OWN_EVENTS]
        if any(c["combination"] == name and c["horizon"] == HORIZON for c in result["cells"])
    ]
    for axes, classifier in zip(panels[:, 0], shown, strict=True):
        boxes, places = [], []
        for cell in result["cells"]:
            where = cell["combination"], cell["classifier"]
            if cell["horizon"] != HORIZON or where[1] != classifier or where[0] not in names:
                continue
            boxes.append(_box(cell))
            places.append(names.index(where[0]) + 1)
        axes.bxp(
            boxes,
            positions=places,
            widths=0.6,
            showfliers=False,
            medianprops={"color": COLOURS[1], "lw": 2.0},
        )
        for row in result["over_control"]:
            if row["classifier"] == classifier and row["change"] > 0:
                place = names.index(row["combination"]) + 1
                axes.text(place, 1.02, stars(row["p"]), ha="center", fontsize=9)
        axes.axhline(0.5, color="0.4", lw=1.0, ls=":")
        axes.set(ylabel=f"AUC, {classifier}", ylim=(-0.05, 1.18), xlim=(0.3, len(names) + 0.7))
    panels[-1, 0].set_xticks(range(1, len(names) + 1), names, rotation=40, ha="right")
    panels[0, 0].set(
        title=f"pairs of robots, {HORIZON} days ahead: mean ± deviation, extremes; "
        "* mean above control's"
    )
    return figure


def _box(cell: dict[str, Any]) -> dict[str, Any]:
    """The thesis' boxes: mean in place of the median, deviations in place of quartiles."""
    auc = np.array(cell["auc"])
    mean, deviation = cell["mean"], cell["deviation"]
    return {
        "med": mean,
        # Beyond 0 and 1 there is no AUC, however large the deviation.
        "q1": max(mean - deviation, 0.0),
        "q3": min(mean + deviation, 1.0),
        "whislo": float(auc.min()),
        "whishi": float(auc.max()),
    }


def _horizons(result: dict[str, Any]) -> Figure:
    """Mean AUC over days ahead, for methods with results at several horizons."""
    figure, axes = plt.subplots(figsize=(7, 3.6))
    lines: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for cell in result["cells"]:
        if cell["combination"] in _STYLES:
            key = cell["combination"], cell["classifier"]
            lines.setdefault(key, []).append((cell["horizon"], cell["mean"]))
    for (name, classifier), points in lines.items():
        axes.plot(
            *zip(*sorted(points), strict=True),
            _STYLES[name],
            marker="o",
            label=f"{name}, {classifier}",
        )
    axes.axhline(0.5, color="0.4", lw=1.0, ls=":")
    axes.set(xlabel="days ahead", ylabel="mean AUC", ylim=(0, 1.02))
    axes.legend(loc="lower left", fontsize=7, ncols=2)
    return figure


def _speed(result: dict[str, Any]) -> Figure:
    """Figure A.1: mean AUC of each robot against its mean speed, LR."""
    rows = [
        r
        for r in result["invariance"]
        if (r["quantity"], r["classifier"]) == ("estimated speed", "LR")
    ]
    figure, axes = plt.subplots(figsize=(6, 3.6))
    for number, row in enumerate(rows):
        level, auc = np.array(row["level"]), np.array(row["auc"])
        colour = COLOURS[number]
        axes.plot(level, auc, "o^"[number % 2], color=colour, label=row["combination"])
        ends = np.array([level.min(), level.max()])
        axes.plot(ends, auc.mean() + row["slope"] * (ends - level.mean()), color=colour, lw=1.2)
    axes.set(xlabel="mean speed over the fleet's largest", ylabel="mean AUC of the robot, LR")
    legend_beside(axes)
    return figure


def _importance(result: dict[str, Any]) -> Figure:
    """Loss of AUC if a measurement of an axis is shuffled."""
    shown = list(dict.fromkeys(row["classifier"] for row in result["importance"]))
    figure, panels = plt.subplots(1, len(shown), figsize=(5.2 * len(shown), 3.4), squeeze=False)
    for axes, classifier in zip(panels[0], shown, strict=True):
        rows = [r for r in result["importance"] if r["classifier"] == classifier and r["axis"]]
        names = list(dict.fromkeys(r["measurement"] for r in rows))
        lost = np.array([r["lost"] for r in rows]).reshape(len(names), -1)
        largest = max(float(np.abs(lost).max()), 1e-12)
        image = axes.imshow(lost, cmap="PuOr_r", vmin=-largest, vmax=largest, aspect="auto")
        axes.set_yticks(range(len(names)), names)
        axes.set_xticks(range(lost.shape[1]), [str(k + 1) for k in range(lost.shape[1])])
        axes.grid(False)
        axes.set(xlabel="axis", title=f"AUC lost by shuffling, {classifier}")
        figure.colorbar(image, ax=axes)
    return figure


FIGURES: Figures = {
    "figure_5_7": _boxes,
    "days_ahead": _horizons,
    "figure_a_1": _speed,
    "importance": _importance,
}
