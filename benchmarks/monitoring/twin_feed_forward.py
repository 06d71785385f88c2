"""What does a twin's detector say if the controller's feed-forward knows the worn friction?

python -m benchmarks.monitoring.twin_feed_forward [--servos model,pd_ff,cascade_ff] -o DIR

The robots are SCARAs of the simulator in `laboratories`, one for each kind of servo with a
feed-forward torque. A twin and a detector are made from five healthy recordings. Then axes 1 and 2
get 10, 15 and 20 % more Coulomb friction, each on two days. Every fault is recorded twice: with a
controller that knows the friction of the healthy model, and with one whose feed-forward torque
contains the wear. Each recording is judged alone. Printed as Markdown: how many raise an alarm, and
how many name effect and axis.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from laboratories.draw import BASE, Laboratory
from laboratories.effects import Effect
from laboratories.make import Setup, set_up
from laboratories.robots import robot_file
from monitoring.twin_detectors import AXES, measured, score, trained
from monitoring.twin_example import FACTORS, NUMBER
from threadpoolctl import threadpool_limits

from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.recordings.recording import mean_of
from faultgen.robot import load_robot

SEVERITIES = (0.10, 0.15, 0.20)
RECORDINGS = 5
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


def tried(servo: str, folder: Path) -> None:
    """Make a detector for a robot with a servo, judge both kinds of faults and print."""
    setup = set_up(Laboratory("development", NUMBER, {**BASE, **FACTORS, "servo": servo}, ()))
    rng = np.random.default_rng(NUMBER)
    healthy = [
        replace(measured(setup, [], rng), source=f"healthy{k + 1}") for k in range(RECORDINGS)
    ]
    model = calibrate(mean_of(healthy), load_robot(robot_file("scara4"))).robot
    detector = trained(model, healthy, folder / servo)
    faults = [Effect("friction_wear", a, s) for a in AXES for s in SEVERITIES for _ in range(DAYS)]
    for name, knows in (("knows the healthy model", False), ("knows the wear", True)):
        days = np.random.default_rng(NUMBER + 1)  # the same days for both
        cases = [
            (fault, measured(knowing(setup, fault) if knows else setup, [fault], days))
            for fault in faults
        ]
        rows = score(detector, cases)
        alarms, right = (sum(bool(row[key]) for row in rows) for key in ("alarm", "right"))
        print(f"| {servo} | {name} | {len(rows)} | {alarms} | {right} |", flush=True)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--servos", default="model,pd_ff,pid_ff,cascade_ff")
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    print("| servo | its feed-forward | faults | alarms | effect and axis named |")
    print("|" + " --- |" * 5)
    with threadpool_limits(1):
        for servo in args.servos.split(","):
            tried(servo, args.out)


if __name__ == "__main__":
    main()
