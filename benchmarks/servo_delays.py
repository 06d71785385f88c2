"""Find delays of single axes in recordings of many laboratories, and count right and wrong answers.

python benchmarks/servo_delays.py --laboratories 40

Each laboratory with commanded positions and measured torque records a healthy robot, two delays and
four other effects on a random axis. Only the equation of the servo is asked, see `own_servo` and
`servo_faults` in `faultgen.discovery.replay`, with a healthy recording and without one.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from laboratories.draw import Laboratory, draw_laboratory
from laboratories.effects import Effect
from laboratories.make import model_for, record_case, set_up

from faultgen.discovery.inputs import read_together
from faultgen.discovery.replay.own_servo import with_own_servo
from faultgen.discovery.replay.servo_faults import find_servo_faults
from faultgen.recordings.recording import mean_of
from faultgen.robot import load_robot

OTHERS = {
    "friction_wear": 0.4,
    "payload_mass": 0.5,
    "torque_constant": 0.1,
    "torque_lowpass": 5e-3,
}
"""Effects that are no delay, and their severities."""


def is_asked(lab: Laboratory) -> bool:
    """Whether the recordings of a laboratory have what the equation needs."""
    factors = lab.factors
    return bool(
        factors["reference"]
        and factors["model_friction"] == "given"
        and factors["torque"] == "torque"
    )


def ask(lab: Laboratory, folder: Path) -> list[tuple[str, str, bool]]:
    """Record the cases of a laboratory and look for delays.

    Args:
        lab: The laboratory.
        folder: Where its files go.

    Returns:
        Name of the case, 'twin' or 'alone', and whether exactly the true delay was found.
    """
    setup, n = set_up(lab), lab.machine.n_axes
    rng = np.random.default_rng([lab.seed, 99])
    axis = int(rng.integers(1, n + 1))
    cases = {"healthy": [], **{f"delay {ms} ms": [("delay", axis, 1e-3 * ms)] for ms in (0.5, 4)}}
    for name, severity in OTHERS.items():
        cases[name] = [(name, n if name == "payload_mass" else axis, severity)]
    model = model_for(lab, folder)
    rows = []
    for name, effects in cases.items():
        where = folder / "cases" / name.replace(" ", "_")
        record_case(setup, [Effect(*one, {}) for one in effects], model, where, rng)
        robot = load_robot(str(where / model if (where / model).is_file() else model))
        given = read_together([where / "measured.h5"], robot, [where / "healthy.h5"], None)
        for mode, runs in (("twin", given.runs), ("alone", [])):
            own, _ = with_own_servo(mean_of(runs) if runs else given.recording, robot)
            found = [one.axis for one in find_servo_faults(given.recording, own, runs).faults]
            rows.append((name, mode, found == ([axis] if name.startswith("delay") else [])))
    return rows


def main() -> None:
    """Ask all laboratories and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--first", type=int, default=0, help="number of the first laboratory")
    parser.add_argument("--laboratories", type=int, default=40, help="how many are drawn")
    given = parser.parse_args()
    right: Counter[tuple[str, str]] = Counter()
    asked: Counter[tuple[str, str]] = Counter()
    for number in range(given.first, given.first + given.laboratories):
        lab = draw_laboratory("development", number, {}, True)
        if is_asked(lab):
            with TemporaryDirectory() as folder:
                for name, mode, is_right in ask(lab, Path(folder)):
                    right[name, mode] += is_right
                    asked[name, mode] += 1
    print("| case | with a baseline | without one |\n| --- | --- | --- |")
    for name in dict.fromkeys(name for name, _ in asked):
        told = (f"{right[name, mode]} of {asked[name, mode]}" for mode in ("twin", "alone"))
        print(f"| {name} | {' | '.join(told)} |")


if __name__ == "__main__":
    main()
