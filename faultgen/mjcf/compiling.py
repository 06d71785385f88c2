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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from faultgen.errors import InputError
from faultgen.system.reading import read_bytes, read_text

MOST_MEMORY = 2 * 2**30
"""Largest memory that compiling a model may use [bytes]."""

MOST_COPIES = 10_000
"""Largest number of copies that the `replicate` elements of a model may make of a body."""

_MOST_SECONDS = 120  # of processor time, for compiling
_LARGEST_ASSET = 512 * 2**20  # [bytes]
_SIZED = re.compile(  # elements that can take far more memory than their text
    r"<(size|hfield|texture|mesh|skin|replicate|composite|flexcomp|flex|plugin)\b"
)

# Compiles the model that comes on stdin. Exit status 3: it takes too much memory or time.
_COMPILE = """
import pickle, sys
import mujoco
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


def read_mjcf(path: Path) -> tuple[str, dict[str, bytes]]:
    """Read a model from an MJCF file.

    Args:
        path: The file.

    Returns:
        Its text, in which the content of included files replaces the `include` elements, and the
        content of its assets by the name that MuJoCo asks for. An asset that does not exist is left
        out, so that MuJoCo reports it.

    Raises:
        InputError: A file cannot be read or is too large, a file includes itself, elements are
            nested too deeply, another model is attached, or `replicate` makes too many copies.
    """
    where = f"robot file {path}"
    xml = read_text(path, "robot file")
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        return xml, {}  # MuJoCo reports what is wrong, and with it the line
    try:
        if root.find(".//include") is not None:
            _include(root, path.parent, (path.resolve(),), where)
            xml = ElementTree.tostring(root, encoding="unicode")
        copies = _copies(root, 1)
    except RecursionError:
        raise InputError(f"{where}: its elements are nested too deeply") from None
    if root.find("asset/model") is not None:
        raise InputError(
            f"{where}: attaches another model (<asset><model>), which is not supported; "
            "put both into one file"
        )
    if copies > MOST_COPIES:
        raise InputError(f"{where}: 'replicate' makes {copies} copies, more than {MOST_COPIES}")
    assets = {}
    for name in _asset_names(root):
        file = path.parent / name
        if os.path.exists(file):
            assets[name] = read_bytes(file, f"{where}: asset", _LARGEST_ASSET)
    return xml, assets


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


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings in a list instead of writing them to stderr and a log file.

    Yields:
        The list, to which the warnings are added.
    """
    caught: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(caught.append)
    try:
        yield caught
    finally:
        mujoco.set_mju_user_warning(before)


def _include(
    element: ElementTree.Element, folder: Path, above: tuple[Path, ...], where: str
) -> None:
    """Replace the `include` elements by the content of the files that they include."""
    for index in reversed(range(len(element))):
        child = element[index]
        if child.tag != "include":
            _include(child, folder, above, where)
            continue
        file = folder / child.get("file", "")
        if file.resolve() in above:
            raise InputError(f"{where}: {file.name} includes itself")
        try:
            included = ElementTree.fromstring(read_text(file, f"{where}: included file"))
        except ElementTree.ParseError as error:
            raise InputError(f"{where}: included file {file}: not valid XML: {error}") from None
        _include(included, folder, (*above, file.resolve()), where)
        element[index : index + 1] = list(included)


def _copies(element: ElementTree.Element, outside: int) -> int:
    """The largest number of copies that `replicate` makes of any element within an element."""
    if element.tag == "replicate":
        count = element.get("count", "1").strip()
        outside *= max(1, int(count)) if count.isdecimal() else 1
    return max([outside, *(_copies(child, outside) for child in element)])


def _asset_names(root: ElementTree.Element) -> list[str]:
    """Names of the files that a model needs, relative to its own file."""
    compiler: dict[str, str] = {}
    for one in root.findall("compiler"):
        compiler |= one.attrib
    anything = compiler.get("assetdir", "")
    names = []
    for element in root.iter():
        if element.tag not in ("mesh", "hfield", "skin", "texture", "flexcomp"):
            continue
        kind = "texturedir" if element.tag == "texture" else "meshdir"
        for attribute, value in element.attrib.items():
            if attribute.startswith("file"):
                file = Path(value).name if compiler.get("strippath") == "true" else value
                names.append(os.path.join(compiler.get(kind, anything), file))
    return names
