"""Names of the robots that come with the package. They are known without loading a simulator."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path

from faultgen.errors import InputError


def robot_names() -> list[str]:
    """Names of the robots that come with the package."""
    folder = resources.files("faultgen.robots")
    return sorted(f.name for f in folder.iterdir() if f.joinpath(f"{f.name}.xml").is_file())


def check_robot(name_or_path: str | Path) -> None:
    """Refuse what is neither the name of a robot nor an existing path.

    Args:
        name_or_path: One of `robot_names`, or a path.

    Raises:
        InputError: There is no such robot.
    """
    known = robot_names()
    if str(name_or_path) not in known and not os.path.exists(name_or_path):
        raise InputError(
            f"unknown robot '{name_or_path}': choose {', '.join(known)}, or give the path of an "
            "MJCF file or of a robot's folder"
        )
