"""What is taken out of a plain model, so that the chain of its axes is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from faultgen.building.axes import FREE, HINGE, SLIDE, above
from faultgen.building.inertias import repair_inertias
from faultgen.mjcf.compiling import compiled_anyway

HOME = "home"
"""Name of the keyframe that is the pose from which tasks start."""


def name_elements(spec: mujoco.MjSpec) -> None:
    """Give joints and bodies without a name one, in place.

    Args:
        spec: The model.
    """
    bodies = {body.name for body in spec.bodies}
    joints = {joint.name for joint in spec.joints}
    for kind, elements, taken in (("link", spec.bodies, bodies), ("axis", spec.joints, joints)):
        number = 0
        for element in elements:
            while not element.name:
                number += 1
                if f"{kind}_{number}" not in taken:
                    element.name = f"{kind}_{number}"


def _of(element: Any) -> str:
    """What an element without a name acts on; empty if it acts on nothing that has a name."""
    target = getattr(element, "target", "")
    return f"of {target}" if target else ""


def strip(
    spec: mujoco.MjSpec, axes: Sequence[str], pose: Mapping[str, float], where: str
) -> list[str]:
    """Take everything out of a model that a robot of faultgen gets new or does not have, in place.

    Args:
        spec: The model.
        axes: Names of the joints that are axes.
        pose: Positions in the keyframe ``home`` by joint, in [rad] or [m]; empty if there is none.
            Joints that are no axes are locked there, and without the keyframe at zero or at the
            nearest limit.
        where: What the model is, for messages.

    Returns:
        One line for each kind of element that was taken out.
    """
    notes = []
    kinds = (
        ("keyframes", "keys"),
        ("sensors", "sensors"),
        ("actuators", "actuators"),
        ("equality constraints", "equalities"),
        ("tendons", "tendons"),
        ("contact pairs", "pairs"),
        ("excluded contacts", "excludes"),
        ("numbers", "numerics"),
        ("texts", "texts"),
        ("tuples", "tuples"),
    )
    for what, kind in kinds:
        elements = list(getattr(spec, kind))
        names = ", ".join(filter(None, (one.name or _of(one) for one in elements)))
        couple = kind == "equalities" and any({o.name1, o.name2} <= set(axes) for o in elements)
        for one in elements:
            spec.delete(one)
        if kind == "keys" and pose:
            elements = [one for one in elements if one.name != HOME]  # it has been read
            names = ", ".join(one.name for one in elements)
        if elements:
            told = what if len(elements) > 1 else what.removesuffix("s")
            notes.append(f"{len(elements)} {told} dropped" + (f": {names}" if names else ""))
        if couple:
            notes[-1] += (
                "; if they couple two axes, as in many wrists, state a [[coupling]] in drives.toml"
            )
    moving = {body for name in axes for body in above(spec.joint(name).parent)}
    for joint in [one for one in spec.joints if one.type == FREE]:
        body = joint.parent
        if body.name in moving:
            notes.append(f"free joint '{joint.name}' dropped: the base stands still")
            spec.delete(joint)
        else:
            notes.append(f"body '{body.name}' dropped: it is a loose object, no part of the arm")
            spec.delete(body)
    locked = [joint for joint in spec.joints if joint.name not in axes]
    if locked:
        notes.append(_lock(spec, locked, pose, where))
    compensated = [body for body in spec.bodies if body.gravcomp]
    for body in compensated:
        body.gravcomp = 0.0
    if compensated:
        notes.append("gravity compensation dropped: the motors carry the weight")
    return notes


def _lock(
    spec: mujoco.MjSpec,
    joints: Sequence[mujoco.MjsJoint],
    pose: Mapping[str, float],
    where: str,
) -> str:
    """Replace joints by fixed links; one line that says where they are locked."""
    copy = spec.copy()
    repair_inertias(copy)
    model = compiled_anyway(copy, where)  # impossible inertias are reported later
    told = []
    for joint in joints:
        name, value = joint.name, 0.0
        if joint.type in (HINGE, SLIDE):
            here = model.joint(name)
            limits = here.range if here.limited[0] else np.array([-np.inf, np.inf])
            value = float(np.clip(pose.get(name, 0.0), *limits))
            _move(joint, model, value)
        unit = "m" if joint.type == SLIDE else "rad"
        told.append(f"{name} at {value:.4g} {unit}" if value else name)
        spec.delete(joint)
    return f"{len(told)} {'joints' if len(told) > 1 else 'joint'} locked: {', '.join(told)}"


def _move(joint: mujoco.MjsJoint, model: mujoco.MjModel, value: float) -> None:
    """Turn or shift the body of a joint as the joint does at a position, in [rad] or [m]."""
    body, own = joint.parent, model.joint(joint.name)
    by = value - float(model.qpos0[own.qposadr[0]])
    if not by:
        return
    pos, quat = model.body(body.name).pos, model.body(body.name).quat
    turned, both, shift, back = np.zeros(4), np.zeros(4), np.zeros(3), np.zeros(3)
    if joint.type == SLIDE:
        shift, turned = by * own.axis, np.array([1.0, 0, 0, 0])
    else:  # about an axis through a point of the body
        mujoco.mju_axisAngle2Quat(turned, own.axis, by)
        mujoco.mju_rotVecQuat(back, own.pos, turned)
        shift = own.pos - back
    outer = np.zeros(3)
    mujoco.mju_rotVecQuat(outer, shift, quat)
    mujoco.mju_mulQuat(both, quat, turned)
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    body.pos, body.quat = pos + outer, both


def moving_links(spec: mujoco.MjSpec, axes: Sequence[str]) -> list[str]:
    """Return the names of the bodies that have an axis of their own.

    Args:
        spec: The model.
        axes: Names of the joints that are axes.
    """
    return list(dict.fromkeys(spec.joint(name).parent.name for name in axes))
