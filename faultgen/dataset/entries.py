"""Entries of an experiment: what a user may write, and what becomes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from faultgen.effects.temperature import TEMPERATURE_RANGE


def listed(value: Any) -> Any:
    """Make a list of one value; a list stays as it is."""
    return value if isinstance(value, list) else [value]


def _places(value: Any) -> Any:
    """Leave names as they are, and make paths absolute, so that they are valid in every folder."""
    return [
        str(Path(item).resolve()) if isinstance(item, str) and _is_place(Path(item)) else item
        for item in listed(value)
    ]


def absolute(value: Any) -> Any:
    """Make the path of a file absolute, and leave a name as it is."""
    is_file = isinstance(value, str) and Path(value).is_file()
    return str(Path(value).resolve()) if is_file else value


def _is_place(path: Path) -> bool:
    """Whether a path is that of a file or of a robot's folder."""
    return path.is_file() or (path / "robot.json").is_file()


def to_axes(value: Any) -> Any:
    """Turn [1, [2, 3]] into [[1], [2, 3]]."""
    return [listed(item) for item in listed(value)]


def several(value: Any) -> Any:
    """Make a list of one number; None stays None."""
    return None if value is None else listed(value)


def to_severities(value: Any) -> Any:
    """Turn 0.1 into [0.1], also within a table of severities by effect."""
    if isinstance(value, dict):
        return {name: listed(one) for name, one in value.items()}
    return listed(value)


def to_windows(value: Any) -> Any:
    """Turn [low, high] into [[low, high]]."""
    single = isinstance(value, list) and not any(isinstance(one, list) for one in value)
    return [value] if single else value


def kind_of(value: Any) -> str:
    """Say whether severities are one list, or a table with a list for each effect."""
    return "table" if isinstance(value, dict) else "list"


Axes = Annotated[list[int], Field(min_length=1)]
Names = Annotated[list[str], BeforeValidator(listed), Field(min_length=1)]
Places = Annotated[list[str], BeforeValidator(_places), Field(min_length=1)]
Severity = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Severities = Annotated[list[Severity], Field(min_length=1)]
Window = Annotated[
    list[Annotated[float, Field(ge=0, allow_inf_nan=False)]], Field(min_length=2, max_length=2)
]

Speed = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Mass = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Temperature = Annotated[float, Field(ge=TEMPERATURE_RANGE[0], le=TEMPERATURE_RANGE[1])]
Windows = Annotated[list[Window], BeforeValidator(to_windows), Field(min_length=1)]
