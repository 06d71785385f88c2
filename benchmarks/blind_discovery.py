"""Blind trial of `faultgen.discover` on sealed cases; see docs/blind.md.

python benchmarks/blind_discovery.py generate --seeds development --mode twin --count 30 -o DIR
python benchmarks/blind_discovery.py run DIR --workers 2
python benchmarks/blind_discovery.py score DIR
"""

from __future__ import annotations

import importlib
import json
import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import matplotlib
import numpy as np
import typer
from joblib import Parallel, delayed
from matplotlib.figure import Figure
from sealed.cases import CASE_FILE, HEALTHY, MEASURED, make_case, read_truth, write_truth
from sealed.limits import Limits
from sealed.plan import ROBOTS, left_out, plan_cases, sample
from sealed.score import FAILED, Answer, confusion, markdown, score
from tqdm import tqdm

from faultgen.effects import EFFECTS
from faultgen.system.files import write_text

Seeds = StrEnum(
    "Seeds", ["development", "report", "report2", "report3", "report4", "report5", "report6"]
)
Mode = StrEnum("Mode", ["twin", "alone"])
Kind = StrEnum("Kind", ["single", "clean", "unknown", "pair"])

CASES, RESULTS, SEALED = "cases", "results", "sealed"
CACHE = Path.home() / ".cache" / "faultgen-sealed"

app = typer.Typer(add_completion=False, help=__doc__)
Out = Annotated[Path, typer.Option("-o", "--out", help="Folder of the trial.")]
Trial = Annotated[Path, typer.Argument(help="Folder of the trial.")]
Workers = Annotated[int, typer.Option(help="Processes.")]
Results = Annotated[str, typer.Option(help="Folder of the answers in the trial's.")]
Cache = Annotated[Path, typer.Option(help="Folder where sensitivities are kept.")]


def _limits(cache: Path, workers: int, every: bool = True) -> dict[str, Limits]:
    """Limits by robot; with `every`, all sensitivities are computed at once."""
    limits = {robot: Limits(robot, cache) for robot in ROBOTS}
    for one in limits.values() if every else ():
        one.compute(workers)
    return limits


@app.command()
def generate(
    out: Out,
    seeds: Seeds = Seeds["development"],
    mode: Mode = Mode["twin"],
    count: Annotated[int, typer.Option(help="Balanced few; 0: all 560.")] = 0,
    kind: Annotated[Kind | None, typer.Option(help="Only these of them.")] = None,
    workers: Workers = 1,
    cache: Cache = CACHE,
) -> None:
    """Make cases; the truth goes to the folder `sealed`, its SHA-256 is printed."""
    known = _limits(cache, workers, every=count == 0)
    if count:
        chosen = sample(count, seeds.value, mode.value, known)
    else:
        chosen = plan_cases(seeds.value, mode.value, known)
    if kind:
        chosen = [case for case in chosen if case.kind == kind.value]
    digest = write_truth(chosen, out / SEALED)
    made = Parallel(n_jobs=workers, return_as="generator_unordered")(
        delayed(make_case)(case, out / CASES) for case in chosen
    )
    for _ in tqdm(made, total=len(chosen), unit="case"):
        pass
    typer.echo(f"{len(chosen)} cases in {out / CASES}; sha256 of the truth: {digest}")


@app.command()
def limits(mode: Mode = Mode["twin"], workers: Workers = 1, cache: Cache = CACHE) -> None:
    """List effects and axes that no case has, and the limits at 1 % noise."""
    for robot, one in _limits(cache, workers).items():
        typer.echo(f"{robot}: left out, as 5 x limit is beyond what is sensible")
        for name, axis, order, least in left_out(one, mode.value):
            shown = f", order {order}" if order else ""
            typer.echo(
                f"  {name}, axis {axis}{shown}: {least:.3g} of {one.largest(name, axis):.3g}"
            )


def load_function(path: str) -> Callable[..., dict[str, Any]]:
    """The function that is tried: 'module:name'."""
    module, _, name = path.partition(":")
    function: Callable[..., dict[str, Any]] = getattr(importlib.import_module(module), name)
    return function


def answer(case: Path, results: Path, function: str, cache: Path) -> None:
    """Run discovery on one case and store its answer, unless it is there.

    Args:
        case: Folder of the case; it holds no label.
        results: Folder of the answers.
        function: 'module:name' of what is tried, with the signature of `faultgen.discover`.
        cache: Folder for the sensitivities, which cases of one robot share.
    """
    target = results / f"{case.name}.json"
    if target.is_file():
        return
    told = json.loads((case / CASE_FILE).read_text())
    healthy = case / HEALTHY
    started = time.monotonic()
    try:
        result = load_function(function)(
            case / MEASURED,
            told["robot"],
            healthy=healthy if healthy.is_file() else None,
            exclude=[name for name in told["exclude"] if name in EFFECTS],
            cache=cache,
        )
    except Exception as error:  # noqa: BLE001 - a failure is a verdict
        result = {"verdict": FAILED, "effects": [], "alternatives": [], "error": repr(error)}
    result["seconds"] = round(time.monotonic() - started, 2)
    results.mkdir(parents=True, exist_ok=True)
    write_text(target, json.dumps(result, indent=1, default=float) + "\n")


@app.command()
def run(
    trial: Trial,
    workers: Workers = 1,
    function: Annotated[str, typer.Option(help="What is tried.")] = "faultgen:discover",
    results: Results = RESULTS,
    cache: Annotated[
        Path | None, typer.Option(help="Folder for sensitivities; default: in the trial's folder.")
    ] = None,
) -> None:
    """Run discovery on every case that has no answer yet."""
    kept = trial / "sensitivities" if cache is None else cache
    folders = sorted(path.parent for path in (trial / CASES).glob(f"*/{CASE_FILE}"))
    done = Parallel(n_jobs=workers, return_as="generator_unordered")(
        delayed(answer)(folder, trial / results, function, kept) for folder in folders
    )
    for _ in tqdm(done, total=len(folders), unit="case"):
        pass


def read_answers(trial: Path, results: str = RESULTS) -> dict[str, Answer]:
    """Read all stored answers.

    Args:
        trial: Folder of the trial.
        results: Name of the folder with answers.

    Returns:
        Answers by case.
    """
    return {p.stem: json.loads(p.read_text()) for p in sorted((trial / results).glob("*.json"))}


@app.command("score")
def score_command(trial: Trial, results: Results = RESULTS) -> None:
    """Compare the answers with the truth: `score.md`, `score.json`, `confusion.png`."""
    truth, answers = read_truth(trial / SEALED), read_answers(trial, results)
    rows = score(truth, answers)
    of = "" if results == RESULTS else f"_{results}"
    write_text(trial / f"score{of}.md", markdown(rows))
    write_text(trial / f"score{of}.json", json.dumps([vars(row) for row in rows], indent=1) + "\n")
    draw_confusion(*confusion(truth, answers), trial / f"confusion{of}.png")
    typer.echo(markdown(rows))


def draw_confusion(rows: list[str], columns: list[str], counts: np.ndarray, path: Path) -> None:
    """Draw a confusion matrix. Each row is shown in shares of its cases.

    Args:
        rows: Names of the rows.
        columns: Names of the columns.
        counts: Counts, shape (rows, columns).
        path: Picture to write.
    """
    figure = Figure(figsize=(2 + 0.35 * len(columns), 2 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(counts):
        if count:
            colour = "white" if share[i, j] > 0.6 else "black"
            axes.text(j, i, str(count), ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set_xlabel("first answer")
    axes.set_ylabel("truth")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    matplotlib.use("Agg")
    app()
