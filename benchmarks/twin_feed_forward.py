"""What does a twin's detector say if the controller's feed-forward knows the worn friction?

python benchmarks/twin_feed_forward.py DETECTOR   # the detector of docs/twin.md, "Try it"

The robot is that of `twin_example.py`. Its axes 1 and 2 get 10, 15 and 20 % more Coulomb friction,
each on two days. Every fault is recorded twice: with a controller that knows the friction of the
healthy model, and with one whose feed-forward torque contains the wear. Each recording is judged
alone. Printed as Markdown: how many raise an alarm, and how many name effect and axis.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from laboratories.draw import BASE, Laboratory
from laboratories.effects import Effect
from laboratories.make import Setup, set_up
from twin_detectors import measured, score
from twin_example import FACTORS, NUMBER

from faultgen.twin.detector import load_detector

SEVERITIES = (0.10, 0.15, 0.20)
AXES = (1, 2)
DAYS = 2


def knowing(setup: Setup, fault: Effect) -> Setup:
    """The same laboratory with a feed-forward torque that contains the worn Coulomb friction."""
    machine, axis = setup.lab.machine, fault.axis - 1
    points = []
    for one in setup.points:
        own = one.copy()
        # as `robots.set_points` smooths the friction that the controller knows
        share = np.tanh(own[:, 1, axis] / (0.5 * machine.stribeck[axis]))
        own[:, 2, axis] += fault.severity * machine.coulomb[axis] * share
        points.append(own)
    return replace(setup, points=tuple(points))


def main() -> None:
    """Record, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("detector", type=Path)
    parser.add_argument("--seed", type=int, default=5)
    args = parser.parse_args()
    detector = load_detector(args.detector)
    setup = set_up(Laboratory("development", NUMBER, {**BASE, **FACTORS}, ()))
    faults = [Effect("friction_wear", a, s) for a in AXES for s in SEVERITIES for _ in range(DAYS)]
    print("| feed-forward | faults | alarms | effect and axis named |\n| --- | --- | --- | --- |")
    for name, knows in (("of the healthy model", False), ("knows the wear", True)):
        rng = np.random.default_rng(args.seed)
        cases = [
            (fault, measured(knowing(setup, fault) if knows else setup, [fault], rng))
            for fault in faults
        ]
        rows = score(detector, cases)
        alarms, right = (sum(bool(row[key]) for row in rows) for key in ("alarm", "right"))
        print(f"| {name} | {len(rows)} | {alarms} | {right} |", flush=True)
        print("<!--", [(r["axis"], r["severity"], r["verdict"], r["named"]) for r in rows], "-->")


if __name__ == "__main__":
    main()
