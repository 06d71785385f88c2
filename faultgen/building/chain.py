"""The chain of axes in a plain model: which joints are axes, and what is taken out of the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco

from faultgen.building.findings import Finding

HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
FREE, BALL = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL

_NAME_THEM = "name the joints that are axes in drives.toml, joints = [...]; the others are locked"


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


def chain_findings(spec: mujoco.MjSpec, chosen: Sequence[str] | None) -> list[Finding]:
    """Check that the axes form one chain.

    Args:
        spec: The model, whose joints have names.
        chosen: Names of the joints that are axes, from the base to the tool. None: all.

    Returns:
        Findings; all of them are fatal.
    """
    names = [joint.name for joint in spec.joints]
    rotors = [name for name in names if name == "motor1"]
    if rotors and any(tendon.name == "gearbox1" for tendon in spec.tendons):
        return [
            Finding(
                "joint 'motor1'",
                "the model already has rotors and gearboxes",
                "check it with 'faultgen robot check', or give a plain model",
            )
        ]
    if chosen is not None:
        unknown = [name for name in chosen if name not in names]
        if unknown:
            known = ", ".join(names)
            return [
                Finding(f"joint '{name}'", "is not in the model", f"it has {known}")
                for name in unknown
            ]
    joints = axes_of(spec, chosen)
    found = [
        Finding(
            f"joint '{joint.name}'",
            f"is a {'ball' if joint.type == BALL else 'free'} joint, but axes are hinges or slides",
            _NAME_THEM,
        )
        for joint in spec.joints
        if (joint.type == BALL and chosen is None)
        or (joint.type in (BALL, FREE) and chosen is not None and joint.name in chosen)
    ]
    if not joints and not found:
        remedy = "give a model with hinge or slide joints"
        return [Finding("model", "no joint of it is a hinge or a slide", remedy)]
    for before, after in zip(joints, joints[1:], strict=False):
        if before.parent.name not in _above(after.parent):
            found.append(
                Finding(
                    f"joints '{before.name}' and '{after.name}'",
                    "do not follow each other in one chain: the model branches or has two arms",
                    _NAME_THEM,
                )
            )
    return found


def axes_of(spec: mujoco.MjSpec, chosen: Sequence[str] | None) -> list[mujoco.MjsJoint]:
    """Return the joints that are axes, from the base to the tool.

    Args:
        spec: The model, whose joints have names.
        chosen: Names of the joints that are axes. None: all hinges and slides.
    """
    if chosen is not None:
        return [spec.joint(name) for name in chosen if spec.joint(name).type in (HINGE, SLIDE)]
    return [joint for joint in spec.joints if joint.type in (HINGE, SLIDE)]


def _of(element: Any) -> str:
    """What an element without a name acts on; empty if it acts on nothing that has a name."""
    target = getattr(element, "target", "")
    return f"of {target}" if target else ""


def strip(spec: mujoco.MjSpec, axes: Sequence[str]) -> list[str]:
    """Take everything out of a model that a robot of faultgen gets new or does not have, in place.

    Args:
        spec: The model.
        axes: Names of the joints that are axes.

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
        for one in elements:
            spec.delete(one)
        if elements:
            told = what if len(elements) > 1 else what.removesuffix("s")
            notes.append(f"{len(elements)} {told} dropped" + (f": {names}" if names else ""))
        if elements and kind == "equalities":
            notes[-1] += "; a joint that moves with another one is a [[coupling]] in drives.toml"
    moving = {body for name in axes for body in _above(spec.joint(name).parent)}
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
        names = ", ".join(joint.name for joint in locked)
        notes.append(f"{len(locked)} joints locked at zero: {names}")
    for joint in locked:
        spec.delete(joint)
    compensated = [body for body in spec.bodies if body.gravcomp]
    for body in compensated:
        body.gravcomp = 0.0
    if compensated:
        notes.append("gravity compensation dropped: the motors carry the weight")
    return notes


def moving_links(spec: mujoco.MjSpec, axes: Sequence[str]) -> list[str]:
    """Return the names of the bodies that have an axis of their own.

    Args:
        spec: The model.
        axes: Names of the joints that are axes.
    """
    return list(dict.fromkeys(spec.joint(name).parent.name for name in axes))


def _above(body: mujoco.MjsBody) -> list[str]:
    """Names of a body and of all bodies that carry it."""
    names = []
    while body is not None and body.name != "world":
        names.append(body.name)
        body = body.parent
    return names
