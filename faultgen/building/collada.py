"""Collada meshes (.dae), which MuJoCo does not read, as STL or OBJ.

name, content = converted("link1.dae", data, "robot file arm.urdf: mesh")

The library trimesh with pycollada reads them; it is the extra ``meshes`` of faultgen.
"""

from __future__ import annotations

import io
from pathlib import PurePath
from typing import Any

import numpy as np

from faultgen.errors import InputError, one_line

ENDING = ".dae"
HINT = "Collada meshes (.dae) need the extra 'meshes': pip install 'faultgen[meshes]'"
"""What a user has to do to get these meshes."""

_MOST_FACES = 200_000  # of an STL file that MuJoCo reads


def is_there() -> bool:
    """Tell whether the libraries that read Collada are installed."""
    from importlib.util import find_spec

    return find_spec("trimesh") is not None and find_spec("collada") is not None


def converted(name: str, content: bytes, what: str) -> tuple[str, bytes]:
    """Convert a Collada file to a format that MuJoCo reads.

    All parts of the file become one mesh, in metres. The file's own statement which axis points up
    is not used, as in ROS.

    Args:
        name: Name of the file.
        content: Its content.
        what: What it is, for messages.

    Returns:
        Name and content of an STL file, or of an OBJ file if it has many faces.

    Raises:
        InputError: The file cannot be read, or holds no faces.
    """
    import trimesh

    try:
        scene: Any = trimesh.load_scene(io.BytesIO(content), file_type="dae")
        mesh = scene.to_mesh()
        scale = _unit(content)
    except Exception as error:  # of any of the libraries
        raise InputError(f"{what} {name}: cannot be read as Collada: {one_line(error)}") from None
    if not len(getattr(mesh, "faces", ())):
        raise InputError(f"{what} {name}: holds no faces; remove it from the model")
    mesh.apply_transform(np.diag([scale, scale, scale, 1.0]))
    kind = "stl" if len(mesh.faces) <= _MOST_FACES else "obj"
    made = mesh.export(file_type=kind)
    return PurePath(name).stem + f".{kind}", made.encode() if isinstance(made, str) else made


def _unit(content: bytes) -> float:
    """Length of one unit of a Collada file [m]."""
    import collada

    return float(collada.Collada(io.BytesIO(content), ignore=[Exception]).assetInfo.unitmeter or 1)
