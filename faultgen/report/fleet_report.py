"""The report of a fleet: its robots, and the torque indicator of the axes that fail or age."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from faultgen.analysis.plots import plot_series, style
from faultgen.evaluation.markdown import table
from faultgen.fleet.data import Fleet, open_fleet
from faultgen.report.page import image, markdown, page
from faultgen.system.files import write_text

_MOST = 12  # robots that are drawn


def write_fleet_report(folder: str | Path) -> Path:
    """Write ``report.html`` into the folder of a fleet.

    Args:
        folder: Folder of the fleet.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder has no complete fleet.
    """
    fleet = open_fleet(folder)
    rows = [
        [
            one.name,
            one.robot,
            "fails" if one.failed else "does not fail",
            int(one.truth["damaged_axis"][0]),
            one.split,
            len(one.day),
            f"{one.production.mean():.2f}",
            f"{one.truth['damage'][-1]:.2f}",
            f"{one.events.sum(axis=1).mean():.1f}",
        ]
        for one in fleet.robots
    ]
    head = ["robot", "model", "end", "damaged axis", "part", "samples", "production", "last damage"]
    text = page(
        "fleet.html",
        name=Path(folder).resolve().name,
        robots=len(fleet.robots),
        failing=sum(one.failed for one in fleet.robots),
        days=fleet.days,
        most=_MOST,
        figure_=image(_figure(fleet)),
        table=markdown(table([*head, "events a day"], rows)),
        attributes={"seed": fleet.seed, **fleet.attributes},
    )
    path = Path(folder) / "report.html"
    write_text(path, text)
    return path


def _figure(fleet: Fleet) -> Figure:
    """Torque indicator of the damaged axis of each robot, those that fail first."""
    shown = sorted(fleet.robots, key=lambda one: not one.failed)[:_MOST]
    with style():
        rows = -(-len(shown) // 3)
        figure, grid = plt.subplots(rows, 3, figsize=(9, 2.2 * rows), squeeze=False)
        for axes, one in zip(grid.flat, shown, strict=False):
            axis = int(one.truth["damaged_axis"][0])
            values = one.torque_indicator[:, max(axis - 1, 0)]
            plot_series(axes, one.day, values, one.name, 0)
            what = "fails" if one.failed else "does not fail"
            axes.set(title=f"{one.name}, axis {axis}: {what}", ylabel="indicator [N m]")
            axes.set_xlabel("time [d]")
        for axes in grid.flat[len(shown) :]:
            axes.axis("off")
    return figure
