"""Small inputs of every command for the fault trials of `reliability.py`: a robot of one axis.

    prepare(Path("inputs"))   # about half a minute; folders by the name of the command

The robot is the machine of docs/examples/emps, a motor that moves a carriage. Its recordings are
simulated, and last two seconds each.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.recordings.from_runs import recording_of
from faultgen.recordings.recording import write_recording
from faultgen.twin.make import make_twin
from faultgen.twin.train import train

EMPS = Path(__file__).parents[2] / "docs" / "examples" / "emps" / "emps.xml"

MOVES = """description = "moves the carriage to and fro"
[start]
joints = [0.0]
[[move]]
joints = [0.15]
[[move]]
joints = [0.0]
"""

FLEET = """robots = 1
failing = 1
days = 2
models = ["puma560"]
[programs]
tasks = ["pick_and_place"]
number = [1, 1]
[production]
samples_a_day = [1, 1]
"""

MAP = """side = "joint"
[time]
column = "t"
unit = "s"
[position]
columns = "q_{axis}"
unit = "rad"
[torque]
columns = "tau_{axis}"
unit = "Nm"
"""

COMMANDS = {
    "twin": "twin HERE/h1.h5 HERE/h2.h5 --robot HERE/arm.xml -o HERE/twin --workers 1",
    "calibrate": "calibrate HERE/h1.h5 --robot HERE/arm.xml -o HERE/arm --workers 1",
    "train": "train HERE/data -o HERE/detector",
    "judge": "judge HERE/detector HERE/h3.h5 HERE/new.h5",
    "discover": "discover HERE/new.h5 --healthy HERE/h1.h5 --robot HERE/arm.xml -o HERE/found "
    "--workers 1",
    "import": "import HERE/log.csv --map HERE/map.toml -o HERE/log.h5",
    "fleet": "fleet HERE/fleet.toml -o HERE/fleet --workers 1",
    "report": "report HERE",
    "isolate": "isolate HERE --seeds 1",
    "detect": "detect HERE --seeds 1",
    "export": "export HERE --parquet HERE/cycles.parquet",
}
"""Commands by name. The word HERE stands for a copy of the folder of that name."""


def prepare(place: Path) -> dict[str, Path]:
    """Make the inputs.

    Args:
        place: An empty folder.

    Returns:
        Folder of each of the `COMMANDS`.
    """
    small = place / "recordings"
    small.mkdir(parents=True)
    shutil.copy(EMPS, small / "arm.xml")
    (small / "move.toml").write_text(MOVES)
    experiment = {"robot": str(small / "arm.xml"), "task": str(small / "move.toml"), "axis": 1}
    noisy = {**experiment, "severity": 0.3, "cycles": 3, "repetitions": 3, "sensors": "realistic"}
    generate(make_experiment(noisy), place / "runs", progress=False)
    runs = open_dataset(place / "runs").runs
    healthy, worn = ([run for run in runs if run["axis"] == axis] for axis in (0, 1))
    for name, run in zip(("h1", "h2", "h3", "new"), [*healthy, *worn], strict=False):
        write_recording(recording_of([run.path], None), small / f"{name}.h5")
    log, fleet = place / "log", place / "fleet"
    for folder in (log, fleet):
        folder.mkdir()
    (fleet / "fleet.toml").write_text(FLEET)
    _log(log)
    make_twin([small / "h1.h5", small / "h2.h5"], small / "arm.xml", place / "twin")
    shutil.copytree(small, place / "judge")
    shutil.copytree(small, place / "train")
    told = {
        "robot": str(place / "twin"),
        "task": "recorded",
        "axis": 1,
        "severity": 0.3,
        "cycles": 4,
        "repetitions": 2,
    }
    generate(make_experiment(told), place / "train" / "data", progress=False)
    train(open_dataset(place / "train" / "data")).save(place / "judge" / "detector")
    plain = {"robot": "puma560", "task": "pick_and_place", "axis": 1, "cycles": 8}
    generate(make_experiment({**plain, "severity": 0.2}), place / "dataset", progress=False)
    own = {"import": log, "fleet": fleet, "judge": place / "judge", "train": place / "train"}
    own |= {name: place / "dataset" for name in ("report", "isolate", "detect", "export")}
    return {name: own.get(name, small) for name in COMMANDS}


def _log(folder: Path) -> None:
    """A log of two axes with its map."""
    times = np.arange(400) / 250
    values = np.random.default_rng(0).normal(size=(4, 400))
    head = "t,q_1,q_2,tau_1,tau_2"
    np.savetxt(
        folder / "log.csv", np.vstack([times, values]).T, delimiter=",", header=head, comments=""
    )
    (folder / "map.toml").write_text(MAP)


if __name__ == "__main__":
    print(prepare(Path(sys.argv[1])))
