"""The runs of an experiment, and their checks before anything is simulated or written.

runs = plan_runs(load_experiment("experiment.toml"))
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.building.resonance import largest_step, zero_pose
from faultgen.dataset.experiment import MOST_RUNS, Experiment
from faultgen.dataset.faults import beside_of, list_faults, window_of
from faultgen.dataset.manifest import SCHEMA_VERSION
from faultgen.effects import HEALTHY, Applied
from faultgen.errors import InputError, one_line
from faultgen.monitoring.reductions import SPEED_WINDOW
from faultgen.monitoring.sensors import SENSORS, get_sensors
from faultgen.robot import load_robot
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.operation import Operation
from faultgen.simulation.plant import assemble
from faultgen.simulation.stepping import decimation
from faultgen.tasks import load_task

_OPTIONAL = (
    "parameters",
    "beside",
    "speed_window",
    "sensors_sha256",
    "speed",
    "payload",
    "temperature",
    "interpolated",
    "randomize",
)  # not in the id of a run without them


@dataclass(frozen=True, kw_only=True)
class Run:
    """The parameters of one run.

    Together with the model and the task, they determine every byte of the run's file.
    """

    robot: str
    """Name of the robot, or path of its MJCF file."""
    task: str
    """Name of the task, or path of its file."""
    effect: str
    """Name of the main effect; 'healthy' if there is none."""
    axes: tuple[int, ...]
    """Axes on which the main effect acts, from 1; empty for the healthy robot."""
    severity: float
    """Final severity of the main effect, in its unit."""
    schedule: str | tuple[float, ...]
    """Name of the wear schedule, or the severity of each cycle."""
    cycles: int
    """Number of cycles."""
    sensors: str
    """Name of the preset of sensor noise and disturbances."""
    seed: int
    """Seed of all random numbers of the run."""
    sample_period: float
    """Time between samples [s]."""
    signals: tuple[str, ...]
    """Names of the sampled signals that the file keeps."""
    thin: int
    """The file keeps only every n-th sample, n being this number."""
    parameters: tuple[tuple[str, int | float | str], ...] = ()
    """Parameters of the effect that differ from their defaults."""
    beside: tuple[Applied, ...] = ()
    """The further effects in the run, with their final severities."""
    speed_window: tuple[tuple[float, float], ...] = ()
    """Low and high motor speed of each axis [rad/s]; empty for the task's default."""
    speed: float | None = None
    """Speed override; None: 1."""
    payload: float | None = None
    """Mass of the payload [kg]; None: that of the model."""
    temperature: float | None = None
    """Mean temperature of the gearboxes [deg C]; None: that at which the model's friction holds."""
    interpolated: bool = False
    """Whether cycles are interpolated between simulated ones."""
    randomize: tuple[tuple[str, float], ...] = ()
    """Spreads with which the robot of the run is drawn; empty for the nominal robot."""
    model_sha256: str
    """Hash of the robot's model."""
    task_sha256: str
    """Hash of the task's file."""
    sensors_sha256: str = ""
    """Hash of the sensors' file; empty for a preset."""
    schema_version: int = SCHEMA_VERSION
    """Version of the layout of the file."""

    @property
    def id(self) -> str:
        """Hash of the parameters, 16 hexadecimal digits.

        It does not depend on the folders in which the files of the robot and the task are stored.
        """
        told = {
            k: v for k, v in asdict(self).items() if v or k not in _OPTIONAL
        } | self.operation.given
        told |= {"robot": Path(self.robot).stem, "task": Path(self.task).stem}
        told["sensors"] = Path(self.sensors).stem
        if self.beside:
            told["beside"] = [
                (one.effect, one.axis, one.severity, sorted(one.parameters.items()))
                for one in self.beside
            ]
        text = json.dumps(told, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def operation(self) -> Operation:
        """Speed, payload and temperature."""
        return Operation(self.speed, self.payload, self.temperature)

    @property
    def own_faults(self) -> list[Applied]:
        """The main effect on each of its axes, with its final severity."""
        own = dict(self.parameters)
        return [Applied(self.effect, axis, self.severity, own) for axis in self.axes]

    @property
    def faults(self) -> list[Applied]:
        """Every fault of the run with its final severity: the main effect and the further ones."""
        return [*self.own_faults, *self.beside]

    @property
    def label(self) -> str:
        """A short description of the run for messages."""
        fault = HEALTHY
        if self.axes:
            axes = "+".join(map(str, self.axes))
            fault = f"{self.effect} {self.severity:g} on axis {axes}"
            fault += "".join(
                f" + {one.effect} {one.severity:g} on axis {one.axis}" for one in self.beside
            )
        operated = f" at {self.operation}" if self.operation.given else ""
        return f"{Path(self.robot).stem} {Path(self.task).stem}{operated} {fault} seed {self.seed}"


def plan_runs(experiment: Experiment) -> list[Run]:
    """List all runs of an experiment in a fixed order, each of them once.

    Args:
        experiment: The experiment.

    Returns:
        The runs.

    Raises:
        InputError: A robot, task or axis does not exist, an effect cannot act on it, a severity is
            too large for it, the sample period does not fit, or there are too many runs.
    """
    runs: dict[str, Run] = {}
    first = True
    schedule = experiment.schedule
    sensors, noise = get_sensors(experiment.sensors), ""
    if experiment.sensors not in SENSORS:
        noise = sensors.sha256
    for robot_name in experiment.robot:
        robot = load_robot(robot_name)
        decimation(robot.model.opt.timestep, experiment.sample_period)
        sensors.check_axes(robot.n_axes, experiment.sensors)
        faults = list_faults(experiment, robot)
        window = window_of(experiment, robot)
        operations = experiment.operations
        repetitions = experiment.own_repetitions
        count = len(faults) * len(repetitions) * len(experiment.task) * len(operations)
        if count > MOST_RUNS:
            raise InputError(
                f"experiment: has {count} runs, but a dataset can have at most {MOST_RUNS}; make "
                "it in parts with --part 1/N --keep merged, and so on"
            )
        for task_name in experiment.task:
            task = load_task(robot.name, task_name, robot.tasks)
            digest = task.sha256
            every = itertools.product(operations, repetitions, faults)
            for operation, repetition, (effect, axes, severity) in every:
                seed = experiment.seed + repetition
                # the healthy runs of the first robot, task and operation have the seeds as given
                if not experiment.paired and (axes or not first or operation != operations[0]):
                    own = [robot.sha256, digest, effect, axes, severity]
                    seed = _own_seed(seed, *own, *([operation.given] if operation.given else []))
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
                    beside=beside_of(experiment, axes),
                    speed_window=window,
                    speed=operation.speed,
                    payload=operation.payload,
                    temperature=operation.temperature,
                    interpolated=experiment.fidelity == "interpolated",
                    randomize=tuple(sorted(experiment.randomize.items())),
                    model_sha256=robot.sha256,
                    task_sha256=digest,
                    sensors_sha256=noise,
                )
                runs.setdefault(run.id, run)
            first = False
    return list(runs.values())


def _own_seed(*parts: Any) -> int:
    """A seed for one run alone. It has 53 bits, which every reader of JSON keeps exactly."""
    digest = hashlib.sha256(json.dumps(parts).encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 11


def check_runs(runs: Sequence[Run]) -> list[str]:
    """Check runs by planning their motions and putting their faults into the robot.

    Args:
        runs: All runs of a dataset.

    Returns:
        Lines for the user, at most one for each robot and task. A line names the axes that never
        turn within the speed window, and states what is done about them.

    Raises:
        InputError: The robot cannot do a task, a fault cannot be put into the robot, or no more
            than one sample of a cycle would be kept.
    """
    notes = []
    kinds = {(r.robot, r.task, r.sample_period, r.speed, r.payload): r for r in runs}
    for run in kinds.values():
        try:
            shared = nominal(run.robot, run.task, run.sample_period, run.operation)
        except InputError as error:
            if not run.operation.given:
                raise
            raise InputError(f"at {run.operation}: {error}") from None
        assemble(shared.robot)  # refuses effects of its folder that do not exist
        if run.thin > 1 and run.thin >= shared.samples:
            raise InputError(
                f"thin: must be smaller than the number of samples in a cycle, which is "
                f"{shared.samples}, not {run.thin}"
            )
        note = _window_note(shared, run)
        if note:
            where = ", ".join(filter(None, [Path(run.task).stem, str(run.operation)]))
            notes.append(f"{shared.robot.name}, {where}: {note}")
    for run in {(r.robot, r.payload): r for r in runs if r.payload is not None}.values():
        _check_payload(run)
    faulty = {
        (r.robot, r.payload, r.effect, r.axes, r.parameters, r.beside): r for r in runs if r.axes
    }
    for run in faulty.values():
        shared = nominal(run.robot, run.task, run.sample_period, run.operation)
        try:
            assemble(shared.robot, run.faults)
        except ValueError as error:
            reason = one_line(error)
            raise InputError(f"{run.label}: cannot be simulated ({reason})") from None
    return notes


def _check_payload(run: Run) -> None:
    """Refuse a payload that is so light that the last gearboxes become too fast to be simulated."""
    robot = run.operation.loaded(load_robot(run.robot))
    step, stable = robot.model.opt.timestep, largest_step(robot, zero_pose(robot))
    if step > stable:
        raise InputError(
            f"payload: {run.payload:g} kg is too light for the model of {robot.name}: its time "
            f"step is {step:g} s, and {stable:.2g} s is the largest stable one with this payload; "
            "give a heavier payload or a model with a smaller time step"
        )


def _window_note(shared: Nominal, run: Run) -> str:
    """State which axes never turn within the speed window, and what is done about them."""
    low, high = shared.speed_window(run.speed_window).T
    inside = ((shared.speed >= low) & (shared.speed <= high)).any(axis=0)
    thesis = (low == SPEED_WINDOW[0]) & (high == SPEED_WINDOW[1])
    own = np.flatnonzero(~thesis) + 1 if not run.speed_window else np.empty(0, int)
    parts = []
    if len(own):
        used = ", ".join(f"{low[a - 1]:.3g} to {high[a - 1]:.3g} (axis {a})" for a in own.tolist())
        window = "{:g} to {:g} rad/s".format(*SPEED_WINDOW)
        parts.append(f"{_never(own)} at {window}; mean_abs_torque uses {used} rad/s")
    if not inside.all():
        never = _never(np.flatnonzero(~inside) + 1)
        parts.append(f"{never} within the speed window; mean_abs_torque is nan there")
    return "; ".join(parts)


def _never(axes: np.ndarray) -> str:
    listed = ", ".join(map(str, axes.tolist()))
    return f"axis {listed} never turns" if len(axes) == 1 else f"axes {listed} never turn"
