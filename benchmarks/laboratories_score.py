"""Run `faultgen.discover` on cases of many laboratories and score it; see docs/laboratories.md.

python benchmarks/laboratories_score.py --trial DIR --workers 2 --factor noise=by_motion
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from joblib import Parallel, delayed
from laboratories.files import CASE_FILE, read_truth
from laboratories.score import FAILED, Row, judge, summary, table

app = typer.Typer(add_completion=False, help=__doc__)


def answer(folder: Path, results: Path, cache: Path) -> None:
    """Run discovery on a case and store its answer.

    Args:
        folder: Folder of the case; it holds no label.
        results: Folder of the answers.
        cache: Folder for the sensitivities, which cases of one robot and motion share.
    """
    import faultgen

    told = json.loads((folder / CASE_FILE).read_text())
    robot = folder / told["robot"]

    def file(name: str) -> Path | None:
        path = folder / f"{name}.h5"
        return path if path.is_file() else None

    started = time.process_time(), time.monotonic()
    result: dict[str, Any]
    try:
        result = faultgen.discover(
            folder / "measured.h5",
            robot if robot.is_file() else told["robot"],
            healthy=file("healthy"),
            validate=file("validate"),
            cache=cache,
        )
    except Exception as error:  # noqa: BLE001 - a failure is a verdict
        result = {"verdict": FAILED, "effects": [], "alternatives": [], "error": repr(error)}
    result["seconds"] = round(time.monotonic() - started[1], 2)
    result["processor_seconds"] = round(time.process_time() - started[0], 2)
    results.mkdir(parents=True, exist_ok=True)
    part = results / f"{folder.name}.part{os.getpid()}"
    part.write_text(json.dumps(result, indent=1, default=float) + "\n")
    part.replace(results / f"{folder.name}.json")


def _chosen(truth: dict[str, dict[str, Any]], wanted: list[str], mode: str) -> list[str]:
    """Names of the cases with all the wanted levels of factors.

    Raises:
        typer.BadParameter: An entry is not NAME=LEVEL.
    """
    names = list(truth)
    for text in wanted:
        factor, equals, level = text.partition("=")
        if not equals:
            raise typer.BadParameter(f"'{text}' is not NAME=LEVEL")
        names = [name for name in names if str(truth[name]["factors"].get(factor)) == level]
    return [name for name in names if mode in ("", truth[name]["mode"])]


def _line(row: Row) -> str:
    marks = {True: "right", False: "WRONG", None: ""}
    verdicts = [value for value in (row.first, row.healthy, row.unknown) if value is not None]
    mark = marks[verdicts[0]] if verdicts else ""
    return (
        f"{row.name} {row.mode:5} {row.factors.get('noise', ''):10} {row.truth:38} "
        f"-> {mark:5} {row.said} ({row.seconds:.0f} s)"
    )


@app.command()
def main(
    trial: Annotated[Path, typer.Option(help="Folder with cases/ and truth.json.")],
    workers: Annotated[int, typer.Option(help="Processes.")] = 1,
    cases: Annotated[int, typer.Option(help="Only the first so many; 0: all.")] = 0,
    factor: Annotated[list[str] | None, typer.Option(help="NAME=LEVEL; only these cases.")] = None,
    mode: Annotated[str, typer.Option(help="'twin' or 'alone'; default: both.")] = "",
    results: Annotated[
        str, typer.Option(help="Name of the answers: another one for each version of the code.")
    ] = "results",
) -> None:
    """Answer the cases that have no answer yet, then print the scores of all that have one."""
    truth = read_truth(trial)
    names = _chosen(truth, factor or [], mode)[: cases or None]
    folder = trial / results
    waiting = [name for name in names if not (folder / f"{name}.json").is_file()]
    running = Parallel(n_jobs=workers, return_as="generator_unordered")(
        delayed(answer)(trial / "cases" / name, folder, trial / f"sensitivities-{results}")
        for name in waiting
    )
    shown: set[str] = set()
    rows: dict[str, Row] = {}

    def show() -> None:
        for name in names:
            path = folder / f"{name}.json"
            if name not in shown and path.is_file():
                shown.add(name)
                rows[name] = judge(truth[name], json.loads(path.read_text()))
                typer.echo(_line(rows[name]))

    show()
    for _ in running:
        show()
    done = list(rows.values())
    typer.echo("\n" + table(done, ["noise"]))
    (trial / f"{results}.json").write_text(json.dumps(summary(done, ["noise"]), indent=1) + "\n")


if __name__ == "__main__":
    app()
