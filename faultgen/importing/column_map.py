"""columns.toml: what each column of a log means. docs/importing.md describes every entry.

column_map = load_map("columns.toml", preset="ur_rtde")
column_map.position.columns  # "actual_q_{axis}"
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from faultgen.errors import InputError
from faultgen.importing.units import split_unit
from faultgen.system.reading import read_text

AXIS = "{axis}"
"""Stands for the number or name of each axis in patterns of columns."""

QUANTITIES = (
    "position",
    "velocity",
    "torque",
    "current",
    "reference_position",
    "temperature",
)
"""Tables of a map that describe columns of axes."""

QuantityName = Literal[
    "position", "velocity", "torque", "current", "reference_position", "temperature"
]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Side = Literal["motor", "joint"]
Sign = Literal[1, -1]
# tables know their columns without the units in brackets, which a map may repeat
Column = Annotated[str, AfterValidator(lambda name: split_unit(name)[0])]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Quantity(_Part):
    """Columns that hold one quantity of all axes."""

    columns: Column | Annotated[list[Column], Field(min_length=1)]
    """A pattern with {axis}, or one name for each axis. A temperature may have a single column."""
    unit: str | Finite | list[str | Finite] | None = None
    """Unit of the numbers, or of those of each axis. None: as the log states."""
    side: Side | None = None
    """Side of the gearbox. None: that of the map."""
    sign: Sign | list[Sign] = 1
    """-1 where the log counts the other way round than the model."""
    zero: Finite | list[Finite] = 0.0
    """Number in the log, in its own unit, at which the quantity is 0."""
    rated: Finite | list[Finite] | None = None
    """What 100 % is, in [N m], [N] or [A]."""
    bits: Annotated[int, Field(ge=0, le=63, strict=True)] | None = None
    """Bits of words in two's complement that the log has without a sign, such as 16: 65535 is -1.
    0: the numbers are what they are. None: found out."""
    sign_bit: Annotated[int, Field(ge=1, le=62, strict=True)] | None = None
    """Sign bit of words with sign and magnitude, such as 10: 1024 + n is -n."""
    optional: bool = False
    """Whether the quantity is left out, without an error, if the log lacks its columns."""


class File(_Part):
    """How the log is written. Everything is found out where it is not given."""

    format: Literal["auto", "text", "trace", "bag", "ros2", "arrays", "arrow"] = "auto"
    """Text; DIAdem trace (.dat and .r64); ROS bag ("ros2" is an older name); MATLAB or NumPy file;
    Parquet or Feather file."""
    separator: Literal["auto", ",", ";", "tab", "blank"] = "auto"
    """What separates columns of text."""
    decimal: Literal["auto", ".", ","] = "auto"
    """Sign between whole numbers and fractions."""
    comment: str | list[str] = ["#", "%", "//"]
    """Beginnings of lines that are left out."""
    encoding: str = "auto"
    """Encoding of text, such as utf-8 or cp1252."""
    header: Annotated[int, Field(ge=1, strict=True)] | None = None
    """Line with the names of the columns, from 1."""
    first: Annotated[int, Field(ge=1, strict=True)] | None = None
    """Line with the first row of numbers, from 1."""
    missing: list[Finite] | None = None
    """Numbers that stand for a missing value. None: usual ones, such as -9999, far from all others.
    """
    names: Annotated[list[str], Field(min_length=1)] | None = None
    """Names of the columns of a log that does not state them."""
    topic: str | None = None
    """Topic of a ROS bag. None: the only one with joint states."""
    stamp: Literal["auto", "header", "receive"] = "auto"
    """Times of a ROS bag: those in the headers of its messages, or those at which the bag received
    them. "auto": of the headers, unless they have none."""


class Axes(_Part):
    """The axes, from the base to the tool. Numbers hold for each axis, or for all alike."""

    names: Annotated[list[str | int], Field(min_length=1)] | None = None
    """What stands for {axis}. None: the numbers that the columns of position have."""
    sign: Sign | list[Sign] = 1
    """-1 where the axis of the robot turns the other way round than that of the model."""
    gear_ratio: Finite | list[Finite] | None = None
    """Turns of the motor over turns of the joint."""
    torque_constant: Finite | list[Finite] | None = None
    """Torque over current [N m/A], on the side of the current."""
    column: Column | None = None
    """Column that names the joint of each row, if each joint has a row of its own."""


class Time(_Part):
    """When the rows were recorded."""

    column: Column | None = None
    """Column with times."""
    unit: str | Finite | None = None
    """Unit of that column; "iso" for dates or clock times. None: as the log states."""
    columns: dict[QuantityName, Column | list[Column]] | None = None
    """Columns with the times of quantities that have a clock of their own, one for each quantity or
    for each axis. None: the log is refused if it seems to have such."""
    sample_period: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Time between two rows [s], instead of a column."""


class ColumnMap(_Part):
    """The content of a map."""

    preset: str | None = None
    """Name of a preset that this map changes."""
    description: str = ""
    """What the map is for."""
    source: str = ""
    """Where the names and units come from."""
    assumed: str = ""
    """What is assumed without a source."""
    side: Side
    """Side of the gearbox on which the columns were measured, unless they state their own."""
    robot: str = ""
    """Name of the robot, for the recording."""
    payload_mass: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    """[kg]"""
    torque_sensor: Literal["motor", "link"] = "motor"
    """'link' for torque sensors behind the gearbox."""
    file: File = File()
    """How the log is written."""
    axes: Axes = Axes()
    """The axes."""
    time: Time
    """When the rows were recorded."""
    program: Column | None = None
    """Column with the name of the program that runs. It begins a new segment where it changes, and
    one program can be imported alone."""
    segment: Column | None = None
    """Column whose value changes with each separate recording."""
    position: Quantity
    """Positions."""
    velocity: Quantity | None = None
    """Velocities."""
    torque: Quantity | None = None
    """Torques. Where they are there, currents are left out."""
    current: Quantity | None = None
    """Motor currents."""
    reference_position: Quantity | None = None
    """Commanded positions."""
    temperature: Quantity | None = None
    """Temperatures of the gearboxes, or one temperature."""


def preset_names() -> list[str]:
    """Return the names of the presets."""
    folder = files("faultgen.importing") / "presets"
    names = (item.name for item in folder.iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def preset_text(name: str) -> str:
    """Return the map file of a preset.

    Args:
        name: Its name.

    Raises:
        InputError: There is no such preset.
    """
    if name not in preset_names():
        raise InputError(f"preset '{name}': unknown; there are {', '.join(preset_names())}")
    return (files("faultgen.importing") / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def load_map(path: str | Path | None, preset: str | None = None) -> ColumnMap:
    """Read a map.

    Args:
        path: The file, or None for a preset alone.
        preset: Name of a preset, whose entries hold where the file has none.

    Returns:
        The map.

    Raises:
        InputError: The file is wrong, or neither a file nor a preset is given. The message is one
            line that names the entries.
    """
    if path is None and preset is None:
        raise InputError(
            "give --map FILE, which says what the columns mean, or --preset, one of "
            f"{', '.join(preset_names())}, or both"
        )
    if path is None:
        return map_of({}, preset)
    try:
        content = tomllib.loads(read_text(path, "map"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"map {path}: not valid TOML: {error}") from None
    return map_of(content, preset, f"map {path}")


def map_of(content: Mapping[str, Any], preset: str | None = None, where: str = "map") -> ColumnMap:
    """Make a map of the content of a map file.

    Args:
        content: The content.
        preset: Name of a preset, whose entries hold where the content has none.
        where: What the content is, for messages.

    Returns:
        The map.

    Raises:
        InputError: An entry is missing, unknown or wrong.
    """
    preset = preset or content.get("preset")
    if preset is not None:
        content = _merged(_of_preset(str(preset)), content)
        where = f"{where} with preset {preset}"
    try:
        found = ColumnMap.model_validate(dict(content))
    except ValidationError as error:
        wrong = dict.fromkeys(_words(one) for one in error.errors())
        raise InputError(f"{where}: {'; '.join(wrong)}") from None
    if (found.time.column is None) == (found.time.sample_period is None):
        raise InputError(f"{where}: time: give either column or sample_period [s]")
    if found.time.columns and found.time.column is None:
        raise InputError(
            f"{where}: time.columns: also give time.column, the times of the rows, in place of "
            "sample_period"
        )
    for name in QUANTITIES:
        quantity = getattr(found, name)
        if quantity is not None and quantity.bits and quantity.sign_bit is not None:
            raise InputError(f"{where}: {name}: give bits or sign_bit, not both")
        if quantity is None:
            continue
        if found.axes.column is not None:
            if isinstance(quantity.columns, list) or AXIS in quantity.columns:
                raise InputError(
                    f"{where}: {name}.columns: give the name of one column, because each joint has "
                    f"a row of its own (axes.column = '{found.axes.column}')"
                )
        elif (
            isinstance(quantity.columns, str)
            and AXIS not in quantity.columns
            and name != "temperature"
        ):
            raise InputError(
                f"{where}: {name}.columns: '{quantity.columns}' lacks {AXIS}, which stands for the "
                "number of each axis; or list one name for each axis; or, if each joint has a row "
                "of its own, state the column that names the joint as axes.column"
            )
    return found


def _of_preset(name: str) -> dict[str, Any]:
    """The content of a preset, which may change another one."""
    content = tomllib.loads(preset_text(name))
    base = content.pop("preset", None)
    return content if base is None else _merged(_of_preset(base), content)


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(base)
    for key, value in over.items():
        inner = out.get(key)
        # a column of times and a sample period exclude each other
        if isinstance(inner, Mapping) and isinstance(value, Mapping) and key != "time":
            value = _merged(inner, value)
        out[key] = value
    return out


def _words(error: Any) -> str:
    """An error of an entry in words."""
    place = [str(part) for part in error["loc"]]
    if error["type"] == "extra_forbidden":
        model: Any = ColumnMap
        for part in place[:-1]:
            annotation = model.model_fields[part].annotation
            model = next((one for one in get_args(annotation) if one is not type(None)), annotation)
        near = get_close_matches(place[-1], model.model_fields, n=1)
        told = (
            f"did you mean '{near[0]}'?" if near else f"there are {', '.join(model.model_fields)}"
        )
        return f"{'.'.join(place)}: unknown; {told}"
    name = ".".join(place[:2])  # what follows tells between the types that an entry may have
    if error["type"] == "missing":
        remedies = {
            "side": 'state side = "joint" or "motor", where the columns were measured',
            "position": "state its columns and their unit",
            "time": "state its column and unit, or sample_period",
        }
        return f"{name}: missing; {remedies.get(name, 'state it')}"
    text = str(error["msg"])
    return f"{name}: {text[:1].lower() + text[1:]}, not {error['input']!r}"
