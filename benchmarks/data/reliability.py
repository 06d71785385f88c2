"""How often is anything lost when sweeps are killed, calls fail or bytes change? Counted trials.

    python -m benchmarks.data.reliability kills --trials 100
    python -m benchmarks.data.reliability damage --trials 500
    python -m benchmarks.data.reliability calls
    python -m benchmarks.data.reliability others --most 8

Each command prints one row of docs/reliability.md for every kind of fault. A trial is lost if the
dataset after one further `generate` differs in a byte from that of an undisturbed sweep, and it is
silent if the fault was neither reported nor without any effect.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from data.reliability_inputs import COMMANDS, prepare
from tabulate import tabulate

from faultgen.dataset.experiment import Experiment, make_experiment, to_toml
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.system.files import file_sha256

app = typer.Typer(add_completion=False, help=__doc__.split("\n\n")[0])

EXPERIMENT = {
    "robot": "puma560",
    "task": "pick_and_place",
    "axis": [1, 2],
    "cycles": 3,
    "severity": 0.2,
    "sensors": "realistic",
    "signals": ["signals/motor_torque"],
}
"""Three runs, a few seconds each."""

HANG = 600  # longest command [s]; it only catches a hang


@dataclass
class Row:
    """Trials of one kind of fault."""

    kind: str
    trials: int = 0
    hit: int = 0
    """Trials in which the fault came before the sweep was done."""
    silent: int = 0
    lost: int = 0
    tracebacks: int = 0

    def add(self, other: Row) -> None:
        """Count the trials of another row too."""
        for name in ("trials", "hit", "silent", "lost", "tracebacks"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


def contents(folder: Path) -> dict[str, str]:
    """Checksums of all files of a dataset, by their path in its folder."""
    found = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {str(path.relative_to(folder)): file_sha256(path) for path in found}


def shown(rows: list[Row]) -> None:
    """Print the rows as a table."""
    head = ["fault", "trials", "in time", "not reported", "data lost", "tracebacks"]
    cells = [[r.kind, r.trials, r.hit, r.silent, r.lost, r.tracebacks] for r in rows]
    print(tabulate(cells, head, tablefmt="github"))


def _command(toml: Path, out: Path) -> subprocess.Popen[str]:
    # a shell that starts this program in the background would let its children ignore Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return subprocess.Popen(
        [sys.executable, "-m", "faultgen.cli", "generate", toml, "-o", out, "--workers", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"TQDM_DISABLE": "1"},
    )


def _children(process: int) -> list[int]:
    """Processes that a process has started, as Linux lists them."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        found += [int(child) for child in task.read_text().split()]
    return found + [below for child in found for below in _children(child)]


def _worker(process: subprocess.Popen[str]) -> None:
    """Kill one worker of a sweep, or the sweep if it has none yet."""
    workers = _children(process.pid)
    os.kill(workers[-1] if workers else process.pid, signal.SIGKILL)


STROKES: dict[str, Callable[[subprocess.Popen[str]], None]] = {
    "SIGKILL of all processes": lambda one: os.killpg(one.pid, signal.SIGKILL),
    "SIGKILL of the parent": lambda one: one.kill(),
    "SIGKILL of a worker": _worker,
    "SIGINT (Ctrl-C)": lambda one: os.killpg(one.pid, signal.SIGINT),
    "SIGTERM": lambda one: one.terminate(),
}


@app.command()
def kills(
    trials: Annotated[int, typer.Option(help="Number of sweeps that are killed.")] = 100,
    seed: Annotated[int, typer.Option(help="Seed of the moments.")] = 0,
) -> None:
    """Kill sweeps at random moments, and resume them."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as place:
        toml = Path(place) / "experiment.toml"
        toml.write_text(to_toml(make_experiment(EXPERIMENT)))
        began = time.monotonic()
        _command(toml, Path(place) / "intact").wait(HANG)
        duration = time.monotonic() - began
        intact = contents(Path(place) / "intact")
        assert intact
        rows = {kind: Row(kind) for kind in STROKES}
        for number in range(trials):
            kind = list(STROKES)[number % len(STROKES)]
            out = Path(place) / "out"
            _trial(rows[kind], STROKES[kind], toml, out, rng.uniform(0.1, 0.95) * duration)
            rows[kind].lost += contents(out) != intact
            shutil.rmtree(out)
            print(f"{number + 1} of {trials}", file=sys.stderr)
        shown(list(rows.values()))


def _trial(
    row: Row, stroke: Callable[[subprocess.Popen[str]], None], toml: Path, out: Path, wait: float
) -> None:
    """One sweep that is killed, and the resumed one."""
    row.trials += 1
    sweep = _command(toml, out)
    try:
        sweep.wait(wait)
    except subprocess.TimeoutExpired:
        row.hit += 1
        stroke(sweep)
    _, told = sweep.communicate(timeout=HANG)
    row.tracebacks += "Traceback" in told
    again = _command(toml, out)
    _, told = again.communicate(timeout=HANG)
    row.tracebacks += "Traceback" in told
    row.silent += again.returncode != 0


@app.command()
def damage(
    trials: Annotated[int, typer.Option(help="Number of places.")] = 500,
    seed: Annotated[int, typer.Option(help="Seed of the places.")] = 0,
) -> None:
    """Flip or remove a byte at random places of a dataset, read it, and repair it."""
    rng = np.random.default_rng(seed)
    experiment = make_experiment({**EXPERIMENT, "cycles": 1, "sensors": "thesis"})
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "out"
        generate(experiment, out, progress=False)
        intact = contents(out)
        kinds = ("run files", "merged file", "small files")
        rows = {kind: Row(f"a byte of the {kind}") for kind in kinds}
        for number in range(trials):
            kind = kinds[number % len(kinds)]
            names = [name for name in intact if _kind(name) == kind]
            path = out / names[int(rng.integers(len(names)))]
            before = path.read_bytes()
            _spoil(path, int(rng.integers(path.stat().st_size)), is_flipped=rng.random() < 0.5)
            row = rows[kind]
            changes = not _means_the_same(before, path.read_bytes())
            row.trials, row.hit = row.trials + 1, row.hit + changes
            row.silent += changes and _is_whole(out)
            _repair(experiment, out, row)
            row.lost += contents(out) != intact
            print(f"{number + 1} of {trials}", file=sys.stderr)
        shown(list(rows.values()))


def _kind(name: str) -> str:
    if name.startswith("runs/"):
        return "run files"
    return "merged file" if name == "dataset.h5" else "small files"


def _spoil(path: Path, at: int, *, is_flipped: bool) -> None:
    """Flip a bit of a byte, or remove the byte."""
    content = bytearray(path.read_bytes())
    if is_flipped:
        content[at] ^= 1
    else:
        del content[at]
    path.write_bytes(content)


def _means_the_same(before: bytes, after: bytes) -> bool:
    """Whether two texts are the same JSON, apart from spaces and line ends."""
    try:
        return bool(json.loads(before) == json.loads(after))
    except ValueError:
        return False


def _is_whole(folder: Path) -> bool:
    """Whether the readers take a dataset for whole."""
    try:
        dataset = open_dataset(folder)
        for run in dataset.runs:
            run.read("monitoring/mean_abs_torque")
        return not dataset.damaged() and not dataset.missing
    except InputError:
        return False


def _repair(experiment: Experiment, out: Path, row: Row) -> None:
    """Generate the dataset again."""
    try:
        generate(experiment, out, progress=False)
    except InputError as error:
        row.tracebacks += "\n" in str(error)


@app.command()
def calls(
    step: Annotated[int, typer.Option(help="Fail every so many-th call; 1 fails each.")] = 1,
) -> None:
    """Let one system call of a sweep after another fail (Linux, a C compiler)."""
    arguments = "generate --robot puma560 --task pick_and_place --axis 1 --cycles 1 --workers 1"
    with tempfile.TemporaryDirectory() as place:
        shown(_failing_calls(Path(place), step, [], arguments.split(), ""))


@app.command()
def others(
    commands: Annotated[
        list[str] | None, typer.Argument(help="Names of the commands. Default: all.")
    ] = None,
    most: Annotated[int, typer.Option(help="Trials of each kind of call, evenly spread.")] = 8,
) -> None:
    """Let one system call of other commands after another fail, on small inputs."""
    with tempfile.TemporaryDirectory() as place:
        inputs = prepare(Path(place) / "inputs")
        for name in commands or COMMANDS:
            where = Path(place) / name
            where.mkdir()
            told = [str(inputs[name])]
            rows = _failing_calls(where, -most, told, COMMANDS[name].split(), f"{name}: ")
            whole = Row(f"`{name}`")
            for row in rows:
                whole.add(row)
            shown([*rows, whole])


def _failing_calls(
    place: Path, step: int, prepared: list[str], arguments: list[str], named: str
) -> list[Row]:
    """Run a command again and again, with a failing call of each kind."""
    faults = Path(__file__).parents[2] / "tests" / "faults"
    library = place / "shim.so"
    build = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(faults / "shim.c"), "-ldl"]
    subprocess.run(build, check=True)
    # the code beside this file; if it changed meanwhile, the files would differ
    code = str(Path(__file__).parents[2])
    environment = {"LD_PRELOAD": str(library), "PATH": "/usr/bin:/bin", "PYTHONPATH": code}
    rows = []
    for kind, error in ERRORS.items():
        where = place / kind
        where.mkdir()
        told = [str(one) for one in (where, kind, error, 1, step, *prepared)]
        command = [sys.executable, str(faults / "driver.py"), *told, "--", *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        rows.append(_judged(f"{named}a failing {kind}", done.stdout))
        shutil.rmtree(where)
        print(named + kind, file=sys.stderr)
    return rows


ERRORS = {"open": 5, "write": 28, "sync": 5, "rename": 5, "close": 5, "truncate": 28}
"""Error number of each kind of failing call: an input or output error, or a full disk."""


def _judged(named: str, printed: str) -> Row:
    """Count the trials of one kind of call."""
    cases = [json.loads(line) for line in printed.splitlines()]
    intact = cases[-1]["sums_again"]
    row = Row(named)
    for case in cases[:-1]:  # in the last one, no call was left
        row.trials, row.hit = row.trials + 1, row.hit + bool(case["failed"])
        row.silent += case["status"] == 0 and case["sums"] != intact
        row.lost += case["again"] != 0 or case["sums_again"] != intact
        row.tracebacks += "Traceback" in case["err"]
    return row


if __name__ == "__main__":
    app()
