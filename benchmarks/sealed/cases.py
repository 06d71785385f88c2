"""Making cases: a random robot, the protocol, effects, noise, files without a label.

make_case(case, folder)                      # folder/<name>/{case.json, measured.h5, healthy.h5}
digest = write_truth(cases, other_folder)    # truth.json and its SHA-256
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from sealed.dynamics import STEP
from sealed.effects import context
from sealed.limits import torque_of
from sealed.plan import Case
from sealed.recording import draw_noise, draw_temperatures, measure
from sealed.robots import random_robot

from faultgen.recordings.recording import Recording, write_recording
from faultgen.robot import load_robot
from faultgen.system.files import write_text

CASE_FILE, MEASURED, HEALTHY = "case.json", "measured.h5", "healthy.h5"
TRUTH, DIGEST = "truth.json", "truth.sha256"


def make_recordings(case: Case) -> tuple[Recording, Recording | None]:
    """Simulate a case.

    Args:
        case: The case.

    Returns:
        The recording with the effects, and that of the healthy twin in mode 'twin'.
    """
    where, robot = context(case.robot), load_robot(case.robot)
    rng = np.random.default_rng(case.seed)
    physics = random_robot(where.nominal, rng)
    rms = np.sqrt(np.mean(np.concatenate(where.runs)[:, :, 2] ** 2, axis=0))
    noise = draw_noise(case.level, rms, rng)
    lengths = [len(run) for run in where.runs]

    def record(effects: Sequence[Any]) -> Recording:
        temperatures = draw_temperatures(lengths, rng)
        seed = int(rng.integers(2**32))
        runs, torque = torque_of(effects, physics, where, temperatures, step=STEP, seed=seed)
        recording = measure(runs, torque, temperatures, robot, noise, rng)
        small = {name: getattr(recording, name).astype(np.float32) for name in _SMALL}
        return replace(recording, **small)

    measured = record(case.effects)
    return measured, record(()) if case.mode == "twin" else None


_SMALL = ("position", "torque", "velocity", "temperature")


def make_case(case: Case, folder: Path) -> Path:
    """Write the files of a case, unless they are there: no label is in them.

    Args:
        case: The case.
        folder: Where the folder of the case goes.

    Returns:
        The folder of the case.
    """
    own = folder / case.name
    if (own / CASE_FILE).is_file():
        return own
    measured, healthy = make_recordings(case)
    write_recording(measured, own / MEASURED)
    if healthy is not None:
        write_recording(healthy, own / HEALTHY)
    told = {"robot": case.robot, "mode": case.mode, "exclude": sorted(case.exclude)}
    write_text(own / CASE_FILE, json.dumps(told, indent=1) + "\n")
    return own


def write_truth(cases: Sequence[Case], folder: Path) -> str:
    """Write what is in the cases, and its SHA-256 beside it.

    Args:
        cases: The cases.
        folder: Not that of the cases.

    Returns:
        The SHA-256.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps([case.as_dict() for case in cases], indent=1) + "\n"
    digest = hashlib.sha256(text.encode()).hexdigest()
    write_text(folder / TRUTH, text)
    write_text(folder / DIGEST, digest + "\n")
    return digest


def read_truth(folder: Path) -> dict[str, dict[str, Any]]:
    """What is in the cases, by their names.

    Raises:
        ValueError: It was changed after it was written.
    """
    text = (folder / TRUTH).read_text()
    if hashlib.sha256(text.encode()).hexdigest() != (folder / DIGEST).read_text().strip():
        raise ValueError(f"{folder / TRUTH}: not what its SHA-256 was taken of")
    return {case["name"]: case for case in json.loads(text)}
