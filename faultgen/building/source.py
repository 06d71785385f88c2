"""Reading a plain model, MJCF or URDF, with the files that it needs.

MuJoCo reads URDF itself, but it looks for meshes in one folder only, ignores speed limits, and
reports nothing that it leaves out. This module finds the meshes, and keeps the limits.

    source = read_source(Path("arm.urdf"))
    source.spec, source.speed_limit, source.notes
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from faultgen.errors import InputError, one_line
from faultgen.mjcf.compiling import check_memory, read_mjcf
from faultgen.system.reading import read_bytes, read_text

FOLDER = "assets"
"""Folder of the meshes and textures in the folder of a robot."""

_MESHES = (".obj", ".stl", ".msh")  # formats that MuJoCo reads
_LARGEST = 512 * 2**20  # of a mesh [bytes]
_XACRO = re.compile(r"<xacro:|=\s*[\"'][^\"']*\$[{(]")
"""What a file has that has to be expanded by xacro first."""
_ABOVE = 4  # folders above a URDF in which its packages are looked for


@dataclass(frozen=True)
class Source:
    """A plain model as it was read."""

    name: str
    """Name of the file without its ending."""
    spec: mujoco.MjSpec
    """The model, not compiled. Its assets are named ``assets/<file>``."""
    assets: Mapping[str, bytes]
    """Content of the assets by name."""
    speed_limit: Mapping[str, float]
    """Largest speed that a URDF states, by joint, in [rad/s] or [m/s]."""
    gear_ratio: Mapping[str, float]
    """Gear ratio that a URDF states, by joint: motor turns per joint turn, or in [rad/m]."""
    notes: tuple[str, ...]
    """What was left out."""


def read_source(path: Path) -> Source:
    """Read a plain model.

    Args:
        path: An MJCF or URDF file.

    Returns:
        The model, with all of its assets in one folder.

    Raises:
        InputError: The file cannot be read, or MuJoCo does not understand it.
    """
    text = read_text(path, "robot file")
    speed: dict[str, float] = {}
    ratio: dict[str, float] = {}
    notes: list[str] = []
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"robot file {path}: not valid XML: {error}") from None
    if _XACRO.search(text):
        raise InputError(
            f"robot file {path}: is a xacro file, which only ROS can expand; write 'xacro "
            f"{path.name} > {path.stem.partition('.')[0]}.urdf' there, and give the URDF file"
        )
    if root.tag == "robot":
        text, assets = _prepare_urdf(root, path, notes)
        speed, ratio = _speed_limits(root), _gear_ratios(root)
    elif root.tag == "mujoco":
        text, assets = read_mjcf(path)
    else:
        raise InputError(
            f"robot file {path}: its outermost element is <{root.tag}>; give an MJCF file "
            "(<mujoco>) or a URDF file (<robot>)"
        )
    check_memory(path.stem, text, assets)
    try:
        spec = mujoco.MjSpec.from_string(text, assets=assets)
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        line = one_line(error)
        raise InputError(f"robot file {path}: MuJoCo cannot read it: {line}") from None
    kept = _gather(spec, assets, notes)
    return Source(path.stem, spec, kept, speed, ratio, tuple(notes))


def _speed_limits(root: ElementTree.Element) -> dict[str, float]:
    found = {}
    for joint in root.iter("joint"):
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


def _prepare_urdf(
    root: ElementTree.Element, path: Path, notes: list[str]
) -> tuple[str, dict[str, bytes]]:
    """Find the meshes of a URDF, and make MuJoCo keep its frames and visible shapes."""
    assets: dict[str, bytes] = {}
    lost = []
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            file = _find_mesh(name, path)
            if file is None:
                link.remove(shape)
                lost.append(name)
                continue
            content = read_bytes(file, f"robot file {path}: mesh", _LARGEST)
            mesh.set("filename", _unique(file.name, content, assets))
    if lost:
        names = ", ".join(sorted(set(lost)))
        notes.append(
            f"{len(set(lost))} meshes were not found or are in a format that MuJoCo does not read, "
            f"and are left out (the masses in the URDF stay): {names}"
        )
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    wanted = {"discardvisual": "false", "fusestatic": "false", "strippath": "false"}
    for key, value in {**wanted, "meshdir": FOLDER}.items():
        compiler.set(key, value)
    return ElementTree.tostring(root, encoding="unicode"), assets


def _find_mesh(name: str, urdf: Path) -> Path | None:
    """The file of a mesh, given as a path or as package://<package>/<path>."""
    inside = name
    for scheme in ("package://", "model://", "file://"):
        inside = inside.removeprefix(scheme)
    if not inside.lower().endswith(_MESHES):
        return None
    options = [inside] if name == inside else [inside, inside.partition("/")[2]]
    if name.startswith("file://"):
        options = ["/" + inside.lstrip("/")]
    folders = [urdf.parent, *list(urdf.resolve().parents)[:_ABOVE]]
    for folder in folders:
        for option in options:
            if option and os.path.isfile(folder / option):
                return folder / option
    return None


def _unique(name: str, content: bytes, assets: dict[str, bytes]) -> str:
    """Store an asset under its own name, or under a similar one if that is taken."""
    stem, ending = os.path.splitext(os.path.basename(name))
    number = 1
    new = f"{stem}{ending}"
    while assets.get(f"{FOLDER}/{new}", content) != content:
        number += 1
        new = f"{stem}_{number}{ending}"
    assets[f"{FOLDER}/{new}"] = content
    return new


def _gather(spec: mujoco.MjSpec, assets: Mapping[str, bytes], notes: list[str]) -> dict[str, bytes]:
    """Put all assets of a model into one folder; meshes that do not exist are taken out."""
    kept: dict[str, bytes] = {}

    def moved(file: str, folder: str) -> str | None:
        name = os.path.basename(file) if spec.strippath else file
        content = assets.get(os.path.join(folder, name))
        return None if content is None else _unique(name, content, kept)

    lost = []
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        new = moved(mesh.file, spec.meshdir)
        if new is not None:
            mesh.name = mesh.name or os.path.splitext(os.path.basename(mesh.file))[0]
            mesh.file = new
            continue
        name = mesh.name or os.path.splitext(os.path.basename(mesh.file))[0]
        lost.append(mesh.file)
        for geom in [one for one in spec.geoms if one.meshname == name]:
            spec.delete(geom)
        spec.delete(mesh)
    if lost:
        notes.append(f"meshes that were not found are left out: {', '.join(sorted(lost))}")
    for kind, folder in (("textures", spec.texturedir), ("hfields", spec.meshdir)):
        for one in getattr(spec, kind):
            if one.file:
                one.file = moved(one.file, folder) or one.file
            for k, file in enumerate(getattr(one, "cubefiles", ())):
                if file:
                    one.cubefiles[k] = moved(file, folder) or file
    for skin in list(spec.skins):
        spec.delete(skin)
    spec.meshdir = spec.texturedir = FOLDER
    spec.strippath = False
    spec.assets = kept
    return kept
