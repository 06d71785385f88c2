"""Interpolated runs of `generate` beside stepped ones: error, and cycles per second.

    python benchmarks/interpolated_runs.py [--robot puma560] [--task pick_and_place] [--cycles 1000]
        [--effects friction_wear,delay]

For every effect, a run of 1000 cycles with the preset 'realistic' is made without sampled signals:
interpolated, and as long as ten cycles take also stepped. The severity grows exponentially to the
default of the effect on the second axis, or on the first one on which it can act. Printed as
Markdown: the error that the file states, the largest error of ten further cycles that are spread
over the run, and how many times more cycles each processor second gives. An error is that of the
worst axis, as a share of the torque noise.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from faultgen.dataset.conditions import Course
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.interpolated import interpolated, noise_of
from faultgen.dataset.planning import Run, plan_runs
from faultgen.dataset.run import make_run
from faultgen.effects import EFFECTS, get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.monitoring.environment import surroundings
from faultgen.monitoring.sensors import get_sensors
from faultgen.robot import load_robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.state import plant_at
from faultgen.simulation.stepping import simulate

_STEPPED = 10  # cycles that are stepped, to measure the time and the error


def main() -> None:
    """Measure every effect."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="puma560")
    parser.add_argument("--task", default="pick_and_place")
    parser.add_argument("--cycles", type=int, default=1000)
    parser.add_argument("--effects", default=",".join(EFFECTS))
    args = parser.parse_args()
    print("| effect | stated error | error of further cycles | times faster |")
    print("| --- | --- | --- | --- |")
    for name in args.effects.split(","):
        axes = list(get_effect(name).axes_on(load_robot(args.robot)))
        if not axes:
            continue
        entries = {
            "robot": args.robot,
            "task": args.task,
            "effect": name,
            "axis": 2 if 2 in axes else axes[0],
            "cycles": args.cycles,
            "sensors": "realistic",
            "signals": "none",
            "healthy": False,
            "fidelity": "interpolated",
        }
        try:
            (run,) = plan_runs(make_experiment(entries))
            print(f"| `{name}` | {' | '.join(_measured(run))} |", flush=True)
        except (InputError, SimulationFailed) as error:
            print(
                f"| `{name}` | refused: {str(error).removeprefix('fidelity: ')} | | |", flush=True
            )


def _measured(run: Run) -> list[str]:
    shared = nominal(run.robot, run.task, run.sample_period, run.operation)
    sensors = get_sensors(run.sensors)
    around = surroundings(
        sensors,
        run.cycles,
        shared.robot.friction_temperature,
        np.random.default_rng(run.seed).spawn(4)[0],
    )
    course = Course(run, around, [()] * run.cycles)
    found = interpolated(course, shared)
    further = np.linspace(1, run.cycles - 1, _STEPPED).astype(int)
    conditions, cycles = list(course), list(found.cycles())
    noise = noise_of(sensors, shared.mean_torque)
    errors = []
    for k in further.tolist():
        plants = [plant_at(shared.robot, shared.robot.spec(), conditions[j]) for j in (k - 1, k)]
        *_, true = simulate(shared.robot, shared.control, plants, sample_period=run.sample_period)
        error = np.sqrt(np.mean((cycles[k].motor_torque - true.motor_torque) ** 2, axis=0))
        errors.append(np.max(error / noise))
    interpolated_rate = run.cycles / _seconds(run)
    short = replace(run, cycles=_STEPPED, interpolated=False)
    stepped_rate = _STEPPED / _seconds(short)
    stated = float(np.max(found.error / found.noise))
    return [f"{stated:.3f}", f"{max(errors):.3f}", f"{interpolated_rate / stepped_rate:.0f}"]


def _seconds(run: Run) -> float:
    with tempfile.TemporaryDirectory() as folder:
        started = time.process_time()
        _, reason = make_run(run, Path(folder))
        if reason is not None:
            raise SystemExit(reason)
        return time.process_time() - started


if __name__ == "__main__":
    main()
