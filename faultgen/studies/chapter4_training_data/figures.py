"""Figures of the study `training-data`."""

from __future__ import annotations

from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from faultgen.analysis.plots import COLOURS, legend_beside
from faultgen.studies.chapter4_training_data.signals import SIGNALS, TEST
from faultgen.studies.chapter4_training_data.study import SHARE
from faultgen.studies.chapter4_training_data.tables import NAMES
from faultgen.studies.figures import Figures


def _descriptor(name: str, result: dict[str, Any]) -> Figure:
    """Figures 4-4 to 4-6: mean and standard error by group; * where failing robots differ."""
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.4), sharey=True)
    for axes, source in zip(panels, ("OTM", "OTO"), strict=True):
        tops = np.zeros(len(SIGNALS))
        for number, condition in enumerate(("failure", "normal")):
            rows = [
                r for r in result["groups"] if (r["source"], r["condition"]) == (source, condition)
            ]
            mean = np.array([r[name] for r in rows])
            error = np.array([r[f"{name}_error"] for r in rows])
            places = np.arange(len(rows)) + 0.4 * (number - 0.5)
            axes.bar(places, mean, 0.36, yerr=error, color=COLOURS[number], label=condition)
            tops = np.maximum(tops, mean + error)
        for row in result["cuts"]:
            if (row["descriptor"], row["source"], row["days"]) == (name, source, TEST):
                if row["found"]:
                    place = SIGNALS.index(row["signal"])
                    axes.text(place, tops[place] * 1.03, "*", ha="center", fontsize=14)
        axes.set_xticks(range(len(SIGNALS)), SIGNALS)
        axes.set(title={"OTM": "one to many", "OTO": "one to one"}[source])
        axes.margins(y=0.15)
    panels[0].set(ylabel=NAMES[name])
    legend_beside(panels[1])
    return figure


def _components(result: dict[str, Any]) -> Figure:
    """Figure 4-3: share of the variance over the number of components."""
    explained = 100 * np.array(result["example"]["explained"])
    figure, axes = plt.subplots(figsize=(5, 3.2))
    axes.plot(range(1, len(explained) + 1), explained, marker="o", ms=3)
    axes.axhline(100 * SHARE, color="0.4", lw=1.0, ls=":")
    axes.set(xlabel="components", ylabel="variance explained [%]", ylim=(0, 102))
    return figure


FIGURES: Figures = {
    "figure_4_3": _components,
    "figure_4_4": partial(_descriptor, "variation"),
    "figure_4_5": partial(_descriptor, "above"),
    "figure_4_6": partial(_descriptor, "lead"),
}
"""Figures by name."""
