"""Edits of a robot's friction.

Friction on the rotor of axis i (``friction{i}``), thesis eq. 6.3 with the Stribeck exponent 2 that
MuJoCo has built in:

    torque = (coulomb + (stiction - coulomb) exp(-(w / stribeck_velocity)^2)) sign(w) + viscous w

in [N m], w in [rad/s]; thesis f_c = coulomb, f_s = stiction - coulomb. Axes count from 1.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from faultgen.effects.base import FRACTION, Effect
from faultgen.effects.elements import ONE_WAY, add_one_way_damper
from faultgen.effects.prior import Prior, torque_offset_std
from faultgen.effects.spreads import SPREADS
from faultgen.robot import COULOMB, OFFSET, STICTION, STRIBECK_VELOCITY, Robot

QUADRATIC_SPEED = 100.0
"""Motor speed at which quadratic viscous friction is stated [rad/s]: assumed."""

SPEED_FRICTION = "friction of speed"
"""Group of the effects that change how friction depends on speed."""

_WIDTHS = (0.3, 1.0, 3.0, 10.0, 30.0)  # of low-speed friction, in Stribeck velocities
_STRIBECK = "LuGre friction with Stribeck curve, thesis eq. 6.3"


def scale_coulomb_and_static(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply Coulomb and static friction by 1 + severity: the thesis' wear.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal values.
    """
    actuator = spec.actuator(f"friction{axis}")
    actuator.biasprm[COULOMB] *= 1 + severity
    actuator.biasprm[STICTION] *= 1 + severity


def scale_coulomb(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply Coulomb friction f_c by 1 + severity. The Stribeck part f_s stays.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value.
    """
    actuator = spec.actuator(f"friction{axis}")
    growth = severity * actuator.biasprm[COULOMB]
    actuator.biasprm[COULOMB] += growth
    actuator.biasprm[STICTION] += growth


def scale_static(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply static friction f_s by 1 + severity. The Coulomb part f_c stays.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value.
    """
    actuator = spec.actuator(f"friction{axis}")
    static = actuator.biasprm[STICTION] - actuator.biasprm[COULOMB]
    actuator.biasprm[STICTION] += severity * static


def scale_viscous(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply viscous friction by 1 + severity.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value.
    """
    spec.actuator(f"friction{axis}").damping[0] *= 1 + severity


def scale_stribeck_velocity(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply the Stribeck velocity by 1 + severity.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value.
    """
    spec.actuator(f"friction{axis}").biasprm[STRIBECK_VELOCITY] *= 1 + severity


def add_quadratic_viscous(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add friction b w |w|. At `QUADRATIC_SPEED` it is severity times Coulomb friction.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of Coulomb friction.
    """
    actuator = spec.actuator(f"friction{axis}")
    actuator.damping[1] += severity * actuator.biasprm[COULOMB] / QUADRATIC_SPEED**2


def add_asymmetry(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply Coulomb friction by 1 + severity for forward motion of the motor only.

    Half of the growth is symmetric. The other half is a constant torque against forward motion.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value.
    """
    half = severity * spec.actuator(f"friction{axis}").biasprm[COULOMB] / 2
    add_coulomb(spec, axis, half)
    add_offset(spec, axis, -half)


def add_viscous_asymmetry(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply viscous friction by 1 + severity for forward motion of the motor only.

    Growth is a damper that acts in forward direction. A decrease is a smaller viscous friction in
    both directions, and a damper that acts in backward direction.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value. May be negative.
    """
    friction = spec.actuator(f"friction{axis}")
    grown = severity * friction.damping[0]
    if grown < 0:
        friction.damping[0] += grown
    add_one_way_damper(spec, f"{ONE_WAY}{axis}", f"motor{axis}", abs(grown), forward=grown > 0)


def no_static_friction(bias: np.ndarray) -> bool:
    """Whether a model's static friction equals its Coulomb friction, from its biasprm."""
    return bool(np.isclose(bias[STICTION], bias[COULOMB], rtol=1e-4))


def add_low_speed_friction(
    spec: mujoco.MjSpec, axis: int, severity: float, *, width: float | None
) -> None:
    """Add the friction severity times Coulomb friction exp(-(w / width)^2). It may be negative.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of Coulomb friction.
        width: Stribeck velocity [rad/s], used if the model has no static friction of its own. None:
            that of the model.
    """
    bias = spec.actuator(f"friction{axis}").biasprm
    if width is not None and no_static_friction(bias):
        bias[STRIBECK_VELOCITY] = width
    bias[STICTION] += severity * bias[COULOMB]


def add_coulomb(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add Coulomb friction. The Stribeck part stays.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Friction torque, motor side [N m].
    """
    actuator = spec.actuator(f"friction{axis}")
    actuator.biasprm[COULOMB] += severity
    actuator.biasprm[STICTION] += severity


def add_offset(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add a constant torque on the rotor.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Torque [N m], positive in the direction of forward motion of the motor.
    """
    actuator = spec.actuator(f"friction{axis}")
    # amplitude sin(0 turns + 90 deg): cogging without poles
    actuator.biasprm[OFFSET] += severity
    actuator.biasprm[OFFSET + 1] = 0.0
    actuator.biasprm[OFFSET + 2] = math.pi / 2


def _widths(robot: Robot, axis: int) -> list[dict[str, float]]:
    """Widths of low-speed friction to probe: many if the model has no Stribeck curve."""
    bias = robot.model.actuator_biasprm[robot.ids("actuator", "friction")[axis - 1]]
    if not no_static_friction(bias):
        return [{}]
    return [{"width": float(width * bias[STRIBECK_VELOCITY])} for width in _WIDTHS]


EFFECTS = (
    Effect(
        name="friction_wear",
        description="Coulomb and static friction of the motor side grow together",
        unit=FRACTION,
        signature="more torque against the motion, the same at every speed",
        element="friction{i}, dcmotor lugre: coulomb and static",
        prior=Prior(
            std=SPREADS["friction_wear"].std,
            steps=(0.1,),
            group=SPEED_FRICTION,
            own_axis_only=True,
            at_motor=True,
        ),
        source="thesis 6.3.1; " + _STRIBECK,
        smallest=-0.9,
        edit=scale_coulomb_and_static,
    ),
    Effect(
        name="coulomb_friction",
        description="Coulomb friction grows",
        unit=FRACTION,
        signature="more torque against the motion, the same at every speed",
        element="friction{i}, dcmotor lugre: coulomb and static by the same torque",
        prior=Prior(
            std=SPREADS["coulomb_friction"].std,
            steps=(0.1,),
            group=SPEED_FRICTION,
            in_every_model=True,
            own_axis_only=True,
            at_motor=True,
        ),
        source="thesis eq. 3.7; " + _STRIBECK,
        smallest=-0.9,
        edit=scale_coulomb,
    ),
    Effect(
        name="static_friction",
        description="static friction (the height of the Stribeck curve) grows",
        unit=FRACTION,
        signature="more torque when starting, reversing and creeping",
        element="friction{i}, dcmotor lugre: static",
        prior=Prior(
            std=SPREADS["static_friction"].std,
            steps=(0.1,),
            group=SPEED_FRICTION,
            own_axis_only=True,
            at_motor=True,
        ),
        source=_STRIBECK,
        smallest=-0.9,
        edit=scale_static,
    ),
    Effect(
        name="viscous_friction",
        description="viscous friction grows, as with stiff or old grease",
        unit=FRACTION,
        signature="more torque against the motion, in proportion to speed",
        element="friction{i}, dcmotor damping",
        prior=Prior(
            std=SPREADS["viscous_friction"].std,
            steps=(0.1,),
            group=SPEED_FRICTION,
            in_every_model=True,
            own_axis_only=True,
            at_motor=True,
        ),
        source="thesis eq. 6.3",
        smallest=-0.9,
        edit=scale_viscous,
    ),
    Effect(
        name="stribeck_velocity",
        description="the Stribeck curve reaches to higher speeds, as with thinner oil",
        unit=FRACTION,
        signature="more torque against the motion at low speed, about the Stribeck velocity",
        element="friction{i}, dcmotor lugre: Stribeck velocity",
        prior=Prior(
            std=SPREADS["stribeck_velocity"].std,
            steps=(0.3, 2.0),
            group=SPEED_FRICTION,
            own_axis_only=True,
            at_motor=True,
        ),
        source=_STRIBECK,
        smallest=-0.9,
        edit=scale_stribeck_velocity,
    ),
    Effect(
        name="quadratic_viscous_friction",
        description="friction that grows with the square of speed",
        unit=f"fraction of Coulomb friction, at {QUADRATIC_SPEED:g} rad/s motor side",
        signature="more torque against the motion at high speed, in proportion to its square",
        element="friction{i}, dcmotor damping, second coefficient",
        prior=Prior(
            std=SPREADS["quadratic_viscous_friction"].std,
            steps=(0.1,),
            group=SPEED_FRICTION,
            own_axis_only=True,
            at_motor=True,
        ),
        source="w |w| term of extended friction models; the reference speed is assumed",
        smallest=-1.0,
        edit=add_quadratic_viscous,
    ),
    Effect(
        name="friction_asymmetry",
        description="Coulomb friction grows in one direction, as with a worn screw or seal",
        unit="fraction of Coulomb friction, where the motor turns forward",
        signature="more torque against the motion in one direction, none in the other",
        element="friction{i}, dcmotor lugre and cogging without poles",
        prior=Prior(
            std=SPREADS["friction_asymmetry"].std, steps=(0.1,), own_axis_only=True, at_motor=True
        ),
        source="direction-dependent friction of the EMPS benchmark (Janot et al. 2019)",
        smallest=-0.9,
        edit=add_asymmetry,
    ),
    Effect(
        name="viscous_asymmetry",
        description="viscous friction grows in one direction, as with oil that a screw pumps",
        unit="fraction of viscous friction, where the motor turns forward",
        signature="more torque against the motion in one direction, in proportion to speed",
        element="viscous_asymmetry{i}, short-circuited dcmotor with a force of one sign",
        prior=Prior(
            use="on request",
            reason="other effects of friction imitate it in most motions",
            std=SPREADS["viscous_asymmetry"].std,
            steps=(0.1,),
            own_axis_only=True,
            at_motor=True,
        ),
        source="viscous friction by direction, as the EMPS shows (docs/examples/emps)",
        smallest=-0.9,
        edit=add_viscous_asymmetry,
    ),
    Effect(
        name="low_speed_friction",
        description="friction is more, or less, at low speed than the Coulomb law says",
        unit="fraction of Coulomb friction, at standstill",
        signature="more or less torque against the motion below the Stribeck velocity",
        element="friction{i}, dcmotor lugre: static, and Stribeck velocity",
        prior=Prior(
            use="on request",
            reason="the friction law of most models covers low speed already",
            std=SPREADS["low_speed_friction"].std,
            steps=(0.1,),
            variants=_widths,
            own_axis_only=True,
            at_motor=True,
        ),
        source=_STRIBECK,
        smallest=-0.9,
        parameters={"width": None},
        edit=add_low_speed_friction,
    ),
    Effect(
        name="torque_offset",
        description="a constant torque on the rotor, as of a drifting current sensor",
        unit="N m, motor side, positive with forward motion",
        units="N m",
        motor_torque=True,
        signature="the same torque at all times, also at rest",
        element="friction{i}, dcmotor cogging without poles",
        prior=Prior(
            std=torque_offset_std,
            steps_in_std=100,
            in_every_model=True,
            own_axis_only=True,
            at_motor=True,
        ),
        source="definition",
        smallest=-10.0,
        step=0.01,
        edit=add_offset,
    ),
    Effect(
        name="brake_drag",
        description="the brake does not lift wholly: added Coulomb friction on the rotor",
        unit="N m, motor side",
        units="N m",
        motor_torque=True,
        signature="more torque against the motion, the same at every speed",
        element="friction{i}, dcmotor lugre: coulomb and static by the same torque",
        prior=Prior(use="never", reason="coulomb_friction changes the robot in the same way"),
        source="definition",
        same_as="coulomb_friction",
        step=0.01,
        edit=add_coulomb,
    ),
)
"""Effects of this family."""
