"""How the map trains the detector of `faultgen train`: on healthy cycles, and for all effects.

one = learned_detector(bench, task, view, healthy, drawn, mean_torque, effects, rng)
one.limit(EFFECTS["backlash"], 1, bench, first=1e-6, days=40, rng=rng)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.effects import Effect
from faultgen.monitoring.sensors import torque_growth, torque_noise
from faultgen.robot import Robot
from faultgen.simulation.motion import plan
from faultgen.studies.detectability.disturbed import Drawn
from faultgen.studies.detectability.ideal import BASELINE, FALSE_ALARM, LOGGED, View
from faultgen.studies.detectability.limits import Bench
from faultgen.studies.detectability.trained import LearnedDetector
from faultgen.tasks import load_task
from faultgen.twin.alignment import KnownMotion, stretches_of
from faultgen.twin.columns import Fault, Generated
from faultgen.twin.detector import Detector
from faultgen.twin.train import learn

POOL = 1200
"""Healthy recordings from which days and months are put together."""

LEARNED = (0.25, 0.5, 1.0)
"""Severities of the cycles from which the detector learns an effect, over the default severity."""

_BLOCK = 100  # cycles that are in memory at once


def learned_detector(
    bench: Bench,
    task: str,
    view: View,
    healthy: np.ndarray,
    drawn: Drawn | None,
    mean_torque: np.ndarray,
    effects: Sequence[Effect],
    rng: np.random.Generator,
) -> LearnedDetector:
    """Train the detector on healthy cycles, with all effects that are mapped.

    Healthy cycles are normally distributed, with the mean and covariance of the drawn ones.

    Args:
        bench: The robot at its task.
        task: Name of the task, or path of its file.
        view: What is logged.
        healthy: A healthy cycle, shape (3, simulated samples, n_axes).
        drawn: Healthy cycles with their differences; None if all are the same.
        mean_torque: Mean |torque| of each axis in the nominal cycle, shape (n_axes,), in [N m].
        effects: Effects that it learns to name.
        rng: Source of randomness.

    Returns:
        The detector.
    """
    robot, period = bench.robot, view.sample_period
    every = max(1, round(period / bench.step))
    logged = healthy[:, ::every]
    motion = _motion(robot, task, logged[0], period)
    usual = logged[2] if drawn is None else drawn.mean[2, ::every]
    differing = np.zeros((0, *usual.shape)) if drawn is None else drawn.unknown[:, 2, ::every]
    growth = torque_growth(view.sensors, logged[1], logged[2])

    def torque(count: int) -> np.ndarray:
        size = rng.standard_normal((count, len(differing)))
        noise = np.stack(
            [
                torque_noise(view.sensors, usual.shape, mean_torque, period, rng)
                for _ in range(count)
            ]
        )
        found = usual + np.tensordot(size, differing, axes=1) + noise * growth
        return np.asarray(found[:, motion.compared])

    generated = _generated(bench, healthy, effects, every, motion.compared)
    learned = learn(
        robot, motion, torque(BASELINE), generated, FALSE_ALARM / LOGGED, int(rng.integers(2**31))
    )
    detector = Detector(
        robot=robot.name,
        task=task,
        program=learned.program,
        faults=learned.faults,
        posterior=learned.posterior,
        recordings_per_month=30.0 * LOGGED,
        constants=None,
        torque_gain=robot.torque_gain,
        healthy=learned.healthy,
        made={},
    )
    scores = [
        learned.posterior.transform(learned.program.whiten(torque(_BLOCK)))
        for _ in range(POOL // _BLOCK)
    ]
    pool = np.concatenate(scores).astype(np.float32)
    return LearnedDetector(detector, logged, every, pool, learned.posterior.limit_)


def _motion(robot: Robot, task: str, position: np.ndarray, period: float) -> KnownMotion:
    planned = plan(load_task(robot.name, task, robot.tasks), robot)
    stretches = stretches_of(planned, len(position), period)
    return KnownMotion(position / robot.gear_ratio, stretches, period, robot.gear_ratio)


def _generated(
    bench: Bench, healthy: np.ndarray, effects: Sequence[Effect], every: int, places: np.ndarray
) -> list[Generated]:
    """Cycles of each effect on each axis, without noise; none of what changes no torque."""
    found = []
    for effect in effects:
        for axis in effect.usual_axes_on(bench.robot):
            worn = {s: bench.worn(effect, axis, s * effect.default) for s in LEARNED}
            possible = {s: cycle for s, cycle in worn.items() if cycle is not None}
            changes = [(c - healthy)[2, ::every][places] for c in possible.values()]
            if not any(np.any(change) for change in changes):
                continue
            fault = Fault(
                effect=effect.name,
                axes=(axis,),
                largest=effect.default,
                unit=effect.units_on(bench.robot, axis),
            )
            found.append(
                Generated(fault=fault, change=np.array(changes), severity=np.array([*possible]))
            )
    return found
