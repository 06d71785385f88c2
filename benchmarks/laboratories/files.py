"""Files of the cases: recordings, what discovery is told, and the truth.

DIR/cases/<name>/{case.json, measured.h5, validate.h5, healthy.h5}; DIR/truth/<laboratory>.json
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

CASE_FILE, TRUTH = "case.json", "truth.json"
FILES = ("measured", "healthy", "validate")


def write_case(
    folder: Path,
    robot: str,
    sample_period: float | None,
    files: Mapping[str, Mapping[str, np.ndarray]],
    mode: str,
) -> None:
    """Write the recordings of a case. No label is in them.

    Args:
        folder: Folder of the case.
        robot: Name of the robot, or path of its model relative to the folder.
        sample_period: [s]; None: the files have the true `time` of each sample instead.
        files: Arrays by file and name; `segments` becomes an attribute. docs/measured.md describes
            the names.
        mode: 'twin', 'alone' or 'both'.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, arrays in files.items():
        with h5py.File(folder / f"{name}.h5", "w") as file:
            file.attrs["robot"] = Path(robot).stem
            if sample_period is not None:
                file.attrs["sample_period"] = sample_period
            file.attrs["segments"] = np.asarray(arrays["segments"], dtype=np.int64)
            for channel, values in arrays.items():
                if channel != "segments" and (channel != "time" or sample_period is None):
                    # angles of a motor need the digits; torque is coarser than float32
                    exact = channel.endswith(("position", "time"))
                    kind = np.float64 if exact else np.float32
                    file.create_dataset(channel, data=values.astype(kind), compression="gzip")
    told = {"robot": robot, "mode": mode}
    (folder / CASE_FILE).write_text(json.dumps(told, indent=1) + "\n")


def write_truth(truth: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write what is in some cases: a list with an entry for each case and mode."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(list(truth), indent=1) + "\n")
    part.replace(path)


def read_truth(folder: Path) -> dict[str, dict[str, Any]]:
    """Read what is in the cases of a trial, from truth.json and truth/*.json, by their names."""
    files = [path for path in (folder / TRUTH,) if path.is_file()]
    files += sorted((folder / "truth").glob("*.json"))
    return {case["name"]: case for path in files for case in json.loads(path.read_text())}
