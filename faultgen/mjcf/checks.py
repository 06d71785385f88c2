"""Checks that a model is a complete robot: its elements, and whether its numbers make sense.

All findings are reported at once, so that a user can correct a file in one step.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.etree import ElementTree

import mujoco
import numpy as np

from faultgen.mjcf.dcmotor import (
    BRISTLE_STIFFNESS,
    COULOMB,
    STICTION,
    STRIBECK_VELOCITY,
)
from faultgen.mjcf.elements import KINDS, element_ids

SHORTEST_STEP = 1e-5
"""Shortest time step of a model [s]: a cycle of 10 s then has a million steps."""

LONGEST_STEP = 0.1
"""Longest time step of a model [s]."""

_MOST_SHOWN = 12  # names in a message
_PASSIVE, _SERVO = 0, 3  # controls of friction{i} and drive{i}
_FINITE = ("body_mass", "body_inertia", "body_pos", "body_ipos", "dof_armature", "dof_damping")
_BOUNDED = ("joint", "encoder_counts", "torque_gain", "gearbox", "friction")  # not inf either


def count_axes(model: mujoco.MjModel) -> int:
    """Return the number of axes: the largest i of a joint named ``joint{i}``.

    The result is at most the number of joints in the model.

    Args:
        model: The compiled model.
    """
    names = (model.joint(k).name for k in range(model.njnt))
    numbers = [int(n[5:]) for n in names if re.fullmatch(r"joint[1-9]\d{0,5}", n)]
    return min(max(numbers, default=0), model.njnt)


def missing_elements(model: mujoco.MjModel, n_axes: int) -> list[str]:
    """List the elements that a robot needs and the model lacks.

    Args:
        model: The compiled model.
        n_axes: Number of axes.

    Returns:
        One finding for each kind of element, with the names that are missing.
    """
    found = []
    kinds = {"joint": ("joint", "motor"), "tendon": ("gearbox",), "actuator": ("drive", "friction")}
    for kind, names in kinds.items():
        wanted = [f"{name}{i + 1}" for i in range(n_axes) for name in names]
        lacking = [name for name in wanted if mujoco.mj_name2id(model, KINDS[kind], name) < 0]
        if lacking:
            shown = ", ".join(f"'{name}'" for name in lacking[:_MOST_SHOWN])
            more = f" and {len(lacking) - _MOST_SHOWN} more" if len(lacking) > _MOST_SHOWN else ""
            found.append(f"no {kind} named {shown}{more}")
    return found


def wrong_elements(model: mujoco.MjModel, n_axes: int) -> list[str]:
    """List the elements that have the name of a robot's element but are of another type.

    Args:
        model: The compiled model, in which no element is missing.
        n_axes: Number of axes.

    Returns:
        One finding for each element.
    """
    found = []
    joints = {name: element_ids(model, "joint", name, n_axes) for name in ("joint", "motor")}
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for name, ids in joints.items():
        for axis, joint in enumerate(ids, start=1):
            if model.jnt_type[joint] not in kinds:
                found.append(f"joint '{name}{axis}' must be a hinge or slide")
    for name, controls in (("drive", _SERVO), ("friction", _PASSIVE)):
        for axis, actuator in enumerate(element_ids(model, "actuator", name, n_axes), 1):
            on_motor = (
                model.actuator_trntype[actuator] == int(mujoco.mjtTrn.mjTRN_JOINT)
                and model.actuator_trnid[actuator, 0] == joints["motor"][axis - 1]
            )
            if not on_motor or model.actuator_ctrlnum[actuator] != controls:
                given = 'input="pos vel ff"' if controls else 'input="none"'
                found.append(f"actuator '{name}{axis}' must be a dcmotor on motor{axis}, {given}")
    return found


def wrong_numbers(
    model: mujoco.MjModel, xml: str, n_axes: int, numerics: Mapping[str, np.ndarray]
) -> list[str]:
    """List the numbers that no robot can have.

    Args:
        model: The compiled model, in which no element is missing or wrong.
        xml: The MJCF text of the model.
        n_axes: Number of axes.
        numerics: Values of the ``numeric`` elements by name, or their defaults.

    Returns:
        Findings, each with the place of the number and what would be right.
    """
    found = []
    step = model.opt.timestep
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        found.append(f"timestep must be from {SHORTEST_STEP:g} to {LONGEST_STEP:g} s, not {step:g}")
    for name in _FINITE:
        if not np.isfinite(getattr(model, name)).all():
            found.append(f"{name} must be finite")
    for values in re.findall(r'\bsaturation\s*=\s*["\']([^"\']*)', xml):
        if any(value.startswith("-") for value in values.split()):
            found.append(f"saturation must not be negative, as in '{values}'")
    joints = element_ids(model, "joint", "joint", n_axes)
    # a joint may have no limits; limits that are given as 0 0 look the same once compiled
    with np.errstate(invalid="ignore"):
        ranges = np.ptp(model.jnt_range[joints], axis=1)
    width = np.where(model.jnt_limited[joints], ranges, 1.0)
    given = _given_ranges(xml)
    for axis in range(n_axes):
        if limits := given.get(f"joint{axis + 1}"):
            with np.errstate(invalid="ignore"):  # "inf inf" has no width
                width[axis] = np.minimum(width[axis], np.subtract(limits[1], limits[0]))
    tendon = element_ids(model, "tendon", "gearbox", n_axes)
    friction = element_ids(model, "actuator", "friction", n_axes)
    bias, bristles = model.actuator_biasprm[friction], model.actuator_dynprm[friction]
    # where there is no dry friction, the parameters of its law do not count
    without = (bias[:, COULOMB] == 0) & (bias[:, STICTION] == 0)
    rules: list[tuple[str, np.ndarray, bool]] = [  # where, values, whether 0 is right
        ("joint{}: width of its range", width, False),
        ("motor_velocity_limit of axis {}", numerics["motor_velocity_limit"], False),
        ("joint_acceleration_limit of axis {}", numerics["joint_acceleration_limit"], False),
        ("encoder_counts of axis {}", numerics["encoder_counts"], True),
        ("torque_gain of axis {}", numerics["torque_gain"], False),
        ("gearbox{}: stiffness", model.tendon_stiffness[tendon], False),
        ("gearbox{}: damping", model.tendon_damping[tendon], True),
        ("friction{}: Coulomb friction", bias[:, COULOMB], True),
        ("friction{}: static friction", bias[:, STICTION], True),
        ("friction{}: Stribeck velocity", bias[:, STRIBECK_VELOCITY] + without, False),
        ("friction{}: bristle stiffness", bristles[:, BRISTLE_STIFFNESS] + without, False),
    ]
    for where, values, zero in rules:
        right = values >= 0 if zero else values > 0
        if where.startswith(_BOUNDED):
            right &= np.isfinite(values)
        if right.all():
            continue
        axis = int(np.flatnonzero(~right)[0])
        needed = "must not be negative" if zero else "must be positive"
        found.append(f"{where.format(axis + 1)} {needed}, not {values[axis]:g}")
    finite = ("servo_set_points", "servo_friction", "friction_temperature")
    if not all(np.isfinite(numerics[name]).all() for name in finite):
        found.append(f"{', '.join(finite)} must be finite")
    elif (width := numerics["servo_friction"][1]) <= 0:
        found.append(f"servo_friction: its second number must be positive, not {width:g}")
    return found


def _given_ranges(xml: str) -> dict[str, tuple[float, float]]:
    """Limits of joints as the text of a model gives them, by the name of the joint."""
    try:
        joints = list(ElementTree.fromstring(xml).iter("joint"))
    except ElementTree.ParseError:  # MuJoCo has read it all the same
        return {}
    found = {}
    for joint in joints:
        limits = [float(value) for value in joint.get("range", "").split()]
        if limits:  # an empty text gives none
            found[joint.get("name", "")] = (limits[0], limits[1])
    return found
