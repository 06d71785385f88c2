"""The command line. Results go to stdout, progress and messages to stderr.

Exit status: 0 done, 1 failed while running, 2 bad input (one line), 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.errors import InputError, SimulationFailed

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
Folder = Annotated[Path, typer.Argument(help="Folder of a dataset, as generate writes it.")]


_INTERRUPTED = 130


def main() -> None:
    """Run the command line and exit with its status."""
    try:
        status = app(standalone_mode=False)
        if status == _INTERRUPTED:  # the command-line library has caught Ctrl-C
            raise KeyboardInterrupt
    except InputError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt:
        _fail("stopped; run the same command again to go on", _INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except (SimulationFailed, OSError) as error:
        _fail(" ".join(str(error).split()), 1)
    except Exception as error:
        # usage errors of the command-line library
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()
        if message.startswith("Usage:"):  # no command given: the help page
            print(message)
            sys.exit(2)
        _fail(" ".join(message.split()), 2)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str, status: int) -> None:
    print(f"faultgen: {message}", file=sys.stderr)
    sys.exit(status)


def _print_json(value: Any) -> None:
    print(json.dumps(value, indent=1, default=lambda v: v.tolist()))


def _print_table(rows: list[dict[str, Any]]) -> None:
    """Columns for people; the last one is as long as it likes."""
    if not rows:
        return
    names = list(rows[0])
    cells = [names, *[[str(row[name]) for name in names] for row in rows]]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    for line in cells:
        print("  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip())


@app.command()
def robots(as_json: Json = False) -> None:
    """List the robots, with their limits by axis."""
    from faultgen.robot import load_robot, robot_names

    rows = []
    for name in robot_names():
        robot = load_robot(name)
        rows += [
            {
                "robot": name,
                "axis": axis + 1,
                "gear_ratio": round(float(robot.gear_ratio[axis]), 4),
                "range [deg]": "{:.0f} to {:.0f}".format(*robot.joint_range[axis] * 57.29578),
                "motor_speed [rad/s]": float(robot.motor_velocity_limit[axis]),
                "motor_torque [N m]": float(robot.motor_torque_limit[axis]),
            }
            for axis in range(robot.n_axes)
        ]
    _print_json(rows) if as_json else _print_table(rows)


@app.command()
def tasks(as_json: Json = False) -> None:
    """List the tasks of each robot, with cycle time and time in the speed window."""
    from faultgen.motion import plan
    from faultgen.robot import load_robot, robot_names
    from faultgen.tasks import load_task, task_names

    rows = []
    for name in robot_names():
        robot = load_robot(name)
        for task_name in task_names(name):
            task = load_task(name, task_name)
            motion = plan(task, robot)
            share = " ".join(f"{100 * value:.0f}" for value in motion.window_share)
            rows.append(
                {
                    "robot": name,
                    "task": task_name,
                    "cycle [s]": round(motion.period, 2),
                    "window share [%], axis 1 to 6": share,
                    "description": task.description,
                }
            )
    _print_json(rows) if as_json else _print_table(rows)


@app.command()
def effects(as_json: Json = False) -> None:
    """List the effects: what each does, its unit, its signature, what carries it in MuJoCo."""
    from faultgen.effects import EFFECTS

    rows = [
        {
            "effect": effect.name,
            "severity": effect.unit,
            "description": effect.description,
            "signature": effect.signature,
            "element": effect.element,
            "source": effect.source,
        }
        for effect in EFFECTS.values()
    ]
    if as_json:
        _print_json(rows)
        return
    for row in rows:
        print(row.pop("effect"))
        for name, value in row.items():
            print(f"  {name + ':':13} {value}")


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
        str | None, typer.Option(help="Axes that wear, one run each: 1,2,3; at once: 2+3.")
    ] = None,
    effect: Annotated[str | None, typer.Option(help="Effect; several: a,b. See: effects.")] = None,
    severity: Annotated[
        str | None, typer.Option(help="Final severity, 0.1 = 10 %; several: 0.1,0.2.")
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
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Generate a labelled dataset; run the same command again to resume.

    Every combination of robot, task, effect, axis and severity is a run, and the healthy robot is
    one more. Without flags of their own, axes are 1 to 6, the effect is friction_wear, the severity
    0.2, the schedule exponential, 100 cycles, no noise.

    \b
    faultgen generate --robot irb6700 --task spot_weld --axis 3 --cycles 50 -o out
    faultgen generate experiment.toml -o out
    """  # noqa: D301
    from faultgen.experiment import load_experiment, make_experiment
    from faultgen.sweep import generate as run_generate

    flags: dict[str, Any] = {
        "robot": _split(robot),
        "task": _split(task),
        "axis": _axes(axis),
        "effect": _split(effect),
        "severity": _numbers(severity),
        "schedule": schedule,
        "cycles": cycles,
        "sensors": sensors,
        "seed": seed,
        "repetitions": repetitions,
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
    summary = run_generate(chosen, out, workers=_workers(workers))
    if as_json:
        _print_json(asdict(summary))
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
    from faultgen.dataset import open_dataset

    dataset = open_dataset(folder)
    damaged = dataset.damaged()
    broken = {Path(name).stem for name in damaged}
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
    whole = not damaged and not dataset.missing and merged.is_file()
    result = {
        "folder": str(folder),
        "complete": not dataset.missing and merged.is_file(),
        "intact": not damaged,
        "runs": rows,
        "missing": dataset.missing,
        "failed": dataset.failed,
        "damaged": damaged,
    }
    if as_json:
        _print_json(result)
    else:
        _print_table(rows)
        print(f"{len(rows)} runs planned, {len(dataset.missing)} missing, {len(damaged)} damaged")
        for run_id, reason in dataset.failed.items():
            print(f"failed: {run_id}: {reason}")
        for name, reason in damaged.items():
            print(f"damaged: {name}: {reason}")
        if not merged.is_file():
            print("dataset.h5 is missing")
        print("complete and intact" if whole else "not whole: run the generate command again")
    if not whole:
        raise typer.Exit(1)


@app.command()
def isolate(
    folder: Folder,
    sensors: Annotated[
        str | None,
        typer.Option(help="Noise to draw anew; default: thesis, or the noise the data has."),
    ] = None,
    seeds: Annotated[int, typer.Option(help="Draws of the noise for each run.")] = 20,
    as_json: Json = False,
) -> None:
    """Name the worn axis of every run by each isolator, in the form of thesis table 6.2.

    Ours learn from healthy cycles: of the dataset's healthy run with other noise, or, where the
    noise is stored, of healthy runs of other seeds (generate with repetitions). Shares of right
    answers have 95 % Wilson intervals; rows 'healthy' tell how often an axis is named though none
    is worn. The result is also written to isolation.json in the folder.
    """
    from faultgen.dataset import open_dataset
    from faultgen.studies.isolation import isolate as run_isolate
    from faultgen.studies.tally import save, table, to_dict

    result = run_isolate(open_dataset(folder), sensors=sensors, seeds=seeds)
    save(result, folder)
    _print_json(to_dict(result)) if as_json else print(table(result))


@app.command()
def detect(
    folder: Folder,
    sensors: Annotated[
        str | None,
        typer.Option(help="Noise to draw anew; default: thesis, or the noise the data has."),
    ] = None,
    seeds: Annotated[int, typer.Option(help="Draws of the noise for each run.")] = 20,
    as_json: Json = False,
) -> None:
    """Tell by every detector whether anything is worn, by task and wear.

    Detectors learn from healthy cycles: of the dataset's healthy run with other noise, or, where
    the noise is stored, of healthy runs of other seeds (generate with repetitions). Shares have
    95 % Wilson intervals. The result is also written to detection.json in the folder.
    """
    from faultgen.dataset import open_dataset
    from faultgen.studies.detection import detect as run_detect
    from faultgen.studies.detection import detection_table, save_detection

    result = run_detect(open_dataset(folder), sensors=sensors, seeds=seeds)
    save_detection(result, folder)
    _print_json(vars(result)) if as_json else print(detection_table(result))


@app.command()
def study(
    name: Annotated[str, typer.Argument(help="detection or isolation.")],
    out: Out = Path("study-out"),
    quick: Annotated[bool, typer.Option(help="Fewer seeds, for a first look.")] = False,
    seed: Annotated[int, typer.Option(help="Root of all draws; docs/ reports the default.")] = 2026,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Run a whole study: simulate, judge every method, write tables and figures.

    The folder gets results.json, tables.md and figures/. Simulated cycles stay there, and are used
    again by the next call.
    """
    from faultgen.studies.study import run_study

    result = run_study(name, out, quick=quick, seed=seed, workers=_workers(workers))
    if as_json:
        _print_json(result)
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
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Name the effect that a measured robot has and its healthy twin lacks.

    The folder gets discovery.json, model.xml (the robot with the effects in it) and report.html.
    A first version: it needs --healthy, and its answers were tried on simulated recordings only.
    """
    from faultgen.discovery import discover as run_discover

    result = run_discover(measured, robot, healthy, validate, out=out, workers=_workers(workers))
    for warning in result["warnings"]:
        print(f"faultgen: {warning}", file=sys.stderr)
    if as_json:
        _print_json(result)
        return
    print(result["verdict"])
    for one in result["effects"]:
        low, high = one["interval"]["severity"]
        print(
            f"{one['effect']} on axis {one['axis']}: {one['parameters']['severity']:.4g} "
            f"[{low:.4g}, {high:.4g}], {one['parameters']['unit']}; "
            f"confidence {one['confidence']:.2f}"
        )
    if result["unexplained"]:
        print(result["unexplained"])
    gap = result["gap"]
    print(f"gap {gap['before']:.4f}, after {gap['after']:.4f}, floor {gap['floor']:.4f}")


@app.command()
def report(folder: Folder, as_json: Json = False) -> None:
    """Write report.html, self-contained: figures of a dataset and what isolators answer."""
    from faultgen.report import write_report

    path = write_report(folder)
    _print_json({"report": str(path)}) if as_json else print(path)


@app.command()
def demo(out: Out = Path("demo-out"), workers: Workers = None, as_json: Json = False) -> None:
    """The main job in under a minute: wear sweep, dataset, isolators, report."""
    from faultgen.dataset import open_dataset
    from faultgen.experiment import make_experiment
    from faultgen.report import write_report
    from faultgen.studies.isolation import isolate as run_isolate
    from faultgen.studies.tally import save, table, to_dict
    from faultgen.sweep import generate as run_generate

    chosen = make_experiment(
        {
            "robot": "puma560",
            "task": "pick_and_place",
            "cycles": 30,
            "signals": ["signals/motor_velocity", "signals/motor_torque"],
        }
    )
    summary = run_generate(chosen, out, workers=_workers(workers))
    if summary.failed:
        raise SimulationFailed("; ".join(summary.failed.values()))
    result = run_isolate(open_dataset(out), progress=False)
    save(result, out)
    path = write_report(out, result)
    if as_json:
        _print_json({**asdict(summary), "isolation": to_dict(result), "report": str(path)})
        return
    print(table(result))
    print(f"\ndataset: {out / 'dataset.h5'}\nreport:  {path}")


def _workers(given: int | None) -> int:
    return given if given is not None else len(os.sched_getaffinity(0))


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


def _numbers(text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"severity '{text}': give numbers such as 0.1,0.2") from None


if __name__ == "__main__":
    main()
