"""Values of options that are more than one number or name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from faultgen.errors import InputError
from faultgen.system.terminal import note

TRAINING: dict[str, Any] = {"cycles": 24, "repetitions": 3, "schedule": "linear"}
"""Defaults of a dataset that is made to train a detector."""


def task_of(recording: Path, robot: str, out: Path) -> str:
    """Write the task of a recorded motion into a folder, and return the path of its file.

    A robot's folder may have the task already; that one is then used.

    Args:
        recording: The recording.
        robot: Name of the robot, or path of its MJCF file or folder.
        out: The folder.

    Returns:
        Path of the file, or name of the task in the robot's folder.

    Raises:
        InputError: The recording cannot be used.
    """
    from faultgen.discovery.inputs import usable
    from faultgen.recordings.recorded_task import known_task, recorded_task
    from faultgen.robot import load_robot
    from faultgen.system.files import write_text

    model = load_robot(robot)
    measured, warnings = usable(recording, model)
    for warning in warnings:
        note(warning)
    known = known_task(measured, model)
    if known is not None:
        return known
    text = recorded_task(measured, model, recording.stem)
    path = out / "tasks" / f"{recording.stem}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
    return str(path)


def spreads_of(text: str | None) -> dict[str, float] | None:
    """Parse "parameters=0.03,servo=0.1" to the spreads of robots."""
    if text is None:
        return None
    found = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise InputError(
                f"randomize '{part}': give names and spreads such as parameters=0.03,servo=0.1"
            ) from None
    return found


def axes_of(text: str | None) -> list[list[int]] | None:
    """Parse "1,2+3" to the axes of each run; None stands for every axis."""
    if text is None or text == "all":
        return None
    try:
        return [[int(axis) for axis in part.split("+")] for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"axis '{text}': give numbers such as 1,2,3, or 2+3 for two axes that wear at once"
        ) from None


def severities_of(text: str | None) -> list[float] | dict[str, list[float]] | None:
    """Parse "0.1,0.2" to a list, and "backlash=0.001,0.002,delay=0.01" to a list by effect."""
    if text is None:
        return None
    found: dict[str, list[float]] = {}
    name = ""
    try:
        for part in text.split(","):
            before, equals, number = part.rpartition("=")
            name = before.strip() if equals else name
            found.setdefault(name, []).append(float(number))
    except ValueError:
        found = {}
    if not found or ("" in found and len(found) > 1):
        raise InputError(
            f"severity '{text}': give numbers such as 0.1,0.2, or numbers for each effect such as "
            "backlash=0.001,encoder_offset=0.02"
        )
    return found[""] if "" in found else found


def numbers_of(name: str, text: str | None) -> list[float] | None:
    """Parse "0.5,1" to a list.

    Args:
        name: Name of the option, for the message.
        text: The text, or None.

    Raises:
        InputError: The text has something else than numbers.
    """
    try:
        return None if text is None else [float(number) for number in text.split(",")]
    except ValueError:
        raise InputError(f"--{name}: give numbers such as 0.5,1, not '{text}'") from None


def part_of(text: str | None) -> tuple[int, int] | None:
    """Part and number of parts from '3/10'."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    if found is None:
        raise InputError(f"--part: must be K/N such as 3/10, not '{text}'")
    return int(found[1]), int(found[2])
