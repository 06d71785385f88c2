"""The list of effects. A fault is an effect whose severity follows a wear schedule.

get_effect("friction_wear").apply(spec, axis=3, severity=0.1)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from faultgen.effects import friction, structure, transmission
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
    largest: float = 10.0
    """Largest severity that is sensible."""
    step: float = 0.1
    """Severity that shows clearly and is still near to linear, for sensitivities."""
    edit: Callable[[mujoco.MjSpec, int, float], None]
    """Changes the model in place: (spec, axis from 1, severity)."""

    @property
    def in_fractions(self) -> bool:
        """Whether severity is a fraction of a nominal value."""
        return self.unit == _FRACTION

    def shown(self, severity: float) -> str:
        """A severity for people, with its unit."""
        if self.in_fractions:
            return f"{100 * severity:g} %"
        return f"{severity:g} {self.unit.split(',')[0].split(' of ')[0]}"

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
        Effect(
            name="stribeck_velocity",
            description="the Stribeck curve reaches to higher speeds, as with thinner oil",
            unit=_FRACTION,
            signature="more torque against the motion at low speed, about the Stribeck velocity",
            element="friction{i}, dcmotor lugre: Stribeck velocity",
            source=_STRIBECK,
            edit=friction.scale_stribeck_velocity,
        ),
        Effect(
            name="quadratic_viscous_friction",
            description="friction that grows with the square of speed",
            unit=f"fraction of Coulomb friction, at {friction.QUADRATIC_SPEED:g} rad/s motor side",
            signature="more torque against the motion at high speed, in proportion to its square",
            element="friction{i}, dcmotor damping, second coefficient",
            source="w |w| term of extended friction models; the reference speed is assumed",
            edit=friction.add_quadratic_viscous,
        ),
        Effect(
            name="friction_asymmetry",
            description="Coulomb friction grows in one direction, as with a worn screw or seal",
            unit="fraction of Coulomb friction, where the motor turns forward",
            signature="more torque against the motion in one direction, none in the other",
            element="friction{i}, dcmotor lugre and cogging without poles",
            source="direction-dependent friction of the EMPS benchmark (Janot et al. 2019)",
            edit=friction.add_asymmetry,
        ),
        Effect(
            name="torque_offset",
            description="a constant torque on the rotor, as of a drifting current sensor",
            unit="N m, motor side, positive with forward motion",
            signature="the same torque at all times, also at rest",
            element="friction{i}, dcmotor cogging without poles",
            source="definition",
            step=0.01,
            edit=friction.add_offset,
        ),
        Effect(
            name="brake_drag",
            description="the brake does not lift wholly: added Coulomb friction on the rotor",
            unit="N m, motor side",
            signature="more torque against the motion, the same at every speed",
            element="friction{i}, dcmotor lugre: coulomb and static by the same torque",
            source="definition",
            step=0.01,
            edit=friction.add_coulomb,
        ),
        Effect(
            name="backlash",
            description="teeth have play: the gearbox turns freely over an angle",
            unit="rad, joint side, whole play",
            signature="a jump and ringing where the torque of the gearbox changes sign",
            element="gearbox{i}, tendon springlength (dead band)",
            source="definition",
            step=3e-4,
            edit=transmission.add_backlash,
        ),
        Effect(
            name="gear_stiffness",
            description="the gearbox loses stiffness",
            unit="fraction of nominal that is lost, below 1",
            signature="lower resonance; more twist, which the motor's encoder hardly sees",
            element="gearbox{i}, tendon stiffness",
            source="thesis eq. 6.2a",
            largest=0.95,
            step=0.2,
            edit=transmission.lose_stiffness,
        ),
        Effect(
            name="stiffness_hardening",
            description="the gearbox gets stiffer with load",
            unit=f"fraction of the torque, at a twist of {transmission.REFERENCE_TWIST:g} rad",
            signature="resonance rises with load",
            element="gearbox{i}, tendon stiffness, cubic coefficient",
            source="cubic gear stiffness as in Moberg et al.; the reference twist is assumed",
            step=0.3,
            edit=transmission.harden,
        ),
        Effect(
            name="rotor_inertia",
            description="the rotor is heavier than the model says",
            unit=_FRACTION,
            signature="more torque in proportion to acceleration",
            element="body of motor{i}, inertia",
            source="definition",
            edit=transmission.scale_rotor_inertia,
        ),
        Effect(
            name="payload_mass",
            description="the payload is heavier; belongs to the last axis",
            unit=_FRACTION,
            signature="gravity and inertia on several axes, by the pose",
            element="body payload, mass and inertia",
            source="definition",
            edit=structure.scale_payload,
        ),
        Effect(
            name="payload_offset",
            description="the payload sits off its place; belongs to the last axis",
            unit="m, along the flange's x",
            signature="gravity on the wrist by the tool's orientation",
            element="body payload, inertial pos",
            source="definition",
            step=0.02,
            edit=structure.move_payload,
        ),
        Effect(
            name="gravity_spring",
            description="a balancing device pulls the joint to its zero angle",
            unit="N m/rad, joint side",
            signature="torque in proportion to the angle of the joint, at all speeds",
            element="joint{i}, stiffness",
            source="linear spring",
            largest=1e6,
            step=2.0,
            edit=structure.add_gravity_spring,
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
