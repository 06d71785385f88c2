"""Edits of what the links of an arm carry, and of the spring that balances gravity.

The last link carries the payload, the body ``payload`` of the model, if that has a mass. Everywhere
else an added mass is a small ball. Its place is counted from the far end of the link, see
`far_end`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.effects.base import FRACTION, Effect, last_axis
from faultgen.effects.base import MASSLESS as MASSLESS
from faultgen.effects.base import is_loaded as is_loaded
from faultgen.effects.prior import Prior, of_joint_torque
from faultgen.effects.spreads import SPREADS
from faultgen.errors import InputError
from faultgen.mjcf.edit import add_point
from faultgen.mjcf.warnings import mujoco_warnings

_POINT = 0.01  # radius of gyration of a point [m]: assumed
_HEAVIEST = 3000.0  # point on a link [kg]: the strongest arms carry 2300 kg (FANUC M-2000iA/2300)


def scale_payload(
    spec: mujoco.MjSpec, axis: int, severity: float, *, x: float, y: float, z: float
) -> None:
    """Multiply mass and inertia of the payload by 1 + severity, or add a point mass to a link.

    A point is added on every link that carries no payload with a mass. It is fixed to the link,
    which changes mass m, centre c and inertia of the link: m c becomes m c + severity p for a point
    at p, and the inertia grows by the rule of parallel axes.

    Args:
        spec: The robot, edited in place.
        axis: Number of the joint that carries the link.
        severity: Fraction, or mass of the point [kg] if the link has no payload of at least
            `MASSLESS`.
        x: Position of that point from the far end of the link, along the link's own axes [m]. Where
            the payload only marks a place: in the frame of the payload.
        y: The same for y [m].
        z: The same for z [m].

    Raises:
        InputError: The severity is negative where there is no payload.
    """
    payload = _payload_on(spec, axis)
    if payload is not None and payload.mass >= MASSLESS:
        payload.mass *= 1 + severity
        payload.inertia *= 1 + severity
        return
    if severity < 0:
        raise InputError(f"payload_mass: link {axis} carries no payload whose mass could be less")
    place = np.array([x, y, z])
    if payload is None:
        link = spec.joint(f"joint{axis}").parent
        add_point(link, severity, far_end(spec, axis) + place, _POINT)
        return
    payload.mass = 0.0  # what is below `MASSLESS` counts as none
    add_point(payload, severity, place, _POINT)


def move_payload(spec: mujoco.MjSpec, axis: int, severity: float, *, direction: int) -> None:
    """Move the centre of mass of what a link carries.

    It is the centre of the payload, along an axis of the flange. On a link that carries no payload
    with a mass, it is the centre of the link itself, along an axis of the link's frame.

    Args:
        spec: The robot, edited in place.
        axis: Number of the joint that carries the link.
        severity: Distance [m].
        direction: 0, 1 or 2 for x, y or z.

    Raises:
        InputError: The direction is another, or the link has no mass.
    """
    if direction not in (0, 1, 2):
        raise InputError(f"direction: choose 0, 1 or 2 for x, y or z, not {direction}")
    body = _payload_on(spec, axis)
    if body is None or body.mass < MASSLESS:
        body = spec.joint(f"joint{axis}").parent
    if not body.mass >= MASSLESS:
        raise InputError(f"payload_offset: link {axis} has no mass that could be moved")
    body.ipos = np.array(body.ipos) + severity * np.eye(3)[int(direction)]


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
    payload = _payload_on(spec, axis)
    if payload is None:
        raise InputError(
            f"link {axis} carries no body 'payload' of the robot's MJCF; the last link can have one"
        )
    return payload


def _payload_on(spec: mujoco.MjSpec, axis: int) -> mujoco.MjsBody | None:
    """The body ``payload`` if a link carries it: the last one, if the robot has one."""
    return spec.body("payload") if spec.joint(f"joint{axis + 1}") is None else None


def far_end(spec: mujoco.MjSpec, axis: int) -> np.ndarray:
    """Return the place on a link from which the places of added masses are counted.

    It is that of the next joint. On the last link it is the site ``tool``, or, if it has none, the
    link's centre of mass.

    Args:
        spec: The robot, with diagonal inertias.
        axis: Number of the joint that carries the link.

    Returns:
        Position in the frame of the link [m], shape (3,).
    """
    copy = spec.copy()
    with mujoco_warnings():
        model = copy.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    link = int(model.joint(f"joint{axis}").bodyid[0])
    following = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"joint{axis + 1}")
    tool = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tool")
    if following >= 0:
        end = data.xanchor[following]
    elif tool >= 0 and model.body_weldid[model.site_bodyid[tool]] == link:
        end = data.site_xpos[tool]
    else:
        return np.array(model.body_ipos[link])
    return data.xmat[link].reshape(3, 3).T @ (end - data.xpos[link])


EFFECTS = (
    Effect(
        name="payload_mass",
        description="the payload is heavier, a fraction of its mass; by default on the last axis. "
        "On a link without payload, such as that of any other axis: a small ball of severity kg "
        "(up to 3000) at x, y, z [m], counted along the link's axes from the next joint. On the "
        "last link they are counted from the site tool, or from its centre of mass if it has none, "
        "and in the frame of the body payload if that has no mass",
        unit=FRACTION,
        point_units="kg",
        point_largest=_HEAVIEST,
        signature="gravity and inertia on several axes, by the pose",
        element="body payload, or the body of joint{i}: mass, inertia and centre of mass",
        prior=Prior(std=SPREADS["payload_mass"].std, steps=(0.1,)),
        source="definition",
        smallest=-0.9,
        parameters={"x": 0.0, "y": 0.0, "z": 0.0},
        usual_axes=last_axis,
        edit=scale_payload,
    ),
    Effect(
        name="payload_offset",
        description="the payload sits off its place; by default on the last axis. On a "
        "link without payload, such as that of any other axis: the centre of mass of the link "
        "itself, along the link's own axes",
        unit="m, along x of the flange or the link, or y or z by direction (0, 1, 2)",
        units="m",
        signature="gravity on the wrist by the tool's orientation",
        element="body payload, or the body of joint{i}: inertial pos",
        prior=Prior(std=SPREADS["payload_offset"].std, steps=(0.02,)),
        source="definition",
        largest=2.0,
        smallest=-2.0,
        usual_axes=last_axis,
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
        prior=Prior(
            std=of_joint_torque(SPREADS["gravity_spring"].std),
            steps_in_std=1000,
            own_axis_only=True,
        ),
        source="linear spring",
        largest=1e6,
        smallest=-1e6,
        step=2.0,
        edit=add_gravity_spring,
    ),
)
"""Effects of this family."""
