"""What faultgen reads of a URDF itself, because MuJoCo leaves it out or does not report it.

stated = read_urdf(root, "robot file arm.urdf")
assets = take_meshes(root, path, Reach.of(path), notes)
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from faultgen.building import collada
from faultgen.building.axes import MOST_LINKS
from faultgen.building.ranges import ENDLESS
from faultgen.errors import InputError
from faultgen.mjcf.compiling import read_asset
from faultgen.mjcf.reach import Reach

FOLDER = "assets"
"""Folder of the meshes and textures in the folder of a robot."""

_MESHES = (".obj", ".stl", ".msh")  # formats that MuJoCo reads
_ABOVE = 4  # folders above a URDF in which its meshes are looked for
_SIZES = {"box": "size", "cylinder": "radius length", "sphere": "radius", "capsule": "radius"}
"""Attributes of a shape that must be positive."""


class Stated(NamedTuple):
    """What a URDF states about its joints."""

    speed_limit: Mapping[str, float]
    """Largest speed by joint, in [rad/s] or [m/s]."""
    gear_ratio: Mapping[str, float]
    """Gear ratio by joint: motor turns per joint turn, or in [rad/m]."""
    unstated: frozenset[str]
    """Joints whose limits are no range, such as 0 and 0."""
    leaders: Mapping[str, str]
    """The joints that follow another one (<mimic>), with the one that each follows."""


def read_urdf(root: ElementTree.Element, where: str) -> Stated:
    """Read what a URDF states about its joints, and check its links and shapes.

    Args:
        root: The URDF.
        where: What it is, for messages.

    Returns:
        Limits of the joints.

    Raises:
        InputError: Names occur twice, the links are no tree, or a shape is empty. The message has
            all findings, in one line.
    """
    wrong = [*_wrong_names(root), *_empty_shapes(root)]
    wrong = wrong or _wrong_tree(root)
    if root.find(".//include") is not None:
        wrong.append("<include> belongs to MJCF, not to a URDF; put the text in its place")
    if wrong:
        raise InputError(f"{where}: {'; '.join(wrong)}")
    return Stated(_speed_limits(root), _gear_ratios(root), _unstated(root), _leaders(root))


def _wrong_names(root: ElementTree.Element) -> list[str]:
    """Names that two links or two joints have."""
    found = []
    for kind in ("link", "joint"):
        counts = Counter(one.get("name", "") for one in root.findall(kind))
        found += [
            f"{count} {kind}s are called '{name}'; give each a name of its own"
            for name, count in counts.items()
            if count > 1
        ]
    return found


def _empty_shapes(root: ElementTree.Element) -> list[str]:
    """Boxes, cylinders and spheres without extent."""
    found = []
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            for one in shape.findall("geometry/*"):
                for key in _SIZES.get(one.tag, "").split():
                    if not _positive(one.get(key)):
                        found.append(
                            f"link '{link.get('name')}': the <{one.tag}> of its <{shape.tag}> has "
                            f"the {key} '{one.get(key, '')}', which must be positive; correct it, "
                            "or remove the shape"
                        )
    return found


def _positive(text: str | None) -> bool:
    words = (text or "").split()
    try:
        return bool(words) and all(float(word) > 0 for word in words)
    except ValueError:
        return False


def _wrong_tree(root: ElementTree.Element) -> list[str]:
    """Why the links are not carried by one another from one base."""
    links = [link.get("name", "") for link in root.findall("link")]
    if not links:
        return ["has no <link>"]
    carrier: dict[str, str] = {}
    for joint in root.findall("joint"):
        name, ends = joint.get("name", ""), []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = "" if element is None else element.get("link", "")
            if link not in links:
                return [f"joint '{name}': its {end} link '{link}' is not in the file"]
            ends.append(link)
        if ends[1] in carrier:
            return [f"link '{ends[1]}': two joints have it as their child; a link has one"]
        carrier[ends[1]] = ends[0]
    depth: dict[str, int] = {}
    for link in links:
        path = [link]
        while path[-1] in carrier and path[-1] not in depth:
            path.append(carrier[path[-1]])
            if len(path) > len(links):
                return [f"link '{link}': the joints that carry it form a circle"]
        top = depth.get(path[-1], 1)
        depth |= {one: top + k for k, one in enumerate(reversed(path))}
    if max(depth.values()) > MOST_LINKS:
        return [f"{max(depth.values())} links follow each other, more than {MOST_LINKS}"]
    return []


def _speed_limits(root: ElementTree.Element) -> dict[str, float]:
    found = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if limit is not None:
            try:
                found[joint.get("name", "")] = float(limit.get("velocity", "0"))
            except ValueError:  # MuJoCo does not read it
                continue
    return {name: value for name, value in found.items() if value > 0}


def _gear_ratios(root: ElementTree.Element) -> dict[str, float]:
    """The reduction of each joint; 1 counts as not stated, because most URDF files have it."""
    found = {}
    for transmission in root.iter("transmission"):
        joint = transmission.find("joint")
        reduction = next(transmission.iter("mechanicalReduction"), None)
        if joint is not None and reduction is not None:
            try:
                found[joint.get("name", "")] = abs(float(reduction.text or "1"))
            except ValueError:
                continue
    return {name: value for name, value in found.items() if value not in (0.0, 1.0)}


def _unstated(root: ElementTree.Element) -> frozenset[str]:
    """Joints whose lower limit is not below the upper one, or which have limits without end."""
    found = set()
    for joint in root.findall("joint"):
        if joint.get("type") not in ("revolute", "prismatic"):
            continue
        limit = joint.find("limit")
        try:
            low, high = (
                0.0 if limit is None else float(limit.get(key, "0")) for key in ("lower", "upper")
            )
        except ValueError:  # MuJoCo says so
            continue
        if not -ENDLESS < low < high < ENDLESS:
            found.add(joint.get("name", ""))
    return frozenset(found)


def _leaders(root: ElementTree.Element) -> dict[str, str]:
    return {
        joint.get("name", ""): mimic.get("joint", "")
        for joint in root.findall("joint")
        if (mimic := joint.find("mimic")) is not None
    }


def take_meshes(
    root: ElementTree.Element, path: Path, reach: Reach, notes: list[str]
) -> dict[str, bytes]:
    """Read the meshes of a URDF, and make MuJoCo keep its frames and visible shapes, in place.

    Args:
        root: The URDF.
        path: Its file.
        reach: The folders whose files it may use.
        notes: What is left out is added here.

    Returns:
        Content of the meshes by name.

    Raises:
        InputError: A mesh lies outside of the reach, cannot be read, or is too large.
    """
    assets: dict[str, bytes] = {}
    made: dict[Path, tuple[str, bytes]] = {}
    lost = []
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            file = _find_mesh(name, path, reach)
            if file is None:
                link.remove(shape)
                lost.append(name)
                continue
            what = f"robot file {path}: mesh"
            content, short = read_asset(file, what, assets), file.name
            if file.suffix.lower() == collada.ENDING:
                if file not in made:
                    made[file] = collada.converted(short, content, what)
                short, content = made[file]
            mesh.set("filename", asset_name(short, content, assets))
    if made:
        notes.append(f"{len(made)} Collada meshes (.dae) were converted for MuJoCo")
    if lost:
        notes.append(_told_lost(sorted(set(lost))))
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    for old in extension.findall("compiler")[1:]:
        extension.remove(old)
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    wanted = {"discardvisual": "false", "fusestatic": "false", "strippath": "false"}
    for key, value in {**wanted, "meshdir": FOLDER}.items():
        compiler.set(key, value)
    return assets


def _told_lost(names: list[str]) -> str:
    """Write which meshes are left out, and what to do about it."""
    line = (
        f"{len(names)} meshes were not found or are in a format that MuJoCo does not read, "
        f"and are left out (the masses in the URDF stay): {', '.join(names)}"
    )
    packages = {one.removeprefix("package://").partition("/")[0] for one in names if "://" in one}
    if packages:
        line += (
            f"; name the folder that has the package {', '.join(sorted(packages))} with "
            "--package-path FOLDER"
        )
    if any(one.lower().endswith(collada.ENDING) for one in names) and not collada.is_there():
        line += f"; {collada.HINT}"
    return line


def _find_mesh(name: str, urdf: Path, reach: Reach) -> Path | None:
    """The file of a mesh, given as a path or as package://<package>/<path>."""
    inside = name
    for scheme in ("package://", "model://", "file://"):
        inside = inside.removeprefix(scheme)
    formats = (*_MESHES, collada.ENDING) if collada.is_there() else _MESHES
    if not inside.lower().endswith(formats) or "\x00" in name:
        return None
    options = [inside] if name == inside else [inside, inside.partition("/")[2]]
    if name.startswith("file://"):
        options = ["/" + inside.lstrip("/")]
    elif name != inside:
        reach = reach.with_package(inside.partition("/")[0])
    folders = [urdf.parent, *list(urdf.resolve().parents)[:_ABOVE], *reach.folders]
    there = [
        folder / option
        for folder in folders
        for option in options
        if option and os.path.isfile(folder / option)
    ]
    allowed = next((file for file in there if reach.allows(file)), None)
    if allowed is not None:
        return allowed
    return reach.check(there[0], f"robot file {urdf}: mesh") if there else None


def asset_name(name: str, content: bytes, assets: dict[str, bytes]) -> str:
    """Store an asset under its own name, or under a similar one if that is taken.

    Args:
        name: Name of its file.
        content: Its content.
        assets: Content of the assets by name, to which it is added.

    Returns:
        Its name within the folder of the assets.
    """
    stem, ending = os.path.splitext(os.path.basename(name))
    number = 1
    new = f"{stem}{ending}"
    while assets.get(f"{FOLDER}/{new}", content) != content:
        number += 1
        new = f"{stem}_{number}{ending}"
    assets[f"{FOLDER}/{new}"] = content
    return new
