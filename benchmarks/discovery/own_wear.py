"""Cases with the effects of this project's own datasets, for the question whether they are named.

Datasets are generated with one effect of a size that matters in a plant, and with the noise of a
sensor preset. The runs are not paired: each has noise of its own. The last cycle of each task of
the worn run is a case, with and without that of the healthy run.

    python -m benchmarks.discovery.own_wear -o DIR
    python -m benchmarks.discovery.score --trial DIR
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from faultgen import generate, open_dataset
from faultgen.dataset.experiment import Experiment
from faultgen.discovery import write_recording
from faultgen.recordings.from_runs import recording_of
from faultgen.robot import COULOMB, Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.system.files import write_text
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


def write_case(
    robot: Robot, case: tuple[str, int, float], seed: int, sensors: str, folder: Path
) -> list[dict[str, Any]]:
    """Write the recordings of a case, unless they exist.

    Args:
        robot: The robot.
        case: Effect, axis and severity, of `CASES` or `FURTHER`.
        seed: Of its noise.
        sensors: Preset.
        folder: Of the case.

    Returns:
        What is in it: an entry with a baseline and one without, see scoring.judging.
    """
    effect, axis, size = case
    if not (folder / "measured.h5").is_file():
        generated(robot, case, seed, sensors, folder)
        # of a case without an effect, both are healthy
        first, second = ("worn", "healthy") if effect else ("healthy", "worn")
        (folder / f"{first}.h5").replace(folder / "measured.h5")
        if second != "healthy":
            (folder / f"{second}.h5").replace(folder / "healthy.h5")
    severity = severity_of(robot, effect, axis, size) if effect else 0.0
    entry = {
        "folder": folder.name,
        "kind": "single" if effect else "healthy",
        "robot": robot.name,
        "effects": [{"name": effect, "axis": axis, "severity": severity}] if effect else [],
        "factors": {"robot": robot.name, "sensors": sensors},
    }
    return [{"name": f"{folder.name}_{mode}", "mode": mode, **entry} for mode in ("twin", "alone")]


def main(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the cases.")],
    sensors: Annotated[str, typer.Option(help="Sensor preset of the datasets.")] = "thesis",
    robots: Annotated[str, typer.Option(help="Names of robots.")] = "puma560,irb6700",
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 1,
    further: Annotated[bool, typer.Option(help="Effects that have a place or a moment.")] = False,
) -> None:
    """Write cases and what is in them, for benchmarks/discovery/score.py --trial."""
    truth = []
    for name in robots.split(","):
        robot = load_robot(name)
        for number, case in enumerate(FURTHER if further else CASES):
            folder = out / "cases" / f"{name}_{number + 1}"
            truth += write_case(robot, case, 100 * seed + number, sensors, folder)
    write_text(out / "truth.json", json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
