"""The application: options that commands share, and how results are printed."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(
    name="faultgen",
    help="Labelled condition-monitoring data from industrial robots that wear in MuJoCo.",
    epilog="Start with: faultgen demo -o demo-out",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"faultgen {version('faultgen')}")
        raise typer.Exit


@app.callback()
def _options(
    show: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")]
Workers = Annotated[
    int | None,
    typer.Option(help="Processes that simulate; default: one a core. No effect on data."),
]
Sensors = Annotated[
    str | None,
    typer.Option(help="Noise to draw anew; default: thesis, or the noise the data has."),
]
Seeds = Annotated[int, typer.Option(help="Draws of the noise for each run.")]
Folder = Annotated[Path, typer.Argument(help="Folder of a dataset, as generate writes it.")]


def print_json(value: Any) -> None:
    """The result for machines, on stdout."""
    print(json.dumps(value, indent=1, default=lambda v: v.tolist()))


def print_table(rows: list[dict[str, Any]]) -> None:
    """Columns for people; the last one is as long as it likes."""
    if not rows:
        return
    names = list(rows[0])
    cells = [names, *[[str(row[name]) for name in names] for row in rows]]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    for line in cells:
        print("  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip())


def worker_count(given: int | None) -> int:
    """Processes that were asked for, or one a core."""
    from joblib import cpu_count

    from faultgen.system.parallel import check_workers

    return check_workers(given) if given is not None else cpu_count()
