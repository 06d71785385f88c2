"""Copies of a user's own files, in the folder of the dataset that was made from them.

Isolators and reports need the healthy robot, its task and its sensors. Those that do not come with
faultgen are files, which may change, or may not exist on the machine of another user. A dataset
therefore keeps a copy of each: ``inputs/<checksum>/<name>``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from faultgen.dataset.planning import Run
from faultgen.errors import InputError
from faultgen.monitoring.sensors import SENSORS
from faultgen.robot import load_robot, robot_names
from faultgen.system.files import write_text
from faultgen.system.reading import read_text

INPUTS = "inputs"
"""Name of the folder with the copies."""

_DIGITS = 16  # of a checksum in the name of a folder
_CHECKSUMS = {"robot": "model_sha256", "task": "task_sha256", "sensors": "sensors_sha256"}


def keep_inputs(folder: Path, runs: Iterable[Run]) -> None:
    """Copy the files from which runs are made, unless they come with faultgen or are there.

    Args:
        folder: Folder of the dataset.
        runs: The runs.

    Raises:
        InputError: A robot's file can no longer be read.
        StorageFailed: A copy cannot be written.
    """
    robots = {(run.robot, run.model_sha256) for run in runs if run.robot not in robot_names()}
    for given, checksum in robots:
        copy = _copy(folder, checksum, Path(given).stem)
        if not _is_robot(copy, checksum):
            load_robot(given).write(copy)
    files = {(run.task, run.task_sha256) for run in runs if os.path.isfile(run.task)}
    files |= {(run.sensors, run.sensors_sha256) for run in runs if run.sensors not in SENSORS}
    for given, checksum in files:
        copy = _copy(folder, checksum, Path(given).name)
        text = read_text(given, "file")
        if not copy.is_file() or copy.read_text(encoding="utf-8") != text:
            copy.parent.mkdir(parents=True, exist_ok=True)
            write_text(copy, text)


def found_inputs(folder: Path, planned: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a run with the paths at which its files are now.

    Args:
        folder: Folder of the dataset.
        planned: Parameters of the run, from the list of runs.

    Returns:
        The same parameters. A path at which there is nothing any more, or something else, is
        replaced by that of the copy, if there is one.
    """
    found = dict(planned)
    for what, checksum in _CHECKSUMS.items():
        given, told = str(planned[what]), str(planned.get(checksum, ""))
        name = Path(given).stem if what == "robot" else Path(given).name
        copy = _copy(folder, told, name)
        if not told or not copy.exists():
            continue
        if what == "robot":
            same = _is_robot(Path(given), told)
        else:
            same = os.path.isfile(given) and Path(given).read_bytes() == copy.read_bytes()
        if not same:
            found[what] = str(copy)
    return found


def _copy(folder: Path, checksum: str, name: str) -> Path:
    return folder / INPUTS / checksum[:_DIGITS] / name


def _is_robot(path: Path, checksum: str) -> bool:
    """Whether there is the robot that has a checksum."""
    try:
        return load_robot(path).sha256 == checksum
    except InputError:
        return False
