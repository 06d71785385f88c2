"""Commands that judge: detectors, isolators, studies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import (
    Folder,
    Json,
    Methods,
    Out,
    Seeds,
    Sensors,
    Split,
    Workers,
    app,
    dataset_to_judge,
    names,
    print_json,
    show_estimate,
    worker_count,
)
from faultgen.cli.checks import existing_dataset, existing_study
from faultgen.cli.values import task_of
from faultgen.errors import InputError
from faultgen.system.terminal import say


@app.command()
def detect(
    folder: Folder,
    sensors: Sensors = None,
    seeds: Seeds = 20,
    method: Methods = None,
    split: Split = None,
    as_json: Json = False,
) -> None:
    """Measure how reliably each detector recognises wear.

    The table has a row for each task and severity. Detectors learn from healthy cycles. If the
    dataset was generated without noise, these are the cycles of its healthy run with other draws of
    the noise. If it was generated with noise, they are healthy runs with other seeds; generate such
    a dataset with --repetitions. The table gives shares with 95 % Wilson intervals. The result is
    also written to detection.json in the folder.
    """
    existing_dataset(folder)
    from faultgen.evaluation.detect import detect as run_detect
    from faultgen.evaluation.detect import detection_table, save_detection
    from faultgen.plugins import load

    dataset = dataset_to_judge(folder)
    methods: list[Any] = [load(name) for name in method or ()]
    result = run_detect(dataset, sensors=sensors, seeds=seeds, methods=methods, split=split)
    save_detection(result, dataset.path)
    print_json(vars(result)) if as_json else say(*detection_table(result).split("\n"))


@app.command()
def isolate(
    folder: Folder,
    sensors: Sensors = None,
    seeds: Seeds = 20,
    method: Methods = None,
    split: Split = None,
    as_json: Json = False,
) -> None:
    """Measure how often each isolator names the worn axis.

    The table has the form of table 6.2 of the thesis. Some isolators learn from healthy cycles. If
    the dataset was generated without noise, these are the cycles of its healthy run with other
    draws of the noise. If it was generated with noise, they are healthy runs with other seeds;
    generate such a dataset with --repetitions. The table gives the share of correct answers with 95
    % Wilson intervals. Its columns 'healthy' give the share of healthy runs in which an
    isolator wrongly names an axis. The result is also written to isolation.json in the folder.
    """
    existing_dataset(folder)
    from faultgen.evaluation.isolate import isolate as run_isolate
    from faultgen.evaluation.outcomes import save, table, to_dict
    from faultgen.plugins import load

    dataset = dataset_to_judge(folder)
    methods: list[Any] = [load(name) for name in method or ()]
    result = run_isolate(dataset, sensors=sensors, seeds=seeds, methods=methods, split=split)
    save(result, dataset.path)
    print_json(to_dict(result)) if as_json else say(*table(result).split("\n"))


@app.command()
def benchmark(
    out: Out = Path("benchmark-out"),
    quick: Annotated[
        bool, typer.Option(help="Use fewer axes, robots and runs, for a first look.")
    ] = False,
    method: Methods = None,
    workers: Workers = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Simulate only a few cycles, write nothing, and print the number of runs, and the "
            "estimated time and size of the data.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Compare all isolators and detectors on the standard data, and write a leader board.

    The command generates two kinds of data from fixed seeds: two robots in three tasks with
    friction wear, and robots that differ from each other, with several effects. Methods are tested
    on the test runs of fixed divisions. The leader board is written to benchmark.md, the counts to
    benchmark.json. Data that exist are used again, so that a further --method takes less time.
    """
    from faultgen.plugins import load

    methods: list[Any] = [load(name) for name in method or ()]
    from faultgen.evaluation.benchmark import estimate_benchmark, run_benchmark
    from faultgen.evaluation.leader_board import benchmark_board

    if dry_run:
        count = worker_count(workers)
        found = estimate_benchmark(quick=quick, workers=count)
        show_estimate(found, count, as_json, ", to which the methods add their time")
        return
    result = run_benchmark(out, quick=quick, methods=methods, workers=worker_count(workers))
    if as_json:
        print_json(result)
        return
    boards = [benchmark_board(result, kind).split("\n") for kind in ("isolation", "detection")]
    say(*boards[0], "", *boards[1], "")
    say("score: 100 for a perfect method, 0 for answers that do not depend on the data")
    say(out / "benchmark.md")


@app.command()
def study(
    name: Annotated[
        str,
        typer.Argument(
            help="Name of the study: events, detection, training-data, classifiers, isolation or "
            "detectability."
        ),
    ],
    out: Out = Path("study-out"),
    fleet: Annotated[
        Path | None,
        typer.Option(
            help="Folder of an existing fleet, for the studies events, classifiers and "
            "training-data. Default: the study makes a fleet."
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="Robots of the study, names or paths of MJCF files, separated by commas. "
            "Default: those of the thesis."
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(
            help="Tasks of the study, names or paths of task files, separated by commas. "
            "Default: those of the thesis."
        ),
    ] = None,
    sensors: Annotated[
        str | None,
        typer.Option(
            help="Preset of sensor noise, thesis or realistic, or the path of a sensors file, for "
            "the study detectability. Default: those in the folder of the robot, else realistic."
        ),
    ] = None,
    effect: Annotated[
        str | None,
        typer.Option(
            help="Effects that the study detectability maps, separated by commas. Default: all; "
            "with --quick, five of them."
        ),
    ] = None,
    task_from: Annotated[
        Path | None,
        typer.Option(
            help="Recording of the robot (HDF5 or CSV) whose motion is the task, for the study "
            "detectability with one --robot."
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option(help="Use fewer seeds or robots, for a first look at the results.")
    ] = False,
    method: Methods = None,
    seed: Annotated[
        int,
        typer.Option(
            help="Seed of all random numbers. The results in docs/ are those of the default seed."
        ),
    ] = 2026,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Run a study that compares all methods on simulated data.

    The study detectability maps the smallest severity of every effect that can be detected, on
    every axis and in every task. The other studies repeat chapters of the thesis. The studies
    detectability, detection and isolation simulate the cycles that they need. The studies events,
    training-data and classifiers examine a fleet; they make one if --fleet does not name one.

    The study writes results.json, tables.md and figures/ into the folder. Simulated cycles are
    kept there too, and the next call uses them again.
    """
    existing_study(name)
    if method:
        _join_study(name, method)
    tasks = names(task)
    if task_from is not None:
        if name != "detectability" or task is not None or robot is None or "," in robot:
            raise InputError(
                "--task-from needs the study detectability with one --robot, and no --task"
            )
        tasks = [task_of(task_from, robot, out)]
    from faultgen.studies.runner import run_study

    result = run_study(
        name,
        out,
        quick=quick,
        seed=seed,
        workers=worker_count(workers),
        fleet=fleet,
        robots=names(robot),
        tasks=tasks,
        sensors=sensors,
        effects=names(effect),
    )
    if as_json:
        print_json(result)
        return
    for goal in result["goals"]:
        say(f"{goal['name']}: {goal['measured']} (goal {goal['goal']}; thesis {goal['thesis']})")
    say("", f"tables:  {out / 'tables.md'}", f"figures: {out / 'figures'}")


def _join_study(name: str, methods: list[str]) -> None:
    """Let methods take part in a study; refuse those that it cannot compare."""
    from faultgen.evaluation.methods import Detector, Isolator
    from faultgen.plugins import load, use

    kinds: dict[str, type] = {
        "isolation": Isolator,
        "detection": Detector,
        "detectability": Detector,
    }
    if name not in kinds:
        raise InputError(
            f"--method: study '{name}' compares no methods of this kind; choose "
            f"{' or '.join(kinds)}"
        )
    for one in methods:
        loaded: Any = load(one)
        if not (isinstance(loaded, type) and issubclass(loaded, kinds[name])):
            raise InputError(
                f"method '{one}': must be a subclass of faultgen.evaluation.{kinds[name].__name__}"
            )
        if loaded.supervised:  # type: ignore[attr-defined]
            raise InputError(
                f"method '{one}': learns from labelled runs, which a study does not have; use "
                "'faultgen isolate' or 'faultgen detect' on a dataset"
            )
    use(methods)
