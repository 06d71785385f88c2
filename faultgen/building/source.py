"""Reading a plain model, MJCF or URDF, with the files that it needs.

MuJoCo reads URDF itself, but it looks for meshes in one folder only, ignores speed limits, and
reports nothing that it leaves out. This module finds the meshes, and keeps the limits.

    source = read_source(Path("arm.urdf"))
    source.spec, source.speed_limit, source.notes
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from faultgen.building.axes import MOST_LINKS, deepest
from faultgen.building.numbers import senseless_numbers
from faultgen.building.urdf import FOLDER, Stated, asset_name, read_urdf, take_meshes
from faultgen.errors import InputError, one_line
from faultgen.mjcf.compiling import parsed, read_mjcf
from faultgen.mjcf.memory import check_memory
from faultgen.mjcf.parsing import parse_xml
from faultgen.mjcf.reach import Reach
from faultgen.system.reading import read_text


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
    unstated: frozenset[str]
    """Joints of a URDF whose limits are no range, such as 0 and 0."""
    leaders: Mapping[str, str]
    """The joints that follow another one, with the one that each follows: <mimic> of a URDF, and
    equality constraints of MJCF."""
    notes: tuple[str, ...]
    """What was left out."""
    origin: Mapping[str, str]
    """Text of the file by its name, as the user wrote it; included files are in their place."""


def read_source(path: Path, folders: Sequence[Path] = ()) -> Source:
    """Read a plain model.

    Args:
        path: An MJCF or URDF file.
        folders: Further folders, beside those of the model, whose files it may use.

    Returns:
        The model, with all of its assets in one folder.

    Raises:
        InputError: The file cannot be read, names files outside of these folders, has numbers that
            no robot has, or MuJoCo does not understand it.
    """
    where = f"robot file {path}"
    text = read_text(path, "robot file")
    root = parse_xml(text, where)
    if _is_xacro(root):
        raise InputError(
            f"{where}: is a xacro file, which has to be expanded first: write 'xacro {path.name} > "
            f"{path.stem.partition('.')[0]}_expanded.urdf' with ROS or after 'pip install xacro', "
            "and give the new file"
        )
    original = text
    notes: list[str] = []
    stated = Stated({}, {}, frozenset(), {})
    if root.tag == "robot":
        stated = read_urdf(root, where)
        assets = take_meshes(root, path, Reach.of(path, folders), notes)
        text = ElementTree.tostring(root, encoding="unicode")
    elif root.tag == "mujoco":
        text, assets = read_mjcf(path, folders)
        original = text
        root = parse_xml(text, where)
    else:
        raise InputError(
            f"{where}: its outermost element is <{root.tag}>; give an MJCF file (<mujoco>) or a "
            "URDF file (<robot>)"
        )
    if wrong := senseless_numbers(root):
        raise InputError(f"{where}: {'; '.join(wrong)}")
    check_memory(path.stem, text, assets)
    spec, warned = parsed(text, assets, where)
    if deepest(spec) > MOST_LINKS:
        raise InputError(f"{where}: more than {MOST_LINKS} links follow each other")
    # those about limits and <mimic> are told in terms of the joint, with what is done about it
    notes += [f"MuJoCo: {one_line(line)}" for line in warned if " ignored" not in line]
    follows = {
        one.name1: one.name2
        for one in spec.equalities
        if one.type == mujoco.mjtEq.mjEQ_JOINT and one.name2 and one.name1 != one.name2
    }
    stated = stated._replace(leaders={**follows, **stated.leaders})
    kept = _gather(spec, assets, notes)
    return Source(path.stem, spec, kept, *stated, tuple(notes), {path.name: original})


def _is_xacro(root: ElementTree.Element) -> bool:
    """Whether xacro has to expand a model first; what stands in comments does not count."""
    return any(
        str(element.tag).startswith("xacro:")
        or any("${" in value or "$(" in value for value in element.attrib.values())
        for element in root.iter()
    )


def _gather(spec: mujoco.MjSpec, assets: Mapping[str, bytes], notes: list[str]) -> dict[str, bytes]:
    """Put all assets of a model into one folder; meshes that do not exist are taken out."""
    kept: dict[str, bytes] = {}

    def moved(file: str, folder: str) -> str | None:
        name = os.path.basename(file) if spec.strippath else file
        content = assets.get(os.path.join(folder, name))
        return None if content is None else asset_name(name, content, kept)

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
