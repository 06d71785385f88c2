"""The list of effects. A fault is an effect whose severity follows a wear schedule.

get_effect("friction_wear").apply(spec, axis=3, severity=0.1)
"""

from __future__ import annotations

from faultgen.effects import (
    coupling,
    friction,
    load,
    loose,
    motor,
    ripple,
    sensing,
    signals,
    spot,
    structure,
    temperature,
    tooth,
    transmission,
    winding,
)
from faultgen.effects.base import HEALTHY, Effect
from faultgen.errors import InputError

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for family in (
        friction,
        load,
        temperature,
        coupling,
        transmission,
        ripple,
        motor,
        structure,
        signals,
        spot,
        tooth,
        winding,
        loose,
        sensing,
    )
    for effect in family.EFFECTS
}
"""Every effect by its name."""


def get_effect(name: str) -> Effect:
    """Look an effect up.

    Raises:
        InputError: There is no effect of that name.
    """
    if name not in EFFECTS:
        raise InputError(f"unknown effect '{name}': choose {HEALTHY}, {', '.join(EFFECTS)}")
    return EFFECTS[name]
