"""Elements that effects add to a robot's spec. They are passive: no column of the control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from faultgen.robot import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    COULOMB,
    STICTION,
    STRIBECK_VELOCITY,
    Robot,
)

if TYPE_CHECKING:
    from faultgen.effects.base import Moment

ONE_WAY = "viscous_asymmetry"
"""Name of the elements that damp one way."""

_PASSIVE = 16  # mjsActuator.ctrlspec of input="none"
_ANY = 1e9  # force that is not reached [N m]
_NOTHING = 1e-12  # MuJoCo divides by friction [N m]
_SLIDING = slice(COULOMB, STICTION + 1)
_BRISTLES = slice(BRISTLE_STIFFNESS, BRISTLE_DAMPING + 1)


def gear_ratio(spec: mujoco.MjSpec, axis: int) -> float:
    """Rotor turns per joint turn, signed."""
    for wrap in spec.tendon(f"gearbox{axis}").path:
        if wrap.target.name == f"motor{axis}":
            return 1.0 / wrap.coef
    raise ValueError(f"gearbox{axis} has no motor{axis}")


def add_cogging(
    spec: mujoco.MjSpec, name: str, target: str, amplitude: float, order: float, phase: float
) -> None:
    """Add a passive dcmotor of force amplitude sin(order length + phase) on a joint or tendon.

    Args:
        spec: The robot, edited in place.
        name: Name of the element; a number is added where it is taken.
        target: Name of the joint or tendon.
        amplitude: Force on the target [N m].
        order: Periods a turn of the target; any real number.
        phase: In [rad].
    """
    _motor(spec, name, target).set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, cogging=[amplitude, order, phase], ctrlspec=_PASSIVE
    )


def add_lugre(spec: mujoco.MjSpec, name: str, target: str, lugre: Sequence[float]) -> None:
    """Add a passive dcmotor of LuGre friction on a joint or tendon.

    Args:
        spec: The robot, edited in place.
        name: Name of the element; a number is added where it is taken.
        target: Name of the joint or tendon.
        lugre: Bristle stiffness [N m/rad] and damping [N m s/rad], Coulomb and static friction
            [N m], Stribeck velocity [rad/s].
    """
    _motor(spec, name, target).set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, lugre=list(lugre), ctrlspec=_PASSIVE
    )


def add_told_friction(spec: mujoco.MjSpec, name: str, axis: int) -> None:
    """Add friction on a rotor that holds nothing until `ToldFriction` tells it how much.

    Args:
        spec: The robot, edited in place.
        name: Name of the element; a number is added where it is taken.
        axis: Axis, from 1.
    """
    width = spec.actuator(f"friction{axis}").biasprm[STRIBECK_VELOCITY]
    add_lugre(spec, name, f"motor{axis}", [_NOTHING, _NOTHING, _NOTHING, _NOTHING, width])


class ToldFriction:
    """Coulomb friction of some elements, told between steps.

    Bristles get stiffer as friction grows: their deflection in sliding is the same at all times, so
    that what changes does not excite them.

    Args:
        robot: The healthy robot.
        model: The robot with the elements.
        names: Name of each element, of `add_told_friction`.
        axes: Its axis, from 1.
    """

    def __init__(
        self, robot: Robot, model: mujoco.MjModel, names: Sequence[str], axes: Sequence[int]
    ) -> None:
        self._element = np.array([model.actuator(name).id for name in names])
        friction = robot.ids("actuator", "friction", model)[np.array(axes) - 1]
        self.coulomb = model.actuator_biasprm[friction, COULOMB]
        """Coulomb friction of each axis' own element [N m], shape (elements,)."""
        # bristles as those of the axis' own friction, for each N m that they hold
        self._bristles = model.actuator_dynprm[friction, _BRISTLES] / self.coulomb[:, None]

    def tell(self, moment: Moment, torque: np.ndarray) -> None:
        """Set the friction until the next update, shape (nsim, elements), in [N m]."""
        held = (torque + _NOTHING)[..., None]
        moment.biasprm[:, self._element, _SLIDING] = held
        moment.dynprm[:, self._element, _BRISTLES] = held * self._bristles


def add_one_way_damper(
    spec: mujoco.MjSpec, name: str, target: str, damping: float, *, forward: bool
) -> None:
    """Add a damper that acts on one direction of motion: a short-circuited motor, clipped.

    Args:
        spec: The robot, edited in place.
        name: Name of the element; a number is added where it is taken.
        target: Name of the joint.
        damping: In [N m s/rad].
        forward: Whether it acts on motion forward, else backward.
    """
    constant = float(np.sqrt(damping))  # force = -constant^2 / resistance * speed
    damper = _motor(spec, name, target)
    damper.set_to_dcmotor(motorconst=[constant, constant], resistance=1.0, ctrlspec=_PASSIVE)
    damper.forcelimited = True
    damper.forcerange = [-_ANY, 0.0] if forward else [0.0, _ANY]


def add_tendon(spec: mujoco.MjSpec, name: str, joints: Mapping[str, float]) -> str:
    """Add a fixed tendon without stiffness.

    Args:
        spec: The robot, edited in place.
        name: Name; a number is added where it is taken.
        joints: Coefficient by joint.

    Returns:
        The name that it got.
    """
    free = _free(name, [tendon.name for tendon in spec.tendons])
    tendon = spec.add_tendon(name=free)
    for joint, coefficient in joints.items():
        tendon.wrap_joint(joint, coefficient)
    return free


def _motor(spec: mujoco.MjSpec, name: str, target: str) -> mujoco.MjsActuator:
    free = _free(name, [actuator.name for actuator in spec.actuators])
    on_tendon = spec.tendon(target) is not None
    transmission = mujoco.mjtTrn.mjTRN_TENDON if on_tendon else mujoco.mjtTrn.mjTRN_JOINT
    return spec.add_actuator(name=free, trntype=transmission, target=target)


def numbered(name: str, number: int) -> str:
    """Name of the element that was added as the number-th of its name, from 1."""
    return name if number == 1 else f"{name}_{number}"


def _free(name: str, taken: Sequence[str]) -> str:
    """The first name of `numbered` that is not taken."""
    number = 1
    while numbered(name, number) in taken:
        number += 1
    return numbered(name, number)
