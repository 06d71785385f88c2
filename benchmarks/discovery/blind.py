"""Make sealed cases for a blind trial of discovery; see docs/results/discovery.md.

python -m benchmarks.discovery.blind generate --seeds development --mode twin --count 30 -o DIR
python -m benchmarks.discovery.score --trial DIR --workers 2
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from joblib import Parallel, delayed
from sealed.cases import make_case, write_truth
from sealed.limits import CACHE, Limits
from sealed.plan import ROBOTS, left_out, plan_cases, sample
from tqdm import tqdm

Seeds = StrEnum(
    "Seeds",
    "development report report2 report3 report4 report5 report6 report7 report8 report9 report10 "
    "report11 report12 report13",
)
Mode = StrEnum("Mode", ["twin", "alone"])
Kind = StrEnum("Kind", ["single", "clean", "unknown", "pair"])

CASES, SEALED = "cases", "sealed"

app = typer.Typer(add_completion=False, help=__doc__)
Out = Annotated[Path, typer.Option("-o", "--out", help="Folder of the trial.")]
Workers = Annotated[int, typer.Option(help="Processes.")]
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


if __name__ == "__main__":
    app()
