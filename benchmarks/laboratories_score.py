"""Make cases of many laboratories, run `faultgen.discover` on them, and score its answers.

python benchmarks/laboratories_score.py --seeds development --cases 40 --workers 2
python benchmarks/laboratories_score.py --seeds development --cases 40 --factor noise=by_motion

Run again to continue. docs/laboratories.md describes the laboratories.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from joblib import Parallel, delayed
from laboratories.draw import BASE, CASES, LEVELS, Laboratory, draw_laboratory
from laboratories.files import CASE_FILE, read_truth, write_truth
from laboratories.score import FAILED, Row, judge, summary, table

Seeds = StrEnum("Seeds", ["development", "report"])
Mode = StrEnum("Mode", ["twin", "alone", "both"])
HOME = Path.home() / ".cache" / "faultgen-laboratories"
RESULTS = Path(__file__).with_name("results")
_EVERY = 20  # answers between two tables

app = typer.Typer(add_completion=False, help=__doc__)


def answer(folder: Path, mode: str, target: Path, cache: Path) -> None:
    """Run discovery on a case and store its answer, unless it is there.

    Args:
        folder: Folder of the case; it holds no label.
        mode: 'twin' or 'alone'.
        target: File of the answer.
        cache: Folder for the sensitivities, which cases of one robot and motion share.
    """
    import faultgen

    if target.is_file():
        return
    told = json.loads((folder / CASE_FILE).read_text())
    robot = folder / told["robot"]
    started = time.process_time(), time.monotonic()
    result: dict[str, Any]
    try:
        result = faultgen.discover(
            folder / "measured.h5",
            robot if robot.is_file() else told["robot"],
            healthy=folder / "healthy.h5" if mode == "twin" else None,
            validate=folder / "validate.h5",
            cache=cache,
        )
    except Exception as error:  # noqa: BLE001 - a failure is a verdict
        result = {"verdict": FAILED, "effects": [], "alternatives": [], "error": repr(error)}
    result["seconds"] = round(time.monotonic() - started[1], 2)
    result["processor_seconds"] = round(time.process_time() - started[0], 2)
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_suffix(f".part{os.getpid()}")
    part.write_text(json.dumps(result, indent=1, default=float) + "\n")
    part.replace(target)


def _answer_all(trial: Path, entries: Sequence[Mapping[str, Any]], results: str, mode: str) -> None:
    """Answer cases one after another, as those of a laboratory share their sensitivities."""
    for entry in entries:
        if mode in ("both", entry["mode"]):
            folder = trial / "cases" / entry.get("folder", entry["name"])
            target = trial / results / f"{entry['name']}.json"
            answer(folder, entry["mode"], target, trial / f"sensitivities-{results}")


def _laboratory(lab: Laboratory, trial: Path, results: str, mode: str) -> None:
    """Make the cases of a laboratory and answer them, as far as that has not been done."""
    from laboratories.make import make_laboratory

    path = trial / "truth" / f"{lab.name}.json"
    if not path.is_file():
        write_truth(make_laboratory(lab, trial), path)
    _answer_all(trial, json.loads(path.read_text()), results, mode)


def levels(texts: Sequence[str]) -> dict[str, Any]:
    """Read levels of factors.

    Args:
        texts: Entries NAME=LEVEL.

    Returns:
        Level by factor.

    Raises:
        typer.BadParameter: No factor has this name, or it has no such level.
    """
    found: dict[str, Any] = {}
    for text in texts:
        name, _, level = text.partition("=")
        if name not in LEVELS:
            raise typer.BadParameter(f"no factor '{name}'; there are {', '.join(LEVELS)}")
        by_text = {str(value): value for value in LEVELS[name]}
        if level not in by_text:
            raise typer.BadParameter(f"{name} is one of {', '.join(by_text)}, not '{level}'")
        found[name] = by_text[level]
    return found


def _line(row: Row) -> str:
    verdicts = [v for v in (row.first, row.healthy, row.unknown) if v is not None]
    mark = {True: "right", False: "WRONG"}[verdicts[0]] if verdicts else ""
    seen = "" if row.d_prime is None else f", d' {row.d_prime:.0f}"
    names = [name for name in row.stressed if name != "all"] or ["noise"]
    stressed = " ".join(f"{name}={row.factors.get(name)}" for name in names)
    stressed += " and all others" if "all" in row.stressed else ""
    return (
        f"{row.name:16} {row.mode:5} {row.factors['robot']} {stressed}: {row.truth}{seen} "
        f"-> {mark} {row.said} ({row.seconds:.0f} s)"
    )


@app.command()
def main(
    seeds: Annotated[Seeds, typer.Option(help="Set of seeds.")] = Seeds["development"],
    cases: Annotated[int, typer.Option(help="Cases; 4 a laboratory.")] = 40,
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
    factor: Annotated[
        list[str] | None, typer.Option(help="NAME=LEVEL that every laboratory has; repeatable.")
    ] = None,
    mode: Annotated[Mode, typer.Option(help="With a twin, without, or both.")] = Mode["both"],
    long: Annotated[bool, typer.Option(help="Recordings of up to 60 s, not 25 s.")] = False,
    trial: Annotated[
        Path | None, typer.Option(help="Folder; one that has cases is only answered and scored.")
    ] = None,
    results: Annotated[
        str, typer.Option(help="Name of the answers: another one for each version of the code.")
    ] = "results",
    save: Annotated[
        Path | None,
        typer.Option(
            help="File for all scores, as JSON; without --trial and --factor, "
            "benchmarks/results/laboratories_SEEDS.json."
        ),
    ] = None,
) -> None:
    """Make what is missing, answer what has no answer yet, and score."""
    forced = levels(factor or [])
    if trial is None:
        if save is None and not forced:
            save = RESULTS / f"laboratories_{seeds.value}.json"
        parts = [seeds.value, *(f"{name}_{level}" for name, level in forced.items())]
        trial = HOME / "-".join(parts + ["long"] * long)
    given = (trial / "truth.json").is_file()
    shown = ["noise"] if given else []
    if given:
        names = list(read_truth(trial))[:cases]
        tasks = [
            delayed(_answer_all)(trial, [entry], results, mode.value)
            for name, entry in read_truth(trial).items()
            if name in names
        ]
    else:
        labs = [
            draw_laboratory(seeds.value, number, forced, not long)
            for number in range(-(-cases // CASES))
        ]
        names = [lab.name for lab in labs]
        tasks = [delayed(_laboratory)(lab, trial, results, mode.value) for lab in labs]
    running = Parallel(n_jobs=workers, return_as="generator_unordered")(tasks)
    rows: dict[str, Row] = {}

    def look() -> None:
        before = len(rows)
        for name, entry in read_truth(trial).items():
            path = trial / results / f"{name}.json"
            ours = (name if given else name.partition("_")[0]) in names
            if ours and mode in ("both", entry["mode"]) and name not in rows and path.is_file():
                rows[name] = judge(entry, json.loads(path.read_text()))
                typer.echo(_line(rows[name]))
        if len(rows) // _EVERY > before // _EVERY:
            typer.echo("\n" + table(list(rows.values()), shown))

    for _ in running:
        look()
    look()
    done = list(rows.values())
    typer.echo("\n" + table(done, shown))
    text = json.dumps({"base": BASE, **summary(done, shown)}, indent=1) + "\n"
    for path in (trial / f"{results}.json", save):
        if path is not None:
            path.write_text(text)


if __name__ == "__main__":
    app()
