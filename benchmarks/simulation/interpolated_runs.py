"""Interpolated runs of `generate` beside stepped ones: do the stated bounds hold, and how fast?

    python -m benchmarks.simulation.interpolated_runs [--robot puma560] [--task pick_and_place]
        [--cycles 100] [--effects friction_wear,delay] [--schedule exponential] [--seed 100]
        [--speed]

For every effect, a run with the preset 'realistic' is interpolated, and all of its cycles are
stepped as well. The severity grows to the default of the effect, or to that of `--severity`, on the
second axis, or on the first one on which the effect can act. Printed as Markdown: the error that is
measured over that which is stated, for the axis with the largest share, and the stated bounds as
shares of the torque noise on the worst axis; each for the whole run, for single cycles and for
single samples. With `--speed`, how many more cycles a second of processor time gives in a run of
1000 cycles is measured instead.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.interpolated import interpolated
from faultgen.dataset.planning import Run, plan_runs
from faultgen.dataset.run import make_run, prepare
from faultgen.effects import EFFECTS, get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import load_robot
from faultgen.simulation.stepping import simulate

_STEPPED = 10  # cycles that are stepped, to measure the time
_LONG = 1000  # cycles of the run whose time is measured


def main() -> None:
    """Measure every effect."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="puma560")
    parser.add_argument("--task", default="pick_and_place")
    parser.add_argument("--cycles", type=int, default=100)
    parser.add_argument("--effects", default=",".join(EFFECTS))
    parser.add_argument("--schedule", default="exponential")
    parser.add_argument("--severity", type=float)
    parser.add_argument("--axis", type=int, default=2)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--speed", action="store_true")
    args = parser.parse_args()
    if args.speed:
        print("| effect | times faster |\n| --- | --- |")
    else:
        print("| effect | run | cycle | sample | stated: run | cycle | sample |")
        print("|" + " --- |" * 7)
    shares: list[np.ndarray] = []
    for run in _runs(args):
        name = f"`{run.effect}` {run.axes[0]}"
        try:
            if args.speed:
                print(f"| {name} | {_times_faster(run):.0f} |", flush=True)
                continue
            share, stated = _measured(run)
        except (InputError, SimulationFailed) as error:
            print(f"| {name} | refused: {str(error).removeprefix('fidelity: ')} |", flush=True)
            continue
        shares.append(share)
        cells = [*(f"{one.max():.2f}" for one in share), *(f"{one:.3f}" for one in stated)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    if shares:
        over = np.array(shares) > 1  # (runs, bounds, axes)
        held = ", ".join(f"{over.shape[0] - int(one)}" for one in over.any(axis=2).sum(axis=0))
        print(f"\n{len(shares)} runs; the bounds of run, cycle and sample hold in {held} of them.")


def _runs(args: argparse.Namespace) -> Iterator[Run]:
    """The run of each effect."""
    for name in args.effects.split(","):
        axes = list(get_effect(name).usual_axes_on(load_robot(args.robot)))
        if not axes:
            continue
        entries = {
            "robot": args.robot,
            "task": args.task,
            "effect": name,
            "axis": args.axis if args.axis in axes else axes[0],
            "cycles": _LONG if args.speed else args.cycles,
            "schedule": args.schedule,
            "sensors": "realistic",
            "seed": args.seed,
            "signals": "none",
            "healthy": False,
            "fidelity": "interpolated",
        }
        if args.severity is not None:
            entries["severity"] = args.severity
        try:
            yield from plan_runs(make_experiment(entries))
        except InputError as error:
            print(f"| `{name}` | refused: {error} |", flush=True)


def _measured(run: Run) -> tuple[np.ndarray, list[float]]:
    """Measured over stated errors, shape (3, n_axes), and stated ones over the noise."""
    ready = prepare(run)
    robot, control = ready.shared.robot, ready.shared.control
    found = interpolated(ready.course, ready.shared)
    plants = ready.course.plants(robot)
    true = simulate(robot, control, plants, sample_period=run.sample_period)
    square, by_cycle, sample = [], [], []
    for one, other in zip(found.cycles(), true, strict=True):
        error = one.motor_torque - other.motor_torque
        square.append(np.mean(error**2, axis=0))
        by_cycle.append(np.sqrt(square[-1]))
        sample.append(np.abs(error).max(axis=0))
    measured = [np.sqrt(np.mean(square, axis=0)), np.max(by_cycle, axis=0), np.max(sample, axis=0)]
    share = np.array(measured) / np.maximum(found.error, 1e-6 * found.noise)
    return share, [float(np.max(one / found.noise)) for one in found.error]


def _times_faster(run: Run) -> float:
    short = replace(run, cycles=_STEPPED, interpolated=False)
    return (_LONG / _seconds(run)) / (_STEPPED / _seconds(short))


def _seconds(run: Run) -> float:
    with tempfile.TemporaryDirectory() as folder:
        started = time.process_time()
        _, reason = make_run(run, Path(folder))
        if reason is not None:
            raise SimulationFailed(reason)
        return time.process_time() - started


if __name__ == "__main__":
    main()
