"""How exact and how fast is the simulation on a graphics card? See `faultgen generate --device`.

python -m benchmarks.speed.device --device cuda --save benchmarks/results/device.json  # ten minutes
python -m benchmarks.speed.device --device cpu --seconds 0.2 --worlds 8 --tasks 1      # a trial

Every part is saved as soon as it is done:

speed    many robots with friction wear step through the begin of a motion. The second cycle is
         timed, so that nothing is compiled any more. One core of the processor, and all cores, step
         through the same motion in double precision.
kernels  what a step of the worlds consists of, and how long it takes with and without a CUDA graph.
exact    for tasks of both robots and every effect, one cycle in single precision on the device and
         in double precision on the processor. The error is the RMS difference of the motor torques
         over the mean |torque| of the axis in the healthy cycle; that of the worst axis counts.

docs/speed.md shows the results.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp
from joblib import Parallel, delayed

from faultgen.applied import Applied
from faultgen.effects import EFFECTS
from faultgen.errors import SimulationFailed
from faultgen.robot import robot_names
from faultgen.simulation import worlds
from faultgen.simulation.batch_on_device import Worlds
from faultgen.simulation.nominal import nominal
from faultgen.simulation.plant import Plant, assemble
from faultgen.simulation.stepping import simulate
from faultgen.simulation.worlds import simulate_together, version
from faultgen.system.files import write_text
from faultgen.tasks import task_names

SAMPLE_PERIOD = 0.004
LEAD_IN = 0.5
"""Time before the recorded one [s]."""
ROBOT, TASK = "puma560", "pick_and_place"
"""Of the speed."""
KINDS = 64
"""Severities of friction wear; with more worlds, several have the same model."""
PROFILED, STEPS = 4096, 200
"""Worlds and steps of the part `kernels`."""


def courses_of(robot: Any, count: int) -> list[list[Plant]]:
    """Plants of two cycles of many robots with friction wear."""
    kinds = min(count, KINDS)
    plants = [
        assemble(robot, [Applied("friction_wear", 1, 0.2 * (k + 1) / kinds)]) for k in range(kinds)
    ]
    return [2 * [plants[k % kinds]] for k in range(count)]


class Clock:
    """Adds up the time of calls of a function, the work on the device included."""

    def __init__(self, owner: Any, name: str, device: str) -> None:
        self.seconds, self._inside = 0.0, getattr(owner, name)
        self._device = device

        def timed(*args: Any, **more: Any) -> Any:
            started = time.perf_counter()
            told = self._inside(*args, **more)
            warp.synchronize_device(device)
            self.seconds += time.perf_counter() - started
            return told

        setattr(owner, name, timed)
        self.stop: Callable[[], None] = lambda: setattr(owner, name, self._inside)


def speed(device: str, count: int, seconds: float) -> dict[str, float]:
    """Time the second cycle of many worlds."""
    shared = nominal(ROBOT, TASK, SAMPLE_PERIOD)
    control = shared.control[: round(seconds / shared.robot.model.opt.timestep)]
    courses = courses_of(shared.robot, count)
    started = time.perf_counter()
    cycles = simulate_together(
        shared.robot, control, courses, sample_period=SAMPLE_PERIOD, device=device
    )
    next(cycles)
    first = time.perf_counter() - started
    stepping = Clock(Worlds, "_sample", device)
    moving = Clock(Worlds, "run", device)
    started = time.perf_counter()
    next(cycles)
    whole = time.perf_counter() - started
    for clock in (stepping, moving):
        clock.stop()
    steps = count * len(control)
    told = {
        "worlds": count,
        "steps": len(control),
        "first_cycle_s": first,
        "cycle_s": whole,
        "stepping_s": stepping.seconds,
        "transfers_s": moving.seconds - stepping.seconds,
        "steps_per_second": steps / whole,
        "steps_per_second_without_host": steps / stepping.seconds,
    }
    if warp.get_device(device).is_cuda:
        used = warp.get_device(device)
        told["memory_bytes"] = used.total_memory - used.free_memory
    return told


def _alone(seconds: float) -> float:
    """Time of a cycle of one robot in double precision on one core."""
    shared = nominal(ROBOT, TASK, SAMPLE_PERIOD)
    control = shared.control[: round(seconds / shared.robot.model.opt.timestep)]
    (plants,) = courses_of(shared.robot, 1)
    cycles = simulate(shared.robot, control, 11 * plants[:1], sample_period=SAMPLE_PERIOD)
    next(cycles)
    started = time.perf_counter()
    done = sum(1 for _ in cycles)
    return (time.perf_counter() - started) / done / len(control)


def processors(seconds: float) -> dict[str, float]:
    """Steps per second of one core, and of all cores at once."""
    cores = len(os.sched_getaffinity(0))
    told: dict[str, float] = {"cores": cores, "one_core": 1 / _alone(seconds)}
    with Parallel(n_jobs=cores) as running:
        running(delayed(_alone)(0.1) for _ in range(cores))  # starts the processes
        times = running(delayed(_alone)(seconds) for _ in range(2 * cores))
    told["all_cores"] = cores / float(np.mean(times))
    return told


def kernels(device: str, count: int) -> dict[str, Any]:
    """What a step consists of, with its time; and a step with and without a graph."""
    shared = nominal(ROBOT, TASK, SAMPLE_PERIOD)
    control = np.ascontiguousarray(shared.control[:STEPS])
    plants = [one[0] for one in courses_of(shared.robot, count)]
    told: dict[str, Any] = {"worlds": count}
    batch = Worlds(plants, device)
    batch.use(plants, [control] * count)
    batch.put_states(count * [worlds._start(shared.robot, plants[0], control, 1)])
    every = round(SAMPLE_PERIOD / shared.robot.model.opt.timestep)
    batch.run(0, every)
    started = time.perf_counter()
    batch.run(0, every)
    told["step_s"] = (time.perf_counter() - started) / STEPS
    graph = Worlds._sample
    Worlds._sample = lambda self, control, records, every: self._steps(  # type: ignore[method-assign]
        control, records, every, every
    )
    started = time.perf_counter()
    batch.run(0, every)
    told["step_without_graph_s"] = (time.perf_counter() - started) / STEPS
    if batch.device.is_cuda:
        warp.timing_begin(cuda_filter=warp.TIMING_ALL)
        batch.run(0, every)
        sums: dict[str, list[float]] = {}
        for one in warp.timing_end():
            sums.setdefault(one.name, []).append(one.elapsed * 1e-3)
        told["device_s"] = {
            name: {"calls": len(times) / STEPS, "step_s": sum(times) / STEPS}
            for name, times in sorted(sums.items(), key=lambda pair: -sum(pair[1]))
        }
    Worlds._sample = graph  # type: ignore[method-assign]
    return told


def plants_of(robot: Any) -> tuple[dict[str, Plant], list[str]]:
    """The healthy robot and one plant for each effect, and the effects that are refused."""
    plants, refused = {"healthy": assemble(robot)}, []
    for name, effect in EFFECTS.items():
        axes = effect.axes(robot.n_axes)
        if name == "learned_law" or not axes:
            continue
        plant = assemble(robot, [Applied(name, axes[len(axes) // 2], effect.step)])
        if plant.updates:
            refused.append(name)
        else:
            plants[name] = plant
    return plants, refused


def errors(robot_name: str, task: str, device: str, seconds: float | None) -> dict[str, Any]:
    """Compare one cycle of every plant."""
    shared = nominal(robot_name, task, SAMPLE_PERIOD)
    robot, control = shared.robot, shared.control
    if seconds is not None:
        control = control[: round(seconds / robot.model.opt.timestep)]
    plants, refused = plants_of(robot)
    given: dict[str, Any] = {"sample_period": SAMPLE_PERIOD, "lead_in": LEAD_IN}
    courses = [[plant] for plant in plants.values()]
    (cycles,) = simulate_together(robot, control, courses, device=device, **given)
    found: dict[str, float | str] = {}
    for (name, plant), cycle in zip(plants.items(), cycles, strict=True):
        (exact,) = simulate(robot, control, [plant], **given)
        if cycle is None or isinstance(cycle, SimulationFailed):
            found[name] = str(cycle)
            continue
        error = cycle.motor_torque - exact.motor_torque
        found[name] = float((np.sqrt((error**2).mean(axis=0)) / shared.mean_torque).max())
    return {"seconds": len(control) * robot.model.opt.timestep, "error": found, "refused": refused}


def table(results: dict[str, Any]) -> str:
    """Make the tables of docs/speed.md."""
    lines: list[str] = []
    if results.get("speed"):
        one, cores = results["processors"]["one_core"], results["processors"]["all_cores"]
        lines += [
            f"One core: {one:.3g} steps/s; {results['processors']['cores']} cores: {cores:.3g}.",
            "",
            "| worlds | steps/s | over one core | over all cores | transfers and host | memory |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for row in results["speed"]:
            rate = row["steps_per_second"]
            lines.append(
                f"| {row['worlds']} | {rate:.3g} | {rate / one:.3g} | {rate / cores:.3g} | "
                f"{100 * (1 - row['stepping_s'] / row['cycle_s']):.0f} % | "
                f"{row.get('memory_bytes', 0) / 2**30:.2f} GiB |"
            )
        lines.append("")
    if results.get("errors"):
        told = list(results["errors"].values())
        lines += ["| effect | largest error, in percent of the mean torque | robot and task |"]
        lines += ["| --- | --- | --- |"]
        for effect in told[0]["error"]:
            sizes = {k: one["error"][effect] for k, one in results["errors"].items()}
            broken = [k for k, v in sizes.items() if isinstance(v, str)]
            where = broken[0] if broken else max(sizes, key=sizes.__getitem__)
            size = "failed" if broken else f"{100 * sizes[where]:.3f}"
            lines.append(f"| {effect} | {size} | {where} |")
        lines += ["", f"Refused: {', '.join(told[0]['refused'])}."]
    return "\n".join(lines)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="cuda")
    parser.add_argument(
        "--worlds", type=int, nargs="*", default=[64, 256, 1024, 4096, 16384], help="for the speed"
    )
    parser.add_argument("--speed-seconds", type=float, default=1.0, help="of the timed motion")
    parser.add_argument("--seconds", type=float, help="compared of each task; default: all of it")
    parser.add_argument("--tasks", type=int, default=99, help="of each robot that are compared")
    parser.add_argument("--save", type=Path)
    given = parser.parse_args()
    results: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "device": f"{given.device}: {warp.get_device(given.device).name}",
        "by": version(),
    }

    def keep() -> None:
        if given.save:
            write_text(given.save, json.dumps(results, indent=1) + "\n")

    started = time.perf_counter()
    results["speed"], results["errors"] = [], {}
    if given.worlds:
        results["processors"] = processors(given.speed_seconds)
        print(f"{time.perf_counter() - started:.0f} s: {results['processors']}", flush=True)
    for count in given.worlds:
        results["speed"].append(speed(given.device, count, given.speed_seconds))
        print(f"{time.perf_counter() - started:.0f} s: {results['speed'][-1]}", flush=True)
        keep()
    if given.worlds:
        results["kernels"] = kernels(given.device, min(PROFILED, max(given.worlds)))
        keep()
        print(f"{time.perf_counter() - started:.0f} s: {results['kernels']}", flush=True)
    for robot in robot_names():
        for task in task_names(robot)[: given.tasks]:
            results["errors"][f"{robot} {task}"] = errors(robot, task, given.device, given.seconds)
            keep()
            print(f"{time.perf_counter() - started:.0f} s: {robot} {task}", flush=True)
    print(table(results))


if __name__ == "__main__":
    main()
