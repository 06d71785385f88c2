"""A tool that is loose on its flange: the payload slides within a play and hits its ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from faultgen.effects.base import Effect, last_axis
from faultgen.effects.elements import add_tendon
from faultgen.effects.prior import Prior
from faultgen.effects.spreads import SPREADS
from faultgen.effects.structure import MASSLESS, payload_body
from faultgen.errors import InputError

if TYPE_CHECKING:
    from faultgen.robot import Robot

FREQUENCY = 60.0
"""Frequency of the payload on its stops [Hz]: assumed."""

DAMPING = 0.05
"""Share of the critical damping, on the stops and between them: assumed."""


def loosen_payload(spec: mujoco.MjSpec, axis: int, severity: float, *, direction: int) -> None:
    """Let the payload slide by severity / 2 in both directions along an axis of the flange.

    Beyond that, the force of the stops is k (|x| - severity / 2) with k = m (2 pi `FREQUENCY`)^2.
    Everywhere there is damping, `DAMPING` times the critical damping of that spring.

    Args:
        spec: The robot, edited in place.
        axis: The last axis.
        severity: The whole play [m].
        direction: 0, 1 or 2 for x, y or z.
    """
    if direction not in (0, 1, 2):
        raise InputError(f"direction: choose 0, 1 or 2 for x, y or z, not {direction}")
    payload = payload_body(spec, axis)
    if payload.mass < MASSLESS:
        raise InputError("loose_tool: the payload has no mass that could be loose")
    name = f"loose_tool_{'xyz'[int(direction)]}"
    if spec.joint(name) is not None:  # plays in one direction add up
        severity += float(np.ptp(spec.tendon(name).springlength))
    else:
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        payload.add_joint(name=name, type=slide, axis=np.eye(3)[int(direction)])
        add_tendon(spec, name, {name: 1.0})
    stops = spec.tendon(name)
    stops.stiffness[0], stops.damping[0] = stops_of(payload.mass)
    stops.springlength = np.array([-severity / 2, severity / 2])


def stops_of(mass: float) -> tuple[float, float]:
    """Compute stiffness [N/m] and damping [N s/m] of the stops of a payload with a mass [kg]."""
    rate = 2 * math.pi * FREQUENCY
    return mass * rate**2, 2 * DAMPING * mass * rate


def _directions(robot: Robot, axis: int) -> list[dict[str, Any]]:
    return [{"direction": direction} for direction in range(3)]


EFFECTS = (
    Effect(
        name="loose_tool",
        description="the tool changer has play: the payload slides on its flange and strikes; "
        "belongs to the last axis",
        unit="m, the whole play, along the flange's x, or y or z by direction (0, 1, 2)",
        units="m",
        payload=MASSLESS,
        signature="strikes and ringing where the payload's weight and inertia change sign along "
        "the play",
        element="slide loose_tool_x (y, z) of the payload, tendon springlength (dead band)",
        prior=Prior(
            std=SPREADS["loose_tool"].std,
            steps=(1e-4, 5e-4, 2e-3, 8e-3),
            play=True,
            variants=_directions,
        ),
        source="sliding mass between elastic stops; their 60 Hz and 5 % damping are assumed, so "
        "that the smallest play has elastic stops too",
        largest=0.05,
        step=1e-3,
        parameters={"direction": 0},
        axes=last_axis,
        edit=loosen_payload,
        last=True,
    ),
)
"""Effects of this family."""
