"""Processor time of every command on its smallest input.

    python -m benchmarks.speed.command_speed [--only import,judge] [--python OTHER] [--save FILE]

Each command runs in a process of its own, whose processor time (user and system) is measured: the
smallest of some repetitions, because other work on the machine only adds to it. `--python` measures
another installation with the same inputs, for a comparison. The inputs are made by this one: an arm
with two axes, a dataset of nine runs of six cycles, a log with 600 samples of six axes.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from speed.growth import SWING, arm
from tabulate import tabulate

GOALS = {
    "--help": 0.4,
    "--version": 0.4,
    "import": 1.5,
    "refused import": 0.4,
    "judge": 1.5,
    "robots": 0.6,
    "tasks": 0.6,
    "effects": 0.6,
}
"""Most processor time [s]."""

COMMANDS = {
    "--help": "--help",
    "--version": "--version",
    "robots": "robots",
    "tasks": "tasks",
    "effects": "effects",
    "doctor": "doctor",
    "import": "import log.csv --map map.toml -o log.h5",
    "import --figure": "import log.csv --map map.toml -o log.h5 --figure",
    "refused import": "import log.csv --preset ur_rtde",
    "robot build": "robot build arm.xml -o NEW",
    "robot check": "robot check arm",
    "generate": "generate --robot arm --task swing.toml --axis 1 --cycles 1 --workers 1 -o NEW",
    "merge": "merge data",
    "info": "info data",
    "export": "export RUN -o NEW.h5",
    "report": "report data",
    "detect": "detect data --seeds 2",
    "isolate": "isolate data --seeds 2",
    "judge": "judge detector recording.h5 --state NEW",
    "train": "train worn -o NEW",
    "twin": "twin recording.h5 --robot arm -o NEW --workers 1",
    "calibrate": "calibrate recording.h5 --robot arm -o NEW --workers 1",
    "discover": "discover recording.h5 --robot arm -o NEW --workers 1",
}
"""Arguments of each command. NEW is a path that does not exist, RUN the first run of the data."""

SLOW = ("train", "twin", "calibrate", "discover")
"""Commands that are run once."""

SETUP = (
    "robot build arm.xml -o arm",
    "generate --robot arm --task swing.toml --axis 1,2 --severity 0.2 --cycles 6 --sensors thesis "
    "--repetitions 3 --workers 1 -o data",
    "export RUN -o recording.h5",
    "twin recording.h5 --robot arm -o my_arm --workers 1",
    "generate --robot my_arm --task-from recording.h5 --effect friction_wear --axis 1 --cycles 12 "
    "--repetitions 2 --workers 1 -o worn",
    "train worn -o detector",
)
"""How the inputs are made, after the files of `write_inputs`."""

app = typer.Typer(add_completion=False, help=__doc__)


def write_inputs(folder: Path) -> None:
    """Write the model of an arm, a task, a log and its map.

    Args:
        folder: Where.
    """
    (folder / "arm.xml").write_text(arm(2))
    (folder / "swing.toml").write_text(SWING.format(start=[-40, -30], end=[40, 20]))
    time = 0.004 * np.arange(600)[:, None]
    rng = np.random.default_rng(0)
    rates = np.arange(1, 7)
    torque = 20 * np.cos(rates * time) + 0.1 * rng.standard_normal((600, 6))
    names = [f"{name}{axis}" for name in "qu" for axis in rates]
    np.savetxt(
        folder / "log.csv",
        np.hstack([time, np.sin(rates * time), torque]),
        fmt="%.6f",
        delimiter=",",
        header=",".join(["t", *names]),
        comments="",
    )
    (folder / "map.toml").write_text(
        'side = "joint"\ntime = { column = "t", unit = "s" }\n'
        'position = { columns = "q{axis}", unit = "rad" }\n'
        'torque = { columns = "u{axis}", unit = "Nm" }\n'
    )


def run(python: str, folder: Path, arguments: str, number: int) -> tuple[float, int]:
    """Run a command.

    Args:
        python: Interpreter of the installation.
        folder: Folder with the inputs.
        arguments: As in `COMMANDS`.
        number: Makes the names of results new.

    Returns:
        Processor time of the process and of those that it started [s], and its exit status.
    """
    runs = sorted(folder.glob("data/runs/*.h5"))
    if runs:
        arguments = arguments.replace("RUN", str(runs[0]))
    arguments = arguments.replace("NEW", f"new{number}")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [python, "-m", "faultgen.cli", *arguments.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1", "TQDM_DISABLE": "1"},
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode and "ur_rtde" not in arguments:
        last = done.stderr.strip().splitlines()[-1:] or [f"status {done.returncode}"]
        print(f"faultgen {arguments}: {last[0]}", file=sys.stderr)
    used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return used, done.returncode


@app.command()
def main(
    only: Annotated[str, typer.Option(help="Commands, separated by commas. Default: all.")] = "",
    python: Annotated[str, typer.Option(help="Interpreter to measure.")] = sys.executable,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each command that is quick.")] = 5,
    inputs: Annotated[
        Path | None, typer.Option(help="Folder in which the inputs are kept between calls.")
    ] = None,
    save: Annotated[Path | None, typer.Option(help="Also write the result as JSON.")] = None,
) -> None:
    """Measure and print."""
    chosen = [one.strip() for one in only.split(",")] if only else list(COMMANDS)
    unknown = sorted({*chosen} - {*COMMANDS})
    if unknown:
        raise typer.BadParameter(f"{', '.join(unknown)}; there are {', '.join(COMMANDS)}")
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = inputs or Path(temporary)
        folder.mkdir(exist_ok=True)
        if not (folder / "detector").exists():
            write_inputs(folder)
            for number, arguments in enumerate(SETUP):
                run(sys.executable, folder, arguments, number)
        number = len(list(folder.glob("new*"))) + 100
        for name in chosen:
            times = []
            for _ in range(1 if name in SLOW else repeats):
                number += 1
                times.append(run(python, folder, COMMANDS[name], number)[0])
            rows.append({"command": name, "seconds": round(min(times), 2), "goal": GOALS.get(name)})
    print(tabulate(rows, "keys", tablefmt="github", missingval="–"))
    if save:
        machine = f"{platform.machine()}, {os.cpu_count()} cores"
        result = {"machine": machine, "python": platform.python_version(), "commands": rows}
        save.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    app()
