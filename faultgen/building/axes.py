"""Which joints of a plain model are the axes of its arm: no gripper, and nothing that only follows.

chosen = choose_axes(spec, None, {})
chosen.names, chosen.notes, chosen.findings
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from faultgen.building.findings import Finding
from faultgen.building.flange import is_flange

HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
FREE, BALL = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL

MOST_LINKS = 200
"""Largest number of links that follow each other; a snake robot has some 30."""

_NAME_THEM = "name the joints that are axes in drives.toml, joints = [...]; the others are locked"
_GRIPPER = re.compile(
    r"finger|gripper|jaw|knuckle|thumb|claw|(?<![a-z])(grip|hand)s?(?![a-z])", re.IGNORECASE
)
"""Names of the joints and links of grippers."""
_ARM = re.compile(r"shoulder|elbow|wrist", re.IGNORECASE)
"""Names of joints that are axes, although the link that they move may be called a gripper."""
_TOLD_CHAINS = 2  # of several equally long ones, those for which a line is written
_SHORT = 0.15  # longest stroke of a finger [m]; those of large parallel grippers have 0.1 m


@dataclass(frozen=True)
class Axes:
    """The joints that are axes."""

    names: tuple[str, ...]
    """Their names, from the base to the tool."""
    findings: tuple[Finding, ...]
    """Why they are no arm; all of these findings are fatal."""
    notes: tuple[str, ...]
    """Which hinges and slides are no axes, and what to do if one is."""


def choose_axes(
    spec: mujoco.MjSpec, chosen: Sequence[str] | None, leaders: Mapping[str, str]
) -> Axes:
    """Find the joints that are axes.

    Args:
        spec: The model, whose joints have names.
        chosen: Names of the joints that the user calls axes, from the base to the tool. None: all
            hinges and slides, except those of a gripper and those that follow another joint.
        leaders: The joints that follow another one, with the one that each follows.

    Returns:
        The axes. If they do not form one chain, the findings say so.
    """
    names = [joint.name for joint in spec.joints]
    if "motor1" in names and any(tendon.name == "gearbox1" for tendon in spec.tendons):
        remedy = "check it with 'faultgen robot check', or give a plain model"
        what = "the model already has rotors and gearboxes"
        return Axes((), (Finding("joint 'motor1'", what, remedy),), ())
    if chosen is not None:
        return _named(spec, chosen, leaders)
    movable = [joint.name for joint in spec.joints if joint.type in (HINGE, SLIDE)]
    own = [name for name in movable if name not in leaders]
    gripper = _of_gripper(spec, own)
    arm = [name for name in own if name not in gripper]
    if not arm:
        arm, gripper = own, []
    within = [
        Finding(
            f"joint '{name}'",
            f"follows joint '{leaders[name]}' (<mimic> or an equality constraint), so it has no "
            f"motor, but it carries the axis '{carried}'",
            "a joint that follows another is not simulated: name the axes in drives.toml, "
            f"joints = [...], without '{name}' to lock it, or with it to give it a motor",
        )
        for name in movable
        if name in leaders
        if (carried := next((one for one in arm if _carries(spec, name, one)), None))
    ]
    findings = [*_wrong_types(spec, None), *within]
    if _breaks(spec, arm):  # then the joints of grippers and those that follow are told too
        ready = _longest_chains(spec, arm)
        arm, gripper = movable, []
        findings += _branches(spec, arm, ready)
    if not arm and not findings:
        what = "no joint of it is a hinge or a slide"
        what = "each of its joints follows another one" if movable else what
        findings = [Finding("model", what, "give a model with hinge or slide joints")]
    notes = []
    if gripper:
        notes.append(
            f"{_joints(gripper)} taken for those of a gripper and locked; if one is an axis, name "
            "all axes in drives.toml, joints = [...]"
        )
    elif len(arm) > 1 and _is_finger(spec, arm[-1]):
        stroke = np.ptp(spec.joint(arm[-1]).range)
        notes.append(
            f"the last axis '{arm[-1]}' slides by {stroke:g} m only; if it is a finger of a "
            "gripper, name the axes without it in drives.toml, joints = [...]"
        )
    followers = [name for name in movable if name in leaders]
    if followers and not within:
        told = ", ".join(f"'{name}' follows '{leaders[name]}'" for name in followers)
        notes.append(
            f"{told} (<mimic> or an equality constraint): locked, because a joint that follows "
            "another has no motor; if it is an axis, name all axes in drives.toml, joints = [...]"
        )
    return Axes(tuple(arm), tuple(findings), tuple(notes))


def above(body: mujoco.MjsBody) -> list[str]:
    """Return the names of a body and of all bodies that carry it.

    Args:
        body: The body.
    """
    names = []
    while body is not None and body.name != "world":
        names.append(body.name)
        body = body.parent
    return names


def deepest(spec: mujoco.MjSpec) -> int:
    """Return the largest number of bodies of a model that carry each other.

    Args:
        spec: The model.
    """
    depth, level = 0, list(spec.worldbody.bodies)
    while level:
        depth, level = depth + 1, [child for body in level for child in body.bodies]
    return depth


def _named(spec: mujoco.MjSpec, chosen: Sequence[str], leaders: Mapping[str, str]) -> Axes:
    """The axes that the user names."""
    names = [joint.name for joint in spec.joints]
    known = [name for name in chosen if name in names]
    axes = [name for name in known if spec.joint(name).type in (HINGE, SLIDE)]
    unknown = [name for name in chosen if name not in names]
    if unknown:
        remedy = f"it has {', '.join(names)}"
        wrong = [Finding(f"joint '{name}'", "is not in the model", remedy) for name in unknown]
        return Axes(tuple(axes), tuple(wrong), ())
    twice = sorted({name for name in chosen if list(chosen).count(name) > 1})
    wrong = [
        Finding(f"joint '{name}'", "is named twice as an axis", "name it once in drives.toml")
        for name in twice
    ]
    notes = [
        f"joint '{name}' follows '{leaders[name]}' in the file, but drives.toml names it as an "
        "axis, so it gets a motor of its own"
        for name in axes
        if name in leaders
    ]
    findings = [*wrong, *_wrong_types(spec, chosen), *([] if twice else _breaks(spec, axes))]
    return Axes(tuple(axes), tuple(findings), tuple(notes))


def _wrong_types(spec: mujoco.MjSpec, chosen: Sequence[str] | None) -> list[Finding]:
    """Joints that cannot be axes, although they are named or no joint is named."""
    wrong = [
        joint
        for joint in spec.joints
        if (joint.type == BALL and chosen is None)
        or (joint.type in (BALL, FREE) and chosen is not None and joint.name in chosen)
    ]
    return [
        Finding(
            f"joint '{joint.name}'",
            f"is a {'ball' if joint.type == BALL else 'free'} joint, but axes are hinges or slides",
            _NAME_THEM,
        )
        for joint in wrong
    ]


def _breaks(spec: mujoco.MjSpec, names: Sequence[str]) -> list[Finding]:
    """Where the second one of two neighbouring axes is not carried by the first one."""
    pairs = _gaps(spec, names)
    if not pairs:
        return []
    what = "do not follow each other in one chain: the model branches or has two arms"
    more = f" (and {len(pairs) - 1} other neighbours)" if len(pairs) > 1 else ""
    return [Finding("joints '{}' and '{}'".format(*pairs[0]), what + more, _NAME_THEM)]


def _branches(
    spec: mujoco.MjSpec, names: Sequence[str], chains: Sequence[Sequence[str]]
) -> list[Finding]:
    """That a model branches, with a ready line for its longest chain, or for some of them."""
    ready = " or ".join(_line(chain) for chain in chains[:_TOLD_CHAINS])
    which = "the longest chain is" if len(chains) == 1 else f"{len(chains)} chains are equally long"
    remedy = f"{_NAME_THEM}; {which}: {ready}"
    return [Finding(one.where, one.what, remedy) for one in _breaks(spec, names)]


def _longest_chains(spec: mujoco.MjSpec, names: Sequence[str]) -> list[list[str]]:
    """The longest chains of axes that carry each other, from the base to the tool."""
    chains: dict[str, list[str]] = {}
    for name in names:  # each stands behind those that carry it
        carrying = [other for other in chains if _carries(spec, other, name)]
        before = max((chains[other] for other in carrying), key=len, default=[])
        chains[name] = [*before, name]
    most = max(map(len, chains.values()))
    return [chain for chain in chains.values() if len(chain) == most]


def _line(names: Sequence[str]) -> str:
    return "joints = [" + ", ".join(f'"{name}"' for name in names) + "]"


def _gaps(spec: mujoco.MjSpec, names: Sequence[str]) -> list[tuple[str, str]]:
    """Neighbouring axes of which the second is not carried by the first."""
    return [
        (first, second)
        for first, second in zip(names, names[1:], strict=False)
        if spec.joint(first).parent.name not in above(spec.joint(second).parent)
    ]


def _carries(spec: mujoco.MjSpec, name: str, other: str) -> bool:
    """Whether one joint moves the body of another one."""
    one, two = spec.joint(name).parent, spec.joint(other).parent
    return one.name in above(two) and (one.name != two.name or name != other)


def _of_gripper(spec: mujoco.MjSpec, names: Sequence[str]) -> list[str]:
    """Joints at the end of the arm that look like those of a gripper."""
    bodies = {name: spec.joint(name).parent for name in names}
    likely = {name for name in names if _looks_so(spec, name, bodies)}
    return [name for name in names if name in likely and _last(spec, name, names, likely)]


def _looks_so(spec: mujoco.MjSpec, name: str, bodies: dict[str, mujoco.MjsBody]) -> bool:
    body = bodies[name]
    if _GRIPPER.search(name) or (_GRIPPER.search(body.name) and not _ARM.search(name)):
        return True
    if any(is_flange(one) for one in above(body)[1:]):
        return True
    beside = [
        other
        for other, its in bodies.items()
        if its.parent.name == body.parent.name and its.name != body.name
    ]
    return any(_is_finger(spec, one) for one in beside) and _is_finger(spec, name)


def _is_finger(spec: mujoco.MjSpec, name: str) -> bool:
    """Whether a joint is a slide with a short stroke."""
    joint = spec.joint(name)
    return bool(joint.type == SLIDE and 0 < np.ptp(joint.range) <= _SHORT)


def _last(spec: mujoco.MjSpec, name: str, names: Sequence[str], likely: Collection[str]) -> bool:
    """Whether a joint carries none that does not look like one of a gripper."""
    return all(other in likely for other in names if _carries(spec, name, other))


def _joints(names: Sequence[str]) -> str:
    told = ", ".join(f"'{name}'" for name in names)
    return f"joints {told} are" if len(names) > 1 else f"joint {told} is"
