"""Severities of an experiment: their defaults, and the check of their units and sizes."""

from __future__ import annotations

from collections.abc import Mapping

from faultgen.effects import Effect
from faultgen.effects.base import DEFAULT_FRACTION
from faultgen.errors import InputError


def default_severity(effects: Mapping[str, Effect]) -> list[float] | dict[str, list[float]]:
    """Return the severities of an experiment that gives none.

    Args:
        effects: The effects of the experiment, by name.

    Returns:
        One list for all effects if the severity of every effect is a fraction of its nominal value;
        else a list for each effect, by name.
    """
    if all(effect.units == "1" for effect in effects.values()):
        return [DEFAULT_FRACTION]
    return {name: [effect.default] for name, effect in effects.items()}


def check_severity(
    effects: Mapping[str, Effect],
    severity: list[float] | dict[str, list[float]],
    schedule: str | list[float],
) -> None:
    """Refuse severities that make no sense in the units of their effects.

    Args:
        effects: The effects of an experiment, by name.
        severity: Final severities: one list for all effects, or a list for each effect.
        schedule: Name of the schedule, or the severity of each cycle.

    Raises:
        InputError: One list is given for effects of different units, an effect has no severity, or
            a severity is too large.
    """
    if isinstance(severity, dict):
        for name in severity:
            if name not in effects:
                raise InputError(f"severity: '{name}' is not among the effects of this experiment")
        for name in effects:
            if name not in severity:
                raise InputError(f"severity: no value is given for the effect {name}")
    elif len({effect.units for effect in effects.values()}) > 1:
        given = "severity" if isinstance(schedule, str) else "schedule"
        units = ", ".join(f"{name} is in {_unit(one)}" for name, one in effects.items())
        entry = ", ".join(f"{name} = {one.default:g}" for name, one in effects.items())
        flag = ",".join(f"{name}={one.default:g}" for name, one in effects.items())
        raise InputError(
            f"{given}: effects of different units ({units}) need severities of their own; write, "
            f"for example, severity = {{{entry}}}, or on the command line --severity {flag}"
        )
    for name, effect in effects.items():
        own = severity[name] if isinstance(severity, dict) else severity
        largest = max(own if isinstance(schedule, str) else schedule, default=0.0)
        check_largest(f"severity: {name}", effect, largest)


def check_largest(what: str, effect: Effect, severity: float) -> None:
    """Refuse a severity that is too large for an effect on any axis of any robot.

    Args:
        what: What has the severity, for the message.
        effect: The effect.
        severity: The severity. `Effect.check_severity` compares it with the limit of an axis.

    Raises:
        InputError: The severity is too large.
    """
    if severity <= max(effect.largest, effect.point_largest):
        return
    most = f"{effect.largest:g} ({effect.unit})"
    if effect.point_units:
        most += f", or {effect.point_largest:g} {effect.point_units} where the model has no payload"
    raise InputError(f"{what} must be at most {most}, not {severity:g}")


def _unit(effect: Effect) -> str:
    return "fractions" if effect.units == "1" else effect.units
