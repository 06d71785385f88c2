"""The list of effects. A fault is an effect whose severity follows a wear schedule.

get_effect("friction_wear").apply(spec, axis=3, severity=0.1)

Installed packages can add effects. Such a package declares an entry point of the group
``faultgen.effects``, which names an `Effect` or a list of them:

    [project.entry-points."faultgen.effects"]
    rust = "my_package.rust:EFFECTS"
"""

from __future__ import annotations

from faultgen.effects import (
    coupling,
    friction,
    learned,
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
from faultgen.plugins import EFFECTS as PLUGINS
from faultgen.plugins import added

_OWN = tuple(
    effect
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
        learned,
    )
    for effect in family.EFFECTS
)


def _catalogue() -> dict[str, Effect]:
    """Effects of this package and of installed packages, by name.

    Raises:
        InputError: An entry point cannot be loaded, is no effect, or takes a name that exists.
    """
    found = {effect.name: effect for effect in _OWN}
    effect: Effect
    for where, effect in added(PLUGINS, lambda one: isinstance(one, Effect), "an Effect"):
        if effect.name in found:
            raise InputError(f"{where}: an effect '{effect.name}' exists")
        found[effect.name] = effect
    return found


EFFECTS = _catalogue()
"""Every effect by its name."""


def get_effect(name: str) -> Effect:
    """Return the effect with a name.

    Raises:
        InputError: There is no effect with that name.
    """
    if name not in EFFECTS:
        raise InputError(f"unknown effect '{name}': choose {HEALTHY}, {', '.join(EFFECTS)}")
    return EFFECTS[name]
