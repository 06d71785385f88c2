"""A map of severity: a row for each axis, a column for each cycle. It needs no script."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from faultgen.effects.words import familiar
from faultgen.evaluation.summary import Worst
from faultgen.report.robot_picture import colour_of
from faultgen.report.signals import Place

_MOST_MAPS = 6  # effects of one robot and task
_MOST_COLUMNS = 60  # more are not visible on a narrow page


def heat_map(values: np.ndarray, unit: str) -> dict[str, Any]:
    """Make the cells of a map.

    Args:
        values: Severity of each axis in each cycle, shape (n_axes, cycles). What is not finite
            gets an empty cell.
        unit: Unit of the values.

    Returns:
        What the template ``parts.html`` shows. If there are more than 60 cycles, neighbouring
        cycles share a cell, which shows the largest of their severities.
    """
    cycles = values.shape[1]
    width = -(-cycles // _MOST_COLUMNS)
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    rows = []
    for axis, own in enumerate(values, start=1):
        cells = []
        for start in range(0, cycles, width):
            part = own[start : start + width]
            part = part[np.isfinite(part)]
            if not len(part):
                cells.append({"colour": "", "text": ""})
                continue
            value = float(part[np.argmax(np.abs(part))])
            last = min(start + width, cycles)
            which = f"cycle {last}" if width == 1 else f"cycles {start + 1} to {last}"
            cells.append(
                {
                    "colour": colour_of(abs(value) / largest if largest else 0.0),
                    "text": f"axis {axis}, {which}: {value:.3g} {unit}".rstrip(),
                }
            )
        known = own[np.isfinite(own)]
        end = f"{known[-1]:.3g} {unit}".rstrip() if len(known) else ""
        rows.append({"axis": axis, "cells": cells, "end": end})
    return {
        "rows": rows,
        "cycles": cycles,
        "largest": f"{largest:.3g} {unit}".rstrip(),
        "colours": [colour_of(0.0), colour_of(1.0)],
    }


def severity_maps(place: Place, worst: Sequence[Worst]) -> list[dict[str, Any]]:
    """Make a map of the true severity for each effect: of each axis in the run of its worst wear.

    Args:
        place: The runs.
        worst: From `worst_runs`, for these runs.

    Returns:
        One map for each of the first six effects, from `heat_map`, with the name of the effect.
    """
    maps = []
    for effect in list(dict.fromkeys(one.effect for one in worst))[:_MOST_MAPS]:
        own = [one for one in worst if one.effect == effect]
        values = np.full((place.n_axes, max(int(one.run["cycles"]) for one in own)), np.nan)
        factor, unit = 1.0, str(own[0].run["severity_units"]).removeprefix("1")
        for one in own:
            if place.robot is not None:
                factor, unit = familiar(place.robot, effect, one.axis)
            severity = one.run.read(f"cycle/fault_severity/{effect}")[:, one.axis - 1]
            values[one.axis - 1, : len(severity)] = factor * severity
        maps.append({"effect": effect, **heat_map(values, unit)})
    return maps
