"""The list of effects. A fault is an effect whose severity follows a wear schedule.

get_effect("friction_wear").apply(spec, axis=3, severity=0.1)

Installed packages can add effects. Such a package declares an entry point of the group
``faultgen.effects``, which names an `Effect` or a list of them:

    [project.entry-points."faultgen.effects"]
    rust = "my_package.rust:EFFECTS"
"""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from functools import cached_property

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


class _Catalogue(MutableMapping[str, Effect]):
    """Effects of this package and of installed packages, by name.

    Those of installed packages are loaded when the catalogue is first used, and not when it is
    imported, because their modules import it.
    """

    @cached_property
    def _effects(self) -> dict[str, Effect]:
        """All effects.

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

    def __getitem__(self, name: str) -> Effect:
        return self._effects[name]

    def __setitem__(self, name: str, effect: Effect) -> None:
        self._effects[name] = effect

    def __delitem__(self, name: str) -> None:
        del self._effects[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)


EFFECTS = _Catalogue()
"""Every effect by its name."""


def get_effect(name: str) -> Effect:
    """Return the effect with a name.

    Raises:
        InputError: There is no effect with that name.
    """
    if name not in EFFECTS:
        raise InputError(f"unknown effect '{name}': choose {HEALTHY}, {', '.join(EFFECTS)}")
    return EFFECTS[name]
