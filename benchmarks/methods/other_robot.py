"""Isolation on a robot that differs from the model that the isolator knows.

    python -m benchmarks.methods.other_robot [--robot irb6700] [--task spot_weld] [--instances 4]

Each instance has Coulomb, static and viscous friction, Stribeck velocity, gearbox stiffness and
payload drawn about the nominal ones. Its isolator learns from its own healthy cycles, but takes
friction terms and directions of wear from the nominal robot. Printed: axis isolated by wear, false
alarms, and the error of the severity, which is a fraction of the instance's own friction.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from faultgen.evaluation import Answer
from faultgen.evaluation.calls import fit
from faultgen.evaluation.features import Features
from faultgen.evaluation.isolate import LEVELS
from faultgen.evaluation.isolators import FrictionResidual
from faultgen.monitoring.sensors import get_sensors
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, load_robot
from faultgen.simulation.surrogate import build_surrogate
from faultgen.studies.chapter6_isolation.monitored import Monitored
from faultgen.studies.chapter6_isolation.series import growth

SCATTER = 0.2
"""Standard deviation of friction and Stribeck velocity from instance to instance: assumed."""


def main() -> None:
    """Make instances, isolate on each, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="irb6700")
    parser.add_argument("--task", default="spot_weld")
    parser.add_argument("--instances", type=int, default=4)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    nominal = Monitored.of(build_surrogate(args.robot, args.task, workers=args.workers))
    print("| instance | " + " | ".join(f"{100 * level:g} %" for level in LEVELS), end=" | ")
    print("false alarms | severity RMS error at 10 %, by nominal friction | by own friction |")
    print("|" + " --- |" * (len(LEVELS) + 4))
    with tempfile.TemporaryDirectory() as folder:
        for number in range(args.instances):
            rng = np.random.default_rng([args.seed, number])
            path = Path(folder) / f"instance{number}.xml"
            own_friction = _write_instance(args.robot, path, rng)
            surrogate = build_surrogate(
                str(path), args.task, controller=args.robot, workers=args.workers
            )
            reference = nominal.reference
            instance = Monitored(surrogate, nominal.model, reference)
            print(f"| {number + 1} | " + " | ".join(_judge(instance, own_friction, rng)) + " |")


def _write_instance(robot: str, path: Path, rng: np.random.Generator) -> np.ndarray:
    """Write an instance's MJCF; returns its Coulomb friction over the nominal, shape (n_axes,)."""
    nominal = load_robot(robot)
    spec = nominal.spec()
    ratios = []
    for axis in range(1, nominal.n_axes + 1):
        friction, speed, viscous = np.exp(SCATTER * rng.standard_normal(3))
        actuator = spec.actuator(f"friction{axis}")
        actuator.biasprm[COULOMB] *= friction
        actuator.biasprm[STICTION] *= friction
        actuator.biasprm[STRIBECK_VELOCITY] *= speed
        actuator.damping[0] *= viscous
        spec.tendon(f"gearbox{axis}").stiffness[0] *= np.exp(0.1 * rng.standard_normal())
        ratios.append(friction)
    payload = spec.body("payload")
    heavier = np.exp(0.1 * rng.standard_normal())
    payload.mass *= heavier
    payload.inertia *= heavier
    spec.compile()
    path.write_text(spec.to_xml())
    return np.array(ratios)


def _judge(instance: Monitored, own: np.ndarray, rng: np.random.Generator) -> list[str]:
    sensors = get_sensors("realistic")
    n_axes = instance.surrogate.n_axes
    grown = growth()
    isolator = FrictionResidual(instance.setting(temperature_varies=True))

    def answer(seen: Features, cycles: int) -> Answer:
        return isolator.isolate(*(seen[name][:cycles] for name in isolator.features))

    healthy = np.zeros((len(grown), n_axes))
    fit(isolator, [instance.observe(sensors, healthy, rng) for _ in range(20)])
    tested = (instance.observe(sensors, healthy, rng) for _ in range(30))
    alarms = sum(bool(answer(seen, len(grown)).worn.any()) for seen in tested)
    right = dict.fromkeys(LEVELS, 0)
    errors = []
    repeats = 3
    for axis in range(n_axes):
        for _ in range(repeats):
            severity = healthy.copy()
            severity[:, axis] = grown
            seen = instance.observe(sensors, severity, rng)
            for level in LEVELS:
                n = int(np.argmax(grown >= level)) + 1
                said = answer(seen, n)
                right[level] += said.axis == axis
                if level == 0.10:
                    estimate = said.severity[axis]
                    errors.append((estimate - grown[n - 1], estimate / own[axis] - grown[n - 1]))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    total = n_axes * repeats
    shares = [f"{100 * right[level] / total:.0f}" for level in LEVELS]
    return [*shares, f"{alarms} of 30", *(f"{100 * value:.2f}" for value in rms)]


if __name__ == "__main__":
    main()
