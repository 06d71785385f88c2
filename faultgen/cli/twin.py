"""Commands from healthy recordings of a robot to a detector for it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import (
    Folder,
    Json,
    Robot,
    TrustLog,
    Workers,
    app,
    dataset_to_judge,
    out_option,
    print_json,
    worker_count,
)
from faultgen.cli.checks import (
    existing_dataset,
    existing_detector,
    existing_robot,
    readable_recordings,
    readable_text,
)
from faultgen.errors import InputError
from faultgen.system.terminal import note, say


@app.command()
def twin(
    healthy: Annotated[
        list[Path],
        typer.Argument(
            help="Healthy recordings of the robot (HDF5 or CSV), all of the same program; see "
            "docs/measured.md. Three or more show how much the robot differs from run to run."
        ),
    ],
    robot: Robot,
    out: Annotated[Path, out_option("Folder for the twin, a robot's folder.")] = Path("my_robot"),
    discovery: Annotated[
        bool,
        typer.Option(
            "--discovery/--no-discovery",
            help="Whether to search for effects that the model lacks, and add them. In short "
            "recordings it named effects that were not there (docs/twin.md), and it takes most of "
            "the time.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the generated data in the report.")] = 0,
    trust_log: TrustLog = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Learn a simulated twin of a robot from recordings of its healthy days.

    The command calibrates the model, with --discovery adds effects that the model lacks, and learns
    the noise of the torque (level, colour, growth with speed and load) and the differences from run
    to run. What the model still lacks on the recorded motion is learned by place in the cycle.

    It writes a robot's folder, which every command accepts as --robot. Beside the model the folder
    has sensors.toml, which 'faultgen generate' uses for this robot by default, the recorded motion
    as the task 'recorded', twin.json with all numbers, and report.html. The report shows measured
    and generated data side by side, and how well a classifier can tell them apart.

    \b
    faultgen twin healthy1.h5 healthy2.h5 --robot arm.xml -o my_robot
    faultgen generate --robot my_robot --task-from healthy1.h5 --axis all \\
        --effect friction_wear,backlash --severity friction_wear=0.2,backlash=0.001 -o data
    faultgen train data -o detector
    faultgen judge detector new1.h5 new2.h5
    """  # noqa: D301
    existing_robot(robot)
    if seed >= 0:  # a wrong seed is told first
        readable_recordings(healthy)
    from faultgen.twin.make import make_twin

    result = make_twin(
        healthy,
        robot,
        out,
        with_discovery=discovery,
        workers=worker_count(workers),
        seed=seed,
        trust_log=trust_log,
        say=note,
    )
    if as_json:
        print_json(result)
        return
    errors = result["calibration"]["errors"]
    say(f"calibrated: relative torque error {errors['given']:.3f} -> {errors['calibrated']:.3f}")
    say(f"effects that the model lacked: {result['discovery']['verdict']}")
    for one in result["discovery"]["effects"]:
        say(f"  {one['effect']} on axis {one['axis']}: {one['severity']:.4g}")
    for axis, share in enumerate(result["noise"]["over_rms_torque"], start=1):
        left = result["remainder_over_rms_torque"][axis - 1]
        say(
            f"axis {axis}: noise {100 * share:.2f} % of the RMS torque; the model still lacks "
            f"{100 * left:.1f} % on this motion, which is added to generated data"
        )
    say(result["summary"])
    say(f"twin: {out}", f"report: {out / 'report.html'}")


@app.command()
def train(
    folder: Folder,
    out: Annotated[Path, out_option("Folder for the detector.")] = Path("detector"),
    false_alarms: Annotated[
        float,
        typer.Option(help="Rate of false alarms that the limit allows, per robot and month."),
    ] = 0.3,
    recordings_per_month: Annotated[
        float, typer.Option(help="Number of recordings that are judged of a robot in a month.")
    ] = 30.0,
    seed: Annotated[
        int, typer.Option(help="Seed of the random numbers from which the limit is found.")
    ] = 0,
    as_json: Json = False,
) -> None:
    """Train a detector on generated data of one robot, task and sensors.

    The detector names the faults that the dataset has, on the axes that it has, with their
    severity. Beside them it knows a payload that differs, friction of all axes at another
    temperature, and an unknown change of an axis. It learns from the healthy recordings of the twin
    how the robot differs from day to day; without a twin, from the healthy runs. The limit of its
    alarm is found by simulation of the healthy robot.

    It is a small folder of JSON and plain arrays. The command tells how many recordings it takes
    until a fault of some severity raises an alarm.

    \b
    faultgen train data -o detector
    faultgen judge detector new1.h5 new2.h5
    """  # noqa: D301
    existing_dataset(folder)
    from faultgen.dataset.manifest import refuse_data
    from faultgen.recordings.rates import slow
    from faultgen.twin.train import LONGEST
    from faultgen.twin.train import train as run_train

    if out.is_file():
        raise InputError(f"out: must be a folder, not the file {out}")
    refuse_data(out)
    detector = run_train(
        dataset_to_judge(folder),
        false_alarms=false_alarms,
        recordings_per_month=recordings_per_month,
        seed=seed,
    )
    detector.save(out)
    told: dict[str, Any] = {
        "detector": str(out),
        "robot": detector.robot,
        "task": detector.task,
        "faults": [
            {"effect": one.effect, "axes": list(one.axes), "largest": one.largest}
            for one in detector.faults
        ],
        "sample_period": detector.motion.sample_period,
        "limit": detector.posterior.limit_,
        "false_alarms_per_recording": detector.posterior.false_alarms,
        "made": dict(detector.made),
    }
    if as_json:
        print_json(told)
        return
    for row in detector.made["expected"]:
        say(_expected(row, LONGEST))
    period = detector.motion.sample_period
    what = slow(period)
    if what is not None:
        say(f"note: {what}")
    count = detector.made["measured"]
    source = f"{count} measured" if count else "generated"
    say(
        f"learned from {source} healthy recordings; {len(detector.faults)} faults; judges "
        f"recordings at {1 / period:.4g} Hz or faster; detector: {out}"
    )


def _expected(row: dict[str, Any], longest: int) -> str:
    """One line about the time to detection."""
    axes = "+".join(map(str, row["axes"]))
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    fault = f"{row['effect']} on axis {axes} of {row['severity']:.3g}{unit}"
    if row["recordings"] is None:
        return f"{fault}: no alarm within {longest} recordings in half of the robots"
    low, high = row["interval"]
    most = f"more than {longest}" if high is None else f"{high:.0f}"
    return (
        f"{fault}: alarm after {row['recordings']:.0f} recordings (in 80 % of robots "
        f"{low:.0f} to {most})"
    )


@app.command()
def judge(
    detector: Annotated[
        Path,
        typer.Argument(help="Folder of a detector that 'faultgen train' has written."),
    ],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(help="Recordings of the same program (HDF5 or CSV), oldest first."),
    ] = None,
    watch: Annotated[
        Path | None,
        typer.Option(help="Judge the recordings in this folder, and every new one, until Ctrl-C."),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(
            help="File of what was judged before. Default: state.sqlite in the detector's folder."
        ),
    ] = None,
    robot: Annotated[
        str, typer.Option(help="Name of the robot, in a --state of 'faultgen monitor'.")
    ] = "",
    program: Annotated[
        str, typer.Option(help="Name of its program, in a --state of 'faultgen monitor'.")
    ] = "",
    repaired: Annotated[
        str | None,
        typer.Option(
            help="Date of a repair, such as 2026-03-12: earlier recordings do not count any more."
        ),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option(
            help="Write an HTML page about the robot to this file: what was found, the severity "
            "over time with its forecast, and the torque over the healthy band."
        ),
    ] = None,
    settled: Annotated[
        float,
        typer.Option(
            help="With --watch: how many seconds a file must not change before it is judged. HDF5 "
            "files that faultgen has written do not wait, because their checksum shows when they "
            "are complete."
        ),
    ] = 6.0,
    as_json: Json = False,
) -> None:
    """Judge recordings of a robot: healthy, a named fault with its severity, or an unknown change.

    The recordings are judged as a sequence: each answer rests on all recordings since the robot was
    known to be healthy, and tells since when a fault is there. What was judged is remembered
    between calls; --repaired begins anew. A line is printed for each recording. The probability
    assumes that half of the robots are healthy, and that all kinds of faults are equally frequent.

    A recording's date is that of its attribute `date` (ISO 8601), or else that of its file.

    The program must be that of the healthy recordings. It is found by its positions, so that it
    does not matter when a recording begins, or how many cycles it has.

    With --watch, a file that cannot be judged is reported, and tried again when it changes; if a
    disk fails, it is tried again until the disk works. Several processes may use one --state.

    --page shows the robot as 'faultgen monitor' does; without recordings, as it was judged before.

    With --json, the answers are a JSON list, or one JSON object in each line with --watch.
    """
    existing_detector(detector)
    import json

    from faultgen.system.dates import date_of
    from faultgen.twin.judge import Judge, line
    from faultgen.twin.judge import watch as run_watch

    if watch is None and not recordings and repaired is None and page is None:
        raise InputError(
            "give recordings to judge, a folder with --watch, a date --repaired, or a --page"
        )
    if page is not None and page.is_dir():
        raise InputError(f"page: must be a file such as {page / 'page.html'}, not a folder")
    one = Judge(detector, state, robot, program)
    if repaired is not None:
        one.repaired(date_of(repaired, "repaired"))

    def write_page() -> None:
        if page is not None:
            from faultgen.system.files import write_text
            from faultgen.twin.monitor_page import judge_page

            write_text(page, judge_page(one))

    if as_json and watch is None:
        print_json([one.judge(path) for path in recordings or []])
        write_page()
        return

    def tell(answer: dict[str, Any]) -> None:
        try:
            say(json.dumps(answer) if as_json else line(answer), flush=True)
        except BrokenPipeError:
            raise
        except OSError as error:
            if watch is None:
                raise
            # what was not written stays in the buffer of stdout, and is written with the next line
            note(f"an answer cannot be written now ({error.strerror}); {one.state} holds it")

    for path in recordings or []:
        tell(one.judge(path))
    write_page()
    if watch is not None:
        run_watch(one, watch, tell, note, settled=settled, seen=write_page)


@app.command()
def monitor(
    config: Annotated[
        Path, typer.Argument(help="What is monitored (TOML): robots, and their programs.")
    ],
    out: Annotated[Path, out_option("Folder for the page and the memory.")] = Path("monitor"),
    once: Annotated[
        bool, typer.Option("--once", help="Judge the recordings that are there, and end.")
    ] = False,
    settled: Annotated[
        float,
        typer.Option(
            help="How many seconds a file must not change before it is judged, as for 'judge'."
        ),
    ] = 6.0,
    as_json: Json = False,
) -> None:
    """Judge the recordings of several robots and programs over time, and write a page about them.

    The configuration lists robots, and below each its programs, with the detector that 'faultgen
    train' made and the folder in which recordings appear. Paths are relative to its own folder:

    \b
    [[robot]]
    name = "welder 7"
    limits = {friction_wear = 0.3}   # optional: severity until which it may go on
    [[robot.program]]
    detector = "detectors/welder7"
    folder = "recordings/welder7"

    The page OUT/index.html shows robots and axes as a map, the newest alarms as sentences, and for
    each of them the severity over time, the forecast until its limit, and the torque of the newest
    recording over the healthy band. OUT/robots.json has the same as a table. Without --once, the
    command goes on until Ctrl-C. It can be stopped and started again at any time: what was judged
    is kept in OUT/monitor.sqlite. A repair is told by 'faultgen judge DETECTOR --repaired DATE
    --state OUT/monitor.sqlite --robot NAME --program NAME'.

    \b
    faultgen monitor monitor.toml --once -o monitor
    """  # noqa: D301
    readable_text(config, "monitor file")
    if out.is_file():
        raise InputError(f"out: must be a folder, not the file {out}")
    from faultgen.twin.judge import line
    from faultgen.twin.monitor import PAGE, Monitor, load_monitor
    from faultgen.twin.watching import check_settled, paused

    check_settled(settled)

    def tell(robot: str, program: str, answer: dict[str, Any]) -> None:
        if not as_json and answer["alarm"]:
            say(f"{robot}, {program}: {line(answer)}", flush=True)

    one = Monitor(
        load_monitor(config), out, tell=tell, complain=note, settled=0.0 if once else settled
    )
    one.look()
    one.write()
    while not once and paused():
        if one.look():
            one.write()
    robots = one.robots()
    if as_json:
        print_json([robot.table() for robot in robots])
        return
    alarms = [robot for robot in robots if robot.alarm]
    say(f"{len(robots)} robots, {len(alarms)} with an alarm; page: {out / PAGE}")
