"""How many changed bits of recordings, detectors, states and robots are noticed? Counted trials.

    python -m benchmarks.data.reliability_bits --trials 200

Single bits are flipped at random places, and the files are read by the functions that the commands
use: `faultgen.twin.judge.Judge.judge`, `faultgen.robot.load_robot` and
`faultgen.monitoring.sensors.get_sensors`. A flip is without effect if the result is the same.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from data.reliability_inputs import prepare
from tabulate import tabulate

from faultgen.errors import InputError
from faultgen.monitoring.sensors import get_sensors
from faultgen.robot import load_robot
from faultgen.twin.judge import Judge


def bits(
    trials: Annotated[int, typer.Option(help="Bits of each kind of file.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of the places.")] = 0,
) -> None:
    """Flip single bits of the files that `judge` and `load_robot` read, and read them."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as place:
        inputs = prepare(Path(place) / "inputs")
        folder, robot = inputs["judge"], Path(place) / "inputs" / "twin"
        state, new = folder / "state.sqlite", folder / "new.h5"

        def judged() -> str:
            answer = Judge(folder / "detector", state).judge(new)
            names = ("recording", "sha256", "again", "date", "since")  # a date is that of the file
            return json.dumps({k: v for k, v in answer.items() if k not in names})

        def fresh() -> str:
            state.unlink(missing_ok=True)
            return judged()

        def loaded() -> str:
            found = load_robot(robot)
            return str((found.sha256, found.name, found.tasks, get_sensors(robot / "sensors.toml")))

        rows = []
        for kind, path, read in (
            ("a recording (`judge`)", new, fresh),
            ("`detector.json` (`judge`)", folder / "detector" / "detector.json", fresh),
            ("`arrays.npz` (`judge`)", folder / "detector" / "arrays.npz", fresh),
            ("`state.sqlite` (`judge`)", state, judged),
            ("`model.xml` of a twin (`load_robot`)", robot / "model.xml", loaded),
            ("`sensors.toml` of a twin", robot / "sensors.toml", loaded),
        ):
            state.unlink(missing_ok=True)
            if path == state:  # with an earlier answer, so that the mean is used
                Judge(folder / "detector", state).judge(folder / "h3.h5")
            rows.append(_flipped(kind, path, read, trials, rng))
        head = ["a bit of", "trials", "refused", "without effect", "another result", "tracebacks"]
        print(tabulate(rows, head, tablefmt="github"))


def _flipped(
    kind: str, path: Path, read: Callable[[], str], trials: int, rng: np.random.Generator
) -> list[object]:
    """Flip bits of a file at random places, and count what reading it gives."""
    content = path.read_bytes()
    wanted = read()
    refused = same = other = tracebacks = 0
    for _ in range(trials):
        changed = bytearray(content)
        changed[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        try:
            if read() == wanted:
                same += 1
            else:
                other += 1
        except InputError as error:
            refused += 1
            tracebacks += "\n" in str(error)
        except Exception as error:
            tracebacks += 1
            print(f"{kind}: {error!r}", file=sys.stderr)
    path.write_bytes(content)
    print(kind, file=sys.stderr)
    return [kind, trials, refused, same, other, tracebacks]


if __name__ == "__main__":
    typer.run(bits)
