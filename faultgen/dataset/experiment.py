"""An experiment: which runs a dataset consists of.

An experiment is a TOML file. An entry such as robot, task, effect, axis or severity holds one value
or a list of values, and the dataset has a run for every combination of these values.

    experiment = load_experiment("experiment.toml")
"""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from faultgen.dataset.entries import (
    Axes,
    Mass,
    Names,
    Places,
    Severities,
    Severity,
    Speed,
    Temperature,
    Windows,
    absolute,
    kind_of,
    several,
    to_axes,
    to_severities,
)
from faultgen.dataset.severity import check_largest, check_severity, default_severity
from faultgen.dataset.wear import severities
from faultgen.effects import HEALTHY, get_effect
from faultgen.effects.base import DEFAULT_FRACTION
from faultgen.errors import InputError
from faultgen.monitoring.sensors import get_sensors, sensors_of
from faultgen.simulation.operation import Operation
from faultgen.system.reading import read_text

SIGNALS = (
    "signals/motor_position",
    "signals/motor_velocity",
    "signals/motor_torque",
    "truth/motor_velocity",
    "truth/motor_torque",
    "truth/friction_torque",
    "truth/gear_torque",
    "truth/joint_position",
    "truth/joint_velocity",
)
"""Sampled signals that a run file can hold. Those in `signals` include the noise of the sensors;
those in `truth` are free of it."""


SPREADS = {
    "parameters": 0.5,
    "masses": 0.3,
    "servo": 0.5,
    "noise": 2.0,
    "payload": 0.5,
    "temperature": 20.0,
}
"""What `randomize` can vary, and the largest spread of each, with which three standard deviations
are still a robot: a factor of 4.5, 2.5 for masses and 400 for noise, and 60 K; assumed."""

MOST_RUNS = 100_000
"""Largest number of runs that a dataset may have; a larger one is made in parts."""

MOST_REPETITIONS = 1_000_000_000
"""Largest number of repetitions of all parts of a dataset together."""

LARGEST_SEED = 2**63 - 1
"""Largest seed that run files can store."""


def check_seed(seed: int, repetitions: int = 1) -> None:
    """Refuse a seed that cannot be used.

    Args:
        seed: The first seed.
        repetitions: Number of seeds that follow each other.

    Raises:
        InputError: The first seed is negative, or the last one is above `LARGEST_SEED`.
    """
    if seed < 0:
        raise InputError(f"seed: must be at least 0, not {seed}")
    if seed + repetitions - 1 > LARGEST_SEED:
        raise InputError(f"seed: must be at most {LARGEST_SEED + 1 - repetitions}, not {seed}")


def check_part(number: int, count: int) -> None:
    """Refuse a part that cannot be.

    Args:
        number: Number of the part, from 1.
        count: Number of all parts.

    Raises:
        InputError: There is no such part.
    """
    if not 1 <= number <= count:
        raise InputError(f"part: must be K/N with K from 1 to N, not {number}/{count}")


Numbers = dict[str, int | float | str]


class Beside(BaseModel):
    """A further effect in every faulty run. It grows by the same schedule as the main effect."""

    model_config = ConfigDict(extra="forbid", strict=True)

    effect: str
    """Name of the effect in the catalogue."""
    severity: float
    """Severity of this effect when the main effect of the run has its final severity."""
    axis: int | None = None
    """Axis on which it acts, from 1. Default: the axes on which the main effect acts."""
    parameters: Numbers = {}
    """Parameters of this effect that differ from their defaults."""


class Experiment(BaseModel):
    """The runs of a dataset: every combination of the entries that may have several values."""

    model_config = ConfigDict(extra="forbid", strict=True)

    robot: Places
    """Names of robots, or paths of MJCF files."""
    task: Places
    """Names of tasks, or paths of task files. Each task must exist for each robot."""
    effect: Names = ["friction_wear"]
    """Names of effects in the catalogue. 'healthy' stands for the robot without a fault."""
    axis: Annotated[list[Axes], BeforeValidator(to_axes), Field(min_length=1)] | None = None
    """Axes that wear, from 1. There is one run for each entry; an entry that is itself a list names
    axes that wear at the same time. Default: every axis of the robot on which the effect can
    act."""
    severity: Annotated[
        Annotated[Severities, Tag("list")] | Annotated[dict[str, Severities], Tag("table")],
        Discriminator(kind_of),
        BeforeValidator(to_severities),
    ] = [DEFAULT_FRACTION]
    """Final severities, in the unit of the effect: one list for all effects, or a table with a list
    for each effect. Default: 0.2 for an effect whose severity is a fraction of the nominal value,
    else the effect's own default."""
    schedule: str | list[Severity] = "exponential"
    """Name of a wear schedule, or the severity of each cycle."""
    cycles: Annotated[int, Field(ge=1, le=1_000_000)] = 100
    """Number of cycles in each run."""
    parameters: dict[str, Numbers] = {}
    """Parameters of effects that differ from their defaults, by name of the effect; in TOML a table
    such as [parameters.torque_ripple]."""
    beside: list[Beside] = []
    """Further effects that every faulty run has; in TOML one table [[beside]] for each."""
    speed: Annotated[list[Speed] | None, BeforeValidator(several)] = None
    """Speed overrides, above 0 and up to 1. All runs are made at each of them. Default: 1."""
    payload: Annotated[list[Mass] | None, BeforeValidator(several)] = None
    """Masses of the payload [kg], which the controller knows. All runs are made with each of them.
    Default: that of the model."""
    temperature: Annotated[list[Temperature] | None, BeforeValidator(several)] = None
    """Mean temperatures of the gearboxes [deg C]. All runs are made at each of them. Default: that
    at which the friction of the model holds."""
    healthy: bool = True
    """Whether there is also a run of the healthy robot for each robot, task, speed, payload,
    temperature and seed."""
    sensors: Annotated[str, BeforeValidator(absolute)] = "none"
    """Preset of sensor noise and disturbances, or the path of a sensors file. Default: the sensors
    in the robot's folder, if it has any, otherwise "none"."""
    seed: int = 0
    """Seed of the first repetition. Each further repetition uses the next number."""
    repetitions: Annotated[int, Field(ge=1, le=MOST_REPETITIONS)] = 1
    """Number of times that all runs are made, each time with another seed."""
    part: Annotated[list[int], Field(min_length=2, max_length=2)] | None = None
    """[K, N]: only the K-th of N parts of the repetitions. `faultgen generate --part K/N --keep
    merged` writes this entry. Default: all repetitions."""
    paired: bool = False
    """Give every run of a repetition the same seed. A faulty run and its healthy twin then share
    noise, temperature and payload, and differ only by the fault. Default: every run has a seed of
    its own, so that a method that learns from the data cannot recognise runs by their noise."""
    randomize: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = {}
    """Spreads with which each run gets a robot of its own, such as {parameters = 0.03}; see
    `faultgen.dataset.instance`. The nominal robot is that of the controller. Default: all runs have
    the nominal robot."""
    sample_period: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.004
    """Time between samples [s]."""
    fidelity: Literal["stepped", "interpolated"] = "stepped"
    """How cycles are made. "stepped" simulates every one. "interpolated" simulates some conditions
    of each run and computes the cycles between them, which takes much less time; their error is
    measured and stored. A run is refused if it exceeds a tenth of the torque noise."""
    signals: Literal["all", "none"] | list[str] = "all"
    """Which sampled signals are kept in the files."""
    thin: Annotated[int, Field(ge=1)] = 1
    """Keep only every n-th sample in the files, n being this number. The reductions always use all
    samples."""
    speed_window: Windows | None = None
    """Range of motor speeds [rad/s]; `mean_abs_torque` uses the samples within it. Give [low, high]
    for all axes, or one pair for each axis. Default: 50 to 120. For an axis that never turns so
    fast in the task, the default is 0.5 to 1.2 times the highest speed that it reaches."""

    @model_validator(mode="after")
    def _check(self) -> Experiment:
        own = sensors_of(self.robot)
        if "sensors" not in self.model_fields_set and own is not None:
            self.sensors = own
        sensors = get_sensors(self.sensors)
        if "sample_period" not in self.model_fields_set and sensors.sample_period is not None:
            self.sample_period = sensors.sample_period
        if self.fidelity == "interpolated" and sensors.run_to_run:
            raise InputError(
                f"fidelity: with sensors '{self.sensors}' the healthy robot differs from cycle to "
                "cycle in too many ways to be interpolated; use 'stepped'"
            )
        if not isinstance(self.schedule, str):
            if "severity" in self.model_fields_set:
                raise InputError(
                    "severity: leave it out, because the schedule is an array and already gives "
                    "the severities"
                )
            self.severity = self.schedule[-1:] or [0.0]
        effects = {name: get_effect(name) for name in self.faults}
        if isinstance(self.schedule, str) and "severity" not in self.model_fields_set:
            self.severity = default_severity(effects)
        check_severity(effects, self.severity, self.schedule)
        warms = sensors.temperature_wander > 0 or self.temperature is not None
        for name in self.faults:
            if "temperature" in get_effect(name).parameters and not warms:
                raise InputError(
                    f"effect: {name} needs a temperature that changes, but it does not change with "
                    f"sensors '{self.sensors}'; choose sensors 'realistic', or give a temperature"
                )
        self._check_parameters()
        severities(self.schedule, 0.0, self.cycles)
        for name in self.kept_signals:
            if name not in SIGNALS:
                raise InputError(f"signals: unknown '{name}': choose {', '.join(SIGNALS)}")
        if len(set(self.kept_signals)) < len(self.kept_signals):
            raise InputError("signals: the same name is given twice")
        for low, high in self.speed_window or []:
            if not low < high:
                raise InputError(f"speed_window: must be [low, high], not [{low:g}, {high:g}]")
        check_seed(self.seed, self.repetitions)
        self._check_part()
        self._check_randomize()
        for name in ("speed", "payload", "temperature"):
            values = getattr(self, name)
            if values is not None and len(set(values)) < max(len(values), 1):
                raise InputError(f"{name}: give each value once, and at least one")
        return self

    def _check_part(self) -> None:
        if self.part is None:
            return
        number, count = self.part
        check_part(number, count)
        if count > self.repetitions:
            raise InputError(
                f"part: {count} parts need at least {count} repetitions, because each part has "
                f"repetitions of its own, and the experiment has {self.repetitions}"
            )

    def _check_randomize(self) -> None:
        for name, spread in self.randomize.items():
            if name not in SPREADS:
                raise InputError(f"randomize: unknown '{name}': choose {', '.join(SPREADS)}")
            if spread > SPREADS[name]:
                raise InputError(
                    f"randomize: {name} must be at most {SPREADS[name]:g}, not {spread:g}"
                )
        if self.randomize and self.fidelity == "interpolated":
            raise InputError(
                "randomize: each run has a robot of its own, so that no cycles can be "
                "interpolated; use fidelity 'stepped'"
            )

    def _check_parameters(self) -> None:
        for name, values in self.parameters.items():
            if name not in self.effect:
                raise InputError(
                    f"parameters: '{name}' is not among the effects of this experiment"
                )
            get_effect(name).complete(values)
        for one in self.beside:
            effect = get_effect(one.effect)
            effect.complete(one.parameters)
            what = f"beside: the severity of {one.effect}"
            if not one.severity >= 0:
                raise InputError(f"{what} must be at least 0, not {one.severity:g}")
            check_largest(what, effect, one.severity)

    @property
    def own_repetitions(self) -> range:
        """The repetitions that are made, from 0: all of them, or those of the part."""
        number, count = self.part or (1, 1)
        return range((number - 1) * self.repetitions // count, number * self.repetitions // count)

    @property
    def operations(self) -> list[Operation]:
        """Every combination of speed, payload and temperature."""
        default: list[float | None] = [None]
        values = (self.speed or default, self.payload or default, self.temperature or default)
        return [Operation(*one) for one in itertools.product(*values)]

    @property
    def faults(self) -> list[str]:
        """Names of all effects of the experiment except 'healthy'."""
        return [name for name in self.effect if name != HEALTHY]

    def severities_of(self, effect: str) -> list[float]:
        """Final severities of an effect, in its unit."""
        if isinstance(self.severity, dict):
            return self.severity[effect]
        return self.severity

    @property
    def kept_signals(self) -> tuple[str, ...]:
        """Names of the sampled signals that the run files keep."""
        if self.signals == "all":
            return SIGNALS
        return () if self.signals == "none" else tuple(self.signals)


def load_experiment(path: str | Path) -> Experiment:
    """Read an experiment file.

    Args:
        path: The TOML file.

    Returns:
        The experiment.

    Raises:
        InputError: The file cannot be read, or one of its entries is unknown, missing or wrong.
    """
    try:
        content = tomllib.loads(read_text(path, "experiment file"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"experiment file {path}: not valid TOML: {error}") from None
    return make_experiment(content, where=f"experiment file {path}: ")


def make_experiment(content: dict[str, Any], *, where: str = "") -> Experiment:
    """Make an experiment from its entries, and check them.

    Args:
        content: Values of the entries by name, as in an experiment file.
        where: Text that error messages begin with, such as the name of the file.

    Returns:
        The experiment.

    Raises:
        InputError: An entry is unknown, missing or wrong.
    """
    try:
        return Experiment(**content)
    except ValidationError as error:
        # a schedule is a name or a list: of the two reasons the last one is that of the list
        first = error.errors()[-1 if error.errors()[0]["loc"][:1] == ("schedule",) else 0]
        name = ".".join(str(part) for part in first["loc"][:1]) or "experiment"
        if first["type"] == "extra_forbidden":
            known = ", ".join(Experiment.model_fields)
            raise InputError(f"{where}unknown entry '{name}': choose {known}") from None
        given = "" if first["type"] == "missing" else f", not {first['input']!r}"
        said = first["msg"].removeprefix("Value error, ").replace(" after validation, not 0", "")
        if first["type"] == "value_error":
            raise InputError(f"{where}{said}") from None
        raise InputError(f"{where}{name}: {said[0].lower()}{said[1:]}{given}") from None


def to_toml(experiment: Experiment) -> str:
    """Write an experiment as TOML text.

    Every entry is written out, also where it has its default value. Only the defaults that depend
    on the robot, such as the axes, are left out.
    """
    entries = experiment.model_dump(exclude_none=True)
    if not isinstance(experiment.schedule, str):
        del entries["severity"]  # the array has it
    return tomli_w.dumps(entries)
