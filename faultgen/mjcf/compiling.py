"""Reading an MJCF file: its text with all files that it includes, and its assets.

The paths of these files are relative to the MJCF file, as in MuJoCo. Their content is kept in
memory, so that every copy of the model, in any process, is made from the same bytes.

    xml, assets = read_mjcf(Path("robot.xml"))
    mujoco.MjSpec.from_string(xml, assets=assets)
"""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from faultgen.errors import InputError, one_line
from faultgen.mjcf.including import expanded
from faultgen.mjcf.parsing import parse_xml
from faultgen.mjcf.reach import Reach
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.system.reading import read_bytes, read_text

MOST_MEMORY = 2 * 2**30
"""Largest memory that compiling a model may use [bytes]."""

MOST_COPIES = 10_000
"""Largest number of copies that the `replicate` elements of a model may make of a body."""

_MOST_SECONDS = 120  # of processor time, for compiling
MOST_ASSETS = 256 * 2**20
"""Largest size of all meshes, textures, ... of a model together [bytes]. Those of large arms have
some 50 MiB; with two copies of them a command stays below 1 GB."""

_FAILURES = (ValueError, RuntimeError, MemoryError, mujoco.FatalError)  # of MuJoCo
_SIZED = re.compile(  # elements that can take far more memory than their text
    r"<(size|hfield|texture|mesh|skin|replicate|composite|flexcomp|flex|plugin)\b"
)

# Compiles the model that comes on stdin. Exit status 3: it takes too much memory or time.
_COMPILE = """
import pickle, sys
import mujoco
mujoco.set_mju_user_warning(lambda text: None)
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[2]),) * 2)
except (ImportError, OSError, ValueError):
    pass
try:
    xml, assets = pickle.load(sys.stdin.buffer)
    mujoco.MjData(mujoco.MjSpec.from_string(xml, assets=assets).compile())
except ValueError as error:
    sys.exit(3 if "allocate" in str(error) else 0)
except BaseException:
    sys.exit(3)
"""


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
    for name in _asset_names(root):
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
    try:
        return read_bytes(file, what, left)
    except InputError:
        if file.is_file() and file.stat().st_size > left:
            most = f"{MOST_ASSETS / 2**20:g} MiB"
            raise InputError(
                f"{what} {file}: the model's files together are larger than {most}; simplify its "
                "meshes and textures"
            ) from None
        raise


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


def compiled(spec: mujoco.MjSpec, where: str) -> mujoco.MjModel:
    """Let MuJoCo compile a model.

    Args:
        spec: The model.
        where: What it is, for messages.

    Returns:
        The compiled model.

    Raises:
        InputError: MuJoCo cannot compile the model.
    """
    with mujoco_warnings():
        try:
            return spec.compile()
        except _FAILURES as error:
            line = one_line(error) or "not enough memory"
            raise InputError(f"{where}: MuJoCo cannot use the model: {line}") from None


def check_memory(name: str, xml: str, assets: Mapping[str, bytes]) -> None:
    """Refuse a model that needs too much memory or time to compile.

    A model with elements that can be large is first compiled in another process. The memory of that
    process is limited if the operating system supports this.

    Args:
        name: Name of the robot, for the message.
        xml: Text of the model.
        assets: Content of its assets by name.

    Raises:
        InputError: The model needs too much memory or time.
    """
    if _SIZED.search(xml) and not _fits(xml, tuple(sorted(assets.items()))):
        raise InputError(
            f"robot {name}: the model needs more than {MOST_MEMORY / 2**30:g} GiB of memory or "
            f"{_MOST_SECONDS} s to compile; make its height fields, textures, meshes, 'replicate' "
            "or 'size' smaller"
        )


@lru_cache(maxsize=32)
def _fits(xml: str, assets: tuple[tuple[str, bytes], ...]) -> bool:
    command = [sys.executable, "-c", _COMPILE, str(MOST_MEMORY), str(_MOST_SECONDS)]
    # one heap for all threads, so that the limit counts memory that is used
    environment = os.environ | {"MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command,
        input=pickle.dumps((xml, dict(assets))),
        env=environment,
        capture_output=True,
        check=False,
    )
    return done.returncode == 0


def _copies(element: ElementTree.Element, outside: int) -> int:
    """The largest number of copies that `replicate` makes of any element within an element."""
    if element.tag == "replicate":
        count = element.get("count", "1").strip()
        outside *= max(1, int(count)) if count.isdecimal() else 1
    return max([outside, *(_copies(child, outside) for child in element)])


def _asset_names(root: ElementTree.Element) -> list[str]:
    """Names of the files that a model needs, relative to its own file."""
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
