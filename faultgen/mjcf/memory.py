"""Models that would take too much memory or time to compile are refused before it happens.

check_memory("arm", xml, assets)
"""

from __future__ import annotations

import os
import pickle
import re
import struct
import subprocess
import sys
from collections.abc import Mapping
from functools import lru_cache

from faultgen.errors import InputError
from faultgen.mjcf.parsing import parse_xml, whole_number

MOST_MEMORY = 2 * 2**30
"""Largest memory that compiling a model may use [bytes]."""

MOST_CELLS = 2**25
"""Largest number of points of all pictures, or of all height fields: 5793 by 5793 in one. A copy of
them then takes some 100 MB; a small file can state far more, because it is compressed."""

_PNG = b"\x89PNG\r\n\x1a\n"
_GRIDS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol")}
_MOST_SECONDS = 120  # of processor time, for compiling
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
    _check_cells(name, "pictures", sum(_pixels(content) for content in assets.values()))
    if _SIZED.search(xml) and not _fits(xml, tuple(sorted(assets.items()))):
        raise InputError(
            f"robot {name}: the model needs more than {MOST_MEMORY / 2**30:g} GiB of memory or "
            f"{_MOST_SECONDS} s to compile; make its height fields, textures, meshes, 'replicate' "
            "or 'size' smaller"
        )

    grids = [one for one in parse_xml(xml, f"robot {name}").iter() if one.tag in _GRIDS]
    cells = [[whole_number(one.get(key, "0")) for key in _GRIDS[one.tag]] for one in grids]
    _check_cells(name, "textures and height fields", sum(a * b for a, b in cells))


def _check_cells(name: str, what: str, cells: int) -> None:
    if cells > MOST_CELLS:
        raise InputError(
            f"robot {name}: its {what} have {cells} points, more than {MOST_CELLS}; make them "
            "smaller"
        )


def _pixels(content: bytes) -> int:
    """Number of pixels that the head of a PNG file states; 0 for other files."""
    if not content.startswith(_PNG) or len(content) < 24:
        return 0
    width, height = struct.unpack(">II", content[16:24])
    return int(width * height)


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
