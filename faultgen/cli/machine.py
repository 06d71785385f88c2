"""Commands about the machine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import typer

from faultgen.cli.app import Json, app, print_json, print_table
from faultgen.system.terminal import say

_OLDEST_PYTHON = (3, 11)
_LEAST_MEMORY = 2.0  # [GiB]: what a study uses at most with one process
_LEAST_DISK = 1.0  # [GiB]
_SECONDS = 1.0  # that are simulated [s]
_LEAST_MOVE = 0.1  # of a motor in this time [rad]


@app.command()
def doctor(as_json: Json = False) -> None:
    """Check whether this machine is fit for faultgen: versions, memory, disk, a short simulation.

    The simulation is one second of the first task of the PUMA 560, with its speed. A GPU is not
    needed and not used. The exit status is 0 if the machine is fit, and 1 if not.
    """
    from joblib import cpu_count

    from faultgen.system import machine

    rows: list[dict[str, Any]] = []

    def tell(what: str, found: str, remedy: str = "") -> None:
        rows.append({"what": what, "found": found, "fit": not remedy, "remedy": remedy})

    old = "" if machine.python_is_fit(_OLDEST_PYTHON) else "install Python 3.11 or newer"
    tell("Python", machine.python_version(), old)
    tell("faultgen", machine.installed("faultgen") or "not installed")
    for package in machine.packages():
        remedy = f"pip install '{package.name}{package.needed}'"
        tell(package.name, package.version or "missing", "" if package.fit else remedy)
    tell("processor cores", str(cpu_count()))
    memory = machine.memory()
    little = memory is not None and memory < _LEAST_MEMORY
    tell(
        "memory",
        "unknown" if memory is None else f"{memory:.1f} GiB",
        f"use a machine with {_LEAST_MEMORY:g} GiB" if little else "",
    )
    disk = machine.free_disk(Path.cwd())
    tell(
        "free disk here",
        f"{disk:.1f} GiB",
        f"free {_LEAST_DISK:g} GiB" if disk < _LEAST_DISK else "",
    )
    tell("GPU (not needed)", machine.gpu() or "none")
    tell("one second of simulation", *_simulated())
    fit = all(row["fit"] for row in rows)
    if as_json:
        print_json({"fit": fit, "checks": rows})
    else:
        shown = [{k: row[k] for k in ("what", "found")} for row in rows]
        print_table([{**one, "": row["remedy"]} for one, row in zip(shown, rows, strict=True)])
        say("this machine is fit" if fit else "this machine is not fit; see the remedies")
    if not fit:
        raise typer.Exit(1)


def _simulated() -> tuple[str, str]:
    """What a second of simulation gave, and a remedy if it failed."""
    try:
        import numpy as np

        from faultgen.robot import load_robot
        from faultgen.simulation.motion import plan
        from faultgen.simulation.servo import control_signal
        from faultgen.simulation.stepping import simulate
        from faultgen.tasks import load_task, task_names

        robot = load_robot("puma560")
        motion = plan(load_task(robot.name, task_names(robot.name)[0]), robot)
        step = robot.model.opt.timestep
        control = control_signal(motion, step)[: round(_SECONDS / step)]
        started = time.perf_counter()
        (run,) = simulate(robot, control, [robot.model], sample_period=0.004, lead_in=0.0)
        took = time.perf_counter() - started
        moved = float(np.ptp(run.motor_position, axis=0).max())
    except Exception as error:  # whatever is broken, the other checks are still told
        return f"failed: {' '.join(str(error).split())}", "install faultgen anew"
    if not (np.isfinite(run.motor_torque).all() and moved > _LEAST_MOVE):
        return "failed: the robot did not move", "install faultgen anew"
    return f"{took:.2f} s, {len(control) * step / took:.1f} times as fast as the robot", ""
