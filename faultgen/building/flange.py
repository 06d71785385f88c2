"""The flange of an arm: where its payload is attached."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from faultgen.errors import InputError

_USUAL = re.compile(
    r"tool|tool0|flange|attachment(_site)?|ee|eef|tcp|end_?effector(_link)?|ee_?(link|site)?|"
    r"tool_?(frame|link|site)|link_?ee|gripper(_site)?|pinch",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Flange:
    """A frame on the last link."""

    name: str
    """Name of the body or site that it is."""
    body: str
    """Name of the body that carries it."""
    pos: tuple[float, ...]
    """Position in the frame of the body [m]."""
    quat: tuple[float, ...]
    """Orientation in the frame of the body, w x y z."""
    why: str
    """How it was found."""
    passed_over: tuple[str, ...] = ()
    """Names of other sites on the last link, if the user named no flange."""


def find_flange(spec: mujoco.MjSpec, last: str, wanted: str | None) -> Flange:
    """Find the flange of an arm.

    Args:
        spec: The model.
        last: Name of the last axis.
        wanted: Name of the body or site that is the flange. None: a body or site on the last link
            with a usual name, such as tool0, or else the outermost body that is fixed to it.

    Returns:
        The flange.

    Raises:
        InputError: There is no such body or site on the last link.
    """
    link = spec.joint(last).parent
    bodies = _fixed_to(link)
    sites = [site for body in bodies for site in body.sites]
    if wanted is not None:
        named = [one for one in (*sites, *bodies) if one.name == wanted]
        if not named:
            known = ", ".join(one.name for one in (*sites, *bodies) if one.name)
            raise InputError(
                f"drives: tool: the last link has no body or site '{wanted}'; it has {known}"
            )
        return _frame(named[0], "given")
    named = [one for one in (*sites, *bodies[1:]) if is_flange(one.name)]
    if named:
        found = _frame(named[-1], f"assumed: '{named[-1].name}' has the name of a flange")
    else:
        found = _frame(bodies[-1], "assumed: the outermost body of the last link")
    others = tuple(site.name for site in sites if site.name and site.name != found.name)
    return replace(found, passed_over=others)


def is_flange(name: str) -> bool:
    """Tell whether a body or site has a usual name of a flange, such as tool0.

    Args:
        name: Its name.
    """
    return bool(_USUAL.fullmatch(name))


def _frame(one: mujoco.MjsBody | mujoco.MjsSite, why: str) -> Flange:
    if isinstance(one, mujoco.MjsSite):
        pos, quat = np.array(one.pos), np.array(one.quat)
        return Flange(one.name, one.parent.name, tuple(pos.tolist()), tuple(quat.tolist()), why)
    return Flange(one.name, one.name, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), why)


def _fixed_to(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """A body and all bodies that are fixed to it, the outermost last."""
    fixed = [child for child in body.bodies if not len(child.joints)]
    return [body, *(one for child in fixed for one in _fixed_to(child))]
