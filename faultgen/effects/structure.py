"""Edits of what the arm carries."""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.effects.base import FRACTION, Effect, last_axis
from faultgen.errors import InputError


def scale_payload(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Mass and inertia of the payload times 1 + severity."""
    payload = _payload(spec, axis)
    payload.mass *= 1 + severity
    payload.inertia *= 1 + severity


def move_payload(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Move the payload's centre of mass by severity [m] across the flange (its x)."""
    payload = _payload(spec, axis)
    payload.ipos = np.array(payload.ipos) + [severity, 0.0, 0.0]


def add_gravity_spring(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add a spring of severity [N m/rad] that pulls the joint to its zero angle."""
    spec.joint(f"joint{axis}").stiffness[0] += severity


def _payload(spec: mujoco.MjSpec, axis: int) -> mujoco.MjsBody:
    if spec.joint(f"joint{axis + 1}") is not None:
        raise InputError(f"payload effects belong to the last axis, not to axis {axis}")
    payload = spec.body("payload")
    if payload is None:
        raise InputError("payload effects need a body 'payload' in the robot's MJCF")
    return payload


EFFECTS = (
    Effect(
        name="payload_mass",
        description="the payload is heavier; belongs to the last axis",
        unit=FRACTION,
        signature="gravity and inertia on several axes, by the pose",
        element="body payload, mass and inertia",
        source="definition",
        smallest=-0.9,
        axes=last_axis,
        edit=scale_payload,
    ),
    Effect(
        name="payload_offset",
        description="the payload sits off its place; belongs to the last axis",
        unit="m, along the flange's x",
        signature="gravity on the wrist by the tool's orientation",
        element="body payload, inertial pos",
        source="definition",
        smallest=-10.0,
        axes=last_axis,
        step=0.02,
        edit=move_payload,
    ),
    Effect(
        name="gravity_spring",
        description="a balancing device pulls the joint to its zero angle",
        unit="N m/rad, joint side",
        signature="torque in proportion to the angle of the joint, at all speeds",
        element="joint{i}, stiffness",
        source="linear spring",
        largest=1e6,
        smallest=-1e6,
        step=2.0,
        edit=add_gravity_spring,
    ),
)
"""Effects of this family."""
