"""Training a detector on a generated dataset.

detector = train(open_dataset("data"), false_alarms=0.01)
detector.save(Path("detector"))
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.dataset.experiment import check_seed
from faultgen.dataset.reader import Dataset, StoredRun
from faultgen.errors import InputError, what_it_says
from faultgen.provenance import provenance
from faultgen.recordings.recording import TorqueConstants
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.system.arrays import read_arrays
from faultgen.system.files import file_sha256
from faultgen.system.reading import read_text
from faultgen.tasks import load_task
from faultgen.twin.alarm_limits import find_limits
from faultgen.twin.alignment import KnownMotion, stretches_of
from faultgen.twin.classes import Classes, believe, fit_classes, gains
from faultgen.twin.detector import Detector, Fault, baseline_variance
from faultgen.twin.features import KINDS, features_of
from faultgen.twin.folder import HEALTHY, RESULT

FALSE_ALARMS = 0.01
"""Default rate of false alarms, per recording."""

_TORQUE, _POSITION = "signals/motor_torque", "signals/motor_position"
_AS_GOOD = 0.3  # of the mean log-probability: kinds of features that are as good as the best one
_CLEAR = 0.25  # severity, over the largest one, from which a validation cycle should be named


@dataclass(frozen=True, eq=False)
class Examples:
    """Labelled cycles. The first dimension of arrays is the cycle."""

    torque: np.ndarray
    """Torque of the motors, shape (cycles, samples, n_axes), in [N m]."""
    fault: np.ndarray
    """Number of the fault, from 0; -1 for healthy cycles."""
    severity: np.ndarray
    """Severity over the largest one of the fault."""
    held_out: np.ndarray
    """Whether the cycle belongs to a validation run."""

    def part(self, held_out: bool) -> np.ndarray:
        """Choose the cycles of validation runs, or all others.

        Args:
            held_out: Whether those of validation runs are chosen.

        Returns:
            Their numbers, from 0, shape (chosen,).
        """
        return np.flatnonzero(self.held_out == held_out)


def train(dataset: Dataset, *, false_alarms: float = FALSE_ALARMS, seed: int = 0) -> Detector:
    """Train a detector.

    Of every fault, and of the healthy robot, the run of the last repetition is left out. Each
    candidate, a kind of features, is fitted to the other runs and judged on these. Of those that
    are about as good as the best one, the one with most features is fitted again to all runs.

    Args:
        dataset: Runs of one robot, task and sensors, each fault with at least two repetitions.
        false_alarms: Rate of false alarms that the limits allow, per recording.
        seed: Seed of the random numbers from which the limits are found.

    Returns:
        The detector.

    Raises:
        InputError: The dataset does not suit, or the rate is impossible.
    """
    if not 1e-6 <= false_alarms <= 0.5:
        raise InputError(f"false-alarms: must be from 1e-6 to 0.5, not {false_alarms:g}")
    check_seed(seed)
    runs = _checked_runs(dataset)
    robot = load_robot(dataset.input_of(runs[0], "robot"))
    motion = _motion(dataset, runs, robot)
    faults, examples = _examples(runs)
    told = _twin_of(dataset, runs[0])
    measured = _measured(dataset, runs[0], motion)
    baselines = len(measured)
    try:
        found = learn(examples, motion, len(faults), measured, baselines, false_alarms, seed)
    except ValueError as error:
        raise InputError(
            f"{dataset.path}: {error}; generate with more --cycles or --repetitions"
        ) from None
    first = runs[0]
    return Detector(
        robot=robot.name,
        task=str(first["task"]),
        motion=motion,
        kind=found.kind,
        faults=faults,
        classes=found.classes,
        baselines=baselines,
        false_alarms=false_alarms,
        limits=found.limits,
        constants=_constants(told),
        torque_gain=robot.torque_gain,
        made={
            "by": str(provenance("faultgen.twin.train")),
            "dataset": str(dataset.path),
            "experiment_sha256": file_sha256(dataset.path / "experiment.toml"),
            "model_sha256": first["model_sha256"],
            "task_sha256": first["task_sha256"],
            "sensors": Path(first["sensors"]).name,
            "runs": len(runs),
            "cycles": len(examples.fault),
            "seed": seed,
            "candidates": found.candidates,
        },
    )


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned from examples."""

    kind: str
    """The chosen features."""
    classes: Classes
    """Their model, fitted to all examples."""
    limits: dict[str, float]
    """See `Detector.limits`."""
    candidates: list[dict[str, Any]]
    """Results of every kind of features on validation runs."""


def learn(
    examples: Examples,
    motion: KnownMotion,
    count: int,
    measured: np.ndarray,
    baselines: int,
    false_alarms: float,
    seed: int,
) -> Learned:
    """Choose features, fit their model, and find the limits.

    Args:
        examples: Labelled cycles, with some of every fault held out.
        motion: The motion.
        count: Number of faults.
        measured: Torque of healthy recordings of the robot, shape (recordings, samples, n_axes), in
            [N m]. They show how much it varies; there may be none.
        baselines: Number of healthy recordings behind the healthy mean; 0 if it is exact.
        false_alarms: Rate of false alarms that the limits allow, per recording.
        seed: Seed of the random numbers from which the limits are found.

    Returns:
        What was learned.

    Raises:
        ValueError: There are too few cycles.
    """
    results: list[dict[str, Any]] = []
    fitted = {}
    inside, outside = examples.part(False), examples.part(True)
    for kind in KINDS:
        x = features_of(kind, examples.torque, motion)
        real = features_of(kind, measured, motion)
        own = fit_classes(x[inside], examples.fault[inside], examples.severity[inside], count)
        own = own.fitted_to(real)
        score = _score(own, x[outside], examples.fault[outside], examples.severity[outside])
        results.append({"features": kind, **score})
        fitted[kind] = own, x, real
    best = max(one["log_probability"] for one in results)
    # more features also show what no example has, and tell inexact faults apart
    kind = next(str(r["features"]) for r in results if r["log_probability"] > best - _AS_GOOD)
    trial, x, real = fitted[kind]
    healthy = outside[examples.fault[outside] < 0]
    places, rest = trial.place(x[healthy])
    variance = 1 + baseline_variance(baselines)
    classes = fit_classes(x, examples.fault, examples.severity, count).fitted_to(real)
    limits = find_limits(
        classes,
        baselines,
        false_alarms,
        gains(trial, places, variance),
        rest,
        np.random.default_rng(seed),
    )
    return Learned(kind, classes, limits, results)


def _checked_runs(dataset: Dataset) -> list[StoredRun]:
    """All runs of a dataset, if they suit."""
    if dataset.missing:
        raise InputError(
            f"{dataset.path}: {len(dataset.missing)} runs are missing; run the generate command "
            "again to complete it"
        )
    runs = dataset.runs
    if not runs:
        raise InputError(f"{dataset.path}: has no runs")
    operation = ("speed", "payload_mass", "mean_temperature")
    for what in ("robot", "task", "sensors", "sample_period", "model_sha256", *operation):
        told = {str(run.attributes.get(what)) for run in runs}
        if len(told) > 1:
            raise InputError(
                f"{dataset.path}: a detector is for one robot, task, operation and sensors, but "
                f"the runs have several values of {what}: {', '.join(sorted(told))}"
            )
    first = runs[0]
    if int(first["thin"]) != 1 or _TORQUE not in first or _POSITION not in first:
        raise InputError(
            f"{dataset.path}: training needs the signals motor_torque and motor_position in full; "
            'generate with signals = "all" and thin = 1'
        )
    if any(json.loads(run["beside"]) for run in runs):
        raise InputError(
            f"{dataset.path}: has faults beside the main one, of which a detector learns no name"
        )
    return runs


def _motion(dataset: Dataset, runs: list[StoredRun], robot: Any) -> KnownMotion:
    """The motion of the healthy cycles."""
    first = runs[0]
    planned = plan(load_task(robot.name, dataset.input_of(first, "task"), robot.tasks), robot)
    healthy = [run for run in runs if not len(run["axes"])]
    if not healthy:
        raise InputError(f"{dataset.path}: has no healthy run; generate with healthy = true")
    position = np.mean([run.read(_POSITION).mean(axis=0) for run in healthy], axis=0)
    period = float(first["sample_period"])
    return KnownMotion(
        path=position / robot.gear_ratio,
        stretches=stretches_of(planned, len(position), period),
        sample_period=period,
        gear_ratio=robot.gear_ratio,
    )


def _examples(runs: list[StoredRun]) -> tuple[tuple[Fault, ...], Examples]:
    """Labelled cycles of all runs. Of each fault and severity, the last run is held out."""
    groups: dict[tuple[str, tuple[int, ...], float], list[StoredRun]] = {}
    for run in runs:
        axes = tuple(int(axis) for axis in run["axes"])
        groups.setdefault((str(run["effect"]), axes, float(run["severity"])), []).append(run)
    keys = list(dict.fromkeys((effect, axes) for effect, axes, _ in groups if axes))
    if not keys:
        raise InputError("the dataset has no fault; a detector needs some to learn")
    largest = {
        key: max(severity for effect, axes, severity in groups if (effect, axes) == key)
        for key in keys
    }
    faults = []
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ("torque", "fault", "severity", "held")}
    for (effect, axes, _), own in groups.items():
        if len(own) < 2:
            raise InputError(
                "every fault needs at least two runs, one of which is left out to choose the "
                "method and to check it; generate with --repetitions 2 or more"
            )
        for number, run in enumerate(own):
            torque = run.read(_TORQUE).astype(float)
            severity = run.read("cycle/severity") / largest.get((effect, axes), 1.0)
            fault = keys.index((effect, axes)) if axes else -1
            parts["torque"].append(torque)
            parts["fault"].append(np.full(len(torque), fault))
            parts["severity"].append(severity)
            parts["held"].append(np.full(len(torque), number == len(own) - 1))
    for effect, axes in keys:
        run = next(
            r for r in runs if r["effect"] == effect and tuple(int(a) for a in r["axes"]) == axes
        )
        faults.append(
            Fault(
                effect=effect,
                axes=axes,
                largest=largest[effect, axes],
                unit=str(run["severity_units"]),
            )
        )
    return tuple(faults), Examples(
        torque=np.concatenate(parts["torque"]),
        fault=np.concatenate(parts["fault"]),
        severity=np.concatenate(parts["severity"]),
        held_out=np.concatenate(parts["held"]),
    )


def _score(
    classes: Classes, x: np.ndarray, fault: np.ndarray, severity: np.ndarray
) -> dict[str, float]:
    """How probable the truth is in validation cycles, and how often it is named."""
    places, _ = classes.place(x)
    logs, right, error = [], [], []
    for place, truth, size in zip(places, fault.tolist(), severity.tolist(), strict=True):
        told = believe(classes, place, 1.0)
        probability = told.healthy if truth < 0 else float(told.faults[truth])
        if truth < 0 or size >= _CLEAR:
            logs.append(np.log(max(probability, 1e-12)))
        if truth >= 0 and size >= _CLEAR:
            named = int(np.argmax(told.faults))
            right.append(named == truth)
            if named == truth:
                error.append(abs(float(told.severity[truth]) - size))
    return {
        "log_probability": float(np.mean(logs)),
        "named": float(np.mean(right)) if right else float("nan"),
        "severity_error": float(np.median(error)) if error else float("nan"),
    }


def _measured(dataset: Dataset, run: StoredRun, motion: KnownMotion) -> np.ndarray:
    """Cycles of the healthy recordings from which the twin was made; none of another robot."""
    shape = motion.path.shape
    own = Path(dataset.input_of(run, "sensors")).parent / HEALTHY
    if not own.is_file():
        return np.zeros((0, *shape))
    arrays, _ = read_arrays(own)
    torque = arrays.get("torque", np.zeros((0, 0, 0)))
    # another task than the recorded one says nothing here
    if torque.shape[1:] != shape or not np.isfinite(torque[:, motion.compared]).all():
        return np.zeros((0, *shape))
    return torque


def _twin_of(dataset: Dataset, run: StoredRun) -> dict[str, Any] | None:
    """What is known of the robot's twin, if the sensors of the data are its own."""
    own = Path(dataset.input_of(run, "sensors")).parent / RESULT
    if not own.is_file():
        return None
    text = read_text(own, "twin file")
    try:
        told = json.loads(text)
        return {name: told[name] for name in ("recordings", "torque_constants")}
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{own}: damaged ({what_it_says(error)}); run the twin command again"
        ) from None


def _constants(told: dict[str, Any] | None) -> TorqueConstants | None:
    if told is None or told["torque_constants"] is None:
        return None
    rows = told["torque_constants"]
    return TorqueConstants(
        np.array([one["constant"] for one in rows]),
        np.array([one["offset"] for one in rows]),
        "the twin",
    )
