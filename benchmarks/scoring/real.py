"""Real machines whose recordings are in ../shared/data: models, recordings, what is known.

entries = make("emps", trial)
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from laboratories.real_noise import DATA
from real_robots.measured_data import (
    EXAMPLES,
    joined,
    read_emps,
    read_ur10e,
    read_xl330,
    xl330_model,
    xl330_runs,
)
from real_robots.real_arms import CASES as ARMS
from real_robots.real_arms import model

from faultgen.recordings.recording import Recording, write_recording

PENDULUM_RATIO = 6.0
"""Published gear ratio; see the README of the data set."""

Json = dict[str, Any]


def _entry(
    machine: str, robot: str, kind: str, effects: list[tuple[str, int]], **rest: Any
) -> Json:
    """Entry of a machine whose recordings are measured.h5 and perhaps validate.h5."""
    return {
        "name": machine,
        "mode": "alone",
        "kind": kind,
        "effects": [{"name": name, "axis": axis} for name, axis in effects],
        "factors": {"robot": machine},
        "discover": [f"./cases/{machine}/measured.h5", "--robot", robot],
        **rest,
    }


def _write(folder: Path, measured: Recording, validate: Recording | None) -> list[str]:
    """Write the recordings; return the arguments for the second one."""
    folder.mkdir(parents=True, exist_ok=True)
    write_recording(measured, folder / "measured.h5")
    if validate is None:
        return []
    write_recording(validate, folder / "validate.h5")
    return ["--validate", f"./cases/{folder.name}/validate.h5"]


def _arm(machine: str, folder: Path) -> Json:
    """TX40: friction of the coupled wrist is published. Gen3: no effect is known."""
    case = ARMS[machine](DATA / machine)
    other = _write(folder, case.fitted, case.judged)
    (folder / f"{machine}.xml").write_text(case.robot.xml)
    known = [("wrist_coupling_friction", 5), ("wrist_coupling_friction", 6)]
    kind, effects = ("single", known) if machine == "tx40" else ("healthy", [])
    entry = _entry(machine, f"./cases/{machine}/{machine}.xml", kind, effects)
    entry["discover"] += other
    return entry


def _emps(machine: str, folder: Path) -> Json:
    """EMPS: its authors found that friction differs between the directions.

    A ripple with one wave a motor turn is there too, by a Fourier sum of what friction and inertia
    leave: see docs/results/discovery.md.
    """
    train, test = (read_emps(DATA / "emps", name) for name in ("identification", "validation"))
    other = _write(folder, train, test)
    known = [("friction_asymmetry", 1), ("viscous_asymmetry", 1), ("torque_ripple", 1)]
    entry = _entry(machine, str(EXAMPLES / "emps" / "emps.xml"), "single", known)
    entry["discover"] += [*other, "--include", "viscous_asymmetry"]
    return entry


def _xl330(machine: str, folder: Path) -> Json:
    """XL330 at one gain of its firmware: friction that follows the load is published."""
    gain = int(machine.removeprefix("xl330_kp"))
    runs = [n for n, row in xl330_runs(DATA / "bam_xl330").items() if int(row["kp"]) == gain]
    _write(folder, joined([read_xl330(DATA / "bam_xl330", run) for run in runs]), None)
    (folder / f"{machine}.xml").write_text(xl330_model(gain))
    entry = _entry(machine, f"./cases/{machine}/{machine}.xml", "single", [("load_friction", 1)])
    entry["discover"] += ["--white-noise"]  # resampled, so that neighbours share their noise
    return entry


def _ur10e(machine: str, folder: Path) -> Json:
    """UR10e with a payload of a known mass, and a model that is calibrated without it."""
    pair = machine.removeprefix("ur10e_")
    loaded, unloaded = (
        replace(read_ur10e(DATA / "ur10e", f"{kind}_{pair}_feb19"), payload_mass=None)
        for kind in ("loaded", "unloaded")
    )
    _write(folder, loaded, None)
    write_recording(unloaded, folder / "unloaded.h5")
    published = json.loads((DATA / "ur10e" / "published_parameters.json").read_text())
    robot = str(EXAMPLES / "ur10e" / "ur10e.xml")
    entry = _entry(machine, robot, "single", [("payload_mass", 6)])
    entry["effects"][0]["severity"] = published["payload_mass_kg_loaded_14harm"]
    before = [f"./cases/{machine}/unloaded.h5", "--robot", robot, "--known", "inertia"]
    words = [f"./cases/{machine}/measured.h5", "--white-noise"]
    return entry | {"calibrate": before, "discover": words}


def _pendulum(machine: str, folder: Path) -> Json:
    """Double pendulum: a model without friction lacks Coulomb friction of the first joint."""
    names = sorted(path for path in (DATA / "pendulum").glob(f"{machine[-2:]}_*.csv.gz"))
    recordings = []
    for path in names:
        table = np.genfromtxt(path, delimiter=",", names=True)
        even = np.arange(table["time"][5], table["time"][-1], 0.002)
        columns = {
            name: np.stack(
                [np.interp(even, table["time"], table[f"{name}_meas{k}"]) for k in (1, 2)], axis=1
            )
            for name in ("pos", "tau")
        }
        recordings.append(
            Recording(
                source=path.name,
                robot=machine,
                side="joint",
                sample_period=0.002,
                position=columns["pos"],
                torque=columns["tau"],
            )
        )
    other = _write(folder, joined(recordings[:-1]), recordings[-1])
    urdf = (DATA / "pendulum" / "c0.urdf").read_text()
    if '<link name="world"' not in urdf:  # the file uses this link without declaring it
        urdf = urdf.replace("<link ", '<link name="world"/>\n<link ', 1)
    (folder / "c0.urdf").write_text(urdf)
    robot = model("pendulum", folder / "c0.urdf", np.full(2, PENDULUM_RATIO), speed=30.0)
    (folder / "pendulum.xml").write_text(robot.xml)
    known = [("coulomb_friction", 1), ("friction_wear", 1)]
    entry = _entry(machine, f"./cases/{machine}/pendulum.xml", "single", known)
    entry["discover"] += other
    return entry


MACHINES: dict[str, Callable[[str, Path], Json]] = {
    "tx40": _arm,
    "gen3": _arm,
    "emps": _emps,
    "xl330_kp100": _xl330,
    "xl330_kp200": _xl330,
    "xl330_kp800": _xl330,
    "ur10e_14harm": _ur10e,
    "ur10e_15harm": _ur10e,
    "pendulum_c0": _pendulum,
    "pendulum_c1": _pendulum,
}
"""What makes the entry of each machine, from its name and the folder of its recordings."""
_FOLDERS = {"xl330": "bam_xl330"}


def make(machine: str, trial: Path) -> list[Json]:
    """Write the recordings and the model of a machine.

    Args:
        machine: Of `MACHINES`.
        trial: Folder of the trial.

    Returns:
        Its entry, in a list.

    Raises:
        FileNotFoundError: Its recordings are not here.
    """
    family = machine.split("_")[0]
    data = DATA / _FOLDERS.get(family, family)
    if not data.is_dir():
        raise FileNotFoundError(f"{machine} needs the recordings in {data}")
    return [MACHINES[machine](machine, trial / "cases" / machine)]
