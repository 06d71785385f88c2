"""Elements that effects add to a robot's spec. They are passive and have no control input."""

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
    from faultgen.effects.hooks import Moment

ONE_WAY = "viscous_asymmetry"
"""Name of the elements that damp in one direction only."""

_PASSIVE = 16  # mjsActuator.ctrlspec of input="none"
_ANY = 1e9  # force that is not reached [N m]
_NOTHING = 1e-12  # MuJoCo divides by friction [N m]
_SLIDING = slice(COULOMB, STICTION + 1)
_BRISTLES = slice(BRISTLE_STIFFNESS, BRISTLE_DAMPING + 1)


def gear_ratio(spec: mujoco.MjSpec, axis: int) -> float:
    """Return the number of turns of the rotor per turn of the joint, with its sign.

    Args:
        spec: The robot.
        axis: Axis, from 1.

    Returns:
        The gear ratio.

    Raises:
        ValueError: The gearbox is not connected to the motor.
    """
    for wrap in spec.tendon(f"gearbox{axis}").path:
        if wrap.target.name == f"motor{axis}":
            return 1.0 / wrap.coef
    raise ValueError(f"gearbox{axis} has no motor{axis}")


def add_cogging(
    spec: mujoco.MjSpec, name: str, target: str, amplitude: float, order: float, phase: float
) -> None:
    """Add a passive dcmotor with the force amplitude sin(order length + phase) to a target.

    Args:
        spec: The robot, edited in place.
        name: Name of the element. A number is appended if the name exists.
        target: Name of the joint or tendon.
        amplitude: Force on the target [N m].
        order: Periods per turn of the target; any real number.
        phase: Phase [rad].
    """
    _motor(spec, name, target).set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, cogging=[amplitude, order, phase], ctrlspec=_PASSIVE
    )


def add_lugre(spec: mujoco.MjSpec, name: str, target: str, lugre: Sequence[float]) -> None:
    """Add a passive dcmotor with LuGre friction on a joint or tendon.

    Args:
        spec: The robot, edited in place.
        name: Name of the element. A number is appended if the name exists.
        target: Name of the joint or tendon.
        lugre: Bristle stiffness [N m/rad] and damping [N m s/rad], Coulomb and static friction
            [N m], Stribeck velocity [rad/s].
    """
    _motor(spec, name, target).set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, lugre=list(lugre), ctrlspec=_PASSIVE
    )


def add_told_friction(spec: mujoco.MjSpec, name: str, axis: int) -> None:
    """Add friction on a rotor. It is zero until `ToldFriction` sets it.

    Args:
        spec: The robot, edited in place.
        name: Name of the element. A number is appended if the name exists.
        axis: Axis, from 1.
    """
    width = spec.actuator(f"friction{axis}").biasprm[STRIBECK_VELOCITY]
    add_lugre(spec, name, f"motor{axis}", [_NOTHING, _NOTHING, _NOTHING, _NOTHING, width])


class ToldFriction:
    """Coulomb friction of some elements that is set between steps.

    The bristles become stiffer as friction grows. Their deflection in sliding is therefore
    constant, and changes of the friction do not excite them.

    Args:
        robot: The healthy robot.
        model: The robot with the elements.
        names: Name of each element, as added by `add_told_friction`.
        axes: Axis of each element, from 1.
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
        """Set the friction until the next update.

        Args:
            moment: The present state of the simulations.
            torque: Friction torque [N m], shape (nsim, elements).
        """
        held = (torque + _NOTHING)[..., None]
        moment.biasprm[:, self._element, _SLIDING] = held
        moment.dynprm[:, self._element, _BRISTLES] = held * self._bristles


def add_one_way_damper(
    spec: mujoco.MjSpec, name: str, target: str, damping: float, *, forward: bool
) -> None:
    """Add a damper for one direction of motion: a short-circuited motor with one-sided force.

    Args:
        spec: The robot, edited in place.
        name: Name of the element. A number is appended if the name exists.
        target: Name of the joint.
        damping: Damping [N m s/rad].
        forward: Whether it acts on forward motion instead of backward motion.
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
        name: Name of the tendon. A number is appended if the name exists.
        joints: Coefficient by joint.

    Returns:
        The name of the new tendon.
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
    """Return the name of the element that was the number-th to be added with a name.

    Args:
        name: Name that was asked for.
        number: Number of the element among those, from 1.

    Returns:
        The name, with the number appended from 2 on.
    """
    return name if number == 1 else f"{name}_{number}"


def _free(name: str, taken: Sequence[str]) -> str:
    """The first name of `numbered` that does not exist yet."""
    number = 1
    while numbered(name, number) in taken:
        number += 1
    return numbered(name, number)
