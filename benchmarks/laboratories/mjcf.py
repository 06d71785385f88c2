"""The numbers of a robot, read straight from the text of its MJCF file.

machine = read_machine(Path("robots/puma560/puma560.xml"))
machine.mass, machine.ratio, machine.coulomb
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

HINGE, SLIDE = 0, 1
_STANDARD_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A serial arm with drivetrains. Link i moves by joint i; the payload is kept apart.

    Arrays have shape (n_axes,) where nothing else is said; drivetrain values are motor side.
    """

    kind: np.ndarray
    """`HINGE` or `SLIDE`."""
    turn: np.ndarray
    """Orientation of a link's frame in its parent's at zero, shape (n_axes, 3, 3)."""
    place: np.ndarray
    """Origin of a link's frame in its parent's [m], shape (n_axes, 3)."""
    axis: np.ndarray
    """Axis of the joint in the link's frame, shape (n_axes, 3)."""
    mass: np.ndarray
    """Of the links without payload [kg]."""
    com: np.ndarray
    """Their centres of mass, link's frame [m], shape (n_axes, 3)."""
    inertia: np.ndarray
    """About the centres of mass [kg m^2], shape (n_axes, 3, 3)."""
    payload: np.ndarray
    """Mass [kg], centre of mass [m] and inertia by rows, in the last link's frame: shape (13,)."""
    payload_turn: np.ndarray
    """Orientation of the payload's frame in the last link's, shape (3, 3)."""
    spring: np.ndarray
    """Springs: link, point, link, point, stiffness, rest length; shape (springs, 10)."""
    gravity: np.ndarray
    """[m/s^2], shape (3,)."""
    ratio: np.ndarray
    """Turns of the rotor over motion of the joint; signed."""
    rotor: np.ndarray
    """Inertia of the rotor [kg m^2]."""
    stiffness: np.ndarray
    """Of the gearbox, joint side [N m/rad]."""
    damping: np.ndarray
    """Of the gearbox, joint side [N m s/rad]."""
    kp: np.ndarray
    """Gain of the model's servo [N m/rad]."""
    kd: np.ndarray
    """Gain of the model's servo [N m s/rad]."""
    limit: np.ndarray
    """Torque limit [N m]."""
    coulomb: np.ndarray
    """[N m]."""
    static: np.ndarray
    """[N m]."""
    stribeck: np.ndarray
    """Stribeck velocity, exponent 2 [rad/s]."""
    viscous: np.ndarray
    """[N m s/rad]."""
    bristle: np.ndarray
    """Stiffness at rest [N m/rad]."""
    offset: np.ndarray
    """Constant torque on the rotor [N m]."""
    low: np.ndarray
    """Lower end of the joint's range [rad or m]."""
    high: np.ndarray
    """Upper end."""
    speed_limit: np.ndarray
    """[rad/s], motor side."""
    acceleration_limit: np.ndarray
    """Joint side [rad/s^2]."""
    counts: np.ndarray
    """Encoder lines a motor turn."""

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return len(self.mass)

    def loaded(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, centre of mass and inertia about it of all links, the last one with payload."""
        mass, com, inertia = self.mass.copy(), self.com.copy(), self.inertia.copy()
        parts = [
            (mass[-1], com[-1].copy(), inertia[-1].copy()),
            (self.payload[0], self.payload[1:4], self.payload[4:].reshape(3, 3)),
        ]
        mass[-1], com[-1], inertia[-1] = merged(parts)
        return mass, com, inertia

    def changed(self, **values: Any) -> Machine:
        """The machine with other values."""
        return replace(self, **values)


Part = tuple[float, np.ndarray, np.ndarray]
"""Mass, centre of mass, inertia about it."""


def merged(parts: list[Part]) -> Part:
    """Several bodies that move together as one."""
    mass = float(sum(part[0] for part in parts))
    if mass == 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    com = np.asarray(sum(part[0] * part[1] for part in parts)) / mass
    total = np.zeros((3, 3))
    for m, at, tensor in parts:
        arm = at - com
        total += tensor + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, com, total


def _numbers(element: ET.Element, name: str, default: str = "") -> np.ndarray:
    return np.array([float(word) for word in element.get(name, default).split()])


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out: np.ndarray = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return out


def _pose(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    for name in ("euler", "axisangle", "xyaxes", "zaxis"):
        if element.get(name):
            raise ValueError(f"<{element.tag}> has '{name}', which is not read here")
    return _numbers(element, "pos", "0 0 0"), rotation(_numbers(element, "quat", "1 0 0 0"))


def _inertial(body: ET.Element) -> Part | None:
    element = body.find("inertial")
    if element is None:
        return None
    at, turned = _pose(element)
    if element.get("fullinertia"):
        a, b, c, ab, ac, bc = _numbers(element, "fullinertia")
        tensor = np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])
    else:
        tensor = np.diag(_numbers(element, "diaginertia"))
    return float(element.get("mass", "0")), at, turned @ tensor @ turned.T


class _Reader:
    """Goes through the bodies and collects what belongs to each link."""

    def __init__(self) -> None:
        self.joints: list[tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self.parts: list[list[Part]] = []
        self.payload: Part = (0.0, np.zeros(3), np.zeros((3, 3)))
        self.payload_turn = np.eye(3)
        self.sites: dict[str, tuple[int, np.ndarray]] = {}
        self.rotors: dict[int, float] = {}

    def body(self, body: ET.Element, link: int, at: np.ndarray, turned: np.ndarray) -> None:
        """Read a body whose parent's frame has the pose (at, turned) in the frame of its link."""
        own_at, own_turn = _pose(body)
        at, turned = at + turned @ own_at, turned @ own_turn
        joint = body.find("joint")
        if joint is not None:
            name = joint.get("name", "")
            direction = _numbers(joint, "axis", "0 0 1")
            direction = direction / np.linalg.norm(direction)
            if name.startswith("motor"):
                part = _inertial(body)
                assert part is not None
                self.rotors[int(name[5:])] = float(direction @ part[2] @ direction)
                return
            if _numbers(joint, "pos", "0 0 0").any() or int(name[5:]) != link + 2:
                raise ValueError(f"joint '{name}': only serial arms with joints at their origins")
            kind = SLIDE if joint.get("type") == "slide" else HINGE
            self.joints.append((kind, turned, at, direction, _numbers(joint, "range")))
            self.parts.append([])
            link, at, turned = link + 1, np.zeros(3), np.eye(3)
        part = _inertial(body)
        if part is not None and link >= 0:
            placed = (part[0], at + turned @ part[1], turned @ part[2] @ turned.T)
            if body.get("name") == "payload":
                self.payload, self.payload_turn = placed, turned
            else:
                self.parts[link].append(placed)
        for site in body.findall("site"):
            self.sites[site.get("name", "")] = (link, at + turned @ _pose(site)[0])
        for child in body.findall("body"):
            self.body(child, link, at, turned)


def read_machine(path: Path) -> Machine:
    """Read a robot.

    Args:
        path: An MJCF file with the names of docs/robots.md, a serial arm, angles in radians.

    Returns:
        Its numbers.

    Raises:
        ValueError: The file has something that is not read here.
    """
    root = ET.parse(path).getroot()
    compiler = root.find("compiler")
    if compiler is None or compiler.get("angle") != "radian":
        raise ValueError(f"{path}: angles must be in radians")
    reader = _Reader()
    world = root.find("worldbody")
    assert world is not None
    for body in world.findall("body"):
        reader.body(body, -1, np.zeros(3), np.eye(3))
    n = len(reader.joints)
    links = [merged(parts) for parts in reader.parts]

    def named(tag: str, name: str) -> list[ET.Element]:
        found = {element.get("name"): element for element in root.iter(tag)}
        return [found[f"{name}{i + 1}"] for i in range(n)]

    def column(elements: list[ET.Element], name: str, at: int, default: str = "") -> np.ndarray:
        return np.array([_numbers(element, name, default)[at] for element in elements])

    numeric = {e.get("name"): _numbers(e, "data") for e in root.iter("numeric")}
    option = root.find("option")
    gravity = _numbers(option, "gravity") if option is not None else np.array([])
    gearbox = named("fixed", "gearbox")
    drive, friction = named("dcmotor", "drive"), named("dcmotor", "friction")
    ratio = []
    for element in gearbox:
        (rotor,) = (e for e in element if e.get("joint", "").startswith("motor"))
        ratio.append(1 / float(rotor.get("coef", "0")))
    springs = []
    for tendon in root.iter("spatial"):
        (a, at_a), (b, at_b) = (reader.sites[e.get("site", "")] for e in tendon.findall("site"))
        rest = float(tendon.get("springlength", "0"))
        springs.append([a, *at_a, b, *at_b, float(tendon.get("stiffness", "0")), rest])
    offsets = [_numbers(element, "cogging", "0 0 0") for element in friction]
    if any(values[1] for values in offsets):
        raise ValueError(f"{path}: cogging with poles is not read here")
    ranges = np.array([joint[4] for joint in reader.joints])
    payload = reader.payload
    return Machine(
        kind=np.array([joint[0] for joint in reader.joints]),
        turn=np.array([joint[1] for joint in reader.joints]),
        place=np.array([joint[2] for joint in reader.joints]),
        axis=np.array([joint[3] for joint in reader.joints]),
        mass=np.array([link[0] for link in links]),
        com=np.array([link[1] for link in links]),
        inertia=np.array([link[2] for link in links]),
        payload=np.concatenate([[payload[0]], payload[1], payload[2].ravel()]),
        payload_turn=reader.payload_turn,
        spring=np.array(springs, float).reshape(-1, 10),
        gravity=gravity if len(gravity) else np.array(_STANDARD_GRAVITY),
        ratio=np.array(ratio),
        rotor=np.array([reader.rotors[i + 1] for i in range(n)]),
        stiffness=column(gearbox, "stiffness", 0),
        damping=column(gearbox, "damping", 0),
        kp=column(drive, "controller", 0),
        kd=column(drive, "controller", 2),
        limit=column(drive, "saturation", 0),
        coulomb=column(friction, "lugre", 2),
        static=column(friction, "lugre", 3),
        stribeck=column(friction, "lugre", 4),
        viscous=column(friction, "damping", 0),
        bristle=column(friction, "lugre", 0),
        offset=np.array([values[0] * np.sin(values[2]) for values in offsets]),
        low=ranges[:, 0],
        high=ranges[:, 1],
        speed_limit=numeric["motor_velocity_limit"],
        acceleration_limit=numeric["joint_acceleration_limit"],
        counts=numeric.get("encoder_counts", np.full(n, 2000.0)),
    )


COLUMNS = tuple(field.name for field in fields(Machine))
"""Names of all numbers."""
