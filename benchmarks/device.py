"""How exact and how fast is the simulation on a graphics card? See `faultgen generate --device`.

python benchmarks/device.py --device cuda --save device.json
python benchmarks/device.py --device cpu --seconds 2 --worlds 0      # the same code, without a card

For every task of both robots and every effect, one cycle is stepped in single precision on the
device and in double precision on the processor. The error is the RMS difference of the motor
torques over the mean |torque| of the axis in the healthy cycle; that of the worst axis counts.
docs/speed.md shows the results.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.applied import Applied
from faultgen.effects import EFFECTS
from faultgen.errors import SimulationFailed
from faultgen.robot import robot_names
from faultgen.simulation.nominal import nominal
from faultgen.simulation.plant import Plant, assemble
from faultgen.simulation.stepping import simulate
from faultgen.simulation.worlds import simulate_together, version
from faultgen.system.files import write_text
from faultgen.tasks import task_names

SAMPLE_PERIOD = 0.004
LEAD_IN = 0.5
"""Time before the recorded one [s]."""


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


def speed(robot_name: str, task: str, device: str, worlds: int) -> dict[str, float]:
    """Time of one cycle of many worlds, and of one world on one core of the processor."""
    shared = nominal(robot_name, task, SAMPLE_PERIOD)
    robot = shared.robot
    plants = [
        assemble(robot, [Applied("friction_wear", 1, 0.2 * (k + 1) / worlds)])
        for k in range(worlds)
    ]
    times = []
    for kind in ("device", "processor"):
        plan: Any = [[plant, plant] for plant in (plants if kind == "device" else plants[:1])]
        if kind == "device":
            stepped: Iterator[object] = simulate_together(
                robot, shared.control, plan, sample_period=SAMPLE_PERIOD, device=device
            )
        else:
            stepped = simulate(robot, shared.control, plan[0], sample_period=SAMPLE_PERIOD)
        next(stepped)  # compiles, and makes the graph
        started = time.perf_counter()
        next(stepped)
        times.append((time.perf_counter() - started) / len(plan) / len(shared.control))
    return {"worlds": worlds, "device_step": times[0], "processor_step": times[1]}


def table(results: dict[str, Any]) -> str:
    """Make the table of docs/speed.md."""
    told = list(results["errors"].values())
    lines = ["| effect | largest error, in percent of the mean torque | robot and task |"]
    lines += ["| --- | --- | --- |"]
    for effect in told[0]["error"]:
        sizes = {k: one["error"][effect] for k, one in results["errors"].items()}
        broken = [k for k, v in sizes.items() if isinstance(v, str)]
        where = broken[0] if broken else max(sizes, key=sizes.__getitem__)
        size = "failed" if broken else f"{100 * sizes[where]:.3f}"
        lines.append(f"| {effect} | {size} | {where} |")
    lines += ["", f"Refused: {', '.join(told[0]['refused'])}."]
    if "speed" in results:
        one = results["speed"]
        ratio = one["processor_step"] / one["device_step"]
        lines += [
            "",
            f"{one['worlds']} worlds: {1e6 * one['device_step']:.3g} us for each step of a world, "
            f"{1e6 * one['processor_step']:.3g} us on one core; {ratio:.3g} times as fast.",
        ]
    return "\n".join(lines)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--seconds", type=float, help="of each task; default: a whole cycle")
    parser.add_argument("--worlds", type=int, default=2048, help="for the speed; 0: not measured")
    parser.add_argument("--save", type=Path)
    given = parser.parse_args()
    results: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "device": given.device,
        "by": version(),
    }
    results["errors"] = {
        f"{robot} {task}": errors(robot, task, given.device, given.seconds)
        for robot in robot_names()
        for task in task_names(robot)
    }
    if given.worlds:
        results["speed"] = speed("puma560", "pick_and_place", given.device, given.worlds)
    print(table(results))
    if given.save:
        write_text(given.save, json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
