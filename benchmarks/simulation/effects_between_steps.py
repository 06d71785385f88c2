"""Effects that are told between steps: what their interval costs, in time and in accuracy.

    python -m benchmarks.simulation.effects_between_steps

On all six axes, `pick_and_place`. Printed as Markdown: RMS error of the motor torque over that of
the effect against an update at each step, worst axis; in brackets time a step on one core [us].
Effects of many native elements have their time only.
"""

from __future__ import annotations

import time
from dataclasses import replace

import mujoco
import numpy as np
import typer

from faultgen.effects import Applied, get_effect
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import Plant, assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import LEAD_IN, simulate
from faultgen.tasks import load_task

TOLD = {"load_friction": 0.05, "seizing_spot": 0.5, "winding_fault": 0.3}
NATIVE = {"tooth_damage": 3e-5, "transmission_error": 3e-5, "torque_ripple": 0.1}
INTERVALS = (1e-3, 2e-3, 4e-3, 8e-3)
REPEATS = 3


def main() -> None:
    """Measure both robots."""
    print("| robot | effect | each step | " + " | ".join(f"{1e3 * h:g} ms" for h in INTERVALS))
    print("|" + " --- |" * (3 + len(INTERVALS)))
    for name in ("irb6700", "puma560"):
        robot = load_robot(name)
        step = robot.model.opt.timestep
        control = control_signal(plan(load_task(name, "pick_and_place"), robot), step)
        steps = len(control) + LEAD_IN / step

        def torque(plant: Plant | mujoco.MjModel) -> tuple[np.ndarray, float]:
            spent = []
            for _ in range(REPEATS):
                start = time.process_time()
                (cycle,) = simulate(robot, control, [plant], sample_period=0.004)  # noqa: B023
                spent.append((time.process_time() - start) / steps * 1e6)  # noqa: B023
            return cycle.motor_torque, min(spent)

        healthy, bare = torque(robot.model)
        print(f"| {name} | none | ({bare:.1f}) |" + " |" * len(INTERVALS), flush=True)
        for effect, severity in (TOLD | NATIVE).items():
            axes = get_effect(effect).axes(robot.n_axes)
            plant = assemble(robot, [Applied(effect, axis, severity) for axis in axes])
            best, cost = torque(replace(plant, interval=step))
            size = np.sqrt(np.mean((best - healthy) ** 2, axis=0))
            cells = []
            for interval in INTERVALS if plant.updates else ():
                other, spent = torque(replace(plant, interval=interval))
                error = np.sqrt(np.mean((other - best) ** 2, axis=0)) / size
                cells.append(f"{100 * error.max():.2g} % ({spent:.0f})")
            cells += [""] * (len(INTERVALS) - len(cells))
            print(f"| {name} | {effect} | ({cost:.1f}) | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    typer.run(main)
