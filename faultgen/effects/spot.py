"""Friction that is larger around one angle of the joint, which no element of MuJoCo has.

A separate friction element represents it. Its friction torque is set between steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.elements import ToldFriction, add_told_friction, numbered
from faultgen.effects.hooks import Moment, Place, Update
from faultgen.effects.prior import Prior, Search, Seen
from faultgen.errors import InputError
from faultgen.mjcf.dcmotor import COULOMB


def bump(angle: np.ndarray, centre: float | np.ndarray, width: float | np.ndarray) -> np.ndarray:
    """Compute a raised cosine, once per turn: (1 + cos(2 pi x / width)) / 2, x from the centre.

    Args:
        angle: Any shape, in [rad].
        centre: Angle at which it is 1 [rad].
        width: It is 0 beyond half this angle on either side [rad].

    Returns:
        Same shape as the angle, without unit, from 0 to 1.
    """
    away = np.angle(np.exp(1j * (np.asarray(angle) - centre)))
    inside = np.abs(away) < width / 2
    return np.where(inside, (1 + np.cos(2 * np.pi * away / width)) / 2, 0.0)


def add_spot(
    spec: mujoco.MjSpec, axis: int, severity: float, *, angle: float, width: float
) -> None:
    """Add the element ``seizing_spot{axis}``. It has no friction until it is set between steps.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Not used here.
        angle: Not used here.
        width: Width of the spot [rad].

    Raises:
        InputError: The width is not within a turn.
    """
    if not 0 < width <= 2 * np.pi:
        raise InputError(f"width: must be above 0 and at most a turn, not {width}")
    add_told_friction(spec, f"seizing_spot{axis}", axis)


def follow_angle(places: Sequence[Place]) -> Update:
    """Make Coulomb friction severity times that of the axis times `bump` of the joint's angle.

    The angle is predicted for the middle of the time until the next update, from the present speed.
    """
    robot, model = places[0].robot, places[0].model
    axes = [place.axis for place in places]
    names = [
        numbered(f"seizing_spot{axis}", axes[: k + 1].count(axis)) for k, axis in enumerate(axes)
    ]
    friction = ToldFriction(robot, model, names, axes)
    joints = robot.addresses(model)[1][np.array(axes) - 1]
    centre, width = (
        np.array([place.parameters[name] for place in places]) for name in ("angle", "width")
    )
    height = np.array([place.severity for place in places]) * friction.coulomb

    def update(moment: Moment) -> None:
        middle = moment.qpos[:, joints] + moment.qvel[:, joints] * (moment.interval / 2)
        friction.tell(moment, height * bump(middle, centre, width))

    return update


def _push(seen: Seen, parameters: Mapping[str, Any]) -> np.ndarray:
    """Torque on the rotor where the spot has the whole Coulomb friction of the axis."""
    element = seen.robot.ids("actuator", "friction")[seen.axis - 1]
    coulomb = float(seen.robot.model.actuator_biasprm[element, COULOMB])
    spot = bump(seen.joint, parameters["angle"], parameters["width"])
    return -np.sign(seen.velocity) * coulomb * spot


EFFECTS = (
    Effect(
        name="seizing_spot",
        description="a damaged spot of a bearing or gear rubs where the joint passes it",
        unit="fraction of Coulomb friction, at the centre of the spot",
        signature="more torque against the motion about one angle of the joint",
        element="seizing_spot{i}, passive dcmotor lugre, told the joint's angle between steps",
        prior=Prior(
            use="searched",
            search=tuple(
                Search(
                    parameter="angle",
                    spacing=width / 6,
                    within_motion=True,
                    others={"width": width},
                    cause=_push,
                )
                for width in (0.1, 0.14, 0.2, 0.28, 0.4)
            ),
        ),
        source="position-dependent Coulomb friction; its form, a raised cosine "
        "(1 + cos(2 pi (q - angle) / width)) / 2, is assumed; angle and width in rad",
        step=0.3,
        parameters={"angle": 0.0, "width": 0.2},
        edit=add_spot,
        between=follow_angle,
    ),
)
"""Effects of this family."""
