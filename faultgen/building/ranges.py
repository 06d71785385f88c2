"""Ranges of joints that nobody states: what is assumed, and how the user learns of it.

Exporters of CAD programs write lower = upper = 0 where nobody filled in the limits. A robot that is
built from such a file gets a range, and the model keeps in a ``text`` element which ones these are.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import mujoco
import numpy as np

from faultgen.building.axes import SLIDE
from faultgen.mjcf.elements import text_of

ASSUMED_RANGES = "assumed_ranges"
"""Name of the ``text`` element with the numbers of the axes whose range was assumed."""

HALF_TURN, HALF_STROKE = np.pi, 1.0
"""How far a joint without a range moves to both sides, a hinge [rad] and a slide [m]. Assumed."""

ENDLESS = 1e6
"""A limit from which on a joint counts as unlimited [rad or m]: exporters write 1e16."""


def half_ranges(slides: np.ndarray) -> np.ndarray:
    """Return how far joints without a range are assumed to move to both sides.

    Args:
        slides: Whether a joint slides, shape (n_axes,).

    Returns:
        Shape (n_axes,), in [rad] or [m].
    """
    return np.where(slides, HALF_STROKE, HALF_TURN)


def assume_ranges(
    spec: mujoco.MjSpec, names: Sequence[str], unstated: Collection[str]
) -> tuple[list[int], list[str]]:
    """Give a range to the axes of an arm that have none, in place.

    A hinge of an MJCF file without a range turns without end, as does a continuous joint of a URDF.
    A slide cannot move without end.

    Args:
        spec: The model, whose axes have the names that they have in the file.
        names: Names of the axes, from the base to the tool.
        unstated: Names of the joints whose limits in the file are no range.

    Returns:
        The axes that have got a range, from 1; and notes on the others without a range.
    """
    assumed, endless = [], []
    for axis, name in enumerate(names, start=1):
        joint = spec.joint(name)
        low, high = joint.range
        limited = joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
            joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and low < high
        )
        if limited and name not in unstated and max(abs(low), abs(high)) < ENDLESS:
            continue
        slides = joint.type == SLIDE
        if slides or name in unstated or limited:
            half = float(half_ranges(np.array(slides)))
            in_degrees = spec.compiler.degree and not slides
            joint.range = np.array([-half, half]) * (180 / np.pi if in_degrees else 1.0)
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            assumed.append(axis)
        else:
            endless.append(f"'{name}'")
    if not endless:
        return assumed, []
    many = len(endless) > 1
    return assumed, [
        f"joint{'s' if many else ''} {', '.join(endless)} {'have' if many else 'has'} no range in "
        "the file and can turn without end; the tasks stay within half a turn of home"
    ]


def range_warnings(
    names: Sequence[str], axes: Sequence[int], ranges: np.ndarray, slides: Sequence[bool]
) -> list[str]:
    """Write in one line for each axis whose range was assumed which one it is.

    Args:
        names: Names of all axes in the file, from the base to the tool.
        axes: Axes whose range was assumed, from 1.
        ranges: Lower and upper joint position, shape (n_axes, 2), in [rad] or [m].
        slides: Whether each axis slides.
    """
    lines = []
    for axis in axes:
        low, high = ranges[axis - 1] if slides[axis - 1] else np.degrees(ranges[axis - 1])
        lines.append(
            f"joint '{names[axis - 1]}' states no range; assumed {low:g} to {high:g} "
            f"{'m' if slides[axis - 1] else 'deg'}, state it in the URDF or MJCF file"
        )
    return lines


def mark_assumed(spec: mujoco.MjSpec, axes: Sequence[int]) -> None:
    """Let a model say which axes have an assumed range, in place.

    Args:
        spec: The model.
        axes: Axes, from 1.
    """
    if axes:
        spec.add_text(name=ASSUMED_RANGES, data=" ".join(map(str, axes)))


def assumed_axes(model: mujoco.MjModel, n_axes: int) -> list[int]:
    """Return the axes of a robot whose range was assumed when it was built, from 1.

    Args:
        model: Its compiled model.
        n_axes: Number of axes.
    """
    words = text_of(model, ASSUMED_RANGES).split()
    return [int(word) for word in words if word.isdecimal() and 1 <= int(word) <= n_axes]
