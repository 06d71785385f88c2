"""One effect on one axis of a robot, and its form in JSON files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from faultgen.errors import InputError


@dataclass(frozen=True)
class Applied:
    """One effect on one axis of a robot."""

    effect: str
    """Name in the catalogue."""
    axis: int
    """From 1."""
    severity: float
    """In the unit of the effect."""
    parameters: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """Parameters that differ from the effect's defaults."""


_TYPES = {"effect": str, "axis": int, "severity": (int, float), "parameters": dict}


def to_json(effects: Sequence[Applied]) -> list[dict[str, Any]]:
    """Return effects as plain values that JSON can hold.

    Args:
        effects: The effects.

    Returns:
        One dictionary for each effect. `from_json` reads them.
    """
    return [
        {
            "effect": one.effect,
            "axis": one.axis,
            "severity": float(one.severity),
            "parameters": dict(sorted(one.parameters.items())),
        }
        for one in effects
    ]


def from_json(rows: Any) -> tuple[Applied, ...]:
    """Make effects from the plain values of `to_json`.

    Whether the catalogue has these effects is checked when they are put into a robot.

    Args:
        rows: What JSON held.

    Returns:
        The effects.

    Raises:
        InputError: The values are not those of effects. The message says which value is wrong.
    """
    if not isinstance(rows, list):
        raise InputError(f"effects: must be a list, not {type(rows).__name__}")
    return tuple(_one(f"effect {number}", row) for number, row in enumerate(rows, start=1))


def _one(where: str, row: Any) -> Applied:
    if not isinstance(row, dict):
        raise InputError(f"{where}: must be an object, not {type(row).__name__}")
    if wrong := sorted(set(row) ^ set(_TYPES)):
        what = "unknown" if wrong[0] in row else "missing"
        raise InputError(f"{where}: '{wrong[0]}' is {what}; it has {', '.join(_TYPES)}")
    for name, kind in _TYPES.items():
        value = row[name]
        if not isinstance(value, kind) or isinstance(value, bool):  # type: ignore[arg-type]
            raise InputError(f"{where}: '{name}' has the wrong type ({type(value).__name__})")
    if not math.isfinite(row["severity"]):
        raise InputError(f"{where}: 'severity' must be finite, not {row['severity']}")
    return Applied(row["effect"], row["axis"], float(row["severity"]), row["parameters"])
