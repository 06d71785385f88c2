"""Commands that examine recordings: discovery and calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from faultgen.cli.app import (
    Json,
    Out,
    Robot,
    TrustLog,
    Workers,
    app,
    out_option,
    print_json,
    worker_count,
)
from faultgen.cli.checks import existing_robot, readable_recordings
from faultgen.errors import InputError
from faultgen.system.terminal import note, say

LowPass = Annotated[
    float | None,
    typer.Option(
        help="Cut-off frequency [Hz] of a low-pass filter for recordings without a reference "
        "position, in which the simulation follows the measured position. "
        "Default: no filter."
    ),
]


@app.command()
def discover(
    robot: Robot,
    measured: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Recordings of the robot (HDF5 or CSV); see docs/measured.md. Several are used "
            "together. None with --plan."
        ),
    ] = None,
    healthy: Annotated[
        list[Path] | None,
        typer.Option(
            help="Recording of the same motions from before the change. It makes small changes "
            "visible. Repeat the option for several runs: they show how much the unchanged robot "
            "differs from run to run. Several recordings of different motions need equally many "
            "healthy ones each, in any order."
        ),
    ] = None,
    validate: Annotated[
        Path | None,
        typer.Option(
            help="Recording of other motions of the same robot. It is used only to score the "
            "result, not to find it."
        ),
    ] = None,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            help="Analyse no recording; write the motions that are worth recording. Only --robot, "
            "--out, --cache, --include, --workers and --json can be given with it.",
        ),
    ] = False,
    out: Out = Path("discovery-out"),
    cache: Annotated[
        Path | None,
        typer.Option(
            help="Folder that keeps simulated sensitivities, so that later calls with recordings "
            "of the same program, and with the same healthy recording, are faster."
        ),
    ] = None,
    include: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of an effect that is considered only on request. Repeat the option for "
            "several effects."
        ),
    ] = None,
    prior_scale: Annotated[
        float | None,
        typer.Option(
            help="How uncertain the model's parameters are, as a multiple of the usual values. It "
            "counts only without --healthy. Default: it is learned from the recording."
        ),
    ] = None,
    white_noise: Annotated[
        bool,
        typer.Option(
            help="Give long-lasting errors full weight instead of treating part of them as "
            "drifting noise. Use it for recordings that were filtered."
        ),
    ] = False,
    low_pass: LowPass = None,
    trust_log: TrustLog = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Find the effect that a robot has and its model lacks.

    The command compares a recording of the robot with its simulation. With --healthy, the model
    is fitted to the recording from before the change, and the two recordings are subtracted, so
    that even small changes are visible. Without it, the model is calibrated on the measured
    recording itself, and an effect is reported only if it is larger than the errors of this model.

    The recording has position and torque of every axis, or motor current [A] instead of torque; its
    samples need not be evenly spaced.

    Signs, units and sides of the log are tested with an arm that can exist. What the recording
    shows to be wrong is corrected and told, an axis without a usable torque is left out, and all
    findings stand in discovery.json. --trust-log takes the recordings as they are.

    The verdict is one of: no missing effect, named, partly named, ambiguous, unknown effect, model
    not good enough. If it is ambiguous between effects, the command proposes the motion that would
    decide, next_experiment.toml. It also writes discovery.json, model (a robot folder with all that
    was found; model.xml is its MJCF part) and report.html.

    With --plan, the command needs no recording. It writes motions within the limits of the robot,
    motion_1.toml and so on, that separate the effects best, and plan.json with the expected share
    of right answers for each effect and axis. For comparison it has the same for the task
    pick_and_place or, if the robot does not have this task, for fast moves between poses.
    """
    existing_robot(robot)
    if plan:
        others = {
            "a recording": bool(measured),
            "--healthy": healthy is not None,
            "--validate": validate is not None,
            "--prior-scale": prior_scale is not None,
            "--white-noise": white_noise,
            "--low-pass": low_pass is not None,
            "--trust-log": trust_log,
        }
        _plan(robot, others, out, worker_count(workers), include or (), cache, as_json)
        return
    if not measured:
        raise InputError("give a recording of the robot, or --plan to learn what to record")
    for given in (measured, healthy, validate):
        readable_recordings(given)
    from faultgen.report.discover import discover as run_discover

    result = run_discover(
        measured,
        robot,
        healthy,
        validate,
        out=out,
        workers=worker_count(workers),
        include=include or (),
        prior_scale=prior_scale,
        white_noise=white_noise,
        low_pass=low_pass,
        trust_log=trust_log,
        cache=cache,
    )
    for warning in result["warnings"]:
        note(warning)
    if as_json:
        print_json(result)
        return
    say(result["summary"], f"verdict: {result['verdict']}")
    for one in result["effects"]:
        low, high = one["interval"]["severity"]
        say(
            f"{one['effect']} on axis {one['axis']}: {one['parameters']['severity']:.4g} "
            f"[{low:.4g}, {high:.4g}], {one['parameters']['unit']}; "
            f"confidence {one['confidence']:.2f}"
        )
        for other in one.get("also", ()):
            say(
                f"  {other['value']:.3g} {other['unit']} "
                f"({other['interval'][0]:.3g} to {other['interval'][1]:.3g})"
            )
        if "sentence" in one["parameters"]:
            say(f"  {one['parameters']['sentence']}: {one['parameters']['formula']}")
    for one in result["alternatives"]:
        say(
            f"also possible: {one['effect']} on axis {one['axis']}; "
            f"confidence {one['confidence']:.2f}"
        )
    for one in result["usual_differences"]:
        say(f"as a healthy robot may differ: {one['sentence']}")
    if result["next_experiment"]:
        say(f"to distinguish these effects, run the task {out / 'next_experiment.toml'}")
    if result["unexplained"]:
        say(result["unexplained"])
    say(result["following"])
    gap = result["gap"]
    say(
        f"gap {gap['before']:.4f}, calibrated {gap['calibrated']:.4f}, "
        f"after {gap['after']:.4f}, floor {gap['floor']:.4f}"
    )


def _plan(
    robot: str,
    others: dict[str, bool],
    out: Path,
    workers: int,
    include: Sequence[str],
    cache: Path | None,
    as_json: bool,
) -> None:
    """Carry out `discover --plan`; the other arguments must not have been given."""
    from faultgen.report.plan import plan_motions, table

    given = [name for name, is_given in others.items() if is_given]
    if given:
        raise InputError(f"--plan analyses no recording: leave out {', '.join(given)}")
    if out.is_file():
        raise InputError(f"out: must be a folder, not the file {out}")
    result = plan_motions(robot, out=out, workers=workers, include=include, cache=cache)
    if as_json:
        print_json(result)
        return
    for motion in result["motions"]:
        say(f"{out / motion['file']}: {motion['description']}, {motion['duration']:.1f} s")
    say(
        "",
        f"right answers without a healthy recording, in %: {result['reference']} for "
        f"{result['duration']:.0f} s -> these motions, which take as long",
        "",
        *table(result).split("\n"),
        "",
    )
    mean, alarms = result["mean_rate"], result["false_alarms"]
    say(
        f"mean {100 * mean['reference']:.0f} -> {100 * mean['plan']:.0f}; healthy robots in which "
        f"an effect is named: {100 * alarms['reference']:.0f} -> {100 * alarms['plan']:.0f}",
        f"smallest severity that is named, of {result['reference']} over that of these motions: "
        f"{result['smaller']:.2f} (geometric mean)",
        f"These are ideal rates: effects add up, the noise is {100 * result['noise']:.0f} % of the "
        "RMS torque, and robots differ from the model only as assumed (docs/discovery.md).",
    )


@app.command()
def calibrate(
    measured: Annotated[
        list[Path],
        typer.Argument(
            help="Recordings of the robot (HDF5 or CSV); see docs/measured.md. Several are used "
            "together."
        ),
    ],
    robot: Robot,
    out: Annotated[
        Path,
        out_option("Folder for the calibrated robot and its numbers."),
    ] = Path("calibrated"),
    known: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of a parameter that is known well and keeps its usual uncertainty, such as "
            "inertia. Repeat the option for several parameters."
        ),
    ] = None,
    low_pass: LowPass = None,
    trust_log: TrustLog = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Fit the parameters of a roughly known model to recordings.

    The parameters of friction, offsets, rotors, torque constants and links may differ more from
    the model than usual. How much more is chosen with parts of the recording that were not used
    for the fit. A recording can hardly separate the torque constants from the masses of the links,
    so name one of them with --known. The model may be without friction. The recording may have
    motor current [A] instead of torque; its samples need not be evenly spaced. Signs and units are
    tested and corrected as in discover, unless --trust-log is given.

    The command prints the relative RMS torque error on motions that were not fitted, beside that
    of classical identification. It writes a robot folder, which every command accepts as --robot,
    with calibration.json beside the model.
    """
    existing_robot(robot)
    readable_recordings(measured)
    from threadpoolctl import threadpool_limits

    from faultgen.discovery.calibration.calibrate import calibrate as run_calibrate
    from faultgen.discovery.calibration.limits import with_limits_of
    from faultgen.discovery.decision.posterior import FILE, KEY
    from faultgen.discovery.discover import dump
    from faultgen.discovery.inputs import read_together
    from faultgen.discovery.posterior_of import posterior_of
    from faultgen.robot import load_robot
    from faultgen.system.sums import write_listed

    if out.suffix == ".xml" or out.is_file():
        raise InputError(f"out: must be a folder, not {out}; the model is written to its model.xml")
    model = load_robot(robot)
    given = read_together(measured, model, low_pass=low_pass, trust_log=trust_log)
    recording = given.recording
    model, raised = with_limits_of([recording], model)
    for warning in [*given.warnings, *raised]:
        note(warning)
    with threadpool_limits(limits=1):
        found = run_calibrate(recording, model, known=known or (), workers=worker_count(workers))
        posterior = posterior_of(recording, found.robot)
    result = found.report()
    result[KEY] = posterior and posterior.contract()
    result["findings"] = [*given.findings, *result["findings"]]
    if recording.constants is not None:
        changed = recording.constants.constant * found.robot.torque_gain / model.torque_gain
        result["torque_constants"] = replace(recording.constants, constant=changed).contract()
    found.robot.write(out)
    write_listed(out, FILE, dump(result))
    for line in (*found.lacks, *found.findings):
        note(line)
    if as_json:
        print_json(result)
        return
    errors = {name: f"{100 * error:.1f} %" for name, error in found.errors.items()}
    say(
        f"torque error on motions that were not fitted: given model {errors['given']}, "
        f"classical identification {errors['classical']}, this model {errors['calibrated']}"
    )
    for by_axis in found.per_axis:
        shares = {
            label: "-" if by_axis[name] is None else f"{100 * by_axis[name]:.1f} %"
            for label, name in (
                ("given model", "given"),
                ("classical identification", "classical"),
                ("this model", "calibrated"),
            )
        }
        told = ", ".join(f"{label} {share}" for label, share in shares.items())
        say(f"  axis {by_axis['axis']}: {told}")
    say(f"assumed uncertainty of the parameters: {found.prior_scale:g} times the default")
    for one in found.couplings:
        say(f"axes {one.axis - 1} and {one.axis} are coupled: they share friction and inertia")
    for name, values in found.values.items():
        say(f"{name}: " + ", ".join(f"axis {k} {v:+.3g}" for k, v in values.items()))
