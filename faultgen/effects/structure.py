"""Edits of what the arm carries."""

from __future__ import annotations

import mujoco
import numpy as np

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
