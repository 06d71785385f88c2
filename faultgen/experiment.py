"""An experiment: which runs a dataset consists of.

An experiment is a TOML file; every entry that is swept takes one value or a list.

    experiment = load_experiment("experiment.toml")
    runs = plan_runs(experiment)
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from faultgen.effects import HEALTHY, get_effect
from faultgen.errors import InputError
from faultgen.machine import check_axis
from faultgen.robot import Robot, load_robot
from faultgen.sensors import get_sensors
from faultgen.simulate import decimation
from faultgen.tasks import load_task
from faultgen.wear import severities

SCHEMA_VERSION = 1
"""Version of the layout of run files."""

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
"""Sampled signals that a run file can hold; `signals` as measured, `truth` as simulated."""


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _places(value: Any) -> Any:
    """Names as they are, and paths in full, so that they hold in every folder."""
    return [
        str(Path(item).resolve()) if isinstance(item, str) and Path(item).is_file() else item
        for item in _listed(value)
    ]


def _axes(value: Any) -> Any:
    """[1, [2, 3]] to [[1], [2, 3]]."""
    return [_listed(item) for item in _listed(value)]


Axes = Annotated[list[int], Field(min_length=1)]
Names = Annotated[list[str], BeforeValidator(_listed), Field(min_length=1)]
Places = Annotated[list[str], BeforeValidator(_places), Field(min_length=1)]
Severity = Annotated[float, Field(ge=0, allow_inf_nan=False)]


Numbers = dict[str, int | float | str]


class Beside(BaseModel):
    """Another effect that grows beside that of a run, by the same schedule."""

    model_config = ConfigDict(extra="forbid", strict=True)

    effect: str
    """Name from the catalogue."""
    severity: float
    """When the effect of the run has its final severity."""
    axis: int | None = None
    """From 1; default: the axes of the run."""
    parameters: Numbers = {}
    """Of this effect."""


class Experiment(BaseModel):
    """What a dataset is made of: every combination of robot, task, effect, axis and severity."""

    model_config = ConfigDict(extra="forbid", strict=True)

    robot: Places
    """Names of robots, or paths of MJCF files."""
    task: Places
    """Names of tasks, or paths of task files; each must exist for each robot."""
    effect: Names = ["friction_wear"]
    """Names from the catalogue; 'healthy' is the robot without a fault."""
    axis: Annotated[list[Axes], BeforeValidator(_axes), Field(min_length=1)] = [
        [1],
        [2],
        [3],
        [4],
        [5],
        [6],
    ]
    """Axes that wear, one run each, from 1; a list within the list wears at once."""
    severity: Annotated[list[Severity], BeforeValidator(_listed), Field(min_length=1)] = [0.2]
    """Final severities."""
    schedule: str | list[Severity] = "exponential"
    """Name of a wear schedule, or the severity of each cycle."""
    cycles: Annotated[int, Field(ge=1, le=1_000_000)] = 100
    """Cycles a run."""
    parameters: dict[str, Numbers] = {}
    """Further numbers of effects, by name of the effect, as [parameters.torque_ripple]."""
    beside: list[Beside] = []
    """Effects that every faulty run has too, as [[beside]]."""
    healthy: bool = True
    """Also run the healthy robot, once for each robot, task and seed."""
    sensors: str = "none"
    """Preset of noise and disturbance."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the first repetition; the next ones count up."""
    repetitions: Annotated[int, Field(ge=1)] = 1
    """How often everything is repeated with another seed."""
    paired: bool = True
    """Give a faulty run the seed of the healthy one, so that wear is all that tells them apart;
    false draws a seed for each run."""
    sample_period: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.004
    """Time between samples [s]."""
    signals: Literal["all", "none"] | list[str] = "all"
    """Which sampled signals are kept in the files."""
    thin: Annotated[int, Field(ge=1)] = 1
    """Keep every so many-th sample in the files; reductions use all."""

    @model_validator(mode="after")
    def _check(self) -> Experiment:
        if not isinstance(self.schedule, str):
            if "severity" in self.model_fields_set:
                raise InputError("severity: an array as schedule has the severities; leave it out")
            self.severity = self.schedule[-1:]
        warms = get_sensors(self.sensors).temperature_wander > 0
        highest = max(self.severity, default=0.0)
        if not isinstance(self.schedule, str):
            highest = max(self.schedule, default=0.0)
        for name in self.effect:
            if name != HEALTHY and highest > get_effect(name).largest:
                effect = get_effect(name)
                raise InputError(
                    f"severity: {name} takes up to {effect.largest:g} ({effect.unit}), "
                    f"not {highest:g}"
                )
            if name != HEALTHY and "temperature" in get_effect(name).parameters and not warms:
                raise InputError(
                    f"effect: {name} needs a temperature that changes, which sensors "
                    f"'{self.sensors}' do not have; choose realistic"
                )
        self._check_parameters()
        severities(self.schedule, 0.0, self.cycles)
        for name in self.kept_signals:
            if name not in SIGNALS:
                raise InputError(f"signals: unknown '{name}': choose {', '.join(SIGNALS)}")
        if len(set(self.kept_signals)) < len(self.kept_signals):
            raise InputError("signals: the same name twice")
        return self

    def _check_parameters(self) -> None:
        for name, values in self.parameters.items():
            if name not in self.effect:
                raise InputError(f"parameters: '{name}' is no effect of this experiment")
            get_effect(name).complete(values)
        for one in self.beside:
            effect = get_effect(one.effect)
            effect.complete(one.parameters)
            if not 0 <= one.severity <= effect.largest:
                raise InputError(
                    f"beside: {one.effect} takes 0 to {effect.largest:g} ({effect.unit}), "
                    f"not {one.severity:g}"
                )

    @property
    def kept_signals(self) -> tuple[str, ...]:
        """Names of the signals kept."""
        if self.signals == "all":
            return SIGNALS
        return () if self.signals == "none" else tuple(self.signals)


@dataclass(frozen=True, kw_only=True)
class Run:
    """The parameters of one run; with the model and the task they decide every byte of its file."""

    robot: str
    task: str
    effect: str
    axes: tuple[int, ...]
    severity: float
    schedule: str | tuple[float, ...]
    cycles: int
    sensors: str
    seed: int
    sample_period: float
    signals: tuple[str, ...]
    thin: int
    parameters: tuple[tuple[str, int | float | str], ...] = ()
    """Of the effect, where they are not its defaults."""
    beside: tuple[tuple[str, int, float, tuple[tuple[str, int | float | str], ...]], ...] = ()
    """Effect, axis, final severity and parameters of those that grow beside it."""
    model_sha256: str
    task_sha256: str
    schema_version: int = SCHEMA_VERSION

    @property
    def id(self) -> str:
        """Hash of the parameters, 16 hex digits; where robot and task are stored does not count."""
        told = {k: v for k, v in asdict(self).items() if v or k not in ("parameters", "beside")}
        told |= {"robot": Path(self.robot).stem, "task": Path(self.task).stem}
        text = json.dumps(told, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def label(self) -> str:
        """The run in a few words."""
        fault = HEALTHY
        if self.axes:
            axes = "+".join(map(str, self.axes))
            fault = f"{self.effect} {self.severity:g} on axis {axes}"
            fault += "".join(f" + {name} {s:g} on axis {a}" for name, a, s, _ in self.beside)
        return f"{Path(self.robot).stem} {Path(self.task).stem} {fault} seed {self.seed}"


def load_experiment(path: str | Path) -> Experiment:
    """Read an experiment file.

    Raises:
        InputError: The file cannot be read, or says something wrong.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"experiment file {path}: cannot be read ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"experiment file {path}: not valid TOML: {error}") from None
    return make_experiment(content, where=f"experiment file {path}: ")


def make_experiment(content: dict[str, Any], *, where: str = "") -> Experiment:
    """Validate the content of an experiment.

    Args:
        content: Entries by name.
        where: Start of the error message.

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
    """The experiment as TOML, every entry written out."""
    entries = experiment.model_dump()
    if not isinstance(experiment.schedule, str):
        del entries["severity"]  # the array has it
    parameters, beside = entries.pop("parameters"), entries.pop("beside")
    lines = [f"{name} = {json.dumps(value)}" for name, value in entries.items()]
    if parameters:
        lines.append(f"parameters = {_inline(parameters)}")
    if beside:
        lines.append(f"beside = [{', '.join(map(_inline, beside))}]")
    return "\n".join(lines) + "\n"


def _inline(value: Any) -> str:
    """A TOML value; tables in one line, without what is None."""
    if isinstance(value, dict):
        kept = (f"{key} = {_inline(one)}" for key, one in value.items() if one is not None)
        return f"{{{', '.join(kept)}}}"
    return json.dumps(value)


def plan_runs(experiment: Experiment) -> list[Run]:
    """All runs of an experiment, without repetition, in a fixed order.

    Raises:
        InputError: A robot, task or axis does not exist, or the sample period does not fit.
    """
    runs: dict[str, Run] = {}
    for robot_name in experiment.robot:
        robot = load_robot(robot_name)
        decimation(robot.model.opt.timestep, experiment.sample_period)
        _check_axes(experiment, robot)
        for task_name in experiment.task:
            task = load_task(robot.name, task_name)
            digest = hashlib.sha256(task.model_dump_json().encode()).hexdigest()
            for repetition in range(experiment.repetitions):
                for effect, axes, severity in _faults(experiment):
                    seed = experiment.seed + repetition
                    if axes and not experiment.paired:
                        seed = _own_seed(seed, robot.name, task.name, effect, axes, severity)
                    schedule = experiment.schedule
                    run = Run(
                        robot=robot_name,
                        task=task_name,
                        effect=effect,
                        axes=axes,
                        severity=severity,
                        schedule=schedule if isinstance(schedule, str) else tuple(schedule),
                        cycles=experiment.cycles,
                        sensors=experiment.sensors,
                        seed=seed,
                        sample_period=experiment.sample_period,
                        signals=experiment.kept_signals,
                        thin=experiment.thin,
                        parameters=tuple(sorted(experiment.parameters.get(effect, {}).items())),
                        beside=_beside(experiment, axes),
                        model_sha256=robot.sha256,
                        task_sha256=digest,
                    )
                    runs.setdefault(run.id, run)
    return list(runs.values())


def _faults(experiment: Experiment) -> list[tuple[str, tuple[int, ...], float]]:
    """(effect, axes, severity) of every run; severity 0 is the healthy robot."""
    healthy = (HEALTHY, (), 0.0)
    faults: list[tuple[str, tuple[int, ...], float]] = [healthy] if experiment.healthy else []
    for effect in experiment.effect:
        for axes in experiment.axis:
            for severity in experiment.severity:
                worn = effect != HEALTHY and (
                    severity > 0 or not isinstance(experiment.schedule, str)
                )
                fault = (effect, tuple(sorted(axes)), float(severity)) if worn else healthy
                if fault not in faults:
                    faults.append(fault)
    return faults


def _beside(
    experiment: Experiment, axes: tuple[int, ...]
) -> tuple[tuple[str, int, float, tuple[tuple[str, int | float | str], ...]], ...]:
    """What grows beside the effect of a run; nothing in a healthy one."""
    return tuple(
        (one.effect, axis, one.severity, tuple(sorted(one.parameters.items())))
        for one in experiment.beside
        for axis in ((one.axis,) if one.axis is not None and axes else axes)
    )


def _check_axes(experiment: Experiment, robot: Robot) -> None:
    for one in experiment.beside:
        for axis in [one.axis] if one.axis is not None else sum(experiment.axis, []):
            check_axis(get_effect(one.effect), axis, robot)
    for axes in experiment.axis:
        for axis in axes:
            if not 1 <= axis <= robot.n_axes:
                raise InputError(
                    f"axis {axis}: robot {robot.name} has axes 1 to {robot.n_axes} "
                    f"(for the healthy robot alone: effect {HEALTHY})"
                )
            for name in experiment.effect:
                if name != HEALTHY:
                    check_axis(get_effect(name), axis, robot)
        if len(set(axes)) != len(axes):
            raise InputError(f"axis {axes}: the same axis twice")


def _own_seed(*parts: Any) -> int:
    digest = hashlib.sha256(json.dumps(parts).encode()).digest()
    return int(np.frombuffer(digest[:4], np.uint32)[0])
