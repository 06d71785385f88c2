"""Commands that make and describe datasets."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import Folder, Json, Out, Workers, app, print_json, print_table, worker_count
from faultgen.errors import InputError, SimulationFailed


@app.command()
def generate(
    experiment: Annotated[
        Path | None, typer.Argument(help="Experiment file (TOML); or else give the flags.")
    ] = None,
    out: Out = Path("dataset"),
    robot: Annotated[
        str | None, typer.Option(help="Robot, or the path of an MJCF; several: a,b.")
    ] = None,
    task: Annotated[
        str | None, typer.Option(help="Task, or the path of a task file; several: a,b.")
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            help="Axes that wear, one run each: 1,2,3; at once: 2+3; default: all that the effect "
            "can act on."
        ),
    ] = None,
    effect: Annotated[str | None, typer.Option(help="Effect; several: a,b. See: effects.")] = None,
    severity: Annotated[
        str | None,
        typer.Option(
            help="Final severity in the unit of the effect, such as 0.1 for 10 %; several: "
            "0.1,0.2; for each effect: backlash=0.001,encoder_offset=0.02."
        ),
    ] = None,
    schedule: Annotated[
        str | None,
        typer.Option(help="exponential (thesis 6.6), sigmoid (3.7), linear, step or constant."),
    ] = None,
    cycles: Annotated[int | None, typer.Option(help="Cycles a run.")] = None,
    sensors: Annotated[str | None, typer.Option(help="none, thesis or realistic.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the first repetition.")] = None,
    repetitions: Annotated[
        int | None, typer.Option(help="Repeat everything with so many seeds.")
    ] = None,
    paired: Annotated[
        bool | None,
        typer.Option(
            "--paired/--unpaired",
            help="Whether faulty and healthy runs of a repetition share their noise; "
            "default: unpaired, as a dataset to learn from needs it.",
        ),
    ] = None,
    regenerate: Annotated[
        bool, typer.Option(help="Make runs again that another version of faultgen has made.")
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Generate a labelled dataset; run the same command again to resume.

    Every combination of robot, task, effect, axis and severity is a run, and the healthy robot is
    one more. Without flags of their own, the axes are all on which the effect can act, the effect
    is friction_wear, the severity 0.2 (for effects with a unit: see the command effects), the
    schedule exponential, 100 cycles, no noise.

    \b
    faultgen generate --robot irb6700 --task spot_weld --axis 3 --cycles 50 -o out
    faultgen generate experiment.toml -o out
    """  # noqa: D301
    from faultgen.dataset.experiment import load_experiment, make_experiment
    from faultgen.dataset.sweep import generate as run_generate

    flags: dict[str, Any] = {
        "robot": _split(robot),
        "task": _split(task),
        "axis": _axes(axis),
        "effect": _split(effect),
        "severity": _severities(severity),
        "schedule": schedule,
        "cycles": cycles,
        "sensors": sensors,
        "seed": seed,
        "repetitions": repetitions,
        "paired": paired,
    }
    given = {name: value for name, value in flags.items() if value is not None}
    if experiment is not None and given:
        raise InputError(f"give an experiment file or flags, not both: --{next(iter(given))}")
    if experiment is not None:
        chosen = load_experiment(experiment)
    else:
        for name in ("robot", "task"):
            if name not in given:
                raise InputError(f"give an experiment file, or --robot and --task: no --{name}")
        chosen = make_experiment(given)
    summary = run_generate(chosen, out, workers=worker_count(workers), regenerate=regenerate)
    if as_json:
        print_json(asdict(summary))
    else:
        print(
            f"{out}: {summary.planned} runs, {summary.done} made now, {summary.kept} there before, "
            f"{len(summary.failed)} failed"
        )
        for run_id, reason in summary.failed.items():
            print(f"failed: {run_id}: {reason}")
    if summary.failed:
        raise typer.Exit(1)


@app.command()
def info(folder: Folder, as_json: Json = False) -> None:
    """Tell what a dataset holds, and whether it is complete and intact."""
    from faultgen.dataset.reader import open_dataset

    dataset = open_dataset(folder)
    damaged = dataset.damaged()
    broken = {Path(name).stem for name in damaged}
    versions = dataset.versions()
    rows = []
    for run_id, parameters in dataset.planned.items():
        state = "missing" if run_id in dataset.missing else "ok"
        state = "failed" if run_id in dataset.failed else state
        state = "damaged" if run_id in broken else state
        rows.append(
            {
                "run": run_id,
                "robot": Path(parameters["robot"]).stem,
                "task": Path(parameters["task"]).stem,
                "effect": parameters["effect"],
                "axes": "+".join(map(str, parameters["axes"])) or "-",
                "severity": parameters["severity"],
                "cycles": parameters["cycles"],
                "sensors": parameters["sensors"],
                "seed": parameters["seed"],
                "state": state,
            }
        )
    merged = folder / "dataset.h5"
    complete = not dataset.missing and merged.is_file()
    whole = complete and not damaged and len(versions) < 2
    result = {
        "folder": str(folder),
        "complete": complete,
        "intact": not damaged,
        "runs": rows,
        "missing": dataset.missing,
        "failed": dataset.failed,
        "damaged": damaged,
        "versions": {str(version): ids for version, ids in versions.items()},
    }
    if as_json:
        print_json(result)
    else:
        print_table(rows)
        print(f"{len(rows)} runs planned, {len(dataset.missing)} missing, {len(damaged)} damaged")
        for run_id, reason in dataset.failed.items():
            print(f"failed: {run_id}: {reason}")
        for name, reason in damaged.items():
            print(f"damaged: {name}: {reason}")
        if not merged.is_file():
            print("dataset.h5 is missing")
        if len(versions) > 1:
            for version, ids in versions.items():
                print(f"made by {version}: {', '.join(ids)}")
            print("its runs were made by different versions: make the others again, --regenerate")
        print("complete and intact" if whole else "not whole: run the generate command again")
    if not whole:
        raise typer.Exit(1)


@app.command()
def report(folder: Folder, as_json: Json = False) -> None:
    """Write report.html, self-contained: figures of a dataset and what isolators answer."""
    from faultgen.report import write_report

    path = write_report(folder)
    print_json({"report": str(path)}) if as_json else print(path)


@app.command()
def demo(out: Out = Path("demo-out"), workers: Workers = None, as_json: Json = False) -> None:
    """The main job from end to end: a small wear sweep, its dataset, isolators and a report.

    Takes about a minute of processor time on a 2-core AMD EPYC server. With both cores free that is
    less on the clock; on a busy machine it can be several minutes.
    """
    from faultgen.dataset.experiment import make_experiment
    from faultgen.dataset.reader import open_dataset
    from faultgen.dataset.sweep import generate as run_generate
    from faultgen.evaluation.isolate import isolate as run_isolate
    from faultgen.evaluation.outcomes import save, table, to_dict
    from faultgen.report import write_report

    chosen = make_experiment(
        {
            "robot": "puma560",
            "task": "pick_and_place",
            "cycles": 30,
            "signals": ["signals/motor_velocity", "signals/motor_torque"],
        }
    )
    summary = run_generate(chosen, out, workers=worker_count(workers))
    if summary.failed:
        raise SimulationFailed("; ".join(summary.failed.values()))
    result = run_isolate(open_dataset(out), seeds=5, progress=False)
    save(result, out)
    path = write_report(out, result)
    if as_json:
        print_json({**asdict(summary), "isolation": to_dict(result), "report": str(path)})
        return
    print(table(result))
    print(f"\ndataset: {out / 'dataset.h5'}\nreport:  {path}")


def _split(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",")]


def _axes(text: str | None) -> list[list[int]] | None:
    if text is None:
        return None
    try:
        return [[int(axis) for axis in part.split("+")] for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"axis '{text}': give numbers such as 1,2,3, or 2+3 for two at once"
        ) from None


def _severities(text: str | None) -> list[float] | dict[str, list[float]] | None:
    """0.1,0.2 as a list; backlash=0.001,0.002,delay=0.01 as a list for each effect."""
    if text is None:
        return None
    found: dict[str, list[float]] = {}
    name = ""
    try:
        for part in text.split(","):
            before, equals, number = part.rpartition("=")
            name = before.strip() if equals else name
            found.setdefault(name, []).append(float(number))
    except ValueError:
        found = {}
    if not found or ("" in found and len(found) > 1):
        raise InputError(
            f"severity '{text}': give numbers such as 0.1,0.2, or those of each effect such as "
            "backlash=0.001,encoder_offset=0.02"
        )
    return found[""] if "" in found else found
