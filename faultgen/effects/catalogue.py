"""The list of effects. A fault is an effect whose severity follows a wear schedule.

get_effect("friction_wear").apply(spec, axis=3, severity=0.1)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from faultgen.effects import friction
from faultgen.errors import InputError

HEALTHY = "healthy"
"""Effect name of runs without a fault."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One physical effect and how it changes a robot's model."""

    name: str
    """Name in commands and files."""
    description: str
    """What happens in the robot."""
    unit: str
    """What severity 1 means."""
    signature: str
    """How it shows in the motor's torque."""
    element: str
    """MuJoCo element that carries it."""
    source: str
    """Where the law comes from."""
    edit: Callable[[mujoco.MjSpec, int, float], None]
    """Changes the model in place: (spec, axis from 1, severity)."""

    def apply(self, spec: mujoco.MjSpec, axis: int, severity: float) -> None:
        """Put the effect into a model. Severity 0 leaves the model exactly as it is."""
        if severity != 0:
            self.edit(spec, axis, severity)


_FRACTION = "fraction of nominal (0.1 = 10 % more)"
_STRIBECK = "LuGre friction with Stribeck curve, thesis eq. 6.3"

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        Effect(
            name="friction_wear",
            description="Coulomb and static friction of the motor side grow together",
            unit=_FRACTION,
            signature="more torque against the motion, the same at every speed",
            element="friction{i}, dcmotor lugre: coulomb and static",
            source="thesis 6.3.1; " + _STRIBECK,
            edit=friction.scale_coulomb_and_static,
        ),
        Effect(
            name="coulomb_friction",
            description="Coulomb friction grows",
            unit=_FRACTION,
            signature="more torque against the motion, the same at every speed",
            element="friction{i}, dcmotor lugre: coulomb and static by the same torque",
            source="thesis eq. 3.7; " + _STRIBECK,
            edit=friction.scale_coulomb,
        ),
        Effect(
            name="static_friction",
            description="static friction (the height of the Stribeck curve) grows",
            unit=_FRACTION,
            signature="more torque when starting, reversing and creeping",
            element="friction{i}, dcmotor lugre: static",
            source=_STRIBECK,
            edit=friction.scale_static,
        ),
        Effect(
            name="viscous_friction",
            description="viscous friction grows, as with stiff or old grease",
            unit=_FRACTION,
            signature="more torque against the motion, in proportion to speed",
            element="friction{i}, dcmotor damping",
            source="thesis eq. 6.3",
            edit=friction.scale_viscous,
        ),
    )
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
