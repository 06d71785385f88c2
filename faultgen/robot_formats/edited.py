"""The user's own MJCF or URDF file with the numbers of the robot: only what differs is changed.

text = edited_urdf(text, robot_spec, rows, locked)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from faultgen.errors import InputError
from faultgen.mjcf.compiling import asset_names, compiled, compiled_anyway, parsed
from faultgen.mjcf.parsing import parse_xml
from faultgen.mjcf.rotations import matrix_of
from faultgen.robot_formats.joints import JointNumbers
from faultgen.robot_formats.lumps import (
    PAYLOAD,
    differ,
    is_possible,
    lumps,
    own_bodies,
    pseudo_inertia,
    rest_pose,
    rigid_body,
)
from faultgen.robot_formats.urdf import add_origin, numbers, set_inertial

_SAME = 1e-9  # relative difference of numbers that are not changed


class Edited(NamedTuple):
    """An edited file."""

    text: str
    """Its text."""
    model: mujoco.MjModel
    """The compiled text, without the meshes of a URDF."""
    changed: int
    """How many joints, links and actuators were changed."""


def edited_urdf(text: str, plain: mujoco.MjModel, rows: Sequence[JointNumbers]) -> Edited:
    """Write the numbers of a robot into the user's URDF.

    Args:
        text: Text of the URDF.
        plain: The plain arm, compiled from `plain_spec`.
        rows: The numbers of its axes.

    Returns:
        The edited file. Comments and everything that the robot does not know stay.

    Raises:
        InputError: The file does not fit to the robot.
    """
    root = parse_xml(text, "the URDF", comments=True)
    joints = {one.get("name", ""): one for one in root.findall("joint")}
    links = {one.get("name", ""): one for one in root.findall("link")}
    _need([row.joint for row in rows], joints)
    before = without_shapes(root, anyway=True)
    own = {name: _stated_body(link) for name, link in links.items()}
    changed = 0
    for name, matrix in _changes(plain, before, rows, own).items():
        set_inertial(links[name], *rigid_body(matrix))
        changed += 1
    for row in rows:
        changed += _set_urdf_joint(joints[row.joint], row)
    payload = mujoco.mj_name2id(plain, mujoco.mjtObj.mjOBJ_BODY, PAYLOAD)
    if payload >= 0 and plain.body_mass[payload] > 0:
        changed += _urdf_payload(root, links, own, plain, payload)
    ElementTree.indent(root) if "\n" not in text.strip() else None
    return Edited(_text(root), without_shapes(root), changed)


def _set_urdf_joint(joint: Element, row: JointNumbers) -> int:
    """Set limits and friction of a joint; 1 if something was changed."""
    wanted: dict[str, dict[str, float]] = {"limit": {}, "dynamics": {}}
    if joint.get("type") != "continuous":
        wanted["limit"] = {"lower": row.lower, "upper": row.upper}
    wanted["limit"] |= {"effort": row.effort_limit, "velocity": row.velocity_limit}
    wanted["dynamics"] = {"damping": row.damping, "friction": row.frictionloss}
    changed = False
    for tag, values in wanted.items():
        element = joint.find(tag)
        if element is None:
            element = SubElement(joint, tag)
        changed |= any([_set(element, key, value) for key, value in values.items()])
    return int(changed)


def _urdf_payload(
    root: Element,
    links: Mapping[str, Element],
    own: Mapping[str, np.ndarray],
    plain: mujoco.MjModel,
    payload: int,
) -> int:
    target = own_bodies(plain)[PAYLOAD]
    if PAYLOAD in links:
        if not differ(target, own[PAYLOAD]):
            return 0
        set_inertial(links[PAYLOAD], *rigid_body(target))
        return 1
    parent = plain.body(int(plain.body_parentid[payload])).name
    _need([parent], links)
    set_inertial(SubElement(root, "link", {"name": PAYLOAD}), *rigid_body(target))
    joint = SubElement(root, "joint", {"name": f"{PAYLOAD}_fixed", "type": "fixed"})
    SubElement(joint, "parent", {"link": parent})
    SubElement(joint, "child", {"link": PAYLOAD})
    add_origin(joint, plain.body_pos[payload], matrix_of(plain.body_quat[payload]))
    return 1


def edited_mjcf(
    text: str, assets: Mapping[str, bytes], plain: mujoco.MjModel, rows: Sequence[JointNumbers]
) -> tuple[Edited, list[str]]:
    """Write the numbers of a robot into the user's MJCF file.

    Args:
        text: Text of the file, in which included files are in their place.
        assets: Content of its files by name; some may be missing.
        plain: The plain arm, compiled from `plain_spec`.
        rows: The numbers of its axes.

    Returns:
        The edited file, and what could not be written.

    Raises:
        InputError: The file does not fit to the robot.
    """
    root = parse_xml(text, "the MJCF file", comments=True)
    bodies = {one.get("name"): one for one in root.iter("body")}
    holder = {
        joint.get("name"): body for body in root.iter("body") for joint in body.findall("joint")
    }
    _need([row.joint for row in rows], holder)
    files = _files(root, assets)
    before = _compiled(text, files)
    own = own_bodies(before)
    changed, notes = 0, []
    for name, matrix in _changes(plain, before, rows, own).items():
        _need([name], bodies)
        _set_mjcf_inertial(bodies[name], matrix)
        changed += 1
    radians = any(one.get("angle") == "radian" for one in root.findall("compiler"))
    for row in rows:
        joint = next(
            one for one in holder[row.joint].findall("joint") if one.get("name") == row.joint
        )
        changed += _set_mjcf_joint(joint, before, row, radians)
    payload = mujoco.mj_name2id(plain, mujoco.mjtObj.mjOBJ_BODY, PAYLOAD)
    if payload >= 0 and plain.body_mass[payload] > 0:
        target = own_bodies(plain)[PAYLOAD]
        if PAYLOAD not in bodies:
            parent = plain.body(int(plain.body_parentid[payload])).name
            _need([parent], bodies)
            body = SubElement(bodies[parent], "body", {"name": PAYLOAD})
            body.set("pos", numbers(plain.body_pos[payload]))
            body.set("quat", numbers(plain.body_quat[payload]))
            _set_mjcf_inertial(body, target)
            changed += 1
        elif differ(target, own[PAYLOAD]):
            _set_mjcf_inertial(bodies[PAYLOAD], target)
            changed += 1
    count, kept = _set_actuators(root, rows)
    if kept:
        notes.append(
            f"the actuators of {', '.join(kept)} in your file stay as they are, because they are "
            "no position actuators"
        )
    result = _text(root)
    return Edited(result, _compiled(result, files), changed + count), notes


def _set_mjcf_joint(
    joint: Element, before: mujoco.MjModel, row: JointNumbers, radians: bool
) -> int:
    """Set what differs from the compiled model `before`; 1 if something was changed."""
    index = before.joint(row.joint).id
    dof = before.jnt_dofadr[index]
    unit = 1.0 if radians or row.kind == "slide" else 180 / np.pi
    effort = np.array([-row.effort_limit, row.effort_limit])
    pairs = {
        "armature": ([row.armature], before.dof_armature[dof]),
        "damping": ([row.damping], before.dof_damping[dof]),
        "frictionloss": ([row.frictionloss], before.dof_frictionloss[dof]),
        "actuatorfrcrange": (effort, before.jnt_actfrcrange[index]),
        "range": (np.array([row.lower, row.upper]), before.jnt_range[index]),
    }
    changed = False
    for key, (wanted, there) in pairs.items():
        wanted = np.asarray(wanted, float)
        if not np.isfinite(wanted).all() or np.allclose(wanted, there, rtol=_SAME, atol=1e-15):
            continue
        joint.set(key, numbers(wanted * unit if key == "range" else wanted))
        if key in ("range", "actuatorfrcrange"):
            joint.set("limited" if key == "range" else "actuatorfrclimited", "true")
        changed = True
    return int(changed)


def _set_mjcf_inertial(body: Element, matrix: np.ndarray) -> None:
    for old in body.findall("inertial"):
        body.remove(old)
    mass, centre, inertia = rigid_body(matrix)
    full = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    where = {"pos": numbers(centre), "mass": repr(mass), "fullinertia": numbers(full)}
    body.insert(0, Element("inertial", where))


def _set_actuators(root: Element, rows: Sequence[JointNumbers]) -> tuple[int, list[str]]:
    """Set the gains of position actuators, and add those that are missing."""
    there = [one for group in root.findall("actuator") for one in group]
    has_control = any(one.get("ctrl") for one in root.findall("keyframe/key"))
    changed, kept = 0, []
    for row in rows:
        own = [one for one in there if one.get("joint") == row.joint]
        if not own and not has_control:
            group = root.find("actuator")
            group = SubElement(root, "actuator") if group is None else group
            own = [SubElement(group, "position", {"name": row.joint, "joint": row.joint})]
        for one in own:
            if one.tag != "position":
                kept.append(f"'{row.joint}'")
                continue
            one.attrib.pop("dampratio", None)
            edits = [_set(one, "kp", row.kp), _set(one, "kv", row.kd)]
            if np.isfinite(row.effort_limit):
                one.set("forcerange", numbers([-row.effort_limit, row.effort_limit]))
            changed += any(edits)
    return changed, kept


def _changes(
    plain: mujoco.MjModel,
    before: mujoco.MjModel,
    rows: Sequence[JointNumbers],
    own: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Return the new own bodies of the links that are others in the robot than in the file."""
    names = [row.joint for row in rows]
    targets = lumps(plain, names, own_bodies(plain))
    pose = rest_pose(before)
    found = {}
    for name, target, now in zip(names, targets, lumps(before, names, own, pose), strict=True):
        if not differ(target, now):
            continue
        body = before.body(int(before.joint(name).bodyid[0])).name
        new = own[body] + target - now
        if not is_possible(new):
            raise InputError(
                f"the masses that are fixed to link '{body}' are heavier than all that the robot "
                "has there"
            )
        found[body] = new
    return found


def _stated_body(link: Element) -> np.ndarray:
    """What a link of a URDF states about itself, in its own frame; zero if it states no mass."""
    mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or inertia is None:
        return np.zeros((4, 4))
    origin = link.find("inertial/origin")
    place, turn = np.zeros(3), np.eye(3)
    if origin is not None:
        place = np.array(origin.get("xyz", "0 0 0").split(), float)
        rpy = np.array(origin.get("rpy", "0 0 0").split(), float)
        turn = Rotation.from_euler("xyz", rpy).as_matrix()
    value = {k: float(inertia.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    matrix = np.array(
        [
            [value["ixx"], value["ixy"], value["ixz"]],
            [value["ixy"], value["iyy"], value["iyz"]],
            [value["ixz"], value["iyz"], value["izz"]],
        ]
    )
    return pseudo_inertia(float(mass.get("value", "0")), place, turn @ matrix @ turn.T)


def without_shapes(root: Element, *, anyway: bool = False) -> mujoco.MjModel:
    """Compile a URDF without its shapes, which masses and joints do not need.

    Args:
        root: The URDF.
        anyway: Whether impossible inertias are replaced.

    Returns:
        The compiled model.
    """
    copy = parse_xml(_text(root), "the URDF")
    for link in copy.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for old in copy.findall("mujoco"):
        copy.remove(old)
    SubElement(SubElement(copy, "mujoco"), "compiler", {"fusestatic": "false"})
    spec, _ = parsed(_text(copy), {}, "the URDF")
    return compiled_anyway(spec, "the URDF") if anyway else spec.compile()


def _compiled(text: str, files: Mapping[str, bytes]) -> mujoco.MjModel:
    spec, _ = parsed(text, files, "the MJCF file")
    return compiled(spec, "the MJCF file")


def _files(root: Element, assets: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of an MJCF file by the path that MuJoCo asks for, found by their names."""
    by_name = {name.rpartition("/")[2]: content for name, content in assets.items()}
    wanted = asset_names(root)
    return {name: by_name[base] for name in wanted if (base := name.rpartition("/")[2]) in by_name}


def _set(element: Element, key: str, value: float) -> bool:
    """Set a number, unless it is there already; True if it was set."""
    if not np.isfinite(value):
        return False
    try:
        if abs(float(element.get(key, "nan")) - value) <= _SAME * abs(value):
            return False
    except ValueError:
        pass
    element.set(key, repr(float(value)))
    return True


def _need(
    names: Sequence[str], there: Mapping[str | None, Element] | Mapping[str, Element]
) -> None:
    missing = [name for name in names if name not in there]
    if missing:
        raise InputError(f"it has no '{missing[0]}'")


def _text(root: Element) -> str:
    return ElementTree.tostring(root, encoding="unicode") + "\n"
