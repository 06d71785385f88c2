"""What a visitor of the page can choose from, and why some choices are not possible."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.dataset.wear import SCHEDULES
from faultgen.effects import EFFECTS, Effect
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.exploring.choice import MOST_CYCLES, SENSORS, Subject
from faultgen.exploring.ranges import SPEEDS, payload_range, severity_limit, severity_top
from faultgen.monitoring.sensors import SENSORS as PRESETS

_NOT_STEADY = (
    "temperature and payload change from cycle to cycle; write --sensors {} into the command"
)


def offer(subject: Subject) -> dict[str, Any]:
    """List what can be chosen for a robot and task.

    Args:
        subject: The robot and the task.

    Returns:
        Effects with their axes, ranges of the other sliders, and choices for the dataset.
    """
    robot = subject.robot
    low, high = payload_range(robot)
    loaded = bool(np.isfinite(low))
    return {
        "robot": robot.name,
        "task": subject.task,
        "description": subject.description,
        "axes": [robot.label("axis ", axis) for axis in range(1, robot.n_axes + 1)],
        "effects": [_effect(subject, one) for one in EFFECTS.values()],
        "speed": {"low": SPEEDS[0], "high": SPEEDS[1], "usual": 1.0, "why_not": ""},
        "payload": {
            "low": low if loaded else 0.0,
            "high": high if loaded else 1.0,
            "usual": robot.payload_mass if loaded else 0.0,
            "why_not": "" if loaded else "the robot's model has no payload with a mass",
        },
        "temperature": {
            "low": TEMPERATURE_RANGE[0],
            "high": TEMPERATURE_RANGE[1],
            "usual": robot.friction_temperature,
            "why_not": "",
        },
        "sensors": [
            {
                "name": name,
                "description": one.description,
                "why_not": "" if name in SENSORS else _NOT_STEADY.format(name),
            }
            for name, one in PRESETS.items()
        ],
        "schedules": [{"name": name, "description": told} for name, told in SCHEDULES.items()],
        "most_cycles": MOST_CYCLES,
    }


def _effect(subject: Subject, effect: Effect) -> dict[str, Any]:
    robot = subject.robot
    axes: list[dict[str, Any]] = []
    for axis in range(1, robot.n_axes + 1):
        why_not = subject.why_not(effect, axis)
        one: dict[str, Any] = {"axis": axis, "why_not": why_not}
        if not why_not:
            top = severity_top(robot, effect, axis)
            units = effect.units_on(robot, axis)
            one |= {
                "units": units,
                "unit": _unit(effect, units),
                "top": top,
                "largest": severity_limit(robot, effect, axis),
                "usual": min(effect.default, top),
            }
        axes.append(one)
    usual = effect.usual_axes_on(robot)
    return {
        "name": effect.name,
        "description": effect.description,
        "signature": effect.signature,
        "usual_axis": usual[0] if usual else 0,
        "axes": axes,
    }


def _unit(effect: Effect, units: str) -> str:
    """What severity 1 means on an axis, in words; empty where "percent more" says it all."""
    if effect.in_fractions and units == "1":
        return ""
    if units == effect.units:
        return effect.unit
    own = effect.unit.removeprefix(effect.units)  # such as ", joint side" on a joint that slides
    return units + own if own != effect.unit else units
