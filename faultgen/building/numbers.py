"""Numbers in the text of a model that no robot has: not a number, infinite, or far too large."""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree import ElementTree

MOST = 1e9
"""Largest number of a model that is believed, in any unit. The largest that a file can need is an
inertia in g mm^2, 1e9 for 1 kg m^2; products of such numbers can still be computed."""

_LIMITS = ("lower", "upper", "range")
"""Attributes that may be infinite or huge, which means that there is no limit."""
_NUMBERS = frozenset(
    "xyz rpy value ixx ixy ixz iyy iyz izz effort velocity damping friction size radius length "
    "scale multiplier offset pos quat euler axis axisangle xyaxes zaxis fromto mass density "
    "diaginertia fullinertia armature frictionloss stiffness ref springref gravity timestep gear "
    "forcerange actuatorfrcrange margin qpos refpos refquat inertiagrouprange boundmass "
    "boundinertia settotalmass".split()
)
"""Attributes that have numbers, in URDF and MJCF."""


def senseless_numbers(root: ElementTree.Element) -> list[str]:
    """List the numbers of a model that no robot has.

    Args:
        root: The model.

    Returns:
        One finding for each attribute with such a number.
    """
    return [
        f'{where}: <{element.tag} {key}="{value[:40]}"> must have numbers up to {MOST:g}'
        for element, where in _placed(root, root.tag)
        for key, value in element.attrib.items()
        if key in _NUMBERS or key in _LIMITS
        if any(_is_senseless(word, key in _LIMITS) for word in value.split())
    ]


def _is_senseless(word: str, endless: bool) -> bool:
    try:
        number = float(word)
    except ValueError:  # MuJoCo says so
        return False
    return math.isnan(number) or (abs(number) > MOST and not endless)


def _placed(element: ElementTree.Element, where: str) -> Iterator[tuple[ElementTree.Element, str]]:
    """All elements, each with the closest link, body or joint in which it stands."""
    stack = [(element, where)]
    while stack:
        one, where = stack.pop()
        if one.tag in ("link", "body", "joint") and one.get("name"):
            where = f"{'link' if one.tag == 'body' else one.tag} '{one.get('name')}'"
        yield one, where
        stack += [(child, where) for child in reversed(one)]
