"""Recordings of a year of 20 robots, of which 5 wear, and the configuration that monitors them.

    python -m benchmarks.monitoring.monitored_year -o DIR

The robots are SCARAs of the simulator in `laboratories`, of one kind and in one program. DIR gets
``healthy/``, from which a twin and the detector ``detector`` are to be made, a folder for each
robot with a recording every three days, ``arm.xml`` and ``monitor.toml``. docs/twin.md has the
commands and what they answered.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
from laboratories.effects import Effect
from laboratories.make import set_up
from laboratories.robots import robot_file
from monitoring.twin_detectors import laboratory, measured

from faultgen.recordings.recording import write_recording
from faultgen.system.dates import date_of
from faultgen.twin.followed import DAY

ROBOTS, RECORDINGS, EVERY, YEAR = 20, 122, 3, 365
"""Robots, recordings of each, and days between two of them; days of the year."""
WEAR = {
    2: (100, Effect("friction_wear", 1, 0.3)),
    5: (200, Effect("friction_wear", 2, 0.2)),
    9: (150, Effect("backlash", 1, 1.2e-3)),
    13: (60, Effect("backlash", 2, 8e-4)),
    17: (0, Effect("friction_wear", 1, 0.25)),
}
"""Day on which the wear of a robot begins, and its effect at the end of the year."""
GROWTH = 1.5
"""Exponent with which it grows."""
_NUMBER = 40  # of the laboratory, which nothing else uses
_HEALTHY = 5


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, required=True)
    out = parser.parse_args().out
    setup = set_up(laboratory("development", _NUMBER, 0.05))
    rng = np.random.default_rng(1)
    first = date_of("2026-01-01T08:00")

    def write(path: Path, day: int, effects: list[Effect]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        recording = replace(measured(setup, effects, rng), date=first + DAY * day)
        write_recording(recording, path)

    for k in range(_HEALTHY):
        write(out / "healthy" / f"h{k}.h5", k - 10, [])
    shutil.copyfile(robot_file("scara4"), out / "arm.xml")
    entries = []
    for robot in range(ROBOTS):
        name = f"robot{robot:02d}"
        begin, last = WEAR.get(robot, (YEAR, None))
        for day in range(0, EVERY * RECORDINGS, EVERY):
            effects = []
            if last is not None and day > begin:
                grown = ((day - begin) / (YEAR - begin)) ** GROWTH
                effects = [replace(last, severity=last.severity * grown)]
            write(out / name / f"day{day:03d}.h5", day, effects)
        entries.append(
            f'[[robot]]\nname = "robot {robot:02d}"\n'
            "limits = { friction_wear = 0.3, backlash = 0.0012 }\n"
            f'[[robot.program]]\nname = "weld"\ndetector = "detector"\nfolder = "{name}"\n'
        )
    (out / "monitor.toml").write_text("\n".join(entries))


if __name__ == "__main__":
    main()
