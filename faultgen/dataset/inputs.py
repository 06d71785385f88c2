"""Copies of a user's own files, in the folder of the dataset that was made from them.

Isolators and reports need the healthy robot, its task and its sensors. Those that do not come with
faultgen are files, which may change, or may not exist on the machine of another user. A dataset
therefore keeps a copy of each: ``inputs/<checksum>/<name>``. The checksums of all these files are
in ``inputs/sha256sums``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from faultgen.errors import InputError
from faultgen.system.files import file_sha256, write_text
from faultgen.system.reading import read_text
from faultgen.system.sums import sums_text

if TYPE_CHECKING:
    from faultgen.dataset.planning import Run

INPUTS = "inputs"
"""Name of the folder with the copies."""

SUMS = "sha256sums"
"""Name of the file in it with a checksum of every other file, as `sha256sum` writes it."""

_DIGITS = 16  # of a checksum in the name of a folder
_CHECKSUMS = {"robot": "model_sha256", "task": "task_sha256", "sensors": "sensors_sha256"}


def keep_inputs(folder: Path, runs: Iterable[Run]) -> None:
    """Copy the files from which runs are made, unless they come with faultgen or are there.

    Args:
        folder: Folder of the dataset.
        runs: The runs.

    Raises:
        InputError: A file can no longer be read.
        StorageFailed: A copy cannot be written.
    """
    # imported here because `damaged_inputs` serves readers, which need no simulator
    from faultgen.monitoring.sensors import SENSORS
    from faultgen.robot import load_robot, robot_names

    robots, files = {}, {}
    for run in runs:
        if run.robot not in robot_names():
            robots[_copy(folder, run.model_sha256, Path(run.robot).stem)] = run.robot
        if os.path.isfile(run.task):
            files[_copy(folder, run.task_sha256, Path(run.task).name)] = run.task
        if run.sensors not in SENSORS:
            files[_copy(folder, run.sensors_sha256, Path(run.sensors).name)] = run.sensors
    copies = [*robots, *files]
    if not copies or all(copy.exists() for copy in copies) and not damaged_inputs(folder):
        return
    for copy, robot in robots.items():
        load_robot(robot).write(copy)
    for copy, file in files.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        write_text(copy, read_text(file, "file"))
    write_text(folder / INPUTS / SUMS, sums_text(_sums(folder / INPUTS)))


def damaged_inputs(folder: Path) -> dict[str, str]:
    """Find copies that are damaged or missing. All of them are read.

    Args:
        folder: Folder of the dataset.

    Returns:
        Reasons by file name, relative to the folder; empty if nothing is damaged, or if the dataset
        has no copies.
    """
    home = folder / INPUTS
    if not home.is_dir():
        return {}
    there = _sums(home)
    try:
        text = (home / SUMS).read_bytes().decode(errors="replace")
    except OSError as error:
        return {f"{INPUTS}/{SUMS}": f"cannot be read ({error.strerror})"}
    if text == sums_text(there):
        return {}
    lines = [line.partition("  ") for line in text.splitlines()]
    told = {name: checksum for checksum, _, name in lines}
    reasons = {
        f"{INPUTS}/{name}": "is missing" if name not in there else "differs from its checksum"
        for name in told.keys() | there.keys()
        if told.get(name) != there.get(name)
    }
    return dict(sorted(reasons.items())) or {f"{INPUTS}/{SUMS}": "is not as it was written"}


def _sums(home: Path) -> dict[str, str]:
    """Checksums of all finished files in a folder, by their path in it."""
    return {
        path.relative_to(home).as_posix(): file_sha256(path)
        for path in sorted(home.rglob("*"))
        if path.is_file() and path.name != SUMS and not path.name.endswith(".tmp")
    }


def input_path(folder: Path, planned: Mapping[str, Any], what: str) -> str:
    """Return where a file from which a run was made is now.

    Args:
        folder: Folder of the dataset.
        planned: Parameters of the run, from the list of runs.
        what: "robot", "task" or "sensors".

    Returns:
        The path or name that the run was given. If there is nothing any more, or something else, it
        is the path of the copy, if there is one.
    """
    given, checksum = str(planned[what]), str(planned.get(_CHECKSUMS[what], ""))
    copy = _copy(folder, checksum, Path(given).stem if what == "robot" else Path(given).name)
    if not checksum or not copy.exists():
        return given
    if what == "robot":
        same = _is_robot(Path(given), checksum)
    else:
        same = os.path.isfile(given) and Path(given).read_bytes() == copy.read_bytes()
    return given if same else str(copy)


def existing_input(path: str, what: str) -> str:
    """Return the path or name of a file from which a run was made, if it is there.

    Args:
        path: From `input_path`.
        what: "robot", "task" or "sensors", for the message.

    Returns:
        The path or name.

    Raises:
        InputError: The file is gone, and the dataset has no copy of it.
    """
    if os.path.isabs(path) and not os.path.exists(path):
        raise InputError(
            f"{path}: the {what} from which the dataset was made is no longer there, and there is "
            f"no copy of it in {INPUTS}/ beside the dataset"
        )
    return path


def _copy(folder: Path, checksum: str, name: str) -> Path:
    return folder / INPUTS / checksum[:_DIGITS] / name


def _is_robot(path: Path, checksum: str) -> bool:
    """Whether there is the robot that has a checksum."""
    from faultgen.robot import load_robot

    try:
        return load_robot(path).sha256 == checksum
    except InputError:
        return False
