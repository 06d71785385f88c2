"""Elements that effects add to a robot's spec. They are passive: no column of the control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

ONE_WAY = "viscous_asymmetry"
"""Name of the elements that damp one way."""

_PASSIVE = 16  # mjsActuator.ctrlspec of input="none"
_ANY = 1e9  # force that is not reached [N m]


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


def _free(name: str, taken: Sequence[str]) -> str:
    if name not in taken:
        return name
    number = 2
    while f"{name}_{number}" in taken:
        number += 1
    return f"{name}_{number}"
