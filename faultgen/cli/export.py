"""Commands that turn datasets into other forms: recordings, tables and reports."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import Folder, Json, Methods, app, dataset_to_judge, out_option, print_json
from faultgen.cli.checks import existing_dataset
from faultgen.errors import InputError
from faultgen.system.terminal import say


@app.command()
def export(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Run files of a dataset, such as dataset/runs/0123456789abcdef.h5; with "
            "--parquet, a dataset or a fleet; with --layout, a fleet."
        ),
    ],
    out: Annotated[Path, out_option("Recording to write (HDF5).")] = Path("measured.h5"),
    cycle: Annotated[
        int | None, typer.Option(help="Number of the cycle, from 1. Default: the last one.")
    ] = None,
    parquet: Annotated[
        Path | None,
        typer.Option(
            help="Write labels and features of all cycles as a table to this Parquet file."
        ),
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            help="ncmapss: write the robots of a fleet that fail, with their remaining life, in "
            "the layout of the data set N-CMAPSS to the file of --out."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Turn data into another form: a recording, a table, or the layout of another data set.

    \b
    faultgen export dataset/runs/0123456789abcdef.h5 -o measured.h5
    faultgen export dataset --parquet cycles.parquet
    faultgen export fleet --layout ncmapss -o fleet_ncmapss.h5

    The first form makes a recording, as if a controller had logged it. One cycle of each run
    becomes a segment of the recording. It holds positions, torques, commanded positions and the
    temperature, but no label, so that it can be given to 'faultgen discover' as measured data.
    'faultgen info' lists the runs of a dataset.

    The second form writes one row for each cycle of a dataset, or for each sample of a fleet. The
    third form writes run-to-failure data; docs/fleet.md lists its columns.
    """  # noqa: D301
    if layout is not None:
        _export_layout(sources, layout, out, as_json)
        return
    if parquet is not None:
        if cycle is not None:
            raise InputError("cycle: leave it out, because the table has all cycles")
        _export_table(sources, parquet, as_json)
        return
    from faultgen.recordings.from_runs import recording_of
    from faultgen.recordings.recording import write_recording

    recording = recording_of(sources, cycle)
    write_recording(recording, out)
    told = {"recording": str(out), "samples": len(recording.position), "segments": len(sources)}
    if as_json:
        print_json(told)
        return
    say(f"{out}: samples: {told['samples']}, segments: {told['segments']}")


def _export_table(sources: list[Path], path: Path, as_json: bool) -> None:
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
    told = {"table": str(path), "rows": len(frame), "columns": len(frame.columns)}
    print_json(told) if as_json else say(
        f"{path}: rows: {len(frame)}, columns: {len(frame.columns)}"
    )


def _export_layout(sources: list[Path], layout: str, out: Path, as_json: bool) -> None:
    """Write a fleet in the layout of another data set."""
    from faultgen.fleet.data import open_fleet
    from faultgen.fleet.tables import write_ncmapss

    if layout != "ncmapss":
        raise InputError(f"layout: must be ncmapss, not '{layout}'")
    if len(sources) != 1:
        raise InputError(f"give one fleet with --layout, not {len(sources)}")
    arrays = write_ncmapss(open_fleet(sources[0]).robots, out)
    units = {part: len(set(arrays[f"A_{part}"][:, 0].tolist())) for part in ("dev", "test")}
    told = {"file": str(out), "units": units, "samples": sum(len(arrays[f"Y_{p}"]) for p in units)}
    if as_json:
        print_json(told)
        return
    say(
        f"{out}: training units: {units['dev']}, test units: {units['test']}, "
        f"samples: {told['samples']}"
    )


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
