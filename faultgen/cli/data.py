"""Commands that make datasets."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from faultgen.cli.app import (
    Folder,
    Json,
    Out,
    Workers,
    app,
    names,
    print_json,
    show_estimate,
    worker_count,
)
from faultgen.cli.checks import existing_dataset, existing_robot, readable_text
from faultgen.cli.values import (
    TRAINING,
    axes_of,
    numbers_of,
    part_of,
    severities_of,
    spreads_of,
    task_of,
)
from faultgen.errors import InputError, SimulationFailed
from faultgen.system.terminal import say

if TYPE_CHECKING:
    from faultgen.dataset.experiment import Experiment
    from faultgen.dataset.sweep import Summary


@app.command()
def generate(
    experiment: Annotated[
        Path | None,
        typer.Argument(help="Experiment file (TOML). Without one, give --robot and --task."),
    ] = None,
    out: Out = Path("dataset"),
    robot: Annotated[
        str | None,
        typer.Option(
            help="Name of a robot, or the path of an MJCF file or robot folder. For several, "
            "write a,b."
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(help="Name of a task, or the path of a task file. For several, write a,b."),
    ] = None,
    task_from: Annotated[
        Path | None,
        typer.Option(
            help="Recording (HDF5 or CSV) whose motion the robot repeats, instead of --task. The "
            "other defaults then suit the training of a detector: 24 cycles, 3 repetitions, and "
            "the schedule 'linear'."
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            help="Axes that wear. 1,2,3 makes one run for each axis; 2+3 makes one run in which "
            "both axes wear at once. Default, also written 'all': every axis that the effect can "
            "act on; for payload_mass and payload_offset the last one."
        ),
    ] = None,
    effect: Annotated[
        str | None,
        typer.Option(
            help="Name of an effect. For several, write a,b. 'faultgen effects' lists them."
        ),
    ] = None,
    severity: Annotated[
        str | None,
        typer.Option(
            help="Severity in the last cycle, in the unit of the effect: 0.1 means 10 % where the "
            "unit is a fraction. 0.1,0.2 makes a run for each value. Effects of different units "
            "need values of their own: backlash=0.001,encoder_offset=0.02."
        ),
    ] = None,
    schedule: Annotated[
        str | None,
        typer.Option(
            help="How the severity grows from cycle to cycle: exponential (thesis, eq. 6.6), "
            "sigmoid (thesis, eq. 3.7), linear, step or constant."
        ),
    ] = None,
    cycles: Annotated[int | None, typer.Option(help="Number of cycles in each run.")] = None,
    sensors: Annotated[
        str | None,
        typer.Option(
            help="Preset of sensor noise and disturbances, none, thesis or realistic, or the path "
            "of a sensors file. Default: the sensors in the robot's folder, or none."
        ),
    ] = None,
    speed: Annotated[
        str | None,
        typer.Option(
            help="Speed override: 0.5 means half of the programmed speed. For several, write "
            "0.5,1; all runs are made at each of them. Default: 1."
        ),
    ] = None,
    payload: Annotated[
        str | None,
        typer.Option(
            help="Mass of the payload in kg, which the controller knows. For several, write 10,50. "
            "Default: that of the model."
        ),
    ] = None,
    temperature: Annotated[
        str | None,
        typer.Option(
            help="Mean temperature of the gearboxes in °C, from 30 to 80. For several, write "
            "30,50. Default: that at which the friction of the model holds, usually 40."
        ),
    ] = None,
    randomize: Annotated[
        str | None,
        typer.Option(
            help="Give each run a robot of its own, which differs from the model that the "
            "controller knows: parameters=0.03,masses=0.02,servo=0.1,noise=0.3,payload=0.05,"
            "temperature=3. The numbers are spreads (of the logarithm; in K for the temperature): "
            "friction, rotors and stiffness; links; servo gains; noise; payload; mean temperature. "
            "The robot of each run is stored in its file."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the first repetition.")] = None,
    repetitions: Annotated[
        int | None,
        typer.Option(help="Number of times that all runs are made, each time with another seed."),
    ] = None,
    paired: Annotated[
        bool | None,
        typer.Option(
            "--paired/--unpaired",
            help="Whether the faulty and healthy runs of a repetition share the same noise. "
            "Default: unpaired, so that a method that learns from the data cannot recognise runs "
            "by their noise.",
        ),
    ] = None,
    healthy: Annotated[
        bool | None,
        typer.Option(
            "--healthy/--no-healthy",
            help="Whether each robot, task and repetition also gets a run without a fault. "
            "Default: it does.",
        ),
    ] = None,
    signals: Annotated[
        str | None,
        typer.Option(
            help="Sampled signals that the files keep: all, none, or names such as "
            "signals/motor_torque,truth/friction_torque. Default: all."
        ),
    ] = None,
    fidelity: Annotated[
        str | None,
        typer.Option(
            help="stepped: every cycle is simulated. interpolated: some conditions of each run are "
            "simulated, and the cycles are computed between them, which is several times faster. "
            "The error is stored with each run; a run with a large one fails. Default: stepped."
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Simulate only a few cycles, write nothing, and print the number of runs, and the "
            "estimated time and size of the dataset.",
        ),
    ] = False,
    regenerate: Annotated[
        bool,
        typer.Option(help="Replace the runs that another version of faultgen has made."),
    ] = False,
    keep: Annotated[
        str,
        typer.Option(
            help="all: keep a file for each run beside dataset.h5. merged: keep only dataset.h5, "
            "which needs half the disk space; the run files are removed after dataset.h5 was read "
            "back and compared with them."
        ),
    ] = "all",
    part: Annotated[
        str | None,
        typer.Option(
            help="K/N: make only part K of N of the runs. Several machines that share the folder "
            "can make the parts at the same time; then call faultgen merge. With --keep merged, "
            "each part has its share of the repetitions and a folder and dataset.h5 of its own, "
            "so that a million runs do not become a million files."
        ),
    ] = None,
    backend: Annotated[
        str,
        typer.Option(
            help="local: processes of this machine make the runs. dask: the workers of the Dask "
            "scheduler that --scheduler names make them."
        ),
    ] = "local",
    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler, such as tcp://10.0.0.1:8786."),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            help="Simulate all runs at once on a graphics card, such as cuda or cuda:1, with "
            "MuJoCo Warp (pip install 'faultgen[gpu]'); the workers write the files. Single "
            "precision changes the last digits of the torques. Default: the workers simulate."
        ),
    ] = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Generate a labelled dataset. If it was interrupted, run the same command again to resume.

    The dataset has one run for every combination of robot, task, speed, payload, temperature,
    effect, axis and severity, and one healthy run for every combination of the first five.
    Defaults: the effect is friction_wear, it acts on every axis that it can act on, the final
    severity is 0.2 (effects with a unit have a default of their own, see 'faultgen effects'), the
    schedule is exponential, and a run has 100 cycles without noise.

    \b
    faultgen generate --robot irb6700 --task spot_weld --axis 3 --cycles 50 -o out
    faultgen generate experiment.toml -o out
    """  # noqa: D301
    if backend not in ("local", "dask"):
        raise InputError(f"--backend: must be local or dask, not '{backend}'")
    if (backend == "dask") != (scheduler is not None):
        raise InputError("--backend dask and --scheduler belong together: give both or neither")
    flags: dict[str, Any] = {
        "robot": names(robot) or None,
        "task": names(task) or None,
        "axis": axes_of(axis),
        "effect": names(effect) or None,
        "severity": severities_of(severity),
        "schedule": schedule,
        "cycles": cycles,
        "sensors": sensors,
        "speed": numbers_of("speed", speed),
        "payload": numbers_of("payload", payload),
        "temperature": numbers_of("temperature", temperature),
        "randomize": spreads_of(randomize),
        "seed": seed,
        "repetitions": repetitions,
        "paired": paired,
        "healthy": healthy,
        "fidelity": fidelity,
        "signals": signals if signals in ("all", "none") else names(signals) or None,
    }
    given = {name: value for name, value in flags.items() if value is not None}
    if task_from is not None:
        if experiment is not None or task is not None or robot is None or "," in robot:
            raise InputError("--task-from needs one --robot, and neither --task nor a file")
        given = {**TRAINING, **given}
        if dry_run:
            from faultgen.dataset.experiment import make_experiment

            with tempfile.TemporaryDirectory() as place:
                given["task"] = task_of(task_from, robot, Path(place))
                _dry_run(make_experiment(given), worker_count(workers), as_json)
            return
        given["task"] = task_of(task_from, robot, out)
    if experiment is not None and given:
        raise InputError(
            f"give an experiment file or flags, not both: --{next(iter(given))} was given as well"
        )
    readable_text(experiment, "experiment file")
    if experiment is None:
        for name in ("robot", "task"):
            if name not in given:
                raise InputError(
                    f"give an experiment file, or --robot and --task: --{name} is missing"
                )
        for name in given["robot"]:
            existing_robot(name)
    from faultgen.dataset.experiment import load_experiment, make_experiment

    chosen = make_experiment(given) if experiment is None else load_experiment(experiment)
    if dry_run:
        _dry_run(
            chosen, worker_count(workers), as_json, part_of(part) if keep == "merged" else None
        )
        return
    from faultgen.dataset.sweep import generate as run_generate

    summary = run_generate(
        chosen,
        out,
        workers=worker_count(workers),
        regenerate=regenerate,
        keep=keep,
        part=part_of(part),
        scheduler=scheduler,
        device=device,
    )
    _print_summary(summary, as_json)


def _print_summary(summary: Summary, as_json: bool) -> None:
    """Print what was made; exit with status 1 if a run failed."""
    if as_json:
        print_json(asdict(summary))
    else:
        say(
            f"{summary.folder}: {summary.planned} runs, {summary.done} made now, "
            f"{summary.kept} already present, {len(summary.failed)} failed"
        )
        for run_id, reason in summary.failed.items():
            say(f"failed: {run_id}: {reason}")
    if summary.failed:
        raise typer.Exit(1)


@app.command()
def merge(
    folder: Folder,
    keep: Annotated[str, typer.Option(help="all or merged, as in 'faultgen generate'.")] = "all",
    as_json: Json = False,
) -> None:
    """Merge a dataset whose parts were made by 'faultgen generate --part'.

    Every part must be complete. The command writes dataset.h5, the table of runs and the data card,
    as 'faultgen generate' does when it makes all parts itself. Parts with a dataset.h5 of their own
    (--keep merged) stay as they are, and index.h5 becomes the table of all runs; parts that have
    not changed since the last call are not read again.
    """
    existing_dataset(folder)
    from faultgen.dataset.sweep import merge_parts

    _print_summary(merge_parts(folder, keep=keep), as_json)


@app.command()
def demo(out: Out = Path("demo-out"), workers: Workers = None, as_json: Json = False) -> None:
    """Show the main use from end to end on a small dataset.

    The demonstration generates a dataset, names the worn axis of each run with every isolator, and
    writes a report. It takes about one minute of processor time on a 2-core AMD EPYC server. It is
    faster where both cores are free, and can take several minutes on a busy machine.
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
            "signals": [
                "signals/motor_velocity",
                "signals/motor_torque",
                "truth/friction_torque",
                "truth/joint_position",
            ],
        }
    )
    summary = run_generate(chosen, out, workers=worker_count(workers))
    if summary.failed:
        raise SimulationFailed("; ".join(summary.failed.values()))
    result = run_isolate(open_dataset(out), seeds=5)
    save(result, out)
    path = write_report(out, result)
    if as_json:
        print_json({**asdict(summary), "isolation": to_dict(result), "report": str(path)})
        return
    say(*table(result).split("\n"), "", f"dataset: {out / 'dataset.h5'}", f"report:  {path}")


def _dry_run(
    experiment: Experiment, workers: int, as_json: bool, part: tuple[int, int] | None = None
) -> None:
    """Print what a dataset would take, or one part of it that is a dataset of its own."""
    from faultgen.dataset import parts
    from faultgen.dataset.estimate import estimate

    also = ""
    if part is not None:
        experiment = parts.part_of(experiment, part)
        also = f" (part {part[0]} of {part[1]}; the others take about as much)"
    show_estimate(estimate(experiment, workers=workers), workers, as_json, also)
