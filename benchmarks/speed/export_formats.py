"""Time and size of a dataset in the formats of `faultgen export`.

    python -m benchmarks.speed.export_formats

Generates 198 cycles of the PUMA 560 (a minute), writes them in every format whose package is
installed, and prints JSON: seconds, and bytes on the disk.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

from faultgen.dataset.experiment import Experiment
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.export.formats import DATASET_FORMATS, export_dataset

EXPERIMENT = Experiment(
    robot=["puma560"],
    task=["spot_weld"],
    axis=[[2], [3]],
    cycles=22,
    repetitions=3,
    sensors="realistic",
    signals=["signals/motor_position", "signals/motor_velocity", "signals/motor_torque"],
)
"""Nine runs, three of them healthy, with 3365 samples of six axes in each cycle."""


def measure(folder: Path) -> dict[str, dict[str, float] | str]:
    """Export the dataset in every format.

    Args:
        folder: An empty folder.

    Returns:
        Seconds and bytes by format, or why it was not written.
    """
    generate(EXPERIMENT, folder / "data", progress=False)
    merged = (folder / "data/dataset.h5").stat().st_size
    found: dict[str, dict[str, float] | str] = {"dataset.h5": {"bytes": merged}}
    for name in DATASET_FORMATS:
        started = time.perf_counter()
        try:
            export_dataset([folder / "data"], name, folder / name)
        except InputError as error:
            found[name] = str(error)
            continue
        seconds = round(time.perf_counter() - started, 1)
        files = [path for path in (folder / name).rglob("*") if path.is_file()]
        found[name] = {"seconds": seconds, "bytes": sum(path.stat().st_size for path in files)}
    return found


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        print(json.dumps(measure(Path(place)), indent=1))
