"""Friction at other gearbox temperatures.

Bittencourt et al. (IROS 2010), ABB joint; torque over the largest torque, motor speed, deg C.
Figures as in the literature list of docs/physics.md; the Coulomb term does not depend on T.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.hooks import Moment, Place, Temperature, Update, course_of
from faultgen.effects.prior import Prior
from faultgen.effects.spreads import SPREADS
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY

_STRIBECK_HEIGHT = (-2.5e-2, 1.6e-3)
_STRIBECK_VELOCITY = (-24.8, 0.98)
_VISCOUS = (1.3e-4, 1.32e-3, 20.7)
_REFERENCE = 40.0  # of a robot that does not tell

TEMPERATURE_RANGE = (30.0, 80.0)
"""Temperatures [deg C] for which the law is used; measured from 33 to 80."""


def friction_ratios(temperature: float, reference: float) -> tuple[float, float, float]:
    """Compute Stribeck height, Stribeck velocity and viscous friction relative to the reference.

    Args:
        temperature: Gearbox temperature [deg C], limited to `TEMPERATURE_RANGE`.
        reference: Temperature at which the model's friction holds [deg C].

    Returns:
        The three ratios, without unit.
    """
    low, high = TEMPERATURE_RANGE
    hot = min(max(temperature, low), high)

    def ratio(law: tuple[float, float]) -> float:
        return (law[0] + law[1] * hot) / (law[0] + law[1] * reference)

    def viscous(t: float) -> float:
        return _VISCOUS[0] + _VISCOUS[1] * math.exp(-t / _VISCOUS[2])

    return ratio(_STRIBECK_HEIGHT), ratio(_STRIBECK_VELOCITY), viscous(hot) / viscous(reference)


def set_temperature(
    spec: mujoco.MjSpec, axis: int, temperature: float, reference: float, share: float = 1.0
) -> None:
    """Change the friction of an axis to that at another gearbox temperature.

    Viscous friction, the Stribeck height and the Stribeck velocity change by the ratios of
    Bittencourt's law at the two temperatures.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        temperature: Gearbox temperature [deg C], limited to `TEMPERATURE_RANGE`.
        reference: Temperature at which the model's friction holds [deg C].
        share: Power of the ratios: 0 leaves friction as it is, 1 follows the law.
    """
    height, velocity, viscous = (r**share for r in friction_ratios(temperature, reference))
    actuator = spec.actuator(f"friction{axis}")
    coulomb = actuator.biasprm[COULOMB]
    actuator.biasprm[STICTION] = coulomb + (actuator.biasprm[STICTION] - coulomb) * height
    actuator.biasprm[STRIBECK_VELOCITY] *= velocity
    actuator.damping[0] *= viscous


def follow_constant(
    spec: mujoco.MjSpec, axis: int, severity: float, *, temperature: Temperature
) -> None:
    """Set the friction for a temperature that is constant. Otherwise nothing is changed.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Power of the ratios, see `set_temperature`.
        temperature: Gearbox temperature, see `Temperature`.
    """
    if temperature is not None and not isinstance(temperature, tuple):
        told = spec.numeric("friction_temperature")
        reference = _REFERENCE if told is None else float(told.data[0])
        set_temperature(spec, axis, temperature, reference, severity)


def follow_course(places: Sequence[Place]) -> Update | None:
    """Make friction follow a temperature that changes during the motion."""
    followed = []
    for place in places:
        temperature = place.parameters["temperature"]
        if isinstance(temperature, tuple):
            friction = place.element("actuator", "friction")
            times, values = course_of(temperature, place.axis)
            followed.append((friction, place.severity, times, values))
    if not followed:
        return None
    reference = places[0].robot.friction_temperature

    def update(moment: Moment) -> None:
        middle = moment.time + moment.interval / 2
        for friction, share, times, values in followed:
            ratios = friction_ratios(float(np.interp(middle, times, values)), reference)
            height, velocity, viscous = (r**share for r in ratios)
            bias = moment.biasprm[:, friction]
            bias[:, STICTION] = bias[:, COULOMB] + (bias[:, STICTION] - bias[:, COULOMB]) * height
            bias[:, STRIBECK_VELOCITY] *= velocity
            moment.damping[:, friction] *= viscous

    return update


EFFECTS = (
    Effect(
        name="temperature_friction",
        description="friction follows the temperature of the gearbox, beyond what the model does",
        unit="share of the law, as power of its ratios (1 = the law as published)",
        signature="more viscous friction when cold, more friction at low speed when warm",
        element="friction{i}, dcmotor lugre and damping; between steps where temperature changes",
        prior=Prior(std=SPREADS["temperature_friction"].std, steps=(0.3,), at_motor=True),
        source="Bittencourt et al. 2010, as in docs/physics.md",
        largest=3.0,
        smallest=-1.0,
        step=0.3,
        parameters={"temperature": None},
        edit=follow_constant,
        between=follow_course,
        interval=0.1,
    ),
)
"""Effects of this family."""
