"""Runs of a dataset, reduced to the numbers that isolators and detectors use.

`places` groups the runs by robot and task. Each group fits methods to those of its runs from which
they may learn.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from faultgen.dataset.inputs import INPUTS, existing_input
from faultgen.dataset.reader import Dataset
from faultgen.dataset.splits import LEARNED_FROM, TEST
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.evaluation.calls import create, fit, learn
from faultgen.evaluation.features import HOURLY_FEATURES, SIGNALS, Features, features
from faultgen.evaluation.measurement_noise import (
    measured_cycles,
    noise_of,
    sensors_of,
    speed_window_of,
)
from faultgen.evaluation.methods import LabelledRun, M, Method, Setting
from faultgen.evaluation.wear_model import WearModel, wear_model, wear_points
from faultgen.monitoring.reductions import Limits
from faultgen.monitoring.sensors import Sensors, get_sensors
from faultgen.robot import load_robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.operation import Operation
from faultgen.simulation.surrogate import simulate_at
from faultgen.tasks import load_task

WEAR = "friction_wear"
"""The effect that our isolators can find."""

_REFERENCE_DRAWS = 10
_REFERENCE_SEED = 10_000_000  # far from the seeds of tests
_TRAINING_DRAWS = 3  # of each labelled run, if its noise is drawn anew


_Fitted = tuple[dict[str, Any], dict[str, list[str]]]
"""Fitted methods by name, and the names of the others by the reason why they are left out."""


@dataclass(eq=False)
class Place:
    """All runs of one robot and task, and methods that were fitted to healthy runs."""

    robot: str
    """Name of the robot."""
    task: str
    """Name of the task."""
    runs: list[StoredRun]
    """The runs in the planned order."""
    sensors: Sensors | None
    """Sensors whose noise is drawn anew; None: as stored."""
    model: WearModel
    """Friction terms and directions of wear."""
    setting: Setting
    """What methods may know before they see data."""
    limits: Limits
    """Design values of the robot, which set the ranges of the histograms."""
    parts: Mapping[str, str] = field(default_factory=dict)
    """Part of every run of the dataset in the division by which methods are tested; empty: none."""
    others: list[Place] = field(default_factory=list)
    """The other robots and tasks of the dataset."""
    _fitted: dict[tuple[str, ...], _Fitted] = field(default_factory=dict)
    _reference: dict[tuple[str, ...], list[Features]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Robot and task as text."""
        return f"{self.robot}/{self.task}"

    def draws(
        self, run: StoredRun, names: Collection[str], seeds: int, seed: int
    ) -> Iterator[Features]:
        """Reduce a run: with new noise for each seed, or once as stored.

        Args:
            run: A run of this robot and task.
            names: Names of the features.
            seeds: Number of draws.
            seed: First seed.

        Yields:
            The features of each draw; arrays have shape (cycles, ...).

        Raises:
            InputError: The file lacks the signals that new noise needs.
        """
        if self.sensors is None:
            yield self._stored(run, names)
            return
        position = bool({"motor_position", "angle_histogram"} & set(names))
        for number in range(seed, seed + seeds):
            measured = measured_cycles(run, self.sensors, number, position=position)
            yield features(
                measured,
                names,
                run.read("cycle/temperature"),
                terms=self.model.friction_terms,
                limits=self.limits,
                window=speed_window_of(run),
            )

    def _stored(self, run: StoredRun, names: Collection[str]) -> Features:
        found = {}
        for name in names:
            if name == "friction_terms":
                torque = run.read("signals/motor_torque").astype(float)
                found[name] = self.model.friction_terms.transform(torque)
            elif name in SIGNALS:
                found[name] = run.read(_stored_as(name)).astype(float)
            else:
                found[name] = run.read(_stored_as(name))
        return found

    def healthy(self, run: StoredRun, names: Collection[str]) -> list[Features]:
        """List healthy series that share no noise draw with a run.

        Args:
            run: A run of this robot and task.
            names: Names of the features.

        Returns:
            Features by name for each healthy run or draw; arrays have shape (cycles, ...).
        """
        if self.sensors is None:
            return [self._stored(r, names) for r in self._healthy_runs(run)]
        key = tuple(sorted(names))
        if key not in self._reference:
            own = [r for r in self.runs if not len(r["axes"])][:1]
            self._reference[key] = [
                seen
                for r in own
                for seen in self.draws(r, names, _REFERENCE_DRAWS, _REFERENCE_SEED)
            ]
        return self._reference[key]

    def _healthy_runs(self, run: StoredRun) -> list[StoredRun]:
        """Healthy runs of other seeds, and of the training part if it has some of this place.

        If methods are tested on other robots or tasks than those of the training part, they still
        know how this robot behaves in this task while it is healthy.
        """
        found = [r for r in self.runs if not len(r["axes"]) and r["seed"] != run["seed"]]
        trained = [r for r in found if self.parts.get(r.id) in LEARNED_FROM]
        return trained or found

    @property
    def tested(self) -> list[StoredRun]:
        """The runs about which methods are asked: those of the test part, or all."""
        return [run for run in self.runs if self.parts.get(run.id, TEST) == TEST]

    def labelled(self, names: Collection[str]) -> list[LabelledRun]:
        """List the labelled runs from which supervised methods learn.

        Args:
            names: Names of the features.

        Returns:
            The training runs of this robot and task. If there are none, those of all other robots
            and tasks whose robot has as many axes.
        """
        alike = [one for one in self.others if one.setting.n_axes == self.setting.n_axes]
        for places_here in ([self], alike):
            found = [
                LabelledRun(
                    features=seen,
                    severity=run.read("cycle/severity"),
                    axes=tuple(int(axis) - 1 for axis in run["axes"]),
                    effect=run["effect"],
                )
                for place in places_here
                for run in place.runs
                if self.parts.get(run.id) in LEARNED_FROM
                for seen in place.draws(run, names, _TRAINING_DRAWS, _REFERENCE_SEED)
            ]
            if found:
                return found
        return []

    def healthy_cycles(self, run: StoredRun) -> int:
        """Number of cycles of the series that `healthy` returns."""
        if self.sensors is None:
            return sum(int(r["cycles"]) for r in self._healthy_runs(run))
        own = [int(r["cycles"]) for r in self.runs if not len(r["axes"])][:1]
        return _REFERENCE_DRAWS * sum(own)

    def fitted(self, methods: Mapping[str, type[M]], run: StoredRun) -> tuple[dict[str, M], str]:
        """Fit methods to the healthy series that may be used for a run.

        Args:
            methods: Classes of the methods by name.
            run: The run that is to be judged.

        Returns:
            The methods by name, and why others are left out; empty if none is.
        """
        key = (*methods, "" if self.sensors is not None else str(run["seed"]))
        if key not in self._fitted:
            self._fitted[key] = self._fit(methods, run)
        found, reasons = self._fitted[key]
        said = [
            f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'} left out: {reason}"
            for reason, names in reasons.items()
        ]
        return found, "; ".join(said)

    def note_left_out(self, reasons: dict[str, str], run: StoredRun, lacking: str) -> None:
        """Keep the reason why methods are left out; one for worn runs comes first.

        Args:
            reasons: Reasons by `name`.
            run: The run that is judged.
            lacking: The reason, from `fitted`; empty if nothing is left out.
        """
        if lacking and len(run["axes"]):
            reasons[self.name] = lacking
        elif lacking:
            reasons.setdefault(self.name, f"for healthy runs, {lacking}")

    def _fit(
        self, methods: Mapping[str, type[M]], run: StoredRun
    ) -> tuple[dict[str, M], dict[str, list[str]]]:
        """The methods that can be used, and the names of the others by the reason."""
        found: dict[str, M] = {}
        reasons: dict[str, list[str]] = {}
        usable = {}
        for name, method in methods.items():
            lacking = [one for one in method.features if not self._has(run, one)]
            if lacking:
                reasons.setdefault(_lacks(lacking[0]), []).append(f"'{name}'")
            else:
                usable[name] = method
        learning = [one for one in usable.values() if one.learns and not one.supervised]
        features_needed = {name for method in learning for name in method.features}
        healthy = self.healthy(run, features_needed) if learning else []
        labelled: list[LabelledRun] = []
        if any(method.supervised for method in usable.values()):
            supervised = [method for method in usable.values() if method.supervised]
            labelled = self.labelled({name for method in supervised for name in method.features})
        for name, method in usable.items():
            if method.supervised:
                one = create(method, self.setting)
                try:
                    if not labelled:
                        raise ValueError("the training part has none")
                    learn(one, labelled)
                    found[name] = one
                except ValueError as error:
                    reason = f"too few labelled runs to learn from ({error})"
                    reasons.setdefault(reason, []).append(f"'{name}'")
                continue
            if method.learns and not healthy:
                reasons.setdefault(self._no_healthy(), []).append(f"'{name}'")
                continue
            one = create(method, self.setting)
            try:
                fit(one, healthy if method.learns else [])
                found[name] = one
            except ValueError as error:
                reason = f"too few healthy cycles to learn from ({error})"
                reasons.setdefault(reason, []).append(f"'{name}'")
        return found, reasons

    def _no_healthy(self) -> str:
        if not any(not len(run["axes"]) for run in self.runs):
            return "no healthy run to learn from; generate with healthy = true, in a new folder"
        return (
            "no healthy run of another seed to learn from; generate with --repetitions 5, "
            "in a new folder"
        )

    def _has(self, run: StoredRun, name: str) -> bool:
        """Whether a feature can be computed from the file of a run."""
        if name in HOURLY_FEATURES:
            return False
        if self.sensors is not None or name not in (*SIGNALS, "friction_terms"):
            return True
        return run["thin"] == 1 and _stored_as(name) in run


def _stored_as(name: str) -> str:
    """The array of a run file that a feature is read or computed from."""
    if name == "temperature":
        return "cycle/temperature"
    if name == "friction_terms":
        return "signals/motor_torque"
    return f"signals/{name}" if name in SIGNALS else f"monitoring/{name}"


def _lacks(name: str) -> str:
    if name in HOURLY_FEATURES:
        return f"datasets have no feature '{name}'"
    return f"no {_stored_as(name)} in the files, not thinned"


def division_of(methods: Iterable[type[Method]], split: str | None) -> str | None:
    """Determine by which division methods are tested.

    Args:
        methods: The methods.
        split: The division that the user chose, or None.

    Returns:
        That division; else "run" if a method learns from labels; else None, for all runs.
    """
    if split is None and any(method.supervised for method in methods):
        return "run"
    return split


def places(dataset: Dataset, sensors: str | None = None, split: str | None = None) -> list[Place]:
    """Group the runs of a dataset by robot and task.

    Some cycles of each robot and task are simulated to find the directions of wear.

    Args:
        dataset: The dataset.
        sensors: Noise to draw anew; see `noise_of`.
        split: Division by which methods are tested; None: they are asked about all runs.

    Returns:
        One group for each robot and task.

    Raises:
        InputError: As `noise_of`, or there is no such division, or a robot's file has changed since
            the dataset was generated.
    """
    chosen, redraw = noise_of(dataset, sensors)
    parts = dataset.part_of(split) if split is not None else {}
    groups: dict[tuple[str, str, Operation], list[StoredRun]] = {}
    for run in dataset.runs:
        operation = Operation.of(dataset.planned[run.id])
        groups.setdefault((run["robot"], run["task"], operation), []).append(run)
    found = []
    for (robot, task, operation), runs in groups.items():
        robot_path, task_path = (
            existing_input(dataset.input_of(runs[0], what), what) for what in ("robot", "task")
        )
        model = _model(robot_path, task_path, operation, runs)
        first = runs[0]
        preset = get_sensors(chosen) if redraw else None
        period = first["sample_period"]
        limits = nominal(robot_path, task_path, period, operation).limits
        setting = Setting(
            n_axes=len(model.turning),
            samples=len(first.read("time")) * int(first["thin"]),
            temperature_varies=preset is None
            and any(one.changes_motion for one in sensors_of(dataset, runs).values()),
            reference_temperature=operation.temperature
            or load_robot(robot_path).friction_temperature,
            directions=model.directions,
            turning=model.turning,
        )
        found.append(Place(robot, task, runs, preset, model, setting, limits, parts))
    for place in found:
        place.others = [one for one in found if one is not place]
    return found


def _model(
    robot_path: str, task_path: str, operation: Operation, runs: list[StoredRun]
) -> WearModel:
    robot = load_robot(robot_path)
    if robot.sha256 != runs[0]["model_sha256"]:
        raise InputError(
            f"{robot_path}: the robot has changed since the dataset was made, and there is no copy "
            f"of it in {INPUTS}/ beside the dataset"
        )
    if load_task(robot.name, task_path, robot.tasks).sha256 != runs[0]["task_sha256"]:
        raise InputError(f"{task_path}: the task has changed since the dataset was made")
    period = runs[0]["sample_period"]
    conditions = wear_points(robot, WEAR, operation.temperature)
    cycles = [
        simulate_at(robot_path, task_path, period, condition, operation=operation)
        for condition in conditions
    ]
    return wear_model(robot, np.stack(cycles), speed_window_of(runs[0]))
