"""Time and memory of `faultgen monitor` for many robots and recordings.

python -m benchmarks.monitoring.monitor_growth DETECTOR RECORDING.h5 --robots 1000 --out FILE

The recording is read and reduced to scores `--sample` times. Healthy scores are then drawn for
all recordings of all robots and kept in one memory; at a sample of them, the robot is judged with
all its earlier recordings, as `monitor` does. The time of all recordings follows from the sample.
"""

from __future__ import annotations

import json
import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from tqdm import trange

from faultgen.recordings.read import read_recording
from faultgen.system.files import file_sha256, write_text
from faultgen.twin.alignment import find_cycles
from faultgen.twin.detector import FORM, load_detector
from faultgen.twin.judge import Judge
from faultgen.twin.state import State

DAY = 86400.0


def main(
    detector: Annotated[Path, typer.Argument(help="Folder of a detector.")],
    recording: Annotated[Path, typer.Argument(help="A recording of its program.")],
    robots: Annotated[int, typer.Option(help="Number of robots.")] = 1000,
    recordings: Annotated[int, typer.Option(help="Recordings of each robot.")] = 365,
    sample: Annotated[int, typer.Option(help="Recordings that are timed.")] = 300,
    out: Annotated[Path | None, typer.Option(help="File for the result (JSON).")] = None,
) -> None:
    """Measure, and print the result."""
    known = load_detector(detector)
    rng = np.random.default_rng(0)
    begin = time.process_time()
    for _ in range(sample):
        read = read_recording(recording)
        file_sha256(recording), file_sha256(recording)  # before and after reading
        scores = known.scores(find_cycles(read, known.motion))
    reading = (time.process_time() - begin) / sample
    size = len(scores)
    values, vectors = np.linalg.eigh(known.posterior.information_)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    digest = file_sha256(detector / FORM)
    with TemporaryDirectory() as folder:
        memory = Path(folder) / "monitor.sqlite"
        chosen = set(rng.choice(robots * recordings, sample, replace=False).tolist())
        spent: list[tuple[int, float]] = []
        for robot in trange(robots, desc="robots"):
            own = rng.standard_normal((recordings, size)) @ root.T
            with State(memory, digest, size, f"robot {robot}", "program").held() as stream:
                for day in range(recordings):
                    number = robot * recordings + day
                    if number in chosen:
                        begin = time.process_time()
                        _, before = stream.since_repair(day * DAY)
                        known.judge(np.concatenate([before, own[day : day + 1]]))
                        spent.append((day, time.process_time() - begin))
                    stream.keep(f"{number:064x}", day * DAY, own[day], {"alarm": False})
        begin = time.process_time()
        for robot in range(min(robots, sample)):
            Judge(detector, memory, f"robot {robot}", "program", known).latest()
        looking = (time.process_time() - begin) / min(robots, sample)
        megabytes = memory.stat().st_size / 2**20
    judging = float(np.mean([took for _, took in spent]))
    late = [took for day, took in spent if day > 0.9 * recordings]
    result = {
        "robots": robots,
        "recordings": recordings,
        "ms_reading": 1e3 * reading,
        "ms_judging": 1e3 * judging,
        "ms_judging_last_tenth": 1e3 * float(np.mean(late)),
        "ms_latest_answer": 1e3 * looking,
        "hours_for_all": (reading + judging) * robots * recordings / 3600,
        "memory_file_MiB": megabytes,
        "process_MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    text = json.dumps(result, indent=1)
    print(text)
    if out is not None:
        write_text(out, text + "\n")


if __name__ == "__main__":
    typer.run(main)
