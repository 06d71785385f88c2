"""Recordings of a robot that faultgen does not know: those in docs/examples/twin.

python -m benchmarks.monitoring.twin_example -o example

writes arm.xml, healthy1.h5 to healthy5.h5, and new1.h5 and so on.

The robot is a SCARA of the simulator in `laboratories`, with a servo, parameters and noise of its
own. The first call compiles this simulator, which takes one to two minutes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from laboratories.draw import BASE, Laboratory
from laboratories.effects import Effect
from laboratories.make import set_up
from laboratories.robots import robot_file
from monitoring.twin_detectors import measured

from faultgen.recordings.recording import write_recording
from faultgen.system.files import write_text

HEALTHY = 5
NEW: tuple[tuple[Effect, ...], ...] = (
    (),
    (),
    (Effect("friction_wear", 1, 0.05),),
    (Effect("friction_wear", 1, 0.10),),
    (Effect("friction_wear", 1, 0.15),),
    (Effect("friction_wear", 1, 0.20),),
)
"""What is in the robot in each new recording."""
FACTORS = {
    "robot": "scara4",
    "servo": "cascade_ff",
    "seconds": 5.0,
    "segments": 1,
    "motion": "task",
    "level": 0.01,
    "repeat": 0.01,
    "model_error": 0.05,
}
NUMBER = 321


def make(out: Path) -> None:
    """Write the model of the robot and its recordings into a folder."""
    setup = set_up(Laboratory("development", NUMBER, {**BASE, **FACTORS}, ()))
    rng = np.random.default_rng(NUMBER)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "arm.xml", robot_file("scara4").read_text())
    named: list[tuple[str, tuple[Effect, ...]]] = [(f"healthy{k + 1}", ()) for k in range(HEALTHY)]
    named += [(f"new{k}", effects) for k, effects in enumerate(NEW, start=1)]
    for name, effects in named:
        recording = measured(setup, effects, rng)
        small = {key: getattr(recording, key).astype(np.float32) for key in ("torque", "velocity")}
        write_recording(replace(recording, source=name, robot="arm", **small), out / f"{name}.h5")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("example"))
    make(parser.parse_args().out)


if __name__ == "__main__":
    main()
