"""How well can generated and measured healthy cycles be told apart?

A classifier learns to distinguish them, and is tested on recordings that it has not seen. An area
under the ROC curve (AUC) of 0.5 says that it cannot; 1 says that it always can.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.run import make_run
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import SimulationFailed
from faultgen.twin.alignment import KnownMotion, mean_cycle
from faultgen.twin.disturbances import moving_average

CYCLES = 32
"""Generated cycles that are compared with the recordings."""

_RIDGE = 0.1  # inverse of the penalty
_WINDOWS = 12  # of a cycle, for each axis
_LOCAL = 5  # samples of the mean from which noise is counted


def generated_cycles(robot: Path, task: str, cycles: int, seed: int) -> np.ndarray:
    """Generate healthy cycles of a twin.

    Args:
        robot: The robot's folder.
        task: Name of a task.
        cycles: Number of cycles.
        seed: Seed.

    Returns:
        Torque of the motors, shape (cycles, samples, n_axes), in [N m].

    Raises:
        SimulationFailed: The model diverges.
    """
    experiment = make_experiment(
        {
            "robot": str(robot),
            "task": task,
            "effect": "healthy",
            "cycles": cycles,
            "seed": seed,
            "signals": ["signals/motor_torque"],
        }
    )
    (run,) = plan_runs(experiment)
    with tempfile.TemporaryDirectory(dir=robot, prefix=".generated-") as place:
        _, reason = make_run(run, Path(place))
        if reason is not None:
            raise SimulationFailed(reason)
        path = Path(place) / f"{run.id}.h5"
        return StoredRun(run.id, path).read("signals/motor_torque").astype(float)


def likeness(
    measured: Sequence[Sequence[np.ndarray]],
    generated: np.ndarray,
    known: KnownMotion,
    lacking: Callable[[np.ndarray, int], np.ndarray],
) -> dict[str, Any]:
    """Test whether generated and measured cycles differ.

    The classifier is logistic regression with a ridge penalty. A whole recording is left out in
    turn, with a share of the generated cycles. What the model lacks was learned from all
    recordings, so the generated cycles are first moved to where they would be without the one that
    is left out.

    Args:
        measured: Cycles of each recording, shape (samples, n_axes) each, in [N m].
        generated: Generated cycles, shape (cycles, samples, n_axes), in [N m].
        known: The motion.
        lacking: Function that learns what the model lacks from the mean cycle of some recordings,
            shape (samples, n_axes), and their number; it returns the same shape in [N m].

    Returns:
        The AUC, its standard error (Hanley and McNeil 1982), and the numbers of cycles. The AUC is
        None for a single recording.
    """
    count = len(measured)
    told: dict[str, Any] = {
        "auc": None,
        "standard_error": None,
        "recordings": count,
        "measured_cycles": sum(len(own) for own in measured),
        "generated_cycles": len(generated),
    }
    if count < 2:
        return told
    means = np.stack([mean_cycle(own) for own in measured])
    pairs: list[float] = []
    for number in range(count):
        others = np.delete(means, number, axis=0).mean(axis=0)
        moved = lacking(others, count - 1) - lacking(means.mean(axis=0), count)
        made = np.stack([_numbers(cycle + moved, known) for cycle in generated])
        real = np.stack(
            [_numbers(c, known) for k, own in enumerate(measured) if k != number for c in own]
        )
        left_out = np.stack([_numbers(cycle, known) for cycle in measured[number]])
        tested = np.arange(len(made)) % count == number
        x = np.concatenate([real, made[~tested]])
        y = np.r_[np.ones(len(real)), np.zeros(int((~tested).sum()))]
        middle, size = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-12)
        judge = LogisticRegression(C=_RIDGE, class_weight="balanced", max_iter=1000)
        judge.fit((x - middle) / size, y)
        score = judge.decision_function((np.concatenate([left_out, made[tested]]) - middle) / size)
        label = np.r_[np.ones(len(left_out)), np.zeros(int(tested.sum()))]
        pairs.append(float(roc_auc_score(label, score)))
    auc = float(np.mean(pairs))
    told["auc"] = auc
    told["standard_error"] = _error(auc, sum(len(own) for own in measured), len(generated))
    return told


def _numbers(cycle: np.ndarray, known: KnownMotion) -> np.ndarray:
    """Numbers of a cycle: torque by place, its size, and the level and colour of its noise."""
    torque = cycle[known.compared]
    windows = [part.mean(axis=0) for part in np.array_split(torque, _WINDOWS)]
    noise = torque - moving_average(torque, _LOCAL)
    size = np.maximum(noise.std(axis=0), 1e-12)
    follows = (noise[1:] * noise[:-1]).mean(axis=0) / size**2
    return np.concatenate([*windows, np.abs(torque).mean(axis=0), np.log(size), follows])


def _error(auc: float, first: int, second: int) -> float:
    """Standard error of an AUC (Hanley and McNeil 1982)."""
    one, both = auc / (2 - auc), 2 * auc**2 / (1 + auc)
    variance = (
        auc * (1 - auc) + (first - 1) * (one - auc**2) + (second - 1) * (both - auc**2)
    ) / max(first * second, 1)
    return float(np.sqrt(max(variance, 0.0)))


def summary(robot: str, told: dict[str, Any], remainder: Sequence[float]) -> str:
    """Say in one sentence how good a twin is: that of the command and of the report.

    Args:
        robot: Name of the robot.
        told: From `likeness`.
        remainder: What the model lacks on each axis, over its RMS torque, shape (n_axes,).

    Returns:
        The sentence, with its full stop.
    """
    most = int(np.argmax(remainder))
    lacks = f"the model lacks most on axis {most + 1}, {100 * remainder[most]:.1f} % of RMS torque"
    if told["auc"] is None:
        return (
            f"Whether generated cycles of {robot} look like measured ones was not tested, because "
            f"there is one recording; {lacks}."
        )
    return (
        f"A classifier tells generated from measured cycles of {robot} with an AUC of "
        f"{told['auc']:.2f} ± {told['standard_error']:.2f} (0.5: not at all; 1: always); {lacks}."
    )
