"""Edits of the arm's payload, and of the spring that balances gravity."""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.effects.base import FRACTION, Effect, last_axis
from faultgen.effects.base import MASSLESS as MASSLESS
from faultgen.effects.prior import Prior, of_joint_torque
from faultgen.errors import InputError

_POINT = 0.01  # radius of gyration of a point [m]: assumed


def scale_payload(
    spec: mujoco.MjSpec, axis: int, severity: float, *, x: float, y: float, z: float
) -> None:
    """Multiply mass and inertia of the payload by 1 + severity, or add a point mass if it has none.

    Args:
        spec: The robot, edited in place.
        axis: The last axis.
        severity: Fraction, or mass of the point [kg] if the model's payload is below `MASSLESS`.
        x: Position of that point in the frame of the payload [m].
        y: The same for y [m].
        z: The same for z [m].
    """
    payload = payload_body(spec, axis)
    if payload.mass >= MASSLESS:
        payload.mass *= 1 + severity
        payload.inertia *= 1 + severity
        return
    if severity < 0:
        raise InputError("payload_mass: the payload has no mass that could be less")
    payload.mass = severity
    payload.ipos = np.array([x, y, z])
    payload.inertia = np.full(3, severity * _POINT**2)


def move_payload(spec: mujoco.MjSpec, axis: int, severity: float, *, direction: int) -> None:
    """Move the payload's centre of mass along an axis of the flange.

    Args:
        spec: The robot, edited in place.
        axis: The last axis.
        severity: Distance [m].
        direction: 0, 1 or 2 for x, y or z.

    Raises:
        InputError: The direction is another, or as `payload_body`.
    """
    if direction not in (0, 1, 2):
        raise InputError(f"direction: choose 0, 1 or 2 for x, y or z, not {direction}")
    payload = payload_body(spec, axis)
    payload.ipos = np.array(payload.ipos) + severity * np.eye(3)[int(direction)]


def add_gravity_spring(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add a spring that pulls the joint to its zero angle.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Stiffness [N m/rad].
    """
    spec.joint(f"joint{axis}").stiffness[0] += severity


def payload_body(spec: mujoco.MjSpec, axis: int) -> mujoco.MjsBody:
    """Return the body ``payload`` of a robot.

    Args:
        spec: The robot.
        axis: The last axis.

    Returns:
        The body.

    Raises:
        InputError: There is no such body, or the axis is not the last one.
    """
    if spec.joint(f"joint{axis + 1}") is not None:
        raise InputError(f"payload effects belong to the last axis, not to axis {axis}")
    payload = spec.body("payload")
    if payload is None:
        raise InputError("payload effects need a body 'payload' in the robot's MJCF")
    return payload


EFFECTS = (
    Effect(
        name="payload_mass",
        description="the payload is heavier; belongs to the last axis. Where the model's payload "
        "has no mass: a point of severity kg at x, y, z [m]",
        unit=FRACTION,
        point_units="kg",
        payload=0.0,
        signature="gravity and inertia on several axes, by the pose",
        element="body payload, mass and inertia",
        prior=Prior(std=0.035, steps=(0.1,)),
        source="definition",
        smallest=-0.9,
        parameters={"x": 0.0, "y": 0.0, "z": 0.0},
        axes=last_axis,
        edit=scale_payload,
    ),
    Effect(
        name="payload_offset",
        description="the payload sits off its place; belongs to the last axis",
        unit="m, along the flange's x, or y or z by direction (0, 1, 2)",
        units="m",
        payload=MASSLESS,
        signature="gravity on the wrist by the tool's orientation",
        element="body payload, inertial pos",
        prior=Prior(std=2e-3, steps=(0.02,), imitated=True),
        source="definition",
        largest=2.0,
        smallest=-2.0,
        axes=last_axis,
        step=0.02,
        parameters={"direction": 0},
        edit=move_payload,
    ),
    Effect(
        name="gravity_spring",
        description="a balancing device pulls the joint to its zero angle",
        unit="N m/rad, joint side",
        units="N m/rad",
        slide_units="N/m",
        signature="torque in proportion to the angle of the joint, at all speeds",
        element="joint{i}, stiffness",
        prior=Prior(std=of_joint_torque(4e-5), steps_in_std=100, imitated=True, own_axis_only=True),
        source="linear spring",
        largest=1e6,
        smallest=-1e6,
        step=2.0,
        edit=add_gravity_spring,
    ),
)
"""Effects of this family."""
