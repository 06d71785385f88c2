"""Runs of a dataset, reduced to the numbers that isolators and detectors use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from faultgen.analysis.isolation import ChangeIsolator
from faultgen.dataset.reader import Dataset, StoredRun
from faultgen.errors import InputError
from faultgen.evaluation.wear_model import (
    FRICTION,
    Observed,
    WearModel,
    isolator_input,
    wear_model,
    wear_points,
)
from faultgen.monitoring.reductions import SPEED_WINDOW, histogram, mean_abs_torque
from faultgen.monitoring.sensors import Measured, Sensors, get_sensors, measure
from faultgen.robot import load_robot
from faultgen.simulation.surrogate import simulate_at

WEAR = "friction_wear"
"""The effect that our isolators can find."""

_REFERENCE_DRAWS = 10
_REFERENCE_SEED = 10_000_000  # far from the seeds of tests


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
    stored = {run["sensors"] for run in dataset.runs}
    redraw = sensors is not None or stored == {"none"}
    chosen = "thesis" if stored == {"none"} else "/".join(sorted(stored))
    if sensors is not None:
        chosen = sensors
    moving = [name for name in stored if get_sensors(name).changes_motion]
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


@dataclass(frozen=True, eq=False)
class ObservedRun(Observed):
    """Reductions of a run of a dataset."""

    torque_counts: np.ndarray
    """Torque samples in each bin of the design range, shape (cycles, n_axes, 12)."""


@dataclass(eq=False)
class Place:
    """All runs of one robot and task, and isolators that were fitted to healthy runs."""

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
    torque_limit: np.ndarray
    """Largest design torque of each motor, shape (n_axes,), in [N m]."""
    _fitted: dict[tuple[str, ...], dict[str, ChangeIsolator] | str] = field(default_factory=dict)
    _reference: list[ObservedRun] | None = None

    @property
    def temperature_varies(self) -> bool:
        """Whether the temperature is measured and varies."""
        if self.sensors is not None:
            return False
        return any(get_sensors(run["sensors"]).changes_motion for run in self.runs)

    def draws(self, run: StoredRun, seeds: int, seed: int) -> Iterator[ObservedRun]:
        """Reduce a run: with new noise for each seed, or once as stored.

        Args:
            run: A run of this robot and task.
            seeds: Number of draws.
            seed: First seed.

        Yields:
            The reductions of each draw.

        Raises:
            InputError: The file lacks the signals that new noise needs.
        """
        if self.sensors is None:
            yield self._stored(run)
            return
        for number in range(seed, seed + seeds):
            measured = _measured(run, self.sensors, number)
            yield ObservedRun(
                _mean_torque(measured, _speed_window(run)),
                self.model.features.transform(np.stack([m.motor_torque for m in measured])),
                run.read("cycle/temperature"),
                self._counts([m.motor_torque for m in measured]),
            )

    def _counts(self, torque: list[np.ndarray]) -> np.ndarray:
        limit = self.torque_limit
        return np.array([histogram(cycle, -limit, limit) * len(cycle) for cycle in torque])

    def _stored(self, run: StoredRun) -> ObservedRun:
        name = "signals/motor_torque"
        friction = np.empty((run["cycles"], 0))
        if run["thin"] == 1 and name in run:
            friction = self.model.features.transform(run.read(name).astype(float))
        return ObservedRun(
            run.read("monitoring/mean_abs_torque"),
            friction,
            run.read("cycle/temperature"),
            run.read("monitoring/torque_histogram") * len(run.read("time")) * run["thin"],
        )

    def healthy(self, run: StoredRun) -> list[ObservedRun]:
        """Healthy series that share no noise draw with a run."""
        if self.sensors is None:
            others = [r for r in self.runs if not len(r["axes"]) and r["seed"] != run["seed"]]
            return [self._stored(r) for r in others]
        if self._reference is None:
            own = [r for r in self.runs if not len(r["axes"])][:1]
            self._reference = [
                seen for r in own for seen in self.draws(r, _REFERENCE_DRAWS, _REFERENCE_SEED)
            ]
        return self._reference

    def lacking(self, run: StoredRun) -> str:
        """Why some of our isolators cannot be used on a run; empty if all can."""
        ours = self.isolators(run)
        if isinstance(ours, str):
            return f"our isolators are left out: {ours}"
        if FRICTION not in ours:
            return f"'{FRICTION}' is left out: no signals/motor_torque in the files, not thinned"
        return ""

    def isolators(self, run: StoredRun) -> dict[str, ChangeIsolator] | str:
        """Our isolators, fitted on `healthy`, or the reason why there are none."""
        key = () if self.sensors is not None else (str(run["seed"]),)
        if key not in self._fitted:
            self._fitted[key] = self._fit(self.healthy(run))
        return self._fitted[key]

    def _fit(self, healthy: list[ObservedRun]) -> dict[str, ChangeIsolator] | str:
        if not healthy and not any(not len(run["axes"]) for run in self.runs):
            return "no healthy run to learn from; generate with healthy = true, in a new folder"
        if not healthy:
            return (
                "no healthy run of another seed to learn from; generate with --repetitions 5, "
                "in a new folder"
            )
        fitted = {}
        varies = self.temperature_varies
        for name, isolator in self.model.isolators(temperature_varies=varies).items():
            if name == FRICTION and not healthy[0].friction.shape[1]:
                continue
            given = [isolator_input(name, seen, temperature_varies=varies) for seen in healthy]
            try:
                fitted[name] = isolator.fit(given)
            except ValueError as error:
                return f"too few healthy cycles to learn from ({error})"
        return fitted


def one_series(run: StoredRun) -> np.ndarray:
    """Return the mean |torque| of each cycle, with a draw of the thesis' noise if it has none.

    Returns:
        Shape (cycles, n_axes), in [N m].
    """
    if run["sensors"] != "none":
        return run.read("monitoring/mean_abs_torque")
    return _mean_torque(_measured(run, get_sensors("thesis"), 1000), _speed_window(run))


def _measured(run: StoredRun, sensors: Sensors, number: int) -> list[Measured]:
    """Every cycle of a run with new noise."""
    clean = "signals" if run["sensors"] == "none" else "truth"
    names = [f"{clean}/motor_velocity", f"{clean}/motor_torque"]
    if run["thin"] != 1 or any(name not in run for name in names):
        raise InputError(
            f"{run.path}: new noise needs {' and '.join(names)}, not thinned; generate with "
            f"signals = {names}".replace("'", '"')
        )
    velocity, torque = (run.read(name).astype(float) for name in names)
    # a stream of its own for each run and seed, so that answers are independent
    rng = np.random.default_rng([number, int(run.id, 16)])
    return [
        measure(
            sensors,
            np.zeros_like(velocity[k]),
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


def _mean_torque(measured: list[Measured], window: ArrayLike = SPEED_WINDOW) -> np.ndarray:
    return np.array([mean_abs_torque(m.motor_velocity, m.motor_torque, window) for m in measured])


def places(dataset: Dataset, sensors: str | None = None) -> list[Place]:
    """Group the runs of a dataset by robot and task.

    Some cycles of each robot and task are simulated to find the directions of wear.

    Args:
        dataset: The dataset.
        sensors: Noise to draw anew; see `noise_of`.

    Returns:
        One group for each robot and task.

    Raises:
        InputError: As `noise_of`, or a robot's file has changed since the dataset was generated.
    """
    chosen, redraw = noise_of(dataset, sensors)
    groups: dict[tuple[str, str], list[StoredRun]] = {}
    for run in dataset.runs:
        groups.setdefault((run["robot"], run["task"]), []).append(run)
    found = []
    for (robot, task), runs in groups.items():
        planned = dataset.planned[runs[0].id]
        model = _model(planned["robot"], planned["task"], runs)
        limit = runs[0].attributes.get(
            "motor_torque_limit", load_robot(planned["robot"]).motor_torque_limit
        )
        preset = get_sensors(chosen) if redraw else None
        found.append(Place(robot, task, runs, preset, model, limit))
    return found


def _model(robot_path: str, task_path: str, runs: list[StoredRun]) -> WearModel:
    robot = load_robot(robot_path)
    if robot.sha256 != runs[0]["model_sha256"]:
        raise InputError(f"{robot_path}: the robot has changed since the dataset was made")
    period = runs[0]["sample_period"]
    conditions = wear_points(robot, WEAR)
    cycles = [simulate_at(robot_path, task_path, period, condition) for condition in conditions]
    return wear_model(robot, np.stack(cycles), _speed_window(runs[0]))
