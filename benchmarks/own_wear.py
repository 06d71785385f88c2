"""Does discovery name the effects in this project's own datasets, when the label is hidden?

Datasets are generated with one effect of a size that matters in a plant, and with the noise of a
sensor preset. The runs are not paired: each has noise of its own. The last cycle of each task of
the worn run is given to `faultgen.discover`, with and without that of the healthy run.

    python benchmarks/own_wear.py --workers 2
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import faultgen
from faultgen import generate, open_dataset
from faultgen.dataset.experiment import Experiment
from faultgen.discovery import write_recording
from faultgen.recordings.from_runs import recording_of
from faultgen.robot import COULOMB, Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

TASKS = ["pick_and_place", "spot_weld", "arc_weld"]

CASES = (
    ("friction_wear", 2, 0.2),
    ("coulomb_friction", 3, 0.2),
    ("viscous_friction", 1, 0.2),
    ("static_friction", 2, 0.5),
    ("friction_asymmetry", 3, 0.1),
    ("torque_offset", 2, 0.1),
    ("load_friction", 2, 0.02),
    ("backlash", 3, 1e-3),
    ("gear_stiffness", 2, 0.3),
    ("gravity_spring", 2, 20.0),
    ("torque_ripple", 1, 0.1),
    ("torque_constant", 3, 0.05),
    ("payload_mass", 6, 0.1),
    ("delay", 2, 0.004),
    ("encoder_offset", 2, 2e-3),
    ("", 1, 0.0),
)
"""Effect, axis and severity of each case; the last robot is healthy. The torques of `torque_offset`
and `torque_ripple` are shares of the axis' Coulomb friction here."""

FURTHER: tuple[tuple[str, int, float], ...] = (
    ("seizing_spot", 2, 1.0),
    ("seizing_spot", 3, 0.5),
    ("tooth_damage", 2, 5e-5),
    ("tooth_damage", 3, 2e-4),
    ("winding_fault", 1, 0.2),
    ("winding_fault", 3, 0.1),
    ("loose_tool", 6, 1e-3),
    ("torque_sensor_gain", 3, 0.05),
    ("encoder_quantisation", 2, 0.02),
    ("sensor_dropout", 3, 0.05),
    ("sensor_stuck", 2, 0.05),
)
"""The same for effects whose place, phase or moment has to be found. Their parameters are drawn."""

HEALTHY = "no missing effect"


def parameters_of(robot: Robot, effect: str, axis: int, seed: int) -> dict[str, int | float | str]:
    """Draw the parameters of a case: the angle of a spot within the task, and phases."""
    rng = np.random.default_rng(seed)
    if effect == "seizing_spot":
        motion = plan(load_task(robot.name, TASKS[0], robot.tasks), robot)
        position, _, _ = motion(np.linspace(0, motion.period, 500))
        low, high = np.quantile(position[:, axis - 1], [0.2, 0.8])
        return {"angle": float(rng.uniform(low, high)), "width": float(rng.uniform(0.15, 0.3))}
    if effect in ("tooth_damage", "winding_fault"):
        return {"phase": float(rng.uniform(-np.pi, np.pi))}
    return {"direction": int(rng.integers(3))} if effect == "loose_tool" else {}


def severity_of(robot: Robot, effect: str, axis: int, size: float) -> float:
    """Severity of a case in the unit of its effect."""
    if effect not in ("torque_offset", "torque_ripple"):
        return size
    friction = robot.ids("actuator", "friction")[axis - 1]
    return size * float(robot.model.actuator_biasprm[friction, COULOMB])


def generated(
    robot: Robot, case: tuple[str, int, float], seed: int, sensors: str, out: Path
) -> None:
    """Write ``worn.h5`` and ``healthy.h5`` of a case into a folder."""
    effect, axis, size = case
    severity = severity_of(robot, effect, axis, size)
    parameters = parameters_of(robot, effect, axis, seed)
    experiment = Experiment(
        robot=[robot.name],
        task=TASKS,
        axis=[[axis]],
        effect=[effect or "friction_wear"],
        parameters={effect: parameters} if parameters else {},
        schedule=[severity] * 2,
        cycles=2,
        sensors=sensors,
        seed=seed,
        paired=False,
    )
    generate(experiment, out / "data", workers=1, progress=False)
    runs = sorted(open_dataset(out / "data").runs, key=lambda run: str(run["task"]))
    for name, is_worn in (("worn", True), ("healthy", False)):
        chosen = [run.path for run in runs if (int(run["axis"]) > 0) == is_worn]
        write_recording(recording_of(chosen), out / f"{name}.h5")


def main(
    sensors: Annotated[str, typer.Option(help="Sensor preset of the datasets.")] = "thesis",
    robots: Annotated[str, typer.Option(help="Names of robots.")] = "puma560,irb6700",
    mode: Annotated[str, typer.Option(help="'twin', 'alone' or 'both'.")] = "both",
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 1,
    further: Annotated[bool, typer.Option(help="Effects that have a place or a moment.")] = False,
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
    cache: Annotated[Path | None, typer.Option(help="Folder for sensitivities.")] = None,
) -> None:
    """Generate, hide the label, discover, and print a table."""
    print("| robot | hidden | twin | verdict | named | severity | not excluded | right | seconds |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    right: dict[tuple[str, str], list[bool]] = {}
    with tempfile.TemporaryDirectory() as folder:
        kept = cache or Path(folder) / "sensitivities"
        for name in robots.split(","):
            robot = load_robot(name)
            for number, case in enumerate(FURTHER if further else CASES):
                effect, axis, size = case
                out = Path(folder) / f"{name}-{number}"
                generated(robot, case, 100 * seed + number, sensors, out)
                measured = out / ("worn.h5" if effect else "healthy.h5")
                other = out / ("healthy.h5" if effect else "worn.h5")  # both without wear
                for how in ("twin", "alone") if mode == "both" else (mode,):
                    told = faultgen.discover(
                        measured,
                        name,
                        healthy=other if how == "twin" else None,
                        workers=workers,
                        cache=kept,
                    )
                    found = [(one["effect"], one["axis"]) for one in told["effects"]]
                    is_right = told["verdict"] == HEALTHY if not effect else found[:1] == [case[:2]]
                    right.setdefault((name, how), []).append(is_right)
                    sizes = ", ".join(
                        f"{one['parameters']['severity']:.3g}" for one in told["effects"]
                    )
                    others = ", ".join(
                        f"{one['effect']} {one['axis']}" for one in told["alternatives"]
                    )
                    hidden = f"{effect} {axis}, {severity_of(robot, *case):.3g}" if effect else "–"
                    print(
                        f"| {name} | {hidden} | {how} | {told['verdict']} "
                        f"| {', '.join(f'{e} {k}' for e, k in found)} | {sizes} | {others} "
                        f"| {'yes' if is_right else 'no'} | {told['seconds']:.0f} |",
                        flush=True,
                    )
    print()
    for (name, how), answers in right.items():
        print(f"{name}, {how}: {sum(answers)} of {len(answers)} right")


if __name__ == "__main__":
    typer.run(main)
