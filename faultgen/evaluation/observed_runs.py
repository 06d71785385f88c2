"""Runs of a dataset, reduced to the numbers that isolators and detectors use."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from faultgen.dataset.inputs import INPUTS
from faultgen.dataset.reader import Dataset
from faultgen.dataset.splits import LEARNED_FROM, TEST
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.evaluation.calls import create, fit, learn
from faultgen.evaluation.features import HOURLY_FEATURES, SIGNALS, Features, features
from faultgen.evaluation.methods import LabelledRun, M, Method, Setting
from faultgen.evaluation.wear_model import WearModel, wear_model, wear_points
from faultgen.monitoring.reductions import SPEED_WINDOW, Limits, mean_abs_torque
from faultgen.monitoring.sensors import Measured, Sensors, get_sensors, measure
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


def noise_of(dataset: Dataset, sensors: str | None) -> tuple[str, bool]:
    """Determine which noise is used, and whether it is drawn anew.

    Args:
        dataset: The dataset.
        sensors: Preset of the noise. None: 'thesis' for a dataset without noise, otherwise the
            noise of the dataset.

    Returns:
        Name of the noise, and whether it is drawn anew.

    Raises:
        InputError: The dataset has no runs, or another motion would be needed.
    """
    if not dataset.runs:
        raise InputError(f"{dataset.path}: no runs in it; finish it with faultgen generate")
    stored = _sensors_of(dataset, dataset.runs)
    redraw = sensors is not None or set(stored) == {"none"}
    chosen = "thesis" if set(stored) == {"none"} else "/".join(sorted(stored))
    if sensors is not None:
        chosen = sensors
    moving = [name for name, one in stored.items() if one.changes_motion]
    if sensors is not None and moving:
        raise InputError(
            f"sensors '{sensors}': the dataset's '{moving[0]}' runs differ in their motion, which "
            "new noise does not undo; leave --sensors out"
        )
    if redraw and get_sensors(chosen).changes_motion:
        raise InputError(
            f"sensors '{chosen}' change the motion: generate a dataset with them instead, "
            "with several repetitions"
        )
    return chosen, redraw


def _sensors_of(dataset: Dataset, runs: Iterable[StoredRun]) -> dict[str, Sensors]:
    """Sensors of some runs, by name or path."""
    found = {}
    for name, run in {run["sensors"]: run for run in reversed(list(runs))}.items():
        path = _input(dataset, run, "sensors")
        found[name] = get_sensors(path)
        if dataset.planned[run.id].get("sensors_sha256", "") not in ("", found[name].sha256):
            raise InputError(f"{path}: the sensors have changed since the dataset was made")
    return found


def _input(dataset: Dataset, run: StoredRun, what: str) -> str:
    """Name or path of the robot, task or sensors of a run.

    Raises:
        InputError: It is gone, and the dataset has no copy of it.
    """
    path = dataset.input_of(run, what)
    if os.path.isabs(path) and not os.path.exists(path):
        raise InputError(
            f"{path}: the {what} from which the dataset was made is no longer there, and there is "
            f"no copy of it in {INPUTS}/ beside the dataset"
        )
    return path


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
    _fitted: dict[tuple[str, ...], tuple[dict[str, Any], dict[str, list[str]]]] = field(
        default_factory=dict
    )
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
            measured = _measured(run, self.sensors, number, position=position)
            yield features(
                measured,
                names,
                run.read("cycle/temperature"),
                terms=self.model.friction_terms,
                limits=self.limits,
                window=_speed_window(run),
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


def one_series(run: StoredRun) -> np.ndarray:
    """Return the mean |torque| of each cycle, with a draw of the thesis' noise if it has none.

    Returns:
        Shape (cycles, n_axes), in [N m].
    """
    if run["sensors"] != "none":
        return run.read("monitoring/mean_abs_torque")
    measured = _measured(run, get_sensors("thesis"), 1000)
    window = _speed_window(run)
    return np.array([mean_abs_torque(m.motor_velocity, m.motor_torque, window) for m in measured])


def _measured(
    run: StoredRun, sensors: Sensors, number: int, *, position: bool = False
) -> list[Measured]:
    """Every cycle of a run with new noise; the position is 0 unless it is asked for."""
    clean = "signals" if run["sensors"] == "none" else "truth"
    names = [f"{clean}/motor_velocity", f"{clean}/motor_torque"]
    names += [f"{clean}/motor_position"] if position else []
    if run["thin"] != 1 or any(name not in run for name in names):
        raise InputError(
            f"{run.path}: new noise needs {' and '.join(names)}, not thinned; generate with "
            f"signals = {names}".replace("'", '"')
        )
    velocity, torque, *more = (run.read(name).astype(float) for name in names)
    angle = more[0] if more else np.zeros_like(velocity)
    # a stream of its own for each run and seed, so that answers are independent
    rng = np.random.default_rng([number, int(run.id, 16)])
    return [
        measure(
            sensors,
            angle[k],
            velocity[k],
            torque[k],
            gear_ratio=run["gear_ratio"],
            encoder_counts=run["encoder_counts"],
            mean_torque=run["nominal_mean_torque"],
            sample_period=run["sample_period"],
            rng=rng,
        )
        for k in range(len(torque))
    ]


def _speed_window(run: StoredRun) -> ArrayLike:
    """The speed window in which the run's own mean torque was computed."""
    return run.attributes.get("speed_window", SPEED_WINDOW)


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
        robot_path, task_path = (_input(dataset, runs[0], what) for what in ("robot", "task"))
        model = _model(robot_path, task_path, operation, runs)
        first = runs[0]
        preset = get_sensors(chosen) if redraw else None
        period = first["sample_period"]
        limits = nominal(robot_path, task_path, period, operation).limits
        setting = Setting(
            n_axes=len(model.turning),
            samples=len(first.read("time")) * int(first["thin"]),
            temperature_varies=preset is None
            and any(one.changes_motion for one in _sensors_of(dataset, runs).values()),
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
    return wear_model(robot, np.stack(cycles), _speed_window(runs[0]))
