"""Does discovery name the wear in this project's own datasets, when the label is hidden?

Datasets are generated with friction wear on one axis and the noise of a sensor preset; the last
cycle of each task of the worn run is compared with that of the healthy run.

    python benchmarks/own_wear.py --workers 2
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from faultgen import generate, open_dataset
from faultgen.dataset.experiment import Experiment
from faultgen.dataset.reader import StoredRun
from faultgen.discovery import Recording, investigate
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

TASKS = ["pick_and_place", "spot_weld", "arc_weld"]
WORN = ((1, 0.05), (2, 0.10), (3, 0.10), (4, 0.20), (5, 0.10), (6, 0.20))
"""Axis and severity of each case."""


def recording_of(runs: list[StoredRun], robot: Robot, cycle: int = -1) -> Recording:
    """One cycle of each run as a recording, a segment a run.

    Args:
        runs: Runs of one robot, each of another task, with all signals.
        robot: The robot.
        cycle: Which cycle.
    """
    position, torque, reference, temperature, starts = [], [], [], [], [0]
    for run in runs:
        motion = plan(load_task(robot.name, str(run["task"])), robot)
        position.append(run.read("signals/motor_position")[cycle])
        torque.append(run.read("signals/motor_torque")[cycle])
        times = np.arange(len(position[-1])) * float(run["sample_period"])
        reference.append(motion(times)[0])
        warm = float(run.read("cycle/temperature")[cycle])
        temperature.append(np.full(len(times), warm))
        starts.append(starts[-1] + len(times))
    return Recording(
        source="dataset",
        robot=robot.name,
        side="motor",
        sample_period=float(runs[0]["sample_period"]),
        position=np.concatenate(position).astype(float),
        torque=np.concatenate(torque).astype(float),
        reference_position=np.concatenate(reference),
        temperature=np.concatenate(temperature),
        segments=tuple(starts[:-1]),
    )


def main(
    sensors: Annotated[str, typer.Option(help="Sensor preset of the datasets.")] = "thesis",
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
    cache: Annotated[Path | None, typer.Option(help="Folder for sensitivities.")] = None,
) -> None:
    """Generate, hide the label, discover, and print a table."""
    print("| robot | worn | verdict | named | severity | not excluded |")
    print("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        kept = cache or Path(folder) / "sensitivities"
        for name in ("puma560", "irb6700"):
            robot = load_robot(name)
            for axis, severity in WORN:
                experiment = Experiment(
                    robot=[name],
                    task=TASKS,
                    axis=[[axis]],
                    schedule=[severity] * 2,
                    cycles=2,
                    sensors=sensors,
                    seed=axis,
                )
                out = Path(folder) / f"{name}-{axis}"
                generate(experiment, out, workers=workers, progress=False)
                runs = open_dataset(out).runs
                by_label = {
                    worn: [r for r in runs if (int(r["axis"]) > 0) == worn]
                    for worn in (True, False)
                }
                worn, healthy = (
                    recording_of(sorted(by_label[k], key=lambda r: str(r["task"])), robot)
                    for k in (True, False)
                )
                found = investigate(worn, robot, healthy, workers=workers, cache=kept).answer
                named = ", ".join(f"{one.effect} {one.axis}" for one in found.effects)
                sizes = ", ".join(f"{one.severity:.3g} ± {one.error:.2g}" for one in found.effects)
                others = ", ".join(f"{effect} {i}" for effect, i, _ in found.alternatives)
                print(
                    f"| {name} | axis {axis}, {severity:.0%} | {found.verdict} | {named} | {sizes} "
                    f"| {others} |",
                    flush=True,
                )


if __name__ == "__main__":
    typer.run(main)
