"""Commands for recordings of real robots."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from faultgen.cli.app import Json, app, out_option, print_json, print_table
from faultgen.errors import InputError
from faultgen.system.terminal import say


@app.command("import")
def import_(
    log: Annotated[
        Path | None,
        typer.Argument(
            help="Log of a controller: text with columns, XML, JSON, LabVIEW (.lvm), an export of "
            "TwinCAT Scope, a KUKA trace (.dat), a MATLAB, NumPy, Parquet or Feather file, a ROS "
            "bag, or the folder of a ROS 2 bag or LeRobot dataset."
        ),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", help="Map (TOML): which column is which quantity of which axis, and its unit."
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            help="Map that comes with faultgen: abb, abb_egm, dvrk, fanuc, franka, franka_ros, "
            "kuka, kuka_rsi, lerobot, mat, ros1, ros2 or ur_rtde. Entries of --map replace its "
            "entries."
        ),
    ] = None,
    program: Annotated[
        str | None,
        typer.Option(
            help="Take only the rows of this program. The map names the column of its name as "
            "'program'. Default: all rows."
        ),
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            help="For ROS bags: 'header' takes the times in the headers of the messages, 'receive' "
            "those at which the bag received them. Default: header, or receive where the headers "
            "have none."
        ),
    ] = None,
    show_preset: Annotated[
        str | None,
        typer.Option(help="Print the map of a preset, to copy and edit it. No log is read."),
    ] = None,
    out: Annotated[Path, out_option("Recording to write (HDF5).")] = Path("measured.h5"),
    figure: Annotated[
        bool,
        typer.Option(
            "--figure",
            help="Also draw position and torque of every axis over time, in a PNG file beside the "
            "recording. This takes two seconds.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Make a recording for 'faultgen discover' from the log of a robot controller.

    The command tells how it understood each column: the quantity and the axis, the unit and the
    factor to the SI unit, and the range of the values. Check them, and draw the recording with
    --figure. Uneven times are resampled, and a gap of more than three sample periods begins a new
    segment. docs/importing.md describes the map.

    \b
    faultgen import log.csv --preset ur_rtde -o measured.h5
    faultgen import --show-preset ur_rtde > columns.toml
    faultgen import log.csv --map columns.toml -o measured.h5
    """  # noqa: D301
    from faultgen.importing.column_map import load_map, preset_text

    if show_preset is not None:
        print(preset_text(show_preset), end="")
        return
    if log is None:
        raise InputError("give the log that should be imported")
    if out.suffix.lower() not in (".h5", ".hdf5"):
        raise InputError(f"--out {out}: give a name that ends with .h5, because it is HDF5")
    if out.resolve() == log.resolve():
        raise InputError(f"--out {out}: is the log itself; give another name")
    if not log.exists():
        raise InputError(f"{log}: no such file")
    if time not in (None, "header", "receive"):
        raise InputError(f"--time {time}: give header or receive")
    column_map = load_map(map_file, preset)
    from faultgen.importing.read_log import is_bag
    from faultgen.recordings.import_log import import_log

    if time is not None:
        if not is_bag(log, column_map.file):
            raise InputError(
                f"--time {time}: only ROS bags have both times; state time.column in the map"
            )
        file = column_map.file.model_copy(update={"stamp": time})
        column_map = column_map.model_copy(update={"file": file})
    made = import_log(log, column_map, program)
    recording = made.recording
    from faultgen.recordings.recording import write_recording
    from faultgen.system.progress import plural

    picture = out.with_suffix(".png") if figure else None
    if picture is not None:
        from faultgen.report.recording_figure import recording_png
        from faultgen.system.files import write_bytes

        png = recording_png(recording)  # before anything is written
    write_recording(recording, out)
    if picture is not None:
        write_bytes(picture, png)
    result = {
        "recording": str(out),
        "picture": None if picture is None else str(picture),
        "side": recording.side,
        "axes": recording.n_axes,
        "samples": len(recording.position),
        "sample_period": recording.sample_period,
        "jitter": made.jitter,
        "gaps": list(made.gaps),
        "missing": made.missing,
        "segments": list(recording.segments),
        "columns": [asdict(row) for row in made.rows],
        "notes": list(made.notes),
    }
    if as_json:
        print_json(result)
        return
    print_table(
        [
            {
                "quantity": row.quantity,
                "axis": "-" if row.axis is None else row.axis,
                "column": row.column,
                "unit": row.unit,
                "factor": f"{row.factor:.6g}",
                "from": f"{row.lowest:.4g}",
                "to": f"{row.highest:.4g}",
                "in": row.si,
            }
            for row in made.rows
        ]
    )
    period = recording.sample_period
    gaps = "no gaps"
    if made.gaps:
        count = "a gap of" if len(made.gaps) == 1 else f"{len(made.gaps)} gaps of up to"
        gaps = f"{count} {max(made.gaps):.3g} s"
    if made.missing:
        gaps += f"; {made.missing} missing {plural('sample', made.missing)} interpolated"
    axes, segments = recording.n_axes, len(recording.segments)
    say(
        f"{len(recording.position)} samples of {axes} {'axis' if axes == 1 else 'axes'}, "
        f"{recording.side} side, "
        f"every {period:.6g} s ({1 / period:.6g} Hz); largest jitter "
        f"{100 * made.jitter / period:.0f} % of the period; {gaps}; "
        f"{segments} {'segment' if segments == 1 else 'segments'}"
    )
    for remark in made.notes:
        say(remark if remark.startswith("warning: ") else f"note: {remark}")
    say(f"{out} is written" if picture is None else f"{out} and {picture} are written")
