"""Edits of a robot's friction.

Friction on the rotor of axis i (``friction{i}``), thesis eq. 6.3 with the Stribeck exponent 2 that
MuJoCo has built in:

    torque = (coulomb + (stiction - coulomb) exp(-(w / stribeck_velocity)^2)) sign(w) + viscous w

in [N m], w in [rad/s]; thesis f_c = coulomb, f_s = stiction - coulomb. Axes count from 1.
"""

from __future__ import annotations

import math

import mujoco

from faultgen.robot import COULOMB, OFFSET, STICTION, STRIBECK_VELOCITY

# Bittencourt et al. (IROS 2010), ABB joint; torque over the largest torque, motor speed, deg C.
# Figures as in the literature list of docs/physics.md; the Coulomb term does not depend on T.
_STRIBECK_HEIGHT = (-2.5e-2, 1.6e-3)
_STRIBECK_VELOCITY = (-24.8, 0.98)
_VISCOUS = (1.3e-4, 1.32e-3, 20.7)
QUADRATIC_SPEED = 100.0
"""Motor speed at which quadratic viscous friction is measured [rad/s]: assumed."""

TEMPERATURE_RANGE = (30.0, 80.0)
"""Temperatures [deg C] for which the law is used; measured from 33 to 80."""


def scale_coulomb_and_static(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Coulomb and static friction times 1 + severity: thesis' wear."""
    actuator = spec.actuator(f"friction{axis}")
    actuator.biasprm[COULOMB] *= 1 + severity
    actuator.biasprm[STICTION] *= 1 + severity


def scale_coulomb(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Coulomb friction f_c times 1 + severity; the Stribeck part f_s stays."""
    actuator = spec.actuator(f"friction{axis}")
    growth = severity * actuator.biasprm[COULOMB]
    actuator.biasprm[COULOMB] += growth
    actuator.biasprm[STICTION] += growth


def scale_static(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Static friction f_s times 1 + severity; the Coulomb part f_c stays."""
    actuator = spec.actuator(f"friction{axis}")
    static = actuator.biasprm[STICTION] - actuator.biasprm[COULOMB]
    actuator.biasprm[STICTION] += severity * static


def scale_viscous(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Viscous friction times 1 + severity."""
    spec.actuator(f"friction{axis}").damping[0] *= 1 + severity


def scale_stribeck_velocity(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Stribeck velocity times 1 + severity."""
    spec.actuator(f"friction{axis}").biasprm[STRIBECK_VELOCITY] *= 1 + severity


def add_quadratic_viscous(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add friction b w |w|, which at `QUADRATIC_SPEED` is severity times Coulomb friction."""
    actuator = spec.actuator(f"friction{axis}")
    actuator.damping[1] += severity * actuator.biasprm[COULOMB] / QUADRATIC_SPEED**2


def add_asymmetry(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Coulomb friction times 1 + severity where the motor turns forward, as it was backward.

    Half of the growth is symmetric, the other half a constant torque against forward motion.
    """
    half = severity * spec.actuator(f"friction{axis}").biasprm[COULOMB] / 2
    add_coulomb(spec, axis, half)
    add_offset(spec, axis, -half)


def add_coulomb(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add Coulomb friction [N m, motor side]; the Stribeck part stays."""
    actuator = spec.actuator(f"friction{axis}")
    actuator.biasprm[COULOMB] += severity
    actuator.biasprm[STICTION] += severity


def add_offset(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add a constant torque on the rotor [N m], positive with forward motion of the motor."""
    actuator = spec.actuator(f"friction{axis}")
    # amplitude sin(0 turns + 90 deg): cogging without poles
    actuator.biasprm[OFFSET] += severity
    actuator.biasprm[OFFSET + 1] = 0.0
    actuator.biasprm[OFFSET + 2] = math.pi / 2


def set_temperature(spec: mujoco.MjSpec, axis: int, temperature: float, reference: float) -> None:
    """Bring the friction of an axis to another gearbox temperature.

    Viscous friction, the Stribeck height and the Stribeck velocity change by the ratios of
    Bittencourt's law at the two temperatures.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        temperature: Gearbox temperature [deg C], held within `TEMPERATURE_RANGE`.
        reference: Temperature at which the model's friction holds [deg C].
    """
    low, high = TEMPERATURE_RANGE
    hot = min(max(temperature, low), high)

    def ratio(law: tuple[float, float]) -> float:
        return (law[0] + law[1] * hot) / (law[0] + law[1] * reference)

    def viscous(t: float) -> float:
        return _VISCOUS[0] + _VISCOUS[1] * math.exp(-t / _VISCOUS[2])

    actuator = spec.actuator(f"friction{axis}")
    coulomb = actuator.biasprm[COULOMB]
    height = actuator.biasprm[STICTION] - coulomb
    actuator.biasprm[STICTION] = coulomb + height * ratio(_STRIBECK_HEIGHT)
    actuator.biasprm[STRIBECK_VELOCITY] *= ratio(_STRIBECK_VELOCITY)
    actuator.damping[0] *= viscous(hot) / viscous(reference)
