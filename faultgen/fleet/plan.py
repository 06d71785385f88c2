"""What a fleet is: a TOML file, every entry with a default.

A range is a list of two numbers, from which each robot draws its own.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from faultgen.errors import InputError
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
    """When robots run, and how warm it is around them."""

    shifts: Counts = (1, 3)
    """Of 8 h a day; at most 3."""
    duty: Shares = (0.5, 0.95)
    """Share of a shift in which programs run."""
    weekend: Shares = (0.2, 1.0)
    """Duty at the weekend over that of other days."""
    ambient: Annotated[tuple[float, float], AfterValidator(_ordered)] = (18.0, 30.0)
    """Mean temperature of the hall [deg C]."""
    samples_a_day: Counts = (1, 4)
    """Records that the monitoring stores."""


class Programs(_Section):
    """What robots do."""

    tasks: Annotated[list[str], Field(min_length=1)] = ["arc_weld", "pick_and_place", "spot_weld"]
    """That programs are drawn from; every model must have each."""
    number: Counts = (1, 3)
    """Programs of a robot; each is a task of its model at another place."""
    shift: Size = 8.0
    """Spread of the joint angles by which a program is elsewhere than its task [deg]."""
    speed: Shares = (0.5, 1.0)
    """Speed override."""
    payload: Range = (0.6, 1.0)
    """Mass over the nominal one."""
    parts: Size = 0.05
    """Spread of the payload from day to day, over its mass."""
    mix: Size = 60.0
    """How constant the shares of the programs are from day to day (Dirichlet)."""
    change: Size = 90.0
    """Mean time between changes of the mix [d]; 0: none."""


class Scatter(_Section):
    """How robots of a model differ; standard deviations over the nominal values."""

    coulomb: Size = 0.15
    viscous: Size = 0.2
    rotor_inertia: Size = 0.03
    lubricant: Size = 0.03
    """Friction from day to day, of each axis by itself."""
    ageing: Size = 0.1
    """Friction that a lubricant gains between two services."""
    service: Size = 200.0
    """Mean time between services, which bring new lubricant [d]; 0: none."""


class Damage(_Section):
    """How a gearbox fails; see docs/fleet.md."""

    life: Range = (120.0, 600.0)
    """From the first damage to failure [d]."""
    shape: Range = (2.0, 5.0)
    """How late damage grows: exponent of the law."""
    friction: Range = (0.6, 1.6)
    """Friction that is gained at failure, over the nominal one."""
    backlash: Range = (0.001, 0.004)
    """Play at failure, joint side [rad]."""
    ripple: Range = (0.01, 0.04)
    """Torque ripple at failure, over the largest motor torque."""
    unsteadiness: Size = 0.5
    """Spread of the damage that shows from day to day, over the damage."""


class Ageing(_Section):
    """How one gearbox of each robot that does not fail ages; see docs/fleet.md."""

    hours: Size = 40_000.0
    """Operation that such a gearbox lasts [h]; 0: healthy robots do not age."""
    age: Shares = (0.0, 0.8)
    """Share of that life that is over when the record ends."""


class FleetPlan(_Section):
    """A fleet."""

    seed: Annotated[int, Field(ge=0)] = 0
    robots: Annotated[int, Field(ge=1, le=999)] = 26
    failing: Annotated[int, Field(ge=0)] = 13
    days: Annotated[int, Field(ge=2, le=2000)] = 60
    models: Annotated[list[str], Field(min_length=1)] = ["irb6700", "puma560"]
    torque_noise: Size = 0.01
    """White, over the mean |torque| of each axis."""
    production: Production = Production()
    programs: Programs = Programs()
    scatter: Scatter = Scatter()
    damage: Damage = Damage()
    ageing: Ageing = Ageing()

    @model_validator(mode="after")
    def _check(self) -> FleetPlan:
        if self.failing > self.robots:
            raise InputError(f"failing: at most the {self.robots} robots, not {self.failing}")
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
            raise InputError("programs.speed: an override must be at least 0.1")
        if self.production.shifts[1] > 3:
            raise InputError("production.shifts: at most 3 of 8 h a day")
        if self.production.duty[0] <= 0:
            raise InputError("production.duty: must be above 0")
        return self

    @property
    def sha256(self) -> str:
        """Hash of all that it says."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def load_fleet(path: str | Path) -> FleetPlan:
    """Read the plan of a fleet.

    Raises:
        InputError: It cannot be read, or an entry is wrong.
    """
    path = Path(path)
    try:
        return parse_fleet(path.read_text(), path.name)
    except (OSError, UnicodeDecodeError) as error:
        told = error.strerror if isinstance(error, OSError) else "not text"
        raise InputError(f"fleet file {path}: cannot be read ({told})") from None


def parse_fleet(text: str, name: str) -> FleetPlan:
    """The plan that a TOML text tells.

    Raises:
        InputError: It is not TOML, or an entry is wrong.
    """
    try:
        return FleetPlan(**tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"fleet file {name}: not valid TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"{part}." for part in first["loc"]).rstrip(".")
        said = first["msg"].removeprefix("Value error, ")
        told = f"{where}: {said}" if where else said
        raise InputError(f"fleet file {name}: {told}") from None
