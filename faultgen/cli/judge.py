"""Commands that judge: detectors, isolators, studies, discovery."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from faultgen.cli.app import (
    Folder,
    Json,
    Out,
    Seeds,
    Sensors,
    Workers,
    app,
    print_json,
    worker_count,
)


@app.command()
def detect(
    folder: Folder,
    sensors: Sensors = None,
    seeds: Seeds = 20,
    as_json: Json = False,
) -> None:
    """Tell by every detector whether anything is worn, by task and wear.

    Detectors learn from healthy cycles: of the dataset's healthy run with other noise, or, where
    the noise is stored, of healthy runs of other seeds (generate with repetitions). Shares have
    95 % Wilson intervals. The result is also written to detection.json in the folder.
    """
    from faultgen.dataset.reader import open_dataset
    from faultgen.evaluation.detect import detect as run_detect
    from faultgen.evaluation.detect import detection_table, save_detection

    result = run_detect(open_dataset(folder), sensors=sensors, seeds=seeds)
    save_detection(result, folder)
    print_json(vars(result)) if as_json else print(detection_table(result))


@app.command()
def isolate(
    folder: Folder,
    sensors: Sensors = None,
    seeds: Seeds = 20,
    as_json: Json = False,
) -> None:
    """Name the worn axis of every run by each isolator, in the form of thesis table 6.2.

    Ours learn from healthy cycles: of the dataset's healthy run with other noise, or, where the
    noise is stored, of healthy runs of other seeds (generate with repetitions). Shares of right
    answers have 95 % Wilson intervals; rows 'healthy' tell how often an axis is named though none
    is worn. The result is also written to isolation.json in the folder.
    """
    from faultgen.dataset.reader import open_dataset
    from faultgen.evaluation.isolate import isolate as run_isolate
    from faultgen.evaluation.outcomes import save, table, to_dict

    result = run_isolate(open_dataset(folder), sensors=sensors, seeds=seeds)
    save(result, folder)
    print_json(to_dict(result)) if as_json else print(table(result))


@app.command()
def study(
    name: Annotated[
        str, typer.Argument(help="events, detection, training-data, classifiers or isolation.")
    ],
    out: Out = Path("study-out"),
    fleet: Annotated[
        Path | None,
        typer.Option(help="Folder of a fleet to study, for events, classifiers and training-data."),
    ] = None,
    quick: Annotated[bool, typer.Option(help="Fewer seeds or robots, for a first look.")] = False,
    seed: Annotated[int, typer.Option(help="Root of all draws; docs/ reports the default.")] = 2026,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Run a whole study: judge every method, write tables and figures.

    Detection and isolation simulate what they need. Events, training-data and classifiers are of a
    fleet, which is made where none is given.

    The folder gets results.json, tables.md and figures/. Simulated cycles stay there, and are used
    again by the next call.
    """
    from faultgen.studies.runner import run_study

    result = run_study(
        name, out, quick=quick, seed=seed, workers=worker_count(workers), fleet=fleet
    )
    if as_json:
        print_json(result)
        return
    for goal in result["goals"]:
        print(f"{goal['name']}: {goal['measured']} (goal {goal['goal']}; thesis {goal['thesis']})")
    print(f"\ntables:  {out / 'tables.md'}\nfigures: {out / 'figures'}")


@app.command()
def discover(
    measured: Annotated[Path, typer.Argument(help="Recording of the robot (HDF5 or CSV).")],
    robot: Annotated[str, typer.Option(help="Robot, or the path of an MJCF.")],
    healthy: Annotated[
        Path | None, typer.Option(help="Recording of the same motions before the change.")
    ] = None,
    validate: Annotated[
        Path | None, typer.Option(help="Recording of other motions, for scoring only.")
    ] = None,
    out: Out = Path("discovery-out"),
    cache: Annotated[
        Path | None,
        typer.Option(help="Folder that keeps sensitivities for other recordings of one program."),
    ] = None,
    include: Annotated[
        list[str] | None, typer.Option(help="Effect that is a candidate on request only.")
    ] = None,
    width: Annotated[
        float, typer.Option(help="Tolerance of the model's own numbers over the usual one.")
    ] = 1.0,
    steady: Annotated[
        bool, typer.Option(help="Count errors that last in full: for filtered recordings.")
    ] = False,
    low_pass: Annotated[
        float | None, typer.Option(help="Filter of recordings without a reference [Hz].")
    ] = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Name the effect that a measured robot has and its model, or its healthy twin, lacks.

    With --healthy, two recordings of the same motions are subtracted, and small changes show.
    Without, the model is calibrated on the recording, and an effect has to be larger than what
    models are usually wrong by. The answer is: no missing effect, named, ambiguous (with the
    motion that would decide it), or unknown effect. The folder gets discovery.json, model.xml
    (the robot with the effects in it), report.html and, if ambiguous, next_experiment.toml.
    """
    from faultgen.report.discover import discover as run_discover

    result = run_discover(
        measured,
        robot,
        healthy,
        validate,
        out=out,
        workers=worker_count(workers),
        include=include or (),
        width=width,
        steady=steady,
        low_pass=low_pass,
        cache=cache,
    )
    for warning in result["warnings"]:
        print(f"faultgen: {warning}", file=sys.stderr)
    if as_json:
        print_json(result)
        return
    print(result["verdict"])
    for one in result["effects"]:
        low, high = one["interval"]["severity"]
        print(
            f"{one['effect']} on axis {one['axis']}: {one['parameters']['severity']:.4g} "
            f"[{low:.4g}, {high:.4g}], {one['parameters']['unit']}; "
            f"confidence {one['confidence']:.2f}"
        )
    for one in result["alternatives"]:
        print(f"not excluded: {one['effect']} on axis {one['axis']} ({one['confidence']:.2f})")
    if result["next_experiment"]:
        print(f"to tell them apart, run {out / 'next_experiment.toml'}")
    if result["unexplained"]:
        print(result["unexplained"])
    gap = result["gap"]
    print(
        f"gap {gap['before']:.4f}, calibrated {gap['calibrated']:.4f}, "
        f"after {gap['after']:.4f}, floor {gap['floor']:.4f}"
    )


@app.command()
def calibrate(
    measured: Annotated[Path, typer.Argument(help="Recording of the robot (HDF5 or CSV).")],
    robot: Annotated[str, typer.Option(help="Robot, or the path of an MJCF.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="MJCF to write.")] = Path("model.xml"),
    known: Annotated[
        list[str] | None, typer.Option(help="Number that is known well: inertia, say.")
    ] = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Fit the numbers of a model that is only roughly known to a recording.

    Friction, offsets, rotors, torque constants and links get wider tolerances; how wide is told by
    blocks of the recording that were not fitted. Of torque constants and links (inertia) one should
    be --known. The model that is written can be given to discover.
    """
    from faultgen.discovery.calibrate import calibrate as run_calibrate
    from faultgen.discovery.workflow import usable
    from faultgen.mjcf.edit import write_model
    from faultgen.robot import load_robot
    from faultgen.system.files import write_text

    model = load_robot(robot)
    recording, warnings = usable(measured, model)
    for warning in warnings:
        print(f"faultgen: {warning}", file=sys.stderr)
    found = run_calibrate(recording, model, known=known or (), workers=worker_count(workers))
    result = {"width": found.width, "held_out": found.held_out, "values": found.values}
    write_text(out.with_suffix(".json"), json.dumps({**result, "lacks": found.lacks}, indent=1))
    write_model(out, found.robot.xml, found.robot.assets)
    for line in found.lacks:
        print(f"faultgen: {line}", file=sys.stderr)
    if as_json:
        print_json(result)
        return
    print(f"tolerances times {found.width:g}")
    for name, values in found.values.items():
        print(f"{name}: " + ", ".join(f"axis {k} {v:+.3g}" for k, v in values.items()))
