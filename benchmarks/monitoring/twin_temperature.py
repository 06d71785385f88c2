"""What is a measured temperature worth to a twin's detector?

python -m benchmarks.monitoring.twin_temperature [--robots 60,61,62,63] -o DIR

The robots are SCARAs of the simulator in `laboratories`, whose friction on all axes follows the
temperature by a law of that simulator. Each recording has a temperature between 30 and 45 deg C of
its own, which is measured with an error of 0.5 K. A twin and a detector are made from five healthy
recordings, once with and once without the temperatures, and judge the same recordings, each alone:
20 healthy ones, and one of each fault. Printed as Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from laboratories.effects import Effect
from laboratories.make import Setup, draw_session, record, set_up
from laboratories.robots import robot_file
from monitoring.twin_detectors import AXES, laboratory, trained
from threadpoolctl import threadpool_limits

from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.recordings.recording import Recording, mean_of
from faultgen.robot import load_robot
from faultgen.twin.alignment import find_cycles
from faultgen.twin.detector import Detector
from faultgen.twin.warming import temperature_of

SEVERITIES = {
    "friction_wear": (0.05, 0.1, 0.2),
    "viscous_friction": (0.1, 0.2, 0.4),
    "backlash": (0.25e-3, 0.5e-3, 1e-3),
}
LARGEST = {"friction_wear": 0.25, "viscous_friction": 0.5, "backlash": 1.25e-3}
RECORDINGS, JUDGED = 5, 20
COLD, WARM, SENSOR = 30.0, 45.0, 0.5


def measured(setup: Setup, effects: Sequence[Effect], rng: np.random.Generator) -> Recording:
    """Record the program once, on a day and at a temperature of its own."""
    axes = range(1, setup.lab.machine.n_axes + 1)
    warm = [Effect("temperature_friction", axis, 1.0) for axis in axes]
    day, temperature = draw_session(setup, rng), rng.uniform(COLD, WARM)
    day = replace(day, temperatures=np.full(len(setup.motions), temperature))
    arrays, _ = record(setup, [*warm, *effects], day, range(1), rng)
    seen = temperature + SENSOR * rng.standard_normal()
    return Recording(
        source="laboratory",
        robot="scara4",
        side="motor",
        sample_period=setup.period,
        position=arrays["motor_position"],
        torque=arrays["motor_torque"],
        velocity=arrays["motor_velocity"],
        reference_position=arrays["reference_position"],
        temperature=np.full(len(arrays["motor_position"]), seen),
    )


def counted(
    detector: Detector, cases: Sequence[tuple[Effect | None, Recording]], *, told: bool
) -> np.ndarray:
    """Count alarms of healthy robots, verdicts "other temperature" of them, alarms and names."""
    found = np.zeros(4, int)
    for truth, one in cases:
        scores = detector.scores(
            find_cycles(one, detector.motion), temperature_of(one) if told else None
        )
        answer = detector.judge(scores[None])
        if truth is None:
            found[:2] += answer["alarm"], answer["verdict"] == "other temperature"
        else:
            named = answer["effect"] == truth.name and answer["axes"] == [truth.axis]
            found[2:] += answer["alarm"], named
    return found


def compare(number: int, folder: Path) -> dict[str, np.ndarray]:
    """Compare the detectors on one robot."""
    setup = set_up(laboratory("report", number, 0.05))
    rng = np.random.default_rng([5, number])
    healthy = [
        replace(measured(setup, [], rng), source=f"healthy{k + 1}") for k in range(RECORDINGS)
    ]
    cases: list[tuple[Effect | None, Recording]] = [
        (None, measured(setup, [], rng)) for _ in range(JUDGED)
    ]
    for name, sizes in SEVERITIES.items():
        faults = [Effect(name, axis, size) for axis in AXES for size in sizes]
        cases += [(fault, measured(setup, [fault], rng)) for fault in faults]
    model = calibrate(mean_of(healthy), load_robot(robot_file("scara4"))).robot
    found = {}
    for arm, told in (("not measured", False), ("measured", True)):
        seen = healthy if told else [replace(one, temperature=None) for one in healthy]
        detector = trained(model, seen, folder / f"{number}_{told}", LARGEST)
        found[arm] = counted(detector, cases, told=told)
    return found


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default="60,61,62,63")
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    numbers = [int(one) for one in args.robots.split(",")]
    with threadpool_limits(1):
        found = [compare(number, args.out) for number in numbers]
    healthy = JUDGED * len(numbers)
    faults = len(AXES) * sum(map(len, SEVERITIES.values())) * len(numbers)
    print("| temperature | false alarms | other temperature | faults: alarms | named |")
    print("|" + " --- |" * 5)
    for arm in found[0]:
        counts = np.sum([one[arm] for one in found], axis=0)
        cells = (f"{k}/{of}" for k, of in zip(counts, [healthy] * 2 + [faults] * 2, strict=True))
        print(f"| {arm} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
