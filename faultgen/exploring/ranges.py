"""How far the sliders of the page go."""

from __future__ import annotations

import numpy as np

from faultgen.effects import Effect
from faultgen.effects.base import MASSLESS
from faultgen.robot import Robot

SPEEDS = (0.2, 1.0)
"""Smallest and largest speed override."""

_TIMES_DEFAULT = 5.0  # largest severity of a slider over the effect's default
_PAYLOADS = (0.5, 1.5)  # smallest and largest payload over that of the model


def severity_top(robot: Robot, effect: Effect, axis: int) -> float:
    """Return the largest severity of the slider: five times the default, or less if that is less.

    Larger ones can be typed, up to the largest that the effect takes.

    Args:
        robot: The robot.
        effect: The effect, which can act on the axis.
        axis: Axis, from 1.

    Returns:
        The severity in the unit of the effect.
    """
    limit = severity_limit(robot, effect, axis)
    return min(float(f"{_TIMES_DEFAULT * effect.default:.3g}"), limit)


def severity_limit(robot: Robot, effect: Effect, axis: int) -> float:
    """Return the largest severity that an effect takes on an axis.

    Args:
        robot: The robot.
        effect: The effect.
        axis: Axis, from 1.

    Returns:
        The severity in the unit of the effect.
    """
    units = effect.units_on(robot, axis)
    point = bool(effect.point_units) and units == effect.point_units
    largest = effect.point_largest if point else effect.largest
    limit = robot.motor_torque_limit[axis - 1] if effect.motor_torque else np.inf
    return float(min(largest, limit))


def payload_range(robot: Robot) -> tuple[float, float]:
    """Return the smallest and the largest payload of the slider.

    Args:
        robot: The robot.

    Returns:
        Masses [kg]; nan if the model has no payload with a mass.
    """
    if not robot.payload_mass >= MASSLESS:
        return np.nan, np.nan
    low, high = (float(f"{share * robot.payload_mass:.3g}") for share in _PAYLOADS)
    return low, high
