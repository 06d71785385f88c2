"""Figures of the study `detection`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.analysis.monitoring_plots import (
    plot_contributions,
    plot_control_chart,
    plot_detection_delay,
    plot_divergence,
    plot_scores,
)
from faultgen.analysis.plots import legend_beside
from faultgen.studies.chapter3_detection.detectors import DivergenceBoth
from faultgen.studies.chapter3_detection.study import NOISES, TRAINING, WORN
from faultgen.studies.figures import Figures

_NOT_SHOWN = (DivergenceBoth.name,)  # its line lies on that of Q


def _divergence(result: dict[str, Any]) -> Figure:
    """Figure 3-2."""
    divergence = np.array(result["example"]["divergence"])[TRAINING:]
    figure, axes = plt.subplots(figsize=(7, 3.6))
    plot_divergence(axes, np.arange(1, len(divergence) + 1), divergence)
    axes.set(xlabel="hours of wear", title="axis 1 worn by 10 % within 120 h, task 1")
    return figure


def _charts(result: dict[str, Any]) -> Figure:
    """Figure 3-3, with T² in addition to Q."""
    example = result["example"]
    figure, panels = plt.subplots(2, 1, figsize=(8, 5.6), sharex=True)
    plot_control_chart(panels[0], example["t2"], example["t2_limits"], "T²")
    plot_control_chart(panels[1], example["q"], example["q_limits"], "Q")
    for axes in panels:
        axes.axvline(TRAINING + 0.5, color="0.4", lw=1.0, ls=":")
    panels[0].set(xlabel="", title="120 h of training, then 120 h in which axis 1 wears by 10 %")
    panels[1].set(xlabel="hour")
    return figure


def _scores(result: dict[str, Any]) -> Figure:
    example = result["example"]
    figure, panels = plt.subplots(1, 2, figsize=(10, 3.8))
    scores = np.array(example["scores"])
    groups = ["training"] * TRAINING + ["wear"] * (len(scores) - TRAINING)
    if scores.shape[1] > 1:
        plot_scores(panels[0], scores, example["eigenvalues"], TRAINING, groups)
    else:  # one component explains enough
        panels[0].plot(np.arange(1, len(scores) + 1), scores[:, 0], ".")
        panels[0].set(xlabel="hour", ylabel="score along the only component")
    names = [f"axis {k + 1}" for k in range(len(example["contributions"]))]
    plot_contributions(panels[1], example["contributions"], names)
    panels[1].set(xlabel="contribution to Q, last 12 hours")
    return figure


def _delay(result: dict[str, Any]) -> Figure:
    """Delay against false alarms, and how often the right axis is named."""
    figure, panels = plt.subplots(2, len(NOISES), figsize=(10, 6), sharex=True, sharey="row")
    names = dict.fromkeys(row["detector"] for row in result["detectors"])
    shown = [name for name in names if name not in _NOT_SHOWN]
    for column, noise in zip(panels.T, NOISES, strict=True):
        for number, name in enumerate(shown):
            rows = [
                row
                for row in result["detectors"]
                if row["noise"] == noise and row["detector"] == name
            ]
            # a rate of 0 has no place on a logarithmic axis
            rates = [max(row["false_alarms_a_month"], 0.5 / row["months"]) for row in rows]
            half = [k for k, row in enumerate(rows) if row["median_hours"] is not None]
            delays = [rows[k]["median_hours"] for k in half]
            if half:
                plot_detection_delay(column[0], [rates[k] for k in half], delays, name, number)
            if all(row["located"] for row in rows):
                located = [100 * row["located"]["share"] for row in rows]
                plot_detection_delay(column[1], rates, located, name, number)
        column[0].set(title=noise, xlabel="", ylabel="median hours to alarm", ylim=(0, WORN + 5))
        column[1].set(ylabel="alarm with the right axis [%]", ylim=(0, 103))
    for axes in panels[:, 1]:
        axes.set(ylabel="")
    legend_beside(panels[1, 1])
    return figure


FIGURES: Figures = {
    "divergence": _divergence,
    "control_charts": _charts,
    "scores": _scores,
    "detection_delay": _delay,
}
"""Functions that draw each figure, by name."""
