"""Training a detector on a generated dataset.

detector = train(open_dataset("data"), false_alarms=0.3)
detector.save(Path("detector"))
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.analysis import EffectPosterior
from faultgen.dataset.experiment import check_seed
from faultgen.dataset.reader import Dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError, what_it_says
from faultgen.provenance import provenance
from faultgen.recordings.recording import TorqueConstants
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.system.arrays import read_arrays
from faultgen.system.files import file_sha256
from faultgen.system.reading import read_text
from faultgen.tasks import load_task
from faultgen.twin.alignment import KnownMotion, stretches_of
from faultgen.twin.columns import Columns, Fault, Generated
from faultgen.twin.detector import Detector
from faultgen.twin.folder import HEALTHY, RESULT
from faultgen.twin.program import Program, as_recording, program_of
from faultgen.twin.warming import Warming, learn_warming

FALSE_ALARMS = 0.3
"""Default rate of false alarms, per robot and month."""

RECORDINGS_PER_MONTH = 30.0
"""Default number of recordings of a robot in a month."""

_TORQUE, _POSITION = "signals/motor_torque", "signals/motor_position"
_MOST = 200  # generated healthy cycles that stand for recordings, if there are no measured ones
_EXPECTED = (0.1, 0.2)  # severities of which the time to detection is stated, over the largest one
_SIMULATED = 60  # robots, for these times
LONGEST = 60
"""Recordings of each of them."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned for one program."""

    program: Program
    """Its motion and noise."""
    faults: tuple[Fault, ...]
    """Faults that can be named."""
    posterior: EffectPosterior
    """The detector of them."""
    healthy: np.ndarray
    """Mean and deviation of the healthy torque, as `Detector.healthy`."""
    warming: Warming | None
    """How the torque follows a measured temperature."""


def train(
    dataset: Dataset,
    *,
    false_alarms: float = FALSE_ALARMS,
    recordings_per_month: float = RECORDINGS_PER_MONTH,
    seed: int = 0,
) -> Detector:
    """Train a detector.

    Args:
        dataset: Runs of one robot, task and sensors, some of them healthy.
        false_alarms: Rate of false alarms that the limit allows, per robot and month.
        recordings_per_month: Number of recordings of a robot in a month.
        seed: Seed of the random numbers from which the limit is found.

    Returns:
        The detector.

    Raises:
        InputError: The dataset does not suit, or the rate is impossible.
    """
    rate = _rate(false_alarms, recordings_per_month)
    check_seed(seed)
    runs = _checked_runs(dataset)
    robot = load_robot(dataset.input_of(runs[0], "robot"))
    motion = _motion(dataset, runs, robot)
    told = _twin_of(dataset, runs[0])
    own = [run for run in runs if not len(run["axes"])]
    torque = np.concatenate([_torque(run, motion) for run in own])
    measured, temperature = _measured(dataset, runs[0], motion)
    healthy = measured if len(measured) else torque[:_MOST]
    if not len(measured) and "cycle/temperature" in own[0]:
        warm = np.concatenate([run.read("cycle/temperature") for run in own])[:_MOST]
        if np.ptp(warm) > 0:
            temperature = np.repeat(warm[:, None], robot.n_axes, axis=1)
    generated = _generated(runs, motion, torque.mean(axis=0))
    learned = learn(robot, motion, healthy, generated, rate, seed, temperature)
    first = runs[0]
    return Detector(
        robot=robot.name,
        task=str(first["task"]),
        program=learned.program,
        faults=learned.faults,
        posterior=learned.posterior,
        healthy=learned.healthy,
        warming=learned.warming,
        recordings_per_month=recordings_per_month,
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
            "measured": len(measured),
            "seed": seed,
            "expected": expected_delays(learned),
        },
    )


def learn(
    robot: Robot,
    motion: KnownMotion,
    healthy: np.ndarray,
    generated: Sequence[Generated],
    rate: float,
    seed: int,
    temperature: np.ndarray | None = None,
) -> Learned:
    """Compute signatures of faults and days, and learn from healthy recordings.

    Args:
        robot: The model.
        motion: The motion.
        healthy: Torque of healthy recordings at the places that are compared, shape (recordings,
            places, n_axes), in [N m].
        generated: Cycles of each fault.
        rate: Rate of false alarms, per recording.
        seed: Seed of the random numbers from which the limit is found.
        temperature: Of the gearboxes in the healthy recordings, shape (recordings, n_axes), in
            [deg C]; None if it was not measured.

    Returns:
        What was learned.
    """
    columns = Columns(as_recording(motion, healthy.mean(axis=0), robot.name), robot)
    alone = len(healthy) == 1
    noisy = columns.apart(healthy[0]) if alone else healthy
    program = program_of(motion, noisy, columns.numbers, columns.drivers, of_model=alone)
    warming = None
    if temperature is not None:
        law = columns.law_of_temperature(temperature)
        warming = learn_warming(law, columns.days(program), program, healthy, temperature)
        healthy = healthy - np.array([warming.change(one) for one in temperature])
        if not alone:
            program = program_of(motion, healthy, columns.numbers, columns.drivers)
    effects, faults = columns.effects(program, generated)
    posterior = EffectPosterior(
        effects, columns.days(program), false_alarms=rate, random_state=seed
    ).fit(program.whiten(healthy))
    by_days = np.tensordot(posterior.day_stds_**2, np.array(columns.numbers.columns) ** 2, axes=1)
    deviation = np.sqrt(by_days + program.noise.of_samples() ** 2)
    shown = np.stack([healthy.mean(axis=0), deviation])
    return Learned(program, faults, posterior, shown, warming)


def expected_delays(learned: Learned) -> list[dict[str, Any]]:
    """Simulate how long it takes until faults raise an alarm.

    Args:
        learned: What was learned.

    Returns:
        For each fault and some severities, the number of recordings until the alarm: the median,
        and the interval of 80 % of robots; None where it is longer than the simulation.
    """
    labels = [cause.label for cause in learned.posterior.effects.causes]
    rows = []
    for fault in learned.faults:
        for share in _EXPECTED:
            severity = share * fault.largest
            found = np.sort(
                learned.posterior.delays(
                    labels.index(fault.name), severity, longest=LONGEST, sequences=_SIMULATED
                )
            )
            low, middle, high = (found[int(q * len(found))] for q in (0.1, 0.5, 0.9))
            told = [float(x) if np.isfinite(x) else None for x in (low, middle, high)]
            rows.append(
                {
                    "effect": fault.effect,
                    "axes": list(fault.axes),
                    "severity": severity,
                    "unit": fault.unit,
                    "recordings": told[1],
                    "interval": [told[0], told[2]],
                }
            )
    return rows


def _rate(false_alarms: float, recordings_per_month: float) -> float:
    """Rate of false alarms per recording."""
    if not 1 <= recordings_per_month <= 1e6:
        raise InputError(
            f"recordings-per-month: must be from 1 to 1e6, not {recordings_per_month:g}"
        )
    rate = false_alarms / recordings_per_month
    if not 1e-6 <= rate <= 0.5:
        raise InputError(
            f"false-alarms: must be from {1e-6 * recordings_per_month:g} to "
            f"{0.5 * recordings_per_month:g} a month with {recordings_per_month:g} recordings, not "
            f"{false_alarms:g}"
        )
    return rate


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


def _torque(run: StoredRun, motion: KnownMotion) -> np.ndarray:
    """Torque of the cycles of a run at the places that are compared, (cycles, places, n_axes)."""
    return np.asarray(run.read(_TORQUE)[:, motion.compared], float)


def _generated(runs: list[StoredRun], motion: KnownMotion, healthy: np.ndarray) -> list[Generated]:
    """Cycles of each fault."""
    groups: dict[tuple[str, tuple[int, ...]], list[StoredRun]] = {}
    for run in runs:
        axes = tuple(int(axis) for axis in run["axes"])
        if axes:
            groups.setdefault((str(run["effect"]), axes), []).append(run)
    if not groups:
        raise InputError("the dataset has no fault; a detector needs some to learn")
    found = []
    for (effect, axes), own in groups.items():
        largest = max(float(run["severity"]) for run in own)
        first = own[0]
        found.append(
            Generated(
                fault=Fault(
                    effect=effect, axes=axes, largest=largest, unit=str(first["severity_units"])
                ),
                parameters=json.loads(first["parameters"]),
                change=np.concatenate([_torque(run, motion) for run in own]) - healthy,
                severity=np.concatenate([run.read("cycle/severity") for run in own]) / largest,
            )
        )
    return found


def _measured(
    dataset: Dataset, run: StoredRun, motion: KnownMotion
) -> tuple[np.ndarray, np.ndarray | None]:
    """Healthy recordings of the twin at the places that are compared; none of another robot.

    Returns:
        Their torques, and the temperatures of their gearboxes if they were measured.
    """
    shape = motion.path.shape
    none = np.zeros((0, len(motion.compared), shape[1]))
    own = Path(dataset.input_of(run, "sensors")).parent / HEALTHY
    if not own.is_file():
        return none, None
    arrays, _ = read_arrays(own)
    torque = arrays.get("torque", np.zeros((0, 0, 0)))
    # another task than the recorded one says nothing here
    if torque.shape[1:] != shape or not np.isfinite(torque[:, motion.compared]).all():
        return none, None
    return np.asarray(torque[:, motion.compared], float), arrays.get("temperature")


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
