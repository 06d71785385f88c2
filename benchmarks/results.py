"""Measure what the tables of the documentation show, and write the tables into the pages.

    python -m benchmarks.results --list           # the parts, with minutes and state
    python -m benchmarks.results --only growth    # measure one part and show it
    python -m benchmarks.results --render         # only write the tables again

A part is measured if its file in benchmarks/results is absent or was made by other code. What
its commands have done stays in build/results, and the next call goes on there.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import typer
from parts import discovery, monitoring, robots, speed
from parts.part import DOCS, ROOT, Part

from faultgen.provenance import Provenance
from faultgen.system.files import write_text

PARTS: tuple[Part, ...] = (*speed.PARTS, *robots.PARTS, *monitoring.PARTS, *discovery.PARTS)
WORK = ROOT / "build" / "results"
DONE = "done.json"
"""In a folder of WORK: the commands that are done there."""

app = typer.Typer(add_completion=False, help=__doc__)


class Failed(Exception):
    """A command of a part failed."""


def read(part: Part) -> dict[str, Any] | None:
    """Read the numbers of a part; None if they were never measured."""
    if not part.path.is_file():
        return None
    told: dict[str, Any] = json.loads(part.path.read_text(encoding="utf-8"))
    return told


def maker(told: dict[str, Any]) -> Provenance | None:
    """Return the code that made the numbers; None if they do not say."""
    return Provenance.of(told["provenance"]) if "provenance" in told else None


def state(part: Part) -> str:
    """Say in words whether the numbers of a part are those of the present code."""
    told = read(part)
    if told is None:
        return "not measured"
    by = maker(told)
    if by is None:
        return "made by a version that was not recorded"
    return "up to date" if by == part.made_by else f"made by other code: {by}"


def run(commands: Sequence[str], folder: Path, inputs: Path | None = None) -> None:
    """Run the commands in a folder, without those that were done there before.

    Args:
        commands: Commands of the shell.
        folder: Made if it is absent.
        inputs: Folder that commands call `$INPUTS`.

    Raises:
        Failed: A command failed; those before it are not run again the next time.
    """
    folder.mkdir(parents=True, exist_ok=True)
    own = Path(sys.executable).parent
    variables = {
        "PATH": f"{own}{os.pathsep}{os.environ.get('PATH', os.defpath)}",
        "PYTHONPATH": str(ROOT),
        "INPUTS": str(inputs or ""),
    }
    done = json.loads((folder / DONE).read_text()) if (folder / DONE).is_file() else []
    for command in commands:
        if command in done:
            continue
        print(f"{folder.name}: {command}", flush=True)
        status = subprocess.run(
            command, shell=True, cwd=folder, env=os.environ | variables
        ).returncode
        if status != 0:
            raise Failed(f"exit status {status} of `{command}` in {folder}")
        done.append(command)
        write_text(folder / DONE, json.dumps(done, indent=1) + "\n")


def measure(part: Part, again: bool = False, work: Path = WORK) -> None:
    """Run the commands of a part, and write its numbers with what made them.

    Args:
        part: The part.
        again: Whether to forget what its commands have done before.
        work: Where the commands run.

    Raises:
        Failed: A command failed, or wrote no numbers. An earlier file of the part stays.
    """
    by = part.made_by
    folder = work / f"{part.name}-{by.key}"
    if again:
        shutil.rmtree(folder, ignore_errors=True)
    inputs = None
    if part.inputs:
        inputs = work / f"{part.inputs.name}-{part.inputs.made_by.key}"
        run(part.inputs.commands, inputs)
    begin = time.monotonic()
    run(part.commands, folder, inputs)
    path = folder / part.path.name
    if not path.is_file():
        raise Failed(f"`{part.commands[-1]}` wrote no {path.name} in {folder}")
    told = json.loads(path.read_text(encoding="utf-8"))
    about = {
        "faultgen_version": by.faultgen_version,
        "mujoco_version": by.mujoco_version,
        "code_sha256": by.code_sha256,
        "commands": [*(part.inputs.commands if part.inputs else ()), *part.commands],
        "date": date.today().isoformat(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "minutes": round((time.monotonic() - begin) / 60, 1),
    }
    write_text(part.path, json.dumps({"provenance": about} | told, indent=1) + "\n")


def origin(part: Part, told: dict[str, Any]) -> str:
    """Sentence that says which version made the numbers, and how to make them again."""
    by = maker(told)
    again = f"`make results PARTS={part.name}`"
    if by is None:
        known = f"of source {told['version']}" if "version" in told else "that was not recorded"
        return f"Made by an earlier version {known}; {again} makes it again."
    about = told["provenance"]
    return f"Made by {again} with {by}, on {about['date']} ({about['machine']})."


def rendered(page: str, text: str, parts: Sequence[Part] = PARTS) -> str:
    """Put the tables of all measured parts into the text of a page.

    Args:
        page: Path of the page below docs/.
        text: The page, in which `<!-- NAME.json -->` and `<!-- end -->` enclose each table.
        parts: Parts, of which those of the page count.

    Returns:
        The page with the tables of the present numbers.

    Raises:
        ValueError: A table has no place in the page.
    """
    for part in parts:
        told = read(part) if part.page == page else None
        if told is None:
            continue
        begin, end = f"<!-- {part.path.name} -->\n", "<!-- end -->"
        before, found, rest = text.partition(begin)
        if not found or end not in rest:
            raise ValueError(f"docs/{page} has no lines {begin.strip()} and {end.strip()}")
        table = f"\n{part.table(told)}\n\n{origin(part, told)}\n\n"
        text = before + begin + table + rest[rest.index(end) :]
    return text


def render() -> None:
    """Write the tables into the pages."""
    for page in sorted({part.page for part in PARTS}):
        path = DOCS / page
        old = path.read_text(encoding="utf-8")
        new = rendered(page, old)
        if new != old:
            write_text(path, new)
            print(f"docs/{page}: tables written")


def show() -> None:
    """Print the parts."""
    for part in PARTS:
        others = f" and {part.inputs.minutes:g} min for its inputs" if part.inputs else ""
        needs = f"; needs {', '.join(part.needs)}" if part.needs else ""
        print(f"{part.name:<19}{part.minutes:g} min{others}, docs/{part.page}{needs}")
        print(f"{'':<19}{state(part)}")


@app.command()
def main(
    only: Annotated[
        list[str] | None, typer.Option(help="Name of a part; repeatable. Default: all.")
    ] = None,
    again: Annotated[bool, typer.Option(help="Measure also what is up to date.")] = False,
    listed: Annotated[
        bool, typer.Option("--list", help="Print the parts with minutes and state, and end.")
    ] = False,
    only_render: Annotated[
        bool, typer.Option("--render", help="Measure nothing, only write the tables.")
    ] = False,
) -> None:
    """Measure the parts that are out of date, one after another, and write all tables."""
    names = [part.name for part in PARTS]
    for name in only or []:
        if name not in names:
            raise typer.BadParameter(f"--only: no part {name!r}; there are {', '.join(names)}")
    if listed:
        show()
        return
    failures = []
    for part in () if only_render else PARTS:
        if only and part.name not in only:
            continue
        if missing := part.missing():
            print(f"{part.name}: left out, because it needs {', '.join(missing)}")
        elif not again and state(part) == "up to date":
            print(f"{part.name}: up to date")
        else:
            try:
                measure(part, again)
            except Failed as error:
                failures.append(f"{part.name}: {error}")
    render()
    for failure in failures:
        print(failure, file=sys.stderr)
    if failures:
        raise typer.Exit(1)


if __name__ == "__main__":
    app()
