"""Speed and memory: what the public API adds to bare MuJoCo stepping.

    python -m benchmarks.speed.speed [--quick] [--save FILE]

Prints JSON. Every ratio is taken within one run of this script: the median of five, for workers of
three.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from faultgen.dataset.experiment import make_experiment, to_toml
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.run import make_run
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import LEAD_IN, simulate
from faultgen.tasks import load_task

ROBOT, TASK, SAMPLE_PERIOD = "irb6700", "pick_and_place", 0.004
REPEATS = 5


def seconds(action: Callable[[], object]) -> float:
    """Wall time of a call [s]."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def stepping(cycles: int) -> dict[str, float]:
    """Cost of stepping through `simulate`, and of making a run file, over bare stepping."""
    robot = load_robot(ROBOT)
    timestep = robot.model.opt.timestep
    control = control_signal(plan(load_task(ROBOT, TASK), robot), timestep)
    lead = control[-round(LEAD_IN / timestep) :]
    signal = np.concatenate([lead, *[control] * cycles])

    def bare() -> None:
        Batch(robot.model, 1, 1).rollout(len(signal), signal[None])

    def api() -> None:
        models = [robot.model] * cycles
        for _ in simulate(robot, control, models, sample_period=SAMPLE_PERIOD):
            pass

    runs = {}
    for name, signals in (("all signals", "all"), ("reductions only", "none")):
        experiment = make_experiment(
            {"robot": ROBOT, "task": TASK, "axis": 1, "cycles": cycles, "healthy": False}
            | {"signals": signals, "sensors": "realistic"}
        )
        runs[name] = plan_runs(experiment)[0]
    times: dict[str, list[float]] = {"bare": [], "api": [], **{name: [] for name in runs}}
    with tempfile.TemporaryDirectory() as folder:
        make_run(runs["reductions only"], Path(folder))  # plans the motion, once a process
        for _ in range(REPEATS):
            times["bare"].append(seconds(bare))
            times["api"].append(seconds(api))
            for name, run in runs.items():
                times[name].append(seconds(partial(make_run, run, Path(folder))))
    bare_time = statistics.median(times["bare"])

    def ratio(name: str) -> float:
        pairs = zip(times[name], times["bare"], strict=True)
        return round(statistics.median(a / b for a, b in pairs), 3)

    return {
        "steps": len(signal),
        "bare_us_per_step": round(bare_time / len(signal) * 1e6, 2),
        "bare_simulated_s_per_s": round(len(signal) * timestep / bare_time, 1),
        "api_over_bare": ratio("api"),
        "run_file_all_signals_over_bare": ratio("all signals"),
        "run_file_reductions_over_bare": ratio("reductions only"),
    }


def workers(cycles: int, repeats: int) -> dict[str, object]:
    """Compare two workers with one, including the start of the processes.

    Args:
        cycles: Number of cycles.
        repeats: Number of repetitions.

    Returns:
        Times [s] by name.
    """
    experiment = make_experiment(
        {"robot": ROBOT, "task": TASK, "cycles": cycles, "axis": [1, 2, 3, 4, 5, 6, [1, 2]]}
        | {"signals": ["signals/motor_velocity", "signals/motor_torque"]}
    )
    ratios, ones = [], []
    for _ in range(repeats):
        times = {}
        for count in (1, 2):
            with tempfile.TemporaryDirectory() as folder:
                # a process of its own, so that no worker is warm
                code = (
                    "import sys; from faultgen.dataset.sweep import generate\n"
                    "generate(sys.argv[1], sys.argv[2], workers=int(sys.argv[3]), progress=False)"
                )
                path = Path(folder) / "experiment.toml"
                path.write_text(to_toml(experiment))
                command = [sys.executable, "-c", code, str(path), f"{folder}/out", str(count)]
                times[count] = seconds(partial(subprocess.run, command, check=True))
        ratios.append(times[1] / times[2])
        ones.append(times[1])
    return {
        "runs": len(plan_runs(experiment)),
        "one_worker_s": round(statistics.median(ones), 1),
        "two_over_one": round(statistics.median(ratios), 3),
        "all": [round(r, 3) for r in ratios],
    }


def memory() -> dict[str, float]:
    """Peak memory of a sweep [MiB] with few and many cycles, few and many runs."""
    peaks = {}
    for name, cycles, repetitions in (
        ("few", 5, 1),
        ("many cycles", 60, 1),
        ("many runs", 5, 12),
    ):
        code = (
            "import pathlib, tempfile; from faultgen.dataset.experiment import make_experiment\n"
            "from faultgen.dataset.sweep import generate\n"
            f"e = make_experiment({{'robot': '{ROBOT}', 'task': '{TASK}', 'axis': 1,"
            f" 'cycles': {cycles}, 'repetitions': {repetitions}, 'healthy': False,"
            " 'paired': False})\n"
            "with tempfile.TemporaryDirectory() as d: generate(e, d, progress=False)\n"
            # of this program alone: ru_maxrss would begin with the peak of the process that forks
            "status = pathlib.Path('/proc/self/status').read_text()\n"
            "print(int(status.split('VmHWM:')[1].split()[0]) / 1024)"
        )
        out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        peaks[name] = round(float(out.stdout), 1)
    return peaks


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="shorter runs, fewer repeats")
    parser.add_argument("--save", type=Path, help="also write the result there")
    options = parser.parse_args()
    result = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "mujoco": mujoco.__version__,
        "stepping": stepping(3 if options.quick else 6),
        "workers": workers(20 if options.quick else 60, 1 if options.quick else 3),
        "peak_memory_mib": memory(),
    }
    text = json.dumps(result, indent=1)
    print(text)
    if options.save:
        options.save.write_text(text + "\n")


if __name__ == "__main__":
    main()
