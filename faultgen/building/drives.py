"""drives.toml: what a user knows about the drives of an arm, and what was used in the end.

Every entry is optional. `faultgen robot build` writes the file into the folder of the robot with
all numbers; those that were not given stand behind a #, with the reason.

    drives = read_drives(Path("drives.toml"))
    drives.of("elbow_joint")  # {"gear_ratio": 101.0}
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from faultgen.building.drive_numbers import Value
from faultgen.building.masses import Masses
from faultgen.building.quantities import QUANTITIES
from faultgen.errors import InputError, objection
from faultgen.system.reading import read_text

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]

_HEAVIEST = 1e5  # mass that is believed [kg]; the largest arms weigh 10 t
_SMALLEST, _LARGEST = 1e-12, 1e12  # of any number of a drive: its products can still be computed


class Payload(BaseModel):
    """The payload on the flange."""

    model_config = ConfigDict(extra="forbid")

    mass: Annotated[float, Field(ge=0, le=_HEAVIEST, allow_inf_nan=False)] | None = None
    """[kg]; 0: the arm carries nothing, and the body ``payload`` only marks the flange."""
    position: Vector | None = None
    """Centre of mass in the frame of the flange [m]."""
    inertia: Vector | None = None
    """Inertia about the axes of the flange's frame, through the centre of mass [kg m^2]; 0 only for
    a payload without mass."""

    @model_validator(mode="after")
    def _possible(self) -> Payload:
        """Refuse an inertia that does not fit to the mass."""
        least = min(self.inertia or [1.0])
        if least < 0 or (least == 0 and self.mass != 0):
            raise ValueError("inertia: must be above 0, or 0 for a payload with mass = 0")
        if self.mass == 0 and max(self.inertia or [0.0]) > 0:
            raise ValueError("inertia: must be 0 for a payload with mass = 0")
        return self


class Coupling(BaseModel):
    """A gearbox that also turns with another joint."""

    model_config = ConfigDict(extra="forbid")

    gearbox: str
    """Joint whose gearbox it is."""
    joint: str
    """Other joint."""
    factor: Finite
    """The motor turns by gear_ratio times factor when the other joint turns by one."""


class Drives(BaseModel):
    """The content of drives.toml."""

    model_config = ConfigDict(extra="forbid")

    joints: Annotated[list[str], Field(min_length=1)] | None = None
    """Names of the joints that are axes, from the base to the tool. All others are locked."""
    tool: str | None = None
    """Name of the body or site that is the flange."""
    timestep: Positive | None = None
    """Time step [s]."""
    home: list[Finite] | None = None
    """Joint positions from which tasks start, [deg], or [m] for slides."""
    payload: Payload | None = None
    """What the arm carries."""
    mass: float | dict[str, float] | None = None
    """Mass of the arm with its base, or of single links by name [kg]."""
    all: dict[str, Finite] = {}
    """Numbers of the drives of all axes."""
    axis: dict[str, dict[str, Finite]] = {}
    """Numbers of the drive of one axis, by joint."""
    coupling: list[Coupling] = []
    """Gearboxes that also turn with another joint."""

    @field_validator("mass", mode="before")
    @classmethod
    def _positive(cls, mass: Any) -> Any:
        """Refuse masses that are no positive numbers, in one line."""
        for name, value in mass.items() if isinstance(mass, dict) else [("", mass)]:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not 0 < value <= _HEAVIEST:
                which = f"{name}: " if name else ""
                raise ValueError(
                    f"{which}must be a number of kg above 0 and up to {_HEAVIEST:g}, not {value!r}"
                )
        return mass

    def of(self, joint: str) -> dict[str, float]:
        """Return the numbers that are given for the drive of a joint, by name.

        Args:
            joint: Name of the joint.
        """
        return {**self.all, **self.axis.get(joint, {})}


def read_drives(path: Path) -> Drives:
    """Read drives.toml.

    Args:
        path: The file.

    Returns:
        Its content.

    Raises:
        InputError: The file is wrong. The message names all wrong entries, in one line.
    """
    try:
        found = Drives(**tomllib.loads(read_text(path, "drives file")))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"drives file {path}: not valid TOML: {error}") from None
    except ValidationError as error:
        wrong = [f"{'.'.join(map(str, one['loc']))}: {_words(one)}" for one in error.errors()]
        raise InputError(f"drives file {path}: {'; '.join(wrong)}") from None
    wrong = []
    for where, numbers in (("all", found.all), *((f"axis.{k}", v) for k, v in found.axis.items())):
        wrong += [f"{where}.{name}: {_objection(name, value)}" for name, value in numbers.items()]
    wrong = [line for line in wrong if not line.endswith(": ")]
    if wrong:
        raise InputError(f"drives file {path}: {'; '.join(wrong)}")
    return found


def _words(error: object) -> str:
    kind, text = error["type"], str(error["msg"])  # type: ignore[index]
    if kind != "extra_forbidden":
        return objection(kind, text)
    if len(error["loc"]) == 1:  # type: ignore[index]
        return f"unknown; the file has {', '.join(Drives.model_fields)}"
    return "unknown"


def _objection(name: str, value: float) -> str:
    quantities = {quantity.name: quantity for quantity in QUANTITIES}
    if name not in quantities:
        return f"unknown; a drive has {', '.join(quantities)}"
    if value and not _SMALLEST <= abs(value) <= _LARGEST:
        return f"must be between {_SMALLEST:g} and {_LARGEST:g} in size, not {value:g}"
    if name == "gear_ratio":
        return "" if value else "must not be 0"
    if quantities[name].zero:
        return "" if value >= 0 else f"must not be negative, not {value:g}"
    return "" if value > 0 else f"must be positive, not {value:g}"


def check_names(drives: Drives, joints: Sequence[str]) -> None:
    """Refuse drives of joints that an arm does not have.

    Args:
        drives: The drives.
        joints: Names of the axes.

    Raises:
        InputError: A name is unknown, or a list has another length than there are axes.
    """
    wrong = [f"axis.{name}" for name in drives.axis if name not in joints]
    for one in drives.coupling:
        wrong += [f"coupling: '{k}'" for k in (one.gearbox, one.joint) if k not in joints]
        if one.gearbox == one.joint:
            raise InputError(f"drives: coupling: '{one.joint}' cannot be coupled to itself")
    if wrong:
        raise InputError(
            f"drives: {', '.join(wrong)}: no such axis; the arm has {', '.join(joints)}"
        )
    if drives.home is not None and len(drives.home) != len(joints):
        raise InputError(f"drives: home: needs {len(joints)} positions, not {len(drives.home)}")


def drives_text(
    name: str,
    joints: Sequence[str],
    values: Sequence[dict[str, Value]],
    general: Sequence[tuple[str, str, Value | None]],
    payload: dict[str, tuple[str, Value]],
    couplings: Sequence[Coupling],
) -> str:
    """Return the text of drives.toml with all numbers that were used.

    Args:
        name: Name of the robot.
        joints: Names of the axes.
        values: Numbers of the drive of each axis, by name.
        general: Key, text of the value, and source of the other entries.
        payload: Text of the value and source of the entries of the payload.
        couplings: Gearboxes that also turn with another joint.
    """
    units = {quantity.name: quantity.unit for quantity in QUANTITIES}
    lines = [
        f"# The drives of {name}: every number that its model has.",
        "# A line that begins with # was not given. To state the number yourself, remove the #,",
        "# change the number, and run 'faultgen robot build' again with this file. The numbers",
        "# that remain behind a # are then determined anew. Numbers of a similar arm (--like) are",
        "# without #, so that they stay.",
        "",
    ]
    lines += [
        _line(key, text, source, "kg" if key.startswith("mass") else "")
        for key, text, source in general
    ]
    lines += ["", "[payload]"]
    lines += [_line(key, text, source, "") for key, (text, source) in payload.items()]
    for joint, numbers in zip(joints, values, strict=True):
        lines += ["", f"[axis.{_key(joint)}]"]
        lines += [_line(k, _number(v.value), v, units[k]) for k, v in numbers.items()]
    for one in couplings:
        lines += ["", "[[coupling]]", f"gearbox = {json.dumps(one.gearbox)}"]
        lines += [f"joint = {json.dumps(one.joint)}", f"factor = {_number(one.factor)}"]
    return "\n".join(lines) + "\n"


def mass_entries(masses: Masses) -> list[tuple[str, str, Value | None]]:
    """Return the entries of drives.toml for the masses of the links, as `drives_text` takes them.

    Args:
        masses: What was used for links that state no mass.
    """
    entries: list[tuple[str, str, Value | None]] = []
    if masses.total is not None:
        entries.append(("mass", _number(masses.total), Value(0, "given")))
    for name, one in masses.values.items():
        if name != "payload":  # which has a table of its own
            entries.append((f"mass.{_key(name)}", _number(one.value), one))
    return entries


def _key(name: str) -> str:
    plain = name.replace("-", "").replace("_", "").isalnum() and name.isascii()
    return name if plain else json.dumps(name)


def _number(value: float) -> str:
    return repr(float(value))


def _line(key: str, text: str, value: Value | None, unit: str) -> str:
    if value is None:
        return f"{key} = {text}"
    unit = f"[{unit}] " if unit else ""
    if value.source == "given":
        return f"{key} = {text}  # {unit}given"
    if value.source == "like":  # not behind a #, so that it stays when the robot is built again
        return f"{key} = {text}  # {unit}{value.why}"
    origin = (
        f"assumed: {value.why}" if value.source == "assumed" else f"from the model: {value.why}"
    )
    return f"# {key} = {text}  # {unit}{origin}"
