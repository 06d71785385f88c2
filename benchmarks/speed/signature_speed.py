"""Processor time of the signatures of `faultgen discover`, over one simulation of the same motion.

    python -m benchmarks.speed.signature_speed [--save FILE]

Prints JSON. Every ratio is taken within one run of this script. The library for linear algebra runs
on one thread, so that processor time is what the work takes on one core.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from threadpoolctl import threadpool_limits

from faultgen.discovery import Recording, Replay
from faultgen.discovery.signatures import signatures
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

ROBOTS, TASK, SAMPLE_PERIOD = ("puma560", "irb6700"), "pick_and_place", 0.004
GOALS = {25.0: 10.0, 60.0: 25.0}  # processor seconds, by length of the recording [s]
REPEATS = 3
TORQUE_NOISE, POSITION_NOISE = 0.005, 2e-5  # over the deviation of the torque; at the motor [rad]


def processor_seconds(action: Callable[[], object]) -> float:
    """Processor time of a call [s]."""
    start = time.process_time()
    action()
    return time.process_time() - start


def recorded(robot: Robot, control: np.ndarray, seconds: float, seed: int) -> Recording:
    """Simulate a healthy robot that repeats a task, with noise."""
    cycles = math.ceil(seconds / (len(control) * robot.model.opt.timestep))
    plants = [assemble(robot)] * cycles
    runs = list(simulate(robot, control, plants, sample_period=SAMPLE_PERIOD))
    samples = round(seconds / SAMPLE_PERIOD)
    torque, position = (
        np.concatenate([getattr(run, name) for run in runs])[:samples]
        for name in ("motor_torque", "motor_position")
    )
    rng = np.random.default_rng(seed)
    torque = torque + TORQUE_NOISE * torque.std(axis=0) * rng.normal(size=torque.shape)
    return Recording(
        source="benchmark",
        robot=robot.name,
        side="motor",
        sample_period=SAMPLE_PERIOD,
        position=position + POSITION_NOISE * rng.normal(size=torque.shape),
        torque=torque,
    )


def measured(name: str, seconds: float) -> dict[str, object]:
    """Time all signatures of a recording, and a second recording of its motion.

    Args:
        name: Robot.
        seconds: Length of the recording [s].

    Returns:
        A row of the table.
    """
    robot = load_robot(name)
    control = control_signal(plan(load_task(name, TASK), robot), robot.model.opt.timestep)
    recording, second = (recorded(robot, control, seconds, seed) for seed in range(2))
    steps = round(seconds / robot.model.opt.timestep)
    motion = np.concatenate([control] * (steps // len(control) + 1))[:steps]

    def simulation() -> None:
        list(simulate(robot, motion, [assemble(robot)], sample_period=SAMPLE_PERIOD, lead_in=0.0))

    # copies, because a recording is smoothed only once
    actions: dict[str, Callable[[], object]] = {
        "signatures": lambda: signatures(replace(recording), robot),
        "second": lambda: Replay(replace(second), robot).torque(),
    }
    simulation()  # what is prepared once a process is no part of the times
    times: dict[str, list[float]] = {part: [] for part in (*actions, "simulation")}
    for _ in range(REPEATS):
        times["simulation"].append(processor_seconds(simulation))
        for part, action in actions.items():
            times[part].append(processor_seconds(action))
    row: dict[str, object] = {"robot": name, "seconds": seconds, "goal": GOALS[seconds]}
    row["simulation_s"] = round(statistics.median(times["simulation"]), 3)
    for part in actions:
        each = [a / b for a, b in zip(times[part], times["simulation"], strict=True)]
        row[f"{part}_s"] = round(statistics.median(times[part]), 2)
        row[f"{part}_over_simulation"] = round(statistics.median(each), 1)
        row[f"{part}_over_simulation_each"] = [round(ratio, 1) for ratio in each]
    return row


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--save", type=Path, help="also write the result there")
    options = parser.parse_args()
    with threadpool_limits(limits=1):
        rows = [measured(name, seconds) for seconds in GOALS for name in ROBOTS]
    result = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "mujoco": mujoco.__version__,
        "rows": rows,
    }
    text = json.dumps(result, indent=1)
    print(text)
    if options.save:
        options.save.write_text(text + "\n")


if __name__ == "__main__":
    main()
