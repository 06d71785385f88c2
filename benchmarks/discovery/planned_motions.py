"""Does discovery name more faults from the motions of `discover --plan` than from pick_and_place?

The robots are those of the sealed simulator: every number of the model is 1 to 5 % wrong, friction
has another form at low speed, and the faults have other functional forms than the catalogue's. Each
robot is recorded twice, with the planned motions and with pick_and_place for at least as long, and
both recordings get noise of the same size. Discovery gets no healthy recording.

    faultgen discover --plan --robot puma560 -o plan
    python -m benchmarks.discovery.planned_motions plan --cases 30 --workers 2 -o trial
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from joblib import Parallel, delayed
from sealed.effects import CATALOGUE, Effect, apply_effect, context
from sealed.physics import (
    GRID,
    SAMPLE_PERIOD,
    Physics,
    Reference,
    constant,
    nominal_physics,
    set_points,
    simulate,
)
from sealed.recording import Noise, draw_noise, torque_noise
from sealed.robots import random_robot
from tqdm import tqdm

from faultgen.discovery.planning.motion_plan import ORDERS, REFERENCE
from faultgen.recordings.recording import Recording, write_recording
from faultgen.report.discover import discover
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.system.files import write_text
from faultgen.tasks import load_task

NOISE = 0.01
"""Noise of the torque over its RMS in pick_and_place."""
SETS = (REFERENCE, "plan")
"""The two sets of motions."""


def references(folder: Path) -> dict[str, list[Reference]]:
    """Read the motions of a plan, and repeat pick_and_place for at least as long.

    Args:
        folder: Folder of the plan.

    Returns:
        Motions of each set.
    """
    made = json.loads((folder / "plan.json").read_text())
    robot = load_robot(made["robot"])

    def reference(task: str) -> Reference:
        motion = plan(load_task(robot.name, task), robot)
        return Reference(*motion(np.arange(round(motion.period / GRID) + 1) * GRID))

    once = reference(REFERENCE)
    cycles = -(-made["duration"] // (len(once.q) * GRID))
    return {
        REFERENCE: [once] * int(cycles),
        "plan": [reference(str(folder / one["file"])) for one in made["motions"]],
    }


def record(
    robot: str,
    motions: list[Reference],
    physics: Physics,
    fault: Effect,
    noise: Noise,
    rng: np.random.Generator,
) -> Recording:
    """Record a sealed robot with a fault.

    Args:
        robot: Name of the robot.
        motions: What it does.
        physics: The healthy robot.
        fault: The fault.
        noise: Noise of the torque.
        rng: Source of the noise.

    Returns:
        The recording, with a segment for each motion.
    """
    model, nominal = load_robot(robot), nominal_physics(load_robot(robot))
    slow = [constant(motion.samples, model.n_axes) for motion in motions]
    warm = [np.full(motion.samples, 40.0) for motion in motions]
    faulty, slow = apply_effect(fault, physics, context(robot), slow, warm)
    runs = [
        simulate(faulty, set_points(nominal, motion), part)
        for motion, part in zip(motions, slow, strict=True)
    ]
    torque = [run[:, :, 2] + torque_noise(noise, len(run), rng) for run in runs]
    return Recording(
        source="sealed",
        robot=robot,
        side="motor",
        sample_period=SAMPLE_PERIOD,
        position=np.concatenate([run[:, :, 0] for run in runs]),
        torque=np.concatenate(torque),
        reference_position=np.concatenate([motion.sampled for motion in motions]),
        segments=tuple(int(n) for n in np.cumsum([0, *(len(run) for run in runs[:-1])])),
    )


def drawn(folder: Path, cases: int, seed: int) -> list[Effect]:
    """Draw faults from the list of a plan, every effect about equally often."""
    rng = np.random.default_rng(seed)
    rates = json.loads((folder / "plan.json").read_text())["rates"]
    listed = [one for one in rates if one["effect"] in CATALOGUE]
    names = sorted({one["effect"] for one in listed})
    faults = []
    for k in range(cases):
        if k % len(names) == 0:
            order = rng.permutation(names)
        own = [one for one in listed if one["effect"] == order[k % len(names)]]
        one = own[int(rng.integers(len(own)))]
        details = {"order": float(rng.choice(ORDERS)), "phase": float(rng.uniform(0, 2 * np.pi))}
        faults.append(Effect(one["effect"], one["axis"], one["severity"], details))
    return faults


def trial(
    robot: str, folder: Path, out: Path, number: int, fault: Effect, workers: int = 1
) -> dict[str, Any]:
    """Record one robot with both sets of motions and ask discovery; kept in a file.

    Args:
        robot: Name of the robot.
        folder: Folder of the plan.
        out: Folder of the trial.
        number: Number of the case, which is also its seed.
        fault: The fault.
        workers: Processes of discovery.

    Returns:
        The truth, and the verdict and first effect for each set of motions.
    """
    kept = out / f"case_{number:03}.json"
    if kept.is_file():
        return dict(json.loads(kept.read_text()))
    rng = np.random.default_rng([2026, number])
    nominal = nominal_physics(load_robot(robot))
    physics = random_robot(nominal, rng)
    sets = references(folder)
    usual = simulate(nominal, set_points(nominal, sets[REFERENCE][0]))[:, :, 2]
    noise = draw_noise(NOISE, np.sqrt(np.mean(usual**2, axis=0)), rng)
    result: dict[str, Any] = {"effect": fault.name, "axis": fault.axis, "severity": fault.severity}
    for name, motions in sets.items():
        path = out / f"case_{number:03}_{name}.h5"
        write_recording(record(robot, motions, physics, fault, noise, rng), path)
        told = discover(path, robot, workers=workers, cache=out / "sensitivities")
        path.unlink()
        first = told["effects"][0] if told["effects"] else {}
        result[name] = {
            "verdict": told["verdict"],
            "effect": first.get("effect"),
            "axis": first.get("axis"),
            "listed": [
                [one["effect"], one["axis"]] for one in told["effects"] + told["alternatives"]
            ],
        }
    write_text(kept, json.dumps(result, indent=1) + "\n")
    return result


def outcome(truth: dict[str, Any], answer: dict[str, Any]) -> str:
    """Judge one answer."""
    if answer["effect"] is None:
        return "nothing named"
    if (answer["effect"], answer["axis"]) == (truth["effect"], truth["axis"]):
        return "right"
    return "right axis, other effect" if answer["axis"] == truth["axis"] else "wrong axis"


def main(
    folder: Annotated[Path, typer.Argument(help="Folder that 'discover --plan' has written.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder of the trial.")],
    cases: Annotated[int, typer.Option(help="Number of faulty robots.")] = 30,
    seed: Annotated[int, typer.Option(help="Seed of the faults.")] = 2026,
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
) -> None:
    """Run the trial and print its table. Finished cases are kept."""
    robot = json.loads((folder / "plan.json").read_text())["robot"]
    out.mkdir(parents=True, exist_ok=True)
    faults = drawn(folder, cases, seed)
    trial(robot, folder, out, 0, faults[0], workers)  # simulates the sensitivities for the others
    done = Parallel(n_jobs=workers, return_as="generator")(
        delayed(trial)(robot, folder, out, number, fault) for number, fault in enumerate(faults)
    )
    results = list(tqdm(done, total=cases, unit="case"))
    counts = {name: Counter(outcome(one, one[name]) for one in results) for name in SETS}
    print(f"| {robot}, {cases} robots | {' | '.join(SETS)} |\n| --- | --- | --- |")
    for kind in ("right", "right axis, other effect", "wrong axis", "nothing named"):
        print(f"| {kind} | {' | '.join(str(counts[name][kind]) for name in SETS)} |")
    listed = [
        sum([one["effect"], one["axis"]] in one[name]["listed"] for one in results) for name in SETS
    ]
    print(f"| true effect among those listed | {listed[0]} | {listed[1]} |")


if __name__ == "__main__":
    typer.run(main)
