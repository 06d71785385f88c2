"""Reading an MJCF file: its text with all files that it includes, and its assets.

The paths of these files are relative to the MJCF file, as in MuJoCo. Their content is kept in
memory, so that every copy of the model, in any process, is made from the same bytes.

    xml, assets = read_mjcf(Path("robot.xml"))
    mujoco.MjSpec.from_string(xml, assets=assets)
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from faultgen.errors import InputError, one_line
from faultgen.mjcf.including import expanded
from faultgen.mjcf.parsing import parse_xml, whole_number
from faultgen.mjcf.reach import Reach
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.system.reading import read_bytes, read_text

MOST_COPIES = 10_000
"""Largest number of copies that the `replicate` elements of a model may make of a body."""

MOST_ASSETS = 256 * 2**20
"""Largest size of all meshes, textures, ... of a model together [bytes]. Those of large arms have
some 50 MiB; with two copies of them a command stays below 1 GB."""

_FAILURES = (ValueError, RuntimeError, MemoryError, mujoco.FatalError)  # of MuJoCo


def read_mjcf(path: Path, folders: Sequence[Path] = ()) -> tuple[str, dict[str, bytes]]:
    """Read a model from an MJCF file.

    Args:
        path: The file.
        folders: Further folders, beside those of the model, whose files it may use.

    Returns:
        Its text, in which the content of included files replaces the `include` elements, and the
        content of its assets by the name that MuJoCo asks for. An asset that does not exist is left
        out, so that MuJoCo reports it.

    Raises:
        InputError: A file cannot be read, is too large, is not XML or lies outside of these
            folders; a file includes itself; the model is too large or nested too deeply; another
            model is attached; or `replicate` makes too many copies.
    """
    where, reach = f"robot file {path}", Reach.of(path, folders)
    xml = read_text(path, "robot file")
    root = parse_xml(xml, where)
    if root.find(".//include") is not None:
        xml = ElementTree.tostring(expanded(root, path, reach, where), encoding="unicode")
    copies = _copies(root, 1)
    if root.find("asset/model") is not None:
        raise InputError(
            f"{where}: attaches another model (<asset><model>), which is not supported; "
            "put both into one file"
        )
    if copies > MOST_COPIES:
        raise InputError(f"{where}: 'replicate' makes {copies} copies, more than {MOST_COPIES}")
    assets: dict[str, bytes] = {}
    for name in asset_names(root):
        file = reach.check(path.parent / name, f"{where}: asset")
        if file.exists() and name not in assets:
            assets[name] = read_asset(file, f"{where}: asset", assets)
    return xml, assets


def read_asset(file: Path, what: str, others: Mapping[str, bytes]) -> bytes:
    """Read a mesh, texture, ... of a model.

    Args:
        file: The file.
        what: What it is, for messages.
        others: Content of the assets that the model has already, by name.

    Returns:
        Its content.

    Raises:
        InputError: The file cannot be read, or all assets together are too large.
    """
    left = MOST_ASSETS - sum(len(content) for content in others.values())
    if file.is_file() and file.stat().st_size > left:  # before anything is read
        raise InputError(
            f"{what} {file}: the model's files together are larger than {MOST_ASSETS / 2**20:g} "
            "MiB; simplify its meshes and textures"
        )
    return read_bytes(file, what, left)


def parsed(xml: str, assets: Mapping[str, bytes], where: str) -> tuple[mujoco.MjSpec, list[str]]:
    """Let MuJoCo parse a model.

    Args:
        xml: Text of the model, MJCF or URDF.
        assets: Content of its files by name.
        where: What it is, for messages.

    Returns:
        The model, not compiled, and the warnings of MuJoCo.

    Raises:
        InputError: MuJoCo does not understand the model.
    """
    with mujoco_warnings() as warned:
        try:
            spec = mujoco.MjSpec.from_string(xml, assets=dict(assets))
        except _FAILURES as error:
            raise InputError(f"{where}: MuJoCo cannot read it: {one_line(error)}") from None
    if any("NaN" in warning for warning in warned):
        raise InputError(f"{where}: an attribute is NaN, not a number")
    return spec, warned


def compiled(spec: mujoco.MjSpec, where: str, warned: list[str] | None = None) -> mujoco.MjModel:
    """Let MuJoCo compile a model.

    Args:
        spec: The model.
        where: What it is, for messages.
        warned: The warnings of MuJoCo are added here. None: nobody needs them.

    Returns:
        The compiled model.

    Raises:
        InputError: MuJoCo cannot compile the model.
    """
    with mujoco_warnings() as caught:
        try:
            model = spec.compile()
        except _FAILURES as error:
            line = one_line(error) or "not enough memory"
            raise InputError(f"{where}: MuJoCo cannot use the model: {line}") from None
    if warned is not None:
        warned += caught
    return model


def compiled_anyway(spec: mujoco.MjSpec, where: str) -> mujoco.MjModel:
    """Compile a copy of a model whose masses and inertias need not be possible.

    Args:
        spec: The model, which stays as it is.
        where: What it is, for messages.

    Returns:
        The compiled copy. Impossible inertias are others in it.

    Raises:
        InputError: MuJoCo cannot compile the model for another reason.
    """
    copy = spec.copy()
    copy.compiler.boundmass = copy.compiler.boundinertia = 1e-6
    copy.compiler.balanceinertia = True
    return compiled(copy, where)


def _copies(element: ElementTree.Element, outside: int) -> int:
    """The largest number of copies that `replicate` makes of any element within an element."""
    if element.tag == "replicate":
        outside *= max(1, whole_number(element.get("count", "1")))
    return max([outside, *(_copies(child, outside) for child in element)])


def asset_names(root: ElementTree.Element) -> list[str]:
    """Return the names of the files that a model needs, relative to its own file.

    Args:
        root: The model.
    """
    folders = {"meshdir": "", "texturedir": ""}
    strip = False
    for one in root.findall("compiler"):  # the last one counts, as in MuJoCo
        anything = one.get("assetdir")
        for kind, folder in folders.items():
            folders[kind] = one.get(kind, folder if anything is None else anything)
        strip = one.get("strippath", str(strip).lower()) == "true"
    names = []
    for element in root.iter():
        if element.tag not in ("mesh", "hfield", "skin", "texture", "flexcomp"):
            continue
        folder = folders["texturedir" if element.tag == "texture" else "meshdir"]
        for attribute, value in element.attrib.items():
            if attribute.startswith("file"):
                names.append(os.path.join(folder, Path(value).name if strip else value))
    return names
