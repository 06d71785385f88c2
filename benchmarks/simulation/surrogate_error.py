"""Error of interpolated cycles beside the noise, against direct simulation.

    python -m benchmarks.simulation.surrogate_error [--conditions 20] [--workers 2]

Conditions are drawn as the preset 'realistic' draws them, with wear of 0 to 20 % on one axis and,
every second time, on another one too. Printed as Markdown, by axis: RMS error of a torque sample
over the standard deviation of the noise on it; RMS error of a cycle's mean |torque| over its
standard deviation from cycle to cycle on a healthy robot.
"""

from __future__ import annotations

import argparse

import numpy as np
from joblib import Parallel, delayed

from faultgen.effects import Applied
from faultgen.monitoring.reductions import mean_abs_torque
from faultgen.monitoring.sensors import get_sensors
from faultgen.simulation.state import Condition
from faultgen.simulation.surrogate import Surrogate, build_surrogate, simulate_at
from faultgen.studies.chapter3_detection.hourly_torque import SAMPLE_PERIOD
from faultgen.studies.chapter3_detection.study import ROBOT, TASKS
from faultgen.studies.chapter6_isolation.study import ROBOTS
from faultgen.studies.chapter6_isolation.study import TASKS as TASKS_OF_CHAPTER_6


def main() -> None:
    """Measure every robot and task of the studies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--conditions", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    print("| robot | task | sample error / noise, axis 1 to 6 | mean error / healthy scatter |")
    print("|" + " --- |" * 4)
    cases = [(robot, task, 0.004) for robot in ROBOTS for task in TASKS_OF_CHAPTER_6]
    cases += [(ROBOT, task, SAMPLE_PERIOD) for task in TASKS]
    for robot, task, period in cases:
        surrogate = build_surrogate(robot, task, sample_period=period, workers=args.workers)
        samples, means = _errors(surrogate, args.conditions, args.workers)
        shown = "-" if period == SAMPLE_PERIOD else " ".join(f"{x:.3f}" for x in means)
        print(f"| {robot} | {task} | {' '.join(f'{x:.3f}' for x in samples)} | {shown} |")


def _errors(surrogate: Surrogate, count: int, workers: int) -> tuple[np.ndarray, np.ndarray]:
    sensors = get_sensors("realistic")
    rng = np.random.default_rng(3)
    conditions = []
    for number in range(count):
        axes = rng.choice(surrogate.n_axes, 1 + number % 2, replace=False)
        wear = tuple(
            Applied(surrogate.effect, int(axis) + 1, float(rng.uniform(0, 0.2))) for axis in axes
        )
        temperature = 40 + sensors.temperature_wander * rng.standard_normal()
        load = 1 + sensors.payload_scatter * rng.standard_normal()
        conditions.append(Condition(float(temperature), float(load), wear))
    where = surrogate.robot_path, surrogate.task_path, surrogate.sample_period
    truth = np.stack(
        Parallel(n_jobs=workers)(delayed(simulate_at)(*where, each) for each in conditions)
    )
    error = surrogate.at(conditions)[:, 2] - truth[:, 2]
    noise = sensors.torque_noise * surrogate.mean_torque
    by_sample = np.sqrt(np.mean(error**2, axis=(0, 1))) / noise
    if surrogate.sample_period == SAMPLE_PERIOD:
        return by_sample, np.empty(0)
    healthy = surrogate.at([Condition(c.temperature, c.payload_factor) for c in conditions])
    scatter = np.std([mean_abs_torque(c[1], c[2]) for c in healthy], axis=0)
    ours, theirs = (
        np.array([mean_abs_torque(c[1], c[2]) for c in cycles])
        for cycles in (surrogate.at(conditions), truth)
    )
    return by_sample, np.sqrt(np.mean((ours - theirs) ** 2, axis=0)) / scatter


if __name__ == "__main__":
    main()
