"""Friction between two neighbouring axes whose shafts run inside one another in a wrist."""

from __future__ import annotations

import mujoco

from faultgen.effects.base import Effect
from faultgen.effects.elements import add_lugre, add_tendon, gear_ratio
from faultgen.effects.prior import Prior, of_joint_torque
from faultgen.effects.spreads import SPREADS
from faultgen.errors import InputError
from faultgen.robot import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    COULOMB,
    COUPLING,
    STRIBECK_VELOCITY,
)


def coupled_axes(n_axes: int) -> range:
    """Axes that are coupled with the axis before them: from 5 if there are six, else from 2."""
    return range(5 if n_axes > 5 else 2, n_axes + 1)


def add_coupling_friction(spec: mujoco.MjSpec, axis: int, severity: float, *, ratio: float) -> None:
    """Add Coulomb friction on the speed of an axis plus ratio times that of the axis before.

    Speeds are those of the motors over their gear ratios, so the friction acts on both rotors:
    -severity sign(v) / n_i and -severity ratio sign(v) / n_(i-1), in [N m].

    Args:
        spec: The robot, edited in place.
        axis: The later axis of the two, from 2.
        severity: Friction torque, joint side [N m].
        ratio: Share of the speed of the axis before; 1 for the sum, -1 for the difference.

    Raises:
        InputError: There is no axis before.
    """
    if axis < 2:
        raise InputError("wrist_coupling_friction couples an axis with the one before: from axis 2")
    own, before = gear_ratio(spec, axis), gear_ratio(spec, axis - 1)
    name = f"{COUPLING}{axis}"
    tendon = add_tendon(spec, name, {f"motor{axis}": 1 / own, f"motor{axis - 1}": ratio / before})
    friction = spec.actuator(f"friction{axis}")
    # bristles of the axis itself, seen at the joint; softer where there is less to hold
    held = abs(severity / own) / friction.biasprm[COULOMB]
    scale = own**2 * min(1.0, held)
    lugre = [
        scale * friction.dynprm[BRISTLE_STIFFNESS],
        scale * friction.dynprm[BRISTLE_DAMPING],
        severity,
        severity,
        friction.biasprm[STRIBECK_VELOCITY] / abs(own),
    ]
    add_lugre(spec, name, tendon, lugre)


EFFECTS = (
    Effect(
        name="wrist_coupling_friction",
        description="shafts of two neighbouring axes rub on one another",
        unit="N m, joint side",
        units="N m",
        slide_units="N",
        signature="torque on both axes, by the sign of the sum of their speeds",
        element="wrist_coupling{i}, fixed tendon with a passive dcmotor lugre",
        prior=Prior(
            std=of_joint_torque(SPREADS["wrist_coupling_friction"].std),
            steps_in_std=1000,
            # shafts rub on the sum or on the difference of two speeds, by how the wrist is built
            variants=lambda robot, axis: [{"ratio": 1.0}, {"ratio": -1.0}],
            at_motor=True,
        ),
        source="Coulomb friction on q'5 + q'6, as of the wrist of the Staubli TX40 "
        "(Gautier, Janot, Vandanjon 2013; from memory)",
        largest=100.0,
        step=0.2,
        parameters={"ratio": 1.0},
        axes=coupled_axes,
        edit=add_coupling_friction,
    ),
)
"""Effects of this family."""
