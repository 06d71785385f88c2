"""Figures of the study `events`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.studies.chapter2_events.study import BEFORE, DETECTORS, NEVER, TRAINING
from faultgen.studies.figures import Figures

_SHOWN = 12  # events with the largest contributions


def _course(result: dict[str, Any]) -> Figure:
    """Median of robots that fail and that do not."""
    figure, panels = plt.subplots(2, 1, figsize=(8, 5.4), sharex=True)
    for axes, (name, both) in zip(panels, result["course"].items(), strict=True):
        days = np.arange(len(both["failing"])) - len(both["failing"])
        for group, colour in (("failing", "C3"), ("healthy", "C0")):
            axes.plot(days[TRAINING:], both[group][TRAINING:], color=colour, lw=1, label=group)
        axes.axhline(1, color="0.4", lw=0.8, ls="--")
        axes.axvline(-BEFORE, color="0.4", lw=0.8, ls=":")
        axes.set(yscale="log", ylabel=f"{name.replace('2', '²')} / limit, median")
    panels[0].legend(loc="upper left")
    panels[1].set(xlabel="days to failure, or to the end of the record")
    return figure


def _example(result: dict[str, Any]) -> Figure:
    """Figure 2-1."""
    example = result["example"]
    figure, panels = plt.subplots(2, 1, figsize=(8, 5.4), sharex=True)
    for axes, name in zip(panels, ("Q", "T2"), strict=True):
        values = np.array(example[name])
        days = np.arange(len(values)) - len(values)
        axes.semilogy(days, np.maximum(values, 1e-3), color="C0", lw=0.9)
        axes.axhline(1, color="C3", lw=0.8, ls="--", label="95 % limit")
        axes.axvline(days[0] + TRAINING, color="0.4", lw=0.8, ls=":", label="end of training")
        axes.set(ylabel=f"{name.replace('2', '²')} / limit")
    panels[0].set(title=f"{example['robot']}, gearbox {example['axis']} fails at day 0")
    panels[0].legend(loc="upper left")
    panels[1].set(xlabel="days to failure")
    return figure


def _contributions(result: dict[str, Any]) -> Figure:
    """Figure 2-2."""
    example = result["example"]
    figure, panels = plt.subplots(1, 2, figsize=(11, 4.2))
    for axes, name in zip(panels, ("q", "t2"), strict=True):
        values = np.array(example[f"{name}_contributions"])
        order = np.argsort(-np.abs(values))[:_SHOWN][::-1]
        axes.barh([example["names"][k] for k in order], values[order], color="C0")
        axes.set(xlabel=f"contribution to {'Q' if name == 'q' else 'T²'}")
    panels[0].set(title=f"{example['robot']}, gearbox {example['axis']}, last week")
    return figure


def _warnings(result: dict[str, Any]) -> Figure:
    """Days of warning of each failing robot."""
    figure, axes = plt.subplots(figsize=(8, 3.4))
    for row, name in enumerate(DETECTORS):
        one = result["warnings"][name]
        days = np.array([day for day in one["lead"] if day != NEVER])
        spread = 0.25 * np.linspace(-1, 1, len(days)) if len(days) > 1 else np.zeros(len(days))
        axes.plot(days, row + spread, "o", ms=4, color=f"C{row}")
        missed = f"{len(one['lead']) - len(days)} not warned"
        axes.text(result["days"] + 4, row, missed, va="center", fontsize=8)
    axes.set(
        yticks=range(len(DETECTORS)),
        yticklabels=list(DETECTORS),
        xlim=(0, 1.2 * result["days"]),
        xlabel="days of warning before the failure",
    )
    axes.invert_yaxis()
    return figure


FIGURES: Figures = {
    "course": _course,
    "example": _example,
    "contributions": _contributions,
    "warnings": _warnings,
}
