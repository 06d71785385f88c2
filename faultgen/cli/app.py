"""The application: options that commands share, and how results are printed."""

from __future__ import annotations

import json
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from faultgen.system.terminal import note, say, visible

if TYPE_CHECKING:
    from faultgen.dataset.estimate import Estimate
    from faultgen.dataset.reader import Dataset

app = typer.Typer(
    name="faultgen",
    help="Generate labelled condition-monitoring data of industrial robots that wear, simulated "
    "in MuJoCo, and find the physical effects that a robot has and its model lacks.",
    epilog="To begin, run: faultgen demo -o demo-out",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        say(f"faultgen {version('faultgen')}")
        raise typer.Exit


@app.callback()
def _options(
    show: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


ShownRobot = Annotated[
    str, typer.Argument(help="Name of a robot, or the path of an MJCF file or robot folder.")
]
ShownTask = Annotated[
    str | None,
    typer.Option(
        help="Name of a task, or the path of a task file. Default: pick_and_place, or the first "
        "task of a robot without it."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]


def _path(text: str | Path) -> Path:
    """Convert the value of --out. An empty one would stand for the current folder."""
    if not str(text):
        raise typer.BadParameter("is empty; give a path, or . for the current folder")
    return Path(text)


def out_option(what: str) -> Any:
    """Declare the option --out of a command.

    Args:
        what: What is written there, for the help.

    Returns:
        The declaration.
    """
    return typer.Option("--out", "-o", parser=_path, metavar="<path>", help=what)


Out = Annotated[Path, out_option("Folder for the results.")]
Workers = Annotated[
    int | None,
    typer.Option(
        help="Number of processes that work at the same time. The results do not depend on it. "
        "Default: one process for each processor core."
    ),
]
TrustLog = Annotated[
    bool,
    typer.Option(
        "--trust-log",
        help="Take the recordings as they are. Signs, units and sides of the log are neither "
        "tested nor corrected, and no axis is left out.",
    ),
]
Robot = Annotated[
    str,
    typer.Option(help="Name of the robot, or the path of its MJCF file or folder."),
]
Sensors = Annotated[
    str | None,
    typer.Option(
        help="Sensor preset whose noise is added to the simulated cycles: none, thesis or "
        "realistic. Default: thesis, or, if the dataset was generated with noise, that noise."
    ),
]
Seeds = Annotated[int, typer.Option(help="How often the noise is drawn anew for each run.")]
Folder = Annotated[
    Path,
    typer.Argument(
        help="Folder of a dataset that 'faultgen generate' has written, or its dataset.h5."
    ),
]
Methods = Annotated[
    list[str] | None,
    typer.Option(
        "--method",
        help="A method of your own that takes part: my_package:MyClass or ./my_file.py:MyClass. "
        "Repeat the option for several. docs/extending.md shows how to write one.",
    ),
]
Split = Annotated[
    str | None,
    typer.Option(
        help="Division of the dataset: run, axis, robot or task. Methods learn from its training "
        "part and are asked about its test part. Default: all runs; or run, if a method learns "
        "from labels."
    ),
]


MOST_ROWS = 60
"""Rows of a list that are shown one by one."""


def names(text: str | None) -> list[str]:
    """Names that a user gave, separated by commas; none if the option was not given."""
    return [] if text is None else [part.strip() for part in text.split(",")]


def print_json(value: Any) -> None:
    """Print a result as JSON on stdout, for other programs."""
    print(json.dumps(value, indent=1, default=lambda v: v.tolist()))  # which escapes by itself


def print_table(rows: list[dict[str, Any]]) -> None:
    """Print rows as an aligned table, with the keys of the first row as its header.

    Args:
        rows: Cells of each row by name of the column.
    """
    from tabulate import tabulate

    shown = [{name: visible(cell) for name, cell in row.items()} for row in rows]
    print(tabulate(shown, "keys", tablefmt="plain", disable_numparse=True))


def print_estimate(what: str, seconds: float, size: float, workers: int) -> None:
    """Print what a long command would take.

    Args:
        what: What it would make.
        seconds: Estimated time [s].
        size: Estimated size [bytes].
        workers: Number of processes.
    """
    from tqdm import tqdm

    from faultgen.system.progress import clock, plural

    say(
        f"{what}; about {clock(seconds)} with {workers} {plural('worker', workers)} on this "
        f"machine, if each has a processor core; about {tqdm.format_sizeof(size, 'B')}"
    )


def show_estimate(found: Estimate, workers: int, as_json: bool, also: str = "") -> None:
    """Print what datasets would take, as text or as JSON.

    Args:
        found: The estimate.
        workers: Number of processes.
        as_json: Whether to print JSON.
        also: What the text says after the number of cycles.
    """
    if as_json:
        print_json({**asdict(found), "workers": workers})
        return
    what = f"{found.runs} runs, {found.cycles} cycles{also}"
    print_estimate(what, found.seconds, found.bytes, workers)


def dataset_to_judge(folder: Path) -> Dataset:
    """Open a dataset that is to be judged, and say on stderr if it lacks runs.

    Args:
        folder: Its folder or file.

    Returns:
        The dataset.
    """
    from faultgen.dataset.reader import open_dataset

    dataset = open_dataset(folder)
    lacking = len(dataset.missing)
    if lacking:
        note(
            f"{folder}: {lacking} of {len(dataset.planned)} runs are missing, and the "
            "result is about the others; to complete the dataset, run the generate command again"
        )
    return dataset


def worker_count(given: int | None) -> int:
    """The number of processes that the user asked for, or else the number of processor cores."""
    from joblib import cpu_count

    from faultgen.system.parallel import check_workers

    return check_workers(given) if given is not None else cpu_count()
