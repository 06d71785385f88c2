"""Severities in units that a maintenance engineer uses."""

from __future__ import annotations

import numpy as np

_IN = {
    "1": (100.0, "%"),
    "rad": (10800 / np.pi, "arcmin"),
    "m": (1000.0, "mm"),
    "s": (1000.0, "ms"),
    "N m": (1.0, "N m"),
    "N m/rad": (1.0, "N m/rad"),
}


def in_plant_units(severity: float, unit: str) -> tuple[float, str]:
    """Convert a severity.

    Args:
        severity: In its SI unit.
        unit: The SI unit, "1" for a fraction.

    Returns:
        Value and unit, such as 0.5 and "arcmin".
    """
    factor, name = _IN.get(unit, (1.0, unit))
    return severity * factor, name


def shown(severity: float | None, unit: str) -> str:
    """Return a severity as text with two digits and its unit; "-" if there is none.

    Args:
        severity: In its SI unit.
        unit: The SI unit, "1" for a fraction.
    """
    if severity is None:
        return "-"
    value, name = in_plant_units(severity, unit)
    return f"{value:.2g} {name}" if value < 100 else f"{value:.0f} {name}"
