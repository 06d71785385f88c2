"""How do time and memory of `generate` and `info` grow with runs, cycles and axes?

    python -m benchmarks.speed.growth [--runs 10,100,1000] [--save FILE]

Every size is made by a process of its own, of which processor time and peak memory are measured, so
that other work on the machine matters little. The robots are arms of the benchmark's own, whose
joints turn about crossed axes; `faultgen robot build` makes them complete.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from tabulate import tabulate

SWING = """description = "swings all axes"
[start]
joints = {start}
[[move]]
joints = {end}
[[move]]
joints = {start}
"""
MIB = 1024.0  # Linux states memory in KiB

app = typer.Typer(add_completion=False, help=__doc__)


def arm(n_axes: int) -> str:
    """MJCF of a plain arm of light links, whose joints turn about x, y and z in turn."""
    text = "".join(
        f'<body name="link{k}" pos="0 0 0.15"><joint name="j{k}" axis="{" ".join(axis)}" '
        'range="-2 2"/><inertial pos="0 0 0.07" mass="1" diaginertia="0.004 0.004 0.001"/>'
        for k, axis in enumerate((["001", "010", "100"][k % 3] for k in range(n_axes)), start=1)
    )
    head = '<mujoco model="arm"><compiler angle="radian"/><worldbody>'
    return f"{head}{text}{'</body>' * n_axes}</worldbody></mujoco>"


def measured(*arguments: object) -> dict[str, float]:
    """Processor time [s] and peak memory [MiB] of a command of faultgen, without any workers."""
    code = (
        "import resource, sys\n"
        "from faultgen.cli import main\n"
        "try:\n    main()\nfinally:\n"
        "    used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "    print('used', used.ru_utime + used.ru_stime, used.ru_maxrss, file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=os.environ | {"TQDM_DISABLE": "1"},
    )
    line = done.stderr.strip().rpartition("\n")[2].split()
    if done.returncode != 0 or line[:1] != ["used"]:
        raise SystemExit(done.stderr)
    return {"processor_seconds": float(line[1]), "peak_memory_mib": float(line[2]) / MIB}


def robot_of(n_axes: int, folder: Path) -> list[object]:
    """Build an arm and its task; the options of `generate` that choose them."""
    plain = folder / f"arm{n_axes}.xml"
    plain.write_text(arm(n_axes))
    task = folder / f"swing{n_axes}.toml"
    task.write_text(SWING.format(start=[0.0] * n_axes, end=[20.0] * n_axes))
    robot = folder / f"built{n_axes}"
    measured("robot", "build", plain, "-o", robot)
    return ["--robot", robot, "--task", task]


def sweep(
    folder: Path, n_axes: int, runs: int, cycles: int, robot: list[object]
) -> dict[str, float]:
    """Generate a dataset with one worker, and look at it."""
    out = folder / f"{n_axes}-{runs}-{cycles}"
    repetitions = max(1, runs // 2)  # each is a healthy run and a worn one
    told = ["--axis", 1, "--repetitions", repetitions, "--cycles", cycles]
    made = measured("generate", *robot, *told, "--signals", "none", "--workers", 1, "-o", out)
    seen = measured("info", out)
    return {
        "axes": n_axes,
        "runs": 2 * repetitions,
        "cycles": cycles,
        **{f"generate_{name}": value for name, value in made.items()},
        **{f"info_{name}": value for name, value in seen.items()},
    }


@app.command()
def main(
    runs: Annotated[str, typer.Option(help="Numbers of runs, of one cycle each.")] = "10,100,1000",
    cycles: Annotated[str, typer.Option(help="Numbers of cycles of two runs.")] = "10,100,1000",
    axes: Annotated[str, typer.Option(help="Numbers of axes; two runs of 50 cycles.")] = "1,2,6,14",
    save: Annotated[Path | None, typer.Option(help="Also write the results there.")] = None,
) -> None:
    """Measure all sizes, one after another, and print a table."""

    def sizes(text: str) -> list[int]:
        return [int(one) for one in text.split(",")]

    rows = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        robots = {n: robot_of(n, folder) for n in {2, *sizes(axes)}}
        plans = [(2, n, 1) for n in sizes(runs)]
        plans += [(2, 2, n) for n in sizes(cycles)] + [(n, 2, 50) for n in sizes(axes)]
        for n_axes, n_runs, n_cycles in plans:
            rows.append(sweep(folder, n_axes, n_runs, n_cycles, robots[n_axes]))
            print(rows[-1], file=sys.stderr)
    print(tabulate(rows, headers="keys", tablefmt="github", floatfmt=".3g"))
    if save is not None:
        told = {"machine": f"{platform.machine()}, {os.cpu_count()} cores", "rows": rows}
        save.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    app()
