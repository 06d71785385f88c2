"""Commands that turn datasets into other forms: recordings, tables and reports."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import Folder, Json, Methods, app, dataset_to_judge, out_option, print_json
from faultgen.cli.checks import existing_dataset
from faultgen.errors import InputError
from faultgen.export.formats import DATASET_FORMATS, OPTIONS, export_dataset
from faultgen.system.terminal import say

_FORMATS = {
    "recording": ("measured.h5", "one cycle of each run file, as if a controller had logged it"),
    "parquet": ("cycles.parquet", "table of the features of a dataset or a fleet"),
    "ncmapss": ("fleet_ncmapss.h5", "robots of a fleet that fail, in the layout of N-CMAPSS"),
    **{name: (name, text) for name, text in DATASET_FORMATS.items()},
}
"""Where each format is written by default, and what it is."""

_NAMES = "\n".join(f"    {name:<12} {text}" for name, (_, text) in _FORMATS.items())


@app.command(
    help=f"""Turn data into another form: a recording, a table, or the format of another program.

    \b
    faultgen export dataset --format huggingface -o for_the_hub
    faultgen export dataset --format lerobot --episode run -o lerobot
    faultgen export dataset/runs/0123456789abcdef.h5 --format mcap -o run.mcap
    faultgen export dataset/runs/0123456789abcdef.h5 -o measured.h5

    \b
    Formats:
{_NAMES}

    Give a folder or a dataset.h5 for all runs of a dataset, or single run files; 'faultgen info'
    lists the runs. A recording holds positions, torques, commanded positions and the temperature,
    but no label, so that it can be given to 'faultgen discover' as measured data.
    docs/formats.md describes the other formats, and which packages they need."""  # noqa: D301
)
def export(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="A dataset or a fleet, or run files such as dataset/runs/0123456789abcdef.h5."
        ),
    ],
    out: Annotated[
        Path | None,
        out_option(
            "What to write: a folder for huggingface, lerobot, factorynet and zarr; a folder or a "
            "file (.mcap, .rrd) for mcap and rerun; otherwise a file. Default: the name of the "
            "format, or measured.h5, cycles.parquet or fleet_ncmapss.h5."
        ),
    ] = None,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format",
            help=f"One of {', '.join(_FORMATS)}. Default: recording, if run files are given.",
        ),
    ] = None,
    cycle: Annotated[
        int | None,
        typer.Option(help="For recordings: number of the cycle, from 1. Default: the last one."),
    ] = None,
    episode: Annotated[
        str | None, typer.Option(help="For lerobot: what an episode is, cycle (default) or run.")
    ] = None,
    side: Annotated[
        str | None,
        typer.Option(
            help="For lerobot: motor (default) for signals as logged, or joint to convert them to "
            "the joint side of the gearboxes, which are taken for rigid."
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            help="For huggingface: division into training, validation and test part: run "
            "(default), axis, robot or task."
        ),
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option(help="Short for --format parquet with this file.")
    ] = None,
    layout: Annotated[str | None, typer.Option(help="ncmapss: short for --format ncmapss.")] = None,
    as_json: Json = False,
) -> None:
    """Turn data into another form."""
    if layout is not None and layout != "ncmapss":
        raise InputError(f"layout: must be ncmapss, not '{layout}'")
    name = "ncmapss" if layout else "parquet" if parquet else format_ or _default(sources)
    if name not in _FORMATS:
        raise InputError(f"format: unknown '{name}': choose {', '.join(_FORMATS)}")
    if cycle is not None and name != "recording":
        reason = "the table has all cycles" if name == "parquet" else "all cycles are written"
        raise InputError(f"cycle: leave it out, because {reason}")
    place = parquet or out or Path(_FORMATS[name][0])
    options = {"episode": episode, "side": side, "split": split}
    if name in DATASET_FORMATS:
        told = export_dataset(sources, name, place, **options)
    else:
        for option, value in options.items():
            if value is not None:
                raise InputError(
                    f"--{option}: belongs to --format {OPTIONS[option]}, not to {name}"
                )
        told = _FILES[name](sources, place, cycle)
    if as_json:
        print_json(told)
        return
    where, *counts = told.items()
    say(f"{where[1]}: {', '.join(f'{key}: {_shown(value)}' for key, value in counts)}")


def _default(sources: list[Path]) -> str:
    """The format of run files; a dataset has none."""
    for source in sources:
        if source.is_dir():
            choices = ", ".join(name for name in _FORMATS if name != "recording")
            raise InputError(
                f"{source}: is a folder; give the file of a run, or choose a format with --format: "
                f"{choices}"
            )
    return "recording"


def _shown(value: Any) -> str:
    if not isinstance(value, dict):
        return str(value)
    return ", ".join(f"{key} {_shown(part)}" for key, part in value.items())


def _export_recording(sources: list[Path], path: Path, cycle: int | None) -> dict[str, Any]:
    """Write one cycle of each run as a recording."""
    from faultgen.recordings.from_runs import recording_of
    from faultgen.recordings.recording import write_recording

    recording = recording_of(sources, cycle)
    write_recording(recording, path)
    return {"recording": str(path), "samples": len(recording.position), "segments": len(sources)}


def _export_table(sources: list[Path], path: Path, _: int | None) -> dict[str, Any]:
    """Write the table of one dataset or fleet."""
    if len(sources) != 1:
        raise InputError(f"give one dataset with --parquet, not {len(sources)}")
    existing_dataset(sources[0])
    from faultgen.dataset.manifest import is_fleet
    from faultgen.dataset.reader import open_dataset
    from faultgen.fleet.data import open_fleet
    from faultgen.system.tables import write_parquet

    source = open_fleet(sources[0]) if is_fleet(sources[0]) else open_dataset(sources[0])
    frame = source.to_dataframe()
    write_parquet(frame, path)
    return {"table": str(path), "rows": len(frame), "columns": len(frame.columns)}


def _export_layout(sources: list[Path], path: Path, _: int | None) -> dict[str, Any]:
    """Write a fleet in the layout of another data set."""
    from faultgen.fleet.data import open_fleet
    from faultgen.fleet.tables import write_ncmapss

    if len(sources) != 1:
        raise InputError(f"give one fleet with --layout, not {len(sources)}")
    arrays = write_ncmapss(open_fleet(sources[0]).robots, path)
    units = {part: len(set(arrays[f"A_{part}"][:, 0].tolist())) for part in ("dev", "test")}
    samples = sum(len(arrays[f"Y_{part}"]) for part in units)
    return {"file": str(path), "units": units, "samples": samples}


_FILES = {"recording": _export_recording, "parquet": _export_table, "ncmapss": _export_layout}


@app.command()
def report(folder: Folder, method: Methods = None, as_json: Json = False) -> None:
    """Write a report of a dataset or a fleet as an HTML page.

    The page contains figures and, for a dataset, the isolators' results. It is written to
    report.html in the folder, and needs no other files.
    """
    existing_dataset(folder)
    from faultgen.dataset.manifest import is_fleet
    from faultgen.plugins import load
    from faultgen.report import write_report
    from faultgen.report.fleet_report import write_fleet_report

    if is_fleet(folder):
        if method:
            raise InputError("--method: the report of a fleet compares no methods")
        path = write_fleet_report(folder)
    else:
        dataset_to_judge(folder)
        methods: list[Any] = [load(name) for name in method or ()]
        path = write_report(folder, methods=methods)
    print_json({"report": str(path)}) if as_json else say(path)
