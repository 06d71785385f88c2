"""Severities of effects in words, and in the units in which people speak of a robot.

said = in_words(robot, "coulomb_friction", 2, 0.197, (0.193, 0.203))
said.sentence  # "axis 2 has 20 % more Coulomb friction than its model (19.3 to 20.3 %)"
said.also      # (Quantity(0.31, (0.30, 0.32), "N m at the joint"),)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from faultgen.effects.catalogue import get_effect
from faultgen.effects.structure import is_loaded
from faultgen.robot import COULOMB, Robot

_MORE = {
    "friction_wear": "friction",
    "coulomb_friction": "Coulomb friction",
    "static_friction": "static friction above Coulomb friction",
    "viscous_friction": "viscous friction",
    "stribeck_velocity": "Stribeck velocity",
    "rotor_inertia": "rotor inertia",
    "payload_mass": "payload",
}
"""What there is more or less of, where the severity is a fraction of it."""

_LESS = {
    "gear_stiffness": "stiffness of the gearbox",
    "torque_constant": "torque of the motor than its drive believes",
}
"""What there is less of."""

THAN_MODEL, THAN_BEFORE = "than its model", "than in the healthy recording"
"""With what a fraction is compared."""

_NOUNS = {
    "quadratic_viscous_friction": "friction that grows with the square of speed",
    "friction_asymmetry": "friction of the forward direction only",
    "viscous_asymmetry": "viscous friction of the forward direction only",
    "low_speed_friction": "friction at low speed only",
    "torque_offset": "a constant torque",
    "brake_drag": "drag of the brake",
    "load_friction": "friction that grows with the load of the gearbox",
    "wrist_coupling_friction": "friction against the neighbouring axis",
    "backlash": "play of the gearbox",
    "stiffness_hardening": "a gearbox that gets stiffer with load",
    "torque_ripple": "torque ripple",
    "transmission_error": "transmission error",
    "payload_mass": "an additional mass",
    "payload_offset": "a payload off its place",
    "gravity_spring": "a spring that pulls to the zero angle",
    "encoder_offset": "a wrong zero of the encoder",
    "delay": "a delay",
    "seizing_spot": "a spot that rubs",
    "tooth_damage": "a damaged tooth",
    "winding_fault": "a fault of the motor's winding",
    "loose_tool": "play of the tool",
    "temperature_friction": "friction that follows the temperature",
    "torque_sensor_gain": "a gain error of the current sensor",
    "encoder_quantisation": "steps of the encoder",
    "sensor_dropout": "lost samples",
    "sensor_stuck": "a log that stands still",
}
_ARC_MINUTES = float(60 * np.degrees(1.0))


@dataclass(frozen=True)
class Quantity:
    """A severity in another unit."""

    value: float
    """In this unit."""
    interval: tuple[float, float]
    """Interval that contains it with 95 % probability."""
    unit: str
    """In words."""

    def __str__(self) -> str:
        low, high = self.interval
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.value:.3g}{unit} ({low:.3g} to {high:.3g})"


@dataclass(frozen=True)
class Said:
    """A severity in words."""

    sentence: str
    """What the axis has, and in brackets the interval that contains it with 95 % probability."""
    also: tuple[Quantity, ...]
    """The same in other units."""

    def contract(self) -> dict[str, Any]:
        """The content of ``discovery.json``."""
        return {"sentence": self.sentence, "also": [asdict(one) for one in self.also]}


def in_words(
    robot: Robot,
    effect: str,
    axis: int,
    severity: float,
    interval: tuple[float, float],
    parameters: Mapping[str, Any] | None = None,
    *,
    than: str = THAN_MODEL,
) -> Said:
    """Say what an axis has.

    Args:
        robot: The model, whose nominal values count.
        effect: Name of the effect.
        axis: From 1.
        severity: In the unit of the effect.
        interval: Interval that contains it with 95 % probability, in the same unit.
        parameters: Further parameters of the effect.
        than: With what a fraction is compared, such as "than its model".

    Returns:
        The sentence, without a full stop, and the severity in other units.
    """
    also = tuple(
        Quantity(factor * severity, (factor * interval[0], factor * interval[1]), unit)
        for factor, unit in _units(robot, effect, axis, parameters or {})
    )
    is_point = effect == "payload_mass" and bool(parameters or not is_loaded(robot, axis))
    if effect in _MORE and not is_point:
        more = "more" if severity >= 0 else "less"
        return Said(
            f"axis {axis} has {_per_cent(severity, interval, more, _MORE[effect], than)}", also
        )
    if effect in _LESS:
        less = "less" if severity >= 0 else "more"
        return Said(
            f"axis {axis} has {_per_cent(severity, interval, less, _LESS[effect], than)}", also
        )
    unit = _short(robot, effect, axis)
    size = str(also[0]) if also else str(Quantity(severity, interval, unit))
    return Said(f"axis {axis} has {_NOUNS.get(effect, effect)}: {size}", also)


def _per_cent(
    severity: float, interval: tuple[float, float], more: str, what: str, than: str
) -> str:
    """A fraction and its interval, both counted in the direction of the fraction."""
    sign = -100.0 if severity < 0 else 100.0
    low, high = sorted(sign * one for one in interval)
    compared = what if " than " in what else f"{what} {than}"
    return f"{sign * severity:.2g} % {more} {compared} ({low:.3g} to {high:.3g} %)"


def familiar(
    robot: Robot, effect: str, axis: int, parameters: Mapping[str, Any] | None = None
) -> tuple[float, str]:
    """Find the unit in which people speak of the severity of an effect.

    Args:
        robot: The healthy robot.
        effect: Name of the effect.
        axis: From 1.
        parameters: Further parameters of the effect.

    Returns:
        What a severity is multiplied by, and the unit that it then has. Fractions are in %.
    """
    unit = _short(robot, effect, axis)
    others = _units(robot, effect, axis, parameters or {})
    if not unit and effect != "load_friction":
        return 100.0, "%"
    return others[0] if others else (1.0, unit)


def amount(robot: Robot, effect: str, axis: int, severity: float) -> str:
    """Say how much of an effect there is, such as "20 % more friction".

    Args:
        robot: The healthy robot.
        effect: Name of the effect.
        axis: From 1.
        severity: In the unit of the effect.

    Returns:
        A noun with its amount, in the unit in which people speak of it.
    """
    factor, unit = familiar(robot, effect, axis)
    is_point = effect == "payload_mass" and not is_loaded(robot, axis)
    for words, more, less in ((_MORE, "more", "less"), (_LESS, "less", "more")):
        if effect in words and not is_point:
            size = f"{abs(factor * severity):.3g} {unit}"
            return f"{size} {more if severity >= 0 else less} {words[effect]}"
    return f"{_NOUNS.get(effect, effect)} of {factor * severity:.3g} {unit}".rstrip()


def _short(robot: Robot, effect: str, axis: int) -> str:
    """The unit of a severity, empty for a fraction."""
    units = get_effect(effect).units_on(robot, axis)
    return "" if units == "1" else units


def _units(
    robot: Robot, effect: str, axis: int, parameters: Mapping[str, Any]
) -> list[tuple[float, str]]:
    """Factors by which a severity is multiplied, and what it is in then."""
    ratio, slide = abs(float(robot.gear_ratio[axis - 1])), bool(robot.slides[axis - 1])
    torque = "N at the joint" if slide else "N m at the joint"
    friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")[axis - 1]]
    units, words = get_effect(effect).units_on(robot, axis), get_effect(effect).unit
    if effect in ("friction_wear", "coulomb_friction") or "fraction of Coulomb friction" in words:
        return [(float(friction[COULOMB]) * ratio, torque)]
    if effect == "rotor_inertia":
        inertia = float(robot.model.dof_M0[robot.motors[axis - 1]])
        return [(inertia * ratio**2, "kg at the joint" if slide else "kg m^2 at the joint")]
    if effect == "load_friction":
        return [(100.0, "% of the torque of the gearbox")]
    if effect == "payload_mass":
        if parameters or not is_loaded(robot, axis):
            return [(1.0, "kg")]
        return [(float(robot.model.body("payload").mass[0]), "kg")]
    if "motor side" in words and units.startswith("N m"):
        return [(ratio, torque)]
    if units == "rad" and "joint side" in words:
        return [(1e3, "mm")] if slide else [(_ARC_MINUTES, "arc minutes")]
    if units == "rad":
        return [(float(np.degrees(1.0)), "degrees")]
    return {"m": [(1e3, "mm")], "s": [(1e3, "ms")]}.get(units, [])
