"""The plan of a fleet, which is a TOML file. Every entry has a default.

A range is a list of two numbers. The value of each robot is drawn from between them.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from faultgen.errors import InputError, objection
from faultgen.robot import robot_names
from faultgen.tasks import task_names


def _ordered(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError("the first number must not be larger than the second")
    return value


Share = Annotated[float, Field(ge=0, le=1)]
Size = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Range = Annotated[tuple[Size, Size], AfterValidator(_ordered)]
Shares = Annotated[tuple[Share, Share], AfterValidator(_ordered)]
Counts = Annotated[
    tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]], AfterValidator(_ordered)
]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Production(_Section):
    """When robots run, and how warm the hall is."""

    shifts: Counts = (1, 3)
    """Number of shifts of 8 h on each day; at most 3."""
    duty: Shares = (0.5, 0.95)
    """Share of a shift in which programs run."""
    weekend: Shares = (0.2, 1.0)
    """Duty at the weekend divided by that of other days."""
    ambient: Annotated[tuple[float, float], AfterValidator(_ordered)] = (18.0, 30.0)
    """Mean temperature of the hall [deg C]."""
    samples_a_day: Counts = (1, 4)
    """Number of samples that the monitoring stores on each day."""


class Programs(_Section):
    """What robots do."""

    tasks: Annotated[list[str], Field(min_length=1)] = ["arc_weld", "pick_and_place", "spot_weld"]
    """Tasks from which programs are drawn. Every model must have each of them."""
    number: Counts = (1, 3)
    """Number of programs of a robot. Each is a task of its model, moved to another place."""
    shift: Size = 8.0
    """Standard deviation of the angles by which a program shifts the joints of its task [deg]."""
    speed: Shares = (0.5, 1.0)
    """Speed override; 1 is full speed."""
    payload: Range = (0.6, 1.0)
    """Mass of the payload divided by its nominal mass."""
    parts: Size = 0.05
    """Standard deviation of the payload's mass from day to day, as a fraction of the mass."""
    mix: Size = 60.0
    """How constant the shares of the programs are from day to day; concentration of the Dirichlet
    distribution from which they are drawn."""
    change: Size = 90.0
    """Mean time after which the shares of the programs change lastingly [d]; 0 means never."""


class Scatter(_Section):
    """How robots of one model differ: standard deviations as fractions of the nominal values."""

    coulomb: Size = 0.15
    viscous: Size = 0.2
    rotor_inertia: Size = 0.03
    lubricant: Size = 0.03
    """Standard deviation of the friction from day to day, independent for each axis."""
    ageing: Size = 0.1
    """Increase of friction by the ageing of the lubricant between two services."""
    service: Size = 200.0
    """Mean time between services, in which the lubricant is replaced [d]; 0 means no services."""


class Damage(_Section):
    """How a gearbox fails; see docs/fleet.md."""

    life: Range = (120.0, 600.0)
    """Time from the first damage to the failure [d]."""
    shape: Range = (2.0, 5.0)
    """Exponent of the law of growth; the larger it is, the later the damage grows."""
    friction: Range = (0.6, 1.6)
    """Increase of friction at failure as a fraction of the nominal friction."""
    backlash: Range = (0.001, 0.004)
    """Backlash at failure, measured at the joint [rad]."""
    ripple: Range = (0.01, 0.04)
    """Torque ripple at failure as a fraction of the largest motor torque."""
    unsteadiness: Size = 0.5
    """Standard deviation of the visible damage from day to day as a fraction of the damage."""


class Ageing(_Section):
    """How one gearbox of each robot that does not fail ages; see docs/fleet.md."""

    hours: Size = 40_000.0
    """Life of such a gearbox in hours of operation [h]; 0 means that healthy robots do not age."""
    age: Shares = (0.0, 0.8)
    """Share of that life that is over when the record ends."""


class FleetPlan(_Section):
    """The plan of a fleet: number of robots, days and models, and a section for each topic."""

    seed: Annotated[int, Field(ge=0)] = 0
    robots: Annotated[int, Field(ge=1, le=999)] = 26
    failing: Annotated[int, Field(ge=0)] = 13
    days: Annotated[int, Field(ge=2, le=2000)] = 60
    models: Annotated[list[str], Field(min_length=1)] = ["irb6700", "puma560"]
    torque_noise: Size = 0.01
    """Standard deviation of the white torque noise as a fraction of the mean |torque| of the
    axis."""
    production: Production = Production()
    programs: Programs = Programs()
    scatter: Scatter = Scatter()
    damage: Damage = Damage()
    ageing: Ageing = Ageing()

    @model_validator(mode="after")
    def _check(self) -> FleetPlan:
        if self.failing > self.robots:
            raise InputError(
                f"failing: must be at most the number of robots, which is {self.robots}, "
                f"not {self.failing}"
            )
        unknown = [name for name in self.models if name not in robot_names()]
        if unknown:
            raise InputError(f"models: unknown '{unknown[0]}': choose {', '.join(robot_names())}")
        for model in self.models:
            known = task_names(model)
            for task in self.programs.tasks:
                if task not in known:
                    raise InputError(
                        f"programs.tasks: {model} has no '{task}': choose {', '.join(known)}"
                    )
        if self.programs.speed[0] < 0.1:
            raise InputError("programs.speed: a speed override must be at least 0.1")
        if self.production.shifts[1] > 3:
            raise InputError("production.shifts: a day has at most 3 shifts of 8 h")
        if self.production.duty[0] <= 0:
            raise InputError("production.duty: must be above 0")
        return self

    @property
    def sha256(self) -> str:
        """Hash of all entries of the plan."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def load_fleet(path: str | Path) -> FleetPlan:
    """Read the plan of a fleet.

    Args:
        path: The TOML file.

    Returns:
        The plan.

    Raises:
        InputError: The file cannot be read, or one of its entries is wrong.
    """
    path = Path(path)
    try:
        return parse_fleet(path.read_text(), path.name)
    except (OSError, UnicodeDecodeError) as error:
        told = error.strerror if isinstance(error, OSError) else "not text"
        raise InputError(f"fleet file {path}: cannot be read ({told})") from None


def parse_fleet(text: str, name: str) -> FleetPlan:
    """Make the plan of a fleet from TOML text.

    Args:
        text: The TOML text.
        name: Name of the file, for error messages.

    Returns:
        The plan.

    Raises:
        InputError: The text is not valid TOML, or one of its entries is wrong.
    """
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"fleet file {name}: not valid TOML: {error}") from None
    try:
        return make_fleet_plan(values)
    except InputError as error:
        raise InputError(f"fleet file {name}: {error}") from None


def make_fleet_plan(values: Mapping[str, Any]) -> FleetPlan:
    """Make the plan of a fleet from its entries.

    Args:
        values: Entries by name. Sections are mappings, too.

    Returns:
        The plan.

    Raises:
        InputError: An entry is wrong. The message says which.
    """
    try:
        return FleetPlan(**values)
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"{part}." for part in first["loc"]).rstrip(".")
        said = objection(first["type"], first["msg"])
        raise InputError(f"{where}: {said}" if where else said) from None
