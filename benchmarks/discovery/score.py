"""Score one version of `faultgen discover` on every set of cases, and write the table and the page.

python -m benchmarks.discovery.score --set development --out DIR --workers 2
python -m benchmarks.discovery.score --trial DIR                # cases that another command made

Run again to continue: an answer that exists is not made again. docs/results/discovery.md says what
is counted.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from joblib import Parallel, delayed
from scoring import batches, trials
from scoring.answering import LIMIT, answer, version
from scoring.judging import Row, judge
from scoring.table import SHARES, by_factor, by_group, page, scores, share
from sealed.limits import CACHE
from tqdm import tqdm

from faultgen.system.files import write_text

Set = StrEnum("Set", ["development", "report"])
PLAN, VERSION, PAGE, SCORES = "plan.json", "version.txt", "score.md", "score_all.json"

app = typer.Typer(add_completion=False, help=__doc__)


def plan(which: str, out: Path, cache: Path) -> list[batches.Batch]:
    """Read the plan of a trial, or draw it and write it down.

    Args:
        which: Of `batches.SETS`.
        out: Folder of the trial.
        cache: Folder for the sensitivities of the sealed simulator.

    Raises:
        typer.BadParameter: The folder holds another set.
    """
    path = out / PLAN
    if not path.is_file():
        drawn = {"set": which, "batches": batches.planned(which, cache)}
        write_text(path, json.dumps(drawn, indent=1, default=float) + "\n")
    told = json.loads(path.read_text())
    if told["set"] != which:
        raise typer.BadParameter(f"{out} holds the {told['set']} set; name another folder")
    found: list[batches.Batch] = told["batches"]
    return found


def frozen(answers: Path) -> str:
    """Version of the answers in a folder, which is this version.

    Raises:
        typer.BadParameter: Answers of another version are in the folder.
    """
    path, now = answers / VERSION, version()
    if not path.is_file():
        answers.mkdir(parents=True, exist_ok=True)
        write_text(path, now + "\n")
    before = path.read_text().strip()
    if before != now:
        raise typer.BadParameter(
            f"{answers} is of version {before}, and this is {now}; a score is that of one version, "
            "so name other answers with --answers"
        )
    return now


def entries_of(batch: batches.Batch, out: Path) -> list[dict[str, Any]]:
    """Entries of a batch, whose recordings are made unless they exist."""
    path = out / "truth" / f"{batch['name']}.json"
    if not path.is_file():
        made = batches.make(batch, out)
        if any("skipped" in entry for entry in made):
            return made  # tried again next time
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(made, indent=1, default=float) + "\n")
    found: list[dict[str, Any]] = json.loads(path.read_text())
    return found


def chosen(name: str, only: Sequence[str]) -> bool:
    """Whether a name contains one of some texts, or there are none."""
    return not only or any(text in name for text in only)


def work(
    batch: batches.Batch | None,
    entries: Sequence[Mapping[str, Any]],
    out: Path,
    answers: Path,
    only: Sequence[str],
    limit: float,
) -> list[dict[str, Any]]:
    """Make the cases of a batch, or take some entries, and answer them."""
    found = list(entries) if batch is None else entries_of(batch, out)
    for entry in found:
        if "skipped" not in entry and chosen(f"{entry['group']} {entry['name']}", only):
            answer(entry, answers, out, limit)
    return [dict(entry) for entry in found]


def judged(entries: Sequence[Mapping[str, Any]], answers: Path) -> list[Row]:
    """Rows of all entries that have an answer."""
    rows = []
    for entry in entries:
        path = answers / f"{entry['name']}.json"
        if path.is_file():
            rows.append(judge(entry, json.loads(path.read_text())))
    return rows


@app.command()
def main(
    which: Annotated[Set, typer.Option("--set", help="Set of cases.")] = Set["development"],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder for cases, answers and the page.")
    ] = None,
    trial: Annotated[
        Path | None,
        typer.Option(help="Folder of cases that another command made; instead of --set and --out."),
    ] = None,
    name: Annotated[
        str, typer.Option("--answers", help="Name of the answers, another one for each version.")
    ] = "answers",
    only: Annotated[
        list[str] | None,
        typer.Option(help="Text in the group or name of a case, such as alone; repeatable."),
    ] = None,
    workers: Annotated[int, typer.Option(help="Answers at the same time.")] = 1,
    limit: Annotated[float, typer.Option(help="Time that an answer may take [s].")] = LIMIT,
    dry: Annotated[bool, typer.Option(help="Make the cases, but answer none.")] = False,
    save: Annotated[Path | None, typer.Option(help="File for all scores, as JSON.")] = None,
    cache: Annotated[
        Path, typer.Option(help="Folder for sensitivities of the sealed simulator.")
    ] = CACHE,
) -> None:
    """Make what is missing, answer what has no answer yet, and score."""
    folder = trial or out
    if folder is None:
        raise typer.BadParameter("name a folder with --out, or one that has cases with --trial")
    answers = folder / name
    texts = ["/"] if dry else list(only or [])  # no name has a slash
    about: dict[str, Any] = {"version": frozen(answers), "skipped": {}}
    tasks: list[tuple[batches.Batch | None, list[dict[str, Any]]]]
    if trial is None:
        drawn = plan(which.value, folder, cache)
        about |= {"set": which.value, "planned": batches.answers(drawn)}
        digest = hashlib.sha256((folder / PLAN).read_bytes()).hexdigest()
        tasks = [(batch, []) for batch in drawn if batches.has(batch, only or [])]
        if not tasks:
            raise typer.BadParameter("--only: no group and no case has one of these texts")
    else:
        given = trials.entries(trial)
        about |= {"set": trial.name, "planned": len(given)}
        digest = hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()
        tasks = [(None, [entry]) for entry in given]
    about["plan_sha256"] = digest
    running = Parallel(n_jobs=workers, return_as="generator_unordered")(
        delayed(work)(batch, given, folder, answers, texts, limit) for batch, given in tasks
    )
    entries: list[dict[str, Any]] = []
    for found in tqdm(running, total=len(tasks), unit="batch"):
        about["skipped"] |= {e["name"]: e["skipped"] for e in found if "skipped" in e}
        new = [entry for entry in found if "skipped" not in entry]
        entries += new
        for row in judged(new, answers):
            tqdm.write(f"{row.name}: {row.truth} -> {row.said} ({row.seconds:.0f} s)")
    groups_in_order = [group for groups in batches.GROUPS.values() for group in groups]
    order = {group: k for k, group in enumerate(groups_in_order)}
    entries.sort(key=lambda entry: (order.get(entry["group"], 9), entry["group"], entry["name"]))
    rows = judged(entries, answers)
    write_text(answers / PAGE, page(rows, about))
    groups = by_group(rows) | by_factor(rows)
    summary = {
        group: {measure: share(some, measure) for measure in SHARES}
        for group, some in groups.items()
    }
    told = about | {"groups": summary, "cases": [asdict(row) for row in rows]}
    for path in (answers / SCORES, save):
        if path is not None:
            write_text(path, json.dumps(told, indent=1) + "\n")
    typer.echo(scores(by_group(rows)))
    for batch_name, why in about["skipped"].items():
        typer.echo(f"{batch_name} was left out: {why}")


if __name__ == "__main__":
    app()
