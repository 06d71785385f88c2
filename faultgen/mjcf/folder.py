"""A robot as a folder: its MJCF file, its assets, its tasks, and effects that MJCF cannot express.

=================  ================================================================================
``model.xml``      the MJCF file, with everything that MJCF can express
``robot.json``     the robot's name, and the effects that act outside of the model file
``tasks/``         optional: task files of this robot (TOML), which are then known by name
``origin/``        optional: the user's MJCF or URDF file from which the robot was built, as text
``checksums.txt``  checksums of these files, if faultgen has written the folder
=================  ================================================================================

    write_folder(Path("out/model"), "puma560", xml, assets, effects, tasks, origin)
    name, xml, assets, effects, tasks, origin = read_folder(Path("out/model"))
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from faultgen.applied import Applied, from_json, to_json
from faultgen.errors import InputError
from faultgen.mjcf.compiling import read_mjcf
from faultgen.mjcf.edit import write_model
from faultgen.system.files import write_text
from faultgen.system.reading import read_text
from faultgen.system.sums import add_sums, check_listed

MODEL, EFFECTS, TASKS, ORIGIN = "model.xml", "robot.json", "tasks", "origin"
"""Names of the two files of a robot's folder, and of the folders of its tasks and of the file from
which it was built."""

_KEYS = ("format", "name", "effects")
_FORMAT = 1


def write_folder(
    folder: Path,
    name: str,
    xml: str,
    assets: Mapping[str, bytes],
    effects: Sequence[Applied],
    tasks: Mapping[str, str],
    origin: Mapping[str, str],
) -> None:
    """Write a robot into a folder.

    Args:
        folder: The folder. It is created if it does not exist.
        name: Name of the robot, by which its tasks are found.
        xml: Text of the model.
        assets: Content of the files that the model refers to, by path relative to the model.
        effects: Effects that MJCF cannot express.
        tasks: Text of the robot's own task files, by name.
        origin: Text of the user's file from which the robot was built, by its name; or empty.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = write_model(folder / MODEL, xml, assets)
    content = {"format": _FORMAT, "name": name, "effects": to_json(effects)}
    texts = {EFFECTS: json.dumps(content, indent=1, allow_nan=False) + "\n"}
    if tasks:
        (folder / TASKS).mkdir(exist_ok=True)
    texts |= {f"{TASKS}/{task}.toml": text for task, text in tasks.items()}
    if origin:
        (folder / ORIGIN).mkdir(exist_ok=True)
    texts |= {f"{ORIGIN}/{file}": text for file, text in origin.items()}
    for file, text in texts.items():
        write_text(folder / file, text)
        written[file] = text.encode()
    add_sums(folder, written)


Content = tuple[str, str, dict[str, bytes], tuple[Applied, ...], dict[str, str], dict[str, str]]
"""Name, text of the model, assets by path, effects, text of the task files by name, and text of the
file from which it was built by name."""


def read_folder(folder: Path, folders: Sequence[Path] = ()) -> Content:
    """Read a robot from a folder.

    A folder without ``robot.json`` is read if it has an MJCF file of its own name, as the folders
    of the robots that come with faultgen do.

    Args:
        folder: The folder.
        folders: Further folders whose files the model may use.

    Returns:
        Name of the robot, text of its model, content of its assets by path, its effects, the text
        of its own task files by name, and that of the file from which it was built.

    Raises:
        InputError: The folder holds no robot, or a file is damaged. The message is one line.
    """
    plain = folder / f"{folder.resolve().name}.xml"
    if not (folder / EFFECTS).exists() and plain.is_file():
        return plain.stem, *read_mjcf(plain, folders), (), _tasks(folder), {}
    for name in (EFFECTS, MODEL):
        if not (folder / name).exists():
            raise InputError(
                f"robot folder {folder}: has no {name}; give the folder 'model' that "
                "'faultgen discover' writes, a folder that 'faultgen robot build' writes, or the "
                "path of an MJCF file"
            )
    file = folder / EFFECTS
    text = read_text(file, "robot file", compared=False)
    content = _parsed(text, file)
    if not isinstance(content, dict) or sorted(content) != sorted(_KEYS):
        raise InputError(f"robot file {file}: damaged: it must have {', '.join(_KEYS)}")
    if content["format"] != _FORMAT:
        raise InputError(
            f"robot file {file}: has format {content['format']}, but this version of faultgen "
            f"reads format {_FORMAT}"
        )
    if not isinstance(content["name"], str) or not content["name"]:
        raise InputError(f"robot file {file}: damaged: 'name' must be a text")
    try:
        effects = from_json(content["effects"])
    except InputError as error:
        raise InputError(f"robot file {file}: damaged: {error}") from None
    check_listed(file, text.encode())  # last, because the other messages say more
    model = read_mjcf(folder / MODEL, folders)
    return content["name"], *model, effects, _tasks(folder), _origin(folder)


def _tasks(folder: Path) -> dict[str, str]:
    files = sorted((folder / TASKS).glob("*.toml"))
    return {file.stem: read_text(file, "task file") for file in files}


def _origin(folder: Path) -> dict[str, str]:
    files = sorted((folder / ORIGIN).glob("*"))
    files = [file for file in files if file.is_file() and file.suffix in (".xml", ".urdf")]
    return {file.name: read_text(file, "robot file") for file in files[:1]}


def _parsed(text: str, file: Path) -> Any:
    def refuse(value: str) -> None:
        raise ValueError(f"{value} is not a number")

    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"robot file {file}: damaged: not valid JSON ({error})") from None
