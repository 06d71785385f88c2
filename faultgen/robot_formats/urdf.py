"""A plain arm as URDF.

text = urdf_text(model, rows, "my_arm", assets)
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from faultgen.errors import InputError
from faultgen.mjcf.rotations import matrix_of
from faultgen.robot_formats.joints import JointNumbers

_ENDLESS = 1e3  # range that is written for a slide without limits [m]
_ROUNDED = 1e-14  # numbers below are rounding of angles and are written as 0

_SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}


def urdf_text(
    spec: mujoco.MjSpec, rows: Sequence[JointNumbers], name: str, notes: list[str]
) -> str:
    """Write a plain arm as URDF.

    Args:
        spec: The arm, from `plain_spec`.
        rows: The numbers of its axes.
        name: Name of the robot.
        notes: What URDF cannot express of its shapes is added here.

    Returns:
        The text. Meshes have the paths that they have in the MJCF file.

    Raises:
        InputError: A body has several joints, which URDF cannot express.
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    mujoco.mj_kinematics(model, data)
    root = Element("robot", {"name": name})
    compiler = {"strippath": "false", "discardvisual": "false", "fusestatic": "false"}
    SubElement(SubElement(root, "mujoco"), "compiler", {**compiler, "balanceinertia": "false"})
    by_joint = {row.joint: row for row in rows}
    shift = np.zeros((model.nbody, 3))  # of the frame of a link, from that of its body to its joint
    names, lost = ["world"], 0
    for body in range(1, model.nbody):
        names.append(model.body(body).name or f"link{body}")
        if model.body_jntnum[body] > 1:
            raise InputError(
                f"body '{names[-1]}' has {model.body_jntnum[body]} joints, and a joint of a URDF "
                "has a link of its own"
            )
        if model.body_jntnum[body]:
            shift[body] = model.jnt_pos[model.body_jntadr[body]]
    frames = [
        (data.xpos[k] + data.xmat[k].reshape(3, 3) @ shift[k], data.xmat[k].reshape(3, 3))
        for k in range(model.nbody)
    ]
    for body, link_name in enumerate(names):
        link = SubElement(root, "link", {"name": link_name})
        _add_inertial(link, model, body, shift[body])
        lost += _add_shapes(link, spec, model, body, shift[body])
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        (start, turned), (end, turn) = frames[parent], frames[body]
        at = int(model.body_jntadr[body])
        joint_name = model.joint(at).name if at >= 0 else f"{names[body]}_fixed"
        joint = SubElement(root, "joint", {"name": joint_name, "type": "fixed"})
        SubElement(joint, "parent", {"link": names[parent]})
        SubElement(joint, "child", {"link": names[body]})
        add_origin(joint, turned.T @ (end - start), turned.T @ turn)
        if at >= 0:
            _fill_joint(joint, model, at, by_joint[joint_name])
    if "tool" not in names:
        _add_tool(root, model, names, shift)
    for row in rows:
        _add_transmission(root, row)
    if lost:
        notes.append(f"URDF: {lost} shapes that URDF does not know are left out")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def numbers(values: np.ndarray | Sequence[float]) -> str:
    """Return numbers as the text of an attribute, with all digits.

    Args:
        values: The numbers.
    """
    return " ".join(repr(float(x)) if abs(x) > _ROUNDED else "0" for x in values)


def roll_pitch_yaw(turn: np.ndarray) -> np.ndarray:
    """Return the angles about the fixed axes x, y, z of a rotation, as URDF has them.

    Args:
        turn: Rotation matrix, shape (3, 3).

    Returns:
        Shape (3,), in [rad]. With a pitch of 90 deg, the yaw is 0.
    """
    across = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], across)
    if across < 1e-9:
        return np.array([np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    return np.array([roll, pitch, yaw])


def add_origin(element: Element, place: np.ndarray, turn: np.ndarray) -> None:
    """State where an element of a URDF is.

    Args:
        element: The element, edited in place.
        place: In the frame of its parent [m], shape (3,).
        turn: Rotation matrix, shape (3, 3).
    """
    SubElement(element, "origin", {"xyz": numbers(place), "rpy": numbers(roll_pitch_yaw(turn))})


def _add_inertial(link: Element, model: mujoco.MjModel, body: int, shift: np.ndarray) -> None:
    if body == 0 or model.body_mass[body] <= 0:
        return
    axes = matrix_of(model.body_iquat[body])
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    set_inertial(link, float(model.body_mass[body]), model.body_ipos[body] - shift, inertia)


def set_inertial(link: Element, mass: float, centre: np.ndarray, inertia: np.ndarray) -> None:
    """Give a link of a URDF a mass and an inertia, in place of those that it has.

    Args:
        link: The link, edited in place.
        mass: Mass [kg].
        centre: Centre of mass in the frame of the link [m], shape (3,).
        inertia: Inertia about the centre of mass, in the axes of the link [kg m^2], shape (3, 3).
    """
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = Element("inertial")
    link.insert(0, inertial)
    SubElement(inertial, "origin", {"xyz": numbers(centre), "rpy": "0 0 0"})
    SubElement(inertial, "mass", {"value": repr(float(mass))})
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)}
    places |= {"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    SubElement(inertial, "inertia", {k: repr(float(inertia[at])) for k, at in places.items()})


def _add_shapes(
    link: Element, spec: mujoco.MjSpec, model: mujoco.MjModel, body: int, shift: np.ndarray
) -> int:
    """Add the shapes of a body; returns how many URDF does not know."""
    lost, first = 0, int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        shape = _SHAPES.get(int(model.geom_type[geom]))
        if shape is None:
            lost += 1
            continue
        place, turn = model.geom_pos[geom], matrix_of(model.geom_quat[geom])
        mesh = int(model.geom_dataid[geom])
        if shape == "mesh":  # MuJoCo moves the frame of a mesh to its centre
            turn = turn @ matrix_of(model.mesh_quat[mesh]).T
            place = place - turn @ model.mesh_pos[mesh]
            source = spec.mesh(model.mesh(mesh).name)
            if source is None or not source.file:
                lost += 1
                continue
        solid = model.geom_contype[geom] or model.geom_conaffinity[geom]
        element = SubElement(link, "collision" if solid else "visual")
        add_origin(element, place - shift, turn)
        geometry = SubElement(element, "geometry")
        size = model.geom_size[geom]
        if shape == "box":
            SubElement(geometry, shape, {"size": numbers(2 * size)})
        elif shape == "mesh":
            file = f"{spec.meshdir}/{source.file}" if spec.meshdir else source.file
            SubElement(geometry, shape, {"filename": file, "scale": numbers(source.scale)})
        else:
            attributes = {"radius": repr(float(size[0]))}
            if shape != "sphere":
                attributes["length"] = repr(float(2 * size[1]))
            SubElement(geometry, shape, attributes)
    return lost


def _fill_joint(joint: Element, model: mujoco.MjModel, at: int, row: JointNumbers) -> None:
    SubElement(joint, "axis", {"xyz": numbers(model.jnt_axis[at])})
    limited = bool(np.isfinite(row.lower) and np.isfinite(row.upper))
    kind = "prismatic" if row.kind == "slide" else "revolute" if limited else "continuous"
    joint.set("type", kind)
    limit = {}
    if kind != "continuous":
        low, high = (row.lower, row.upper) if limited else (-_ENDLESS, _ENDLESS)
        limit = {"lower": repr(low), "upper": repr(high)}
    for key, value in (("effort", row.effort_limit), ("velocity", row.velocity_limit)):
        limit[key] = repr(value) if np.isfinite(value) else "0"  # 0: not known
    SubElement(joint, "limit", limit)
    SubElement(
        joint, "dynamics", {"damping": repr(row.damping), "friction": repr(row.frictionloss)}
    )


def _add_tool(root: Element, model: mujoco.MjModel, names: list[str], shift: np.ndarray) -> None:
    """Add the site ``tool`` as a link without mass."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tool")
    if site < 0:
        return
    body = int(model.site_bodyid[site])
    SubElement(root, "link", {"name": "tool"})
    joint = SubElement(root, "joint", {"name": "tool_fixed", "type": "fixed"})
    SubElement(joint, "parent", {"link": names[body]})
    SubElement(joint, "child", {"link": "tool"})
    add_origin(joint, model.site_pos[site] - shift[body], matrix_of(model.site_quat[site]))


def _add_transmission(root: Element, row: JointNumbers) -> None:
    """Add the gear ratio of an axis as ROS has it."""
    transmission = SubElement(root, "transmission", {"name": f"{row.joint}_transmission"})
    SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    SubElement(transmission, "joint", {"name": row.joint})
    actuator = SubElement(transmission, "actuator", {"name": f"{row.joint}_motor"})
    SubElement(actuator, "mechanicalReduction").text = repr(row.gear_ratio)
