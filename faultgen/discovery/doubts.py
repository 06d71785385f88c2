"""What a user should know about a discovery besides its answer."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.discover import Discovery
from faultgen.discovery.fit.problem import Problem
from faultgen.effects import get_effect
from faultgen.effects.friction import SPEED_FRICTION

_MANY = 3  # axes whose friction hardly wears at the same time: assumed
_FEWEST_AXES = 4  # that together show how much friction differs from day to day: assumed


def noise_warnings(problem: Problem) -> list[str]:
    """Warn of noise that the recording and its baseline share.

    Args:
        problem: The recordings that were compared.

    Returns:
        One line, or none.
    """
    if not problem.shared.any():
        return []
    axes = ", ".join(str(axis + 1) for axis in np.flatnonzero(problem.shared))
    return [
        f"axis {axes}: the recording and its baseline differ by far less than the noise in "
        "each, as runs of one dataset with paired = true do; they are compared as if each had "
        "noise of its own, and runs with paired = false are the better test"
    ]


def friction_warnings(found: Discovery) -> list[str]:
    """Warn of what a single healthy recording cannot show.

    Args:
        found: The results of a discovery.

    Returns:
        One line for each warning; none without a baseline, or if several runs were compared.
    """
    difference = found.choice_.difference
    if not found.problem_.baseline or found.runs_ is not None:
        return []
    several = "give several healthy recordings, which show how much it differs on this robot"
    friction = [
        number for number, kind in enumerate(difference.numbers.kinds) if kind == "friction"
    ]
    scale = found.prior_scales_.get("friction", 0.0)
    day = scale * max((difference.numbers.std[k] for k in friction), default=0.0)
    moving = int(found.problem_.inside.any(axis=0).sum())
    if moving < _FEWEST_AXES:
        return [
            f"one healthy recording with {moving} moving axes does not show how much friction "
            f"differs from day to day; {100 * day:.2g} % is taken, so that a smaller change of "
            f"friction cannot be told from another day; {several}"
        ]
    named = [
        one for one in found.answer_.effects if get_effect(one.effect).prior.group == SPEED_FRICTION
    ]
    axes = sorted({one.axis for one in named})
    if len(axes) < _MANY:
        return []
    shown = ", ".join(str(axis) for axis in axes)
    return [
        f"axes {shown}: friction differs on all of them at once, as between two temperatures; "
        f"{several}"
    ]
