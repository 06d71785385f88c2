"""The figure of learned laws in a discovery's report."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt

from faultgen.analysis.plots import COLOURS, style
from faultgen.discovery.laws.learned_law import Learned
from faultgen.effects.law_course import UNITS
from faultgen.report.page import image


def laws_image(laws: Sequence[Learned]) -> str:
    """Draw the curves of laws, one row for each law, within the range of the data.

    Args:
        laws: The laws, at least one.

    Returns:
        Address of the image, as `page.image` returns it.
    """
    count = max(len(one.terms) for one in laws)
    with style():
        figure, grid = plt.subplots(
            len(laws), count, figsize=(9, 2.2 * len(laws) + 0.4), squeeze=False
        )
        for row, law in zip(grid, laws, strict=True):
            for axes, term in zip(row, law.terms, strict=False):
                axes.plot(term["knots"], term["values"], color=COLOURS[1])
                over = term["over"].replace("_", " ")
                axes.set(xlabel=f"{over} of axis {term['of']} [{UNITS[term['over']]}]")
            for axes in row[len(law.terms) :]:
                axes.set_axis_off()
            row[0].set(ylabel=f"axis {law.axis}\n[N m]")
    return image(figure)
