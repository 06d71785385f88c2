"""Commands for robots of one's own: build one from a plain model, check it, and export it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import Json, app, out_option, print_json, print_table
from faultgen.cli.checks import existing_robot
from faultgen.errors import InputError
from faultgen.system.terminal import note, say

robot = typer.Typer(
    help="Bring your own robot: build a complete robot from a plain MJCF or URDF model of any arm, "
    "check it, and export it for other programs.",
    epilog="From a plain model to a labelled dataset: faultgen robot build arm.urdf -o my_arm; "
    "faultgen robot check my_arm; faultgen generate --robot my_arm --task pick_and_place -o data",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(robot, name="robot")


Files = Annotated[
    list[Path] | None,
    typer.Option(
        "--files",
        "--package-path",
        help="Folder whose files the model may use, beside those in its own folder and in its "
        "package (a folder above it with a package.xml). For meshes of other packages, "
        "package://NAME/..., give the folder that holds the folder NAME. May be given several "
        "times.",
    ),
]


@robot.command()
def build(
    model: Annotated[
        Path,
        typer.Argument(
            help="MJCF or URDF file of the arm: one chain of hinge or slide joints with any names."
        ),
    ],
    drives: Annotated[
        Path | None,
        typer.Argument(
            help="drives.toml: what you know about gears, motors, friction and servos. Every entry "
            "is optional; what is missing is assumed."
        ),
    ] = None,
    out: Annotated[Path, out_option("Folder of the robot. Its name is the robot's name.")] = Path(
        "my_robot"
    ),
    like: Annotated[
        str | None,
        typer.Option(
            help="A known arm (a part of its name is enough, such as ur10e), or a payload such as "
            "'5 kg', whose drives this arm resembles. Its numbers replace assumed ones, not those "
            "of drives.toml and of the model. docs/robots.md lists the arms."
        ),
    ] = None,
    files: Files = None,
    as_json: Json = False,
) -> None:
    """Build a complete robot from a plain model of an arm.

    The arm gets rotors, gearboxes, servo drives and friction, a payload and a tool, limits of speed
    and acceleration, and the tasks pick_and_place, spot_weld and arc_weld. The folder can be given
    to every command as --robot. Actuators, sensors, free joints and loose objects of the model are
    dropped, and the command says so.

    The folder also gets a drives.toml with every number that was used. Numbers that were assumed
    stand behind a #, with the reason. To state one, remove the #, change the number, and build
    again with this file. docs/robots.md lists the defaults.

    \b
    faultgen robot build arm.urdf -o my_arm
    faultgen robot build arm.urdf my_arm/drives.toml -o my_arm
    faultgen robot build arm.urdf --like "5 kg" -o my_arm
    """  # noqa: D301
    if not model.exists():
        raise InputError(f"robot file {model}: does not exist")
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a folder")
    from faultgen.building.build import DRIVES
    from faultgen.building.build import build as run_build
    from faultgen.building.drives import Drives, read_drives
    from faultgen.building.quantities import QUANTITIES

    stated = out / DRIVES
    if out.is_dir() and any(out.iterdir()) and not stated.is_file():
        raise InputError(
            f"{out}: is not empty, and holds no {DRIVES} of a robot; give a new folder"
        )
    known = Drives() if drives is None else read_drives(drives)
    built = run_build(model, known, out.resolve().name, files or (), like)
    if drives is None and stated.is_file() and stated.read_bytes() != built.drives.encode():
        raise InputError(
            f"{stated}: holds other numbers, which would be lost; give it as the second argument, "
            "or another folder"
        )
    built.write(out)
    numbers = [value.source for one in built.values for value in one.values()]
    counts = {source: numbers.count(source) for source in ("given", "model", "like", "assumed")}
    axes = [
        {"axis": k + 1, "joint": joint, **{name: one.value for name, one in values.items()}}
        for k, (joint, values) in enumerate(zip(built.plain.joints, built.values, strict=True))
    ]
    result: dict[str, Any] = {
        "robot": str(out),
        "axes": axes,
        "numbers": counts,
        "tasks": list(built.robot.tasks),
        "timestep": float(built.robot.model.opt.timestep),
        "notes": list(built.notes),
        "warnings": list(built.warnings),
    }
    _warn(built.warnings)
    if as_json:
        print_json(result)
        return
    units = {quantity.name: quantity.unit for quantity in QUANTITIES}
    shown = ("gear_ratio", "torque_limit", "speed_limit", "gear_stiffness")
    print_table(
        [
            {
                "axis": one["axis"],
                "joint": one["joint"],
                **{f"{key} [{units[key]}]": f"{one[key]:g}" for key in shown},
            }
            for one in axes
        ]
    )
    for remark in built.notes:
        say(f"note: {remark}")
    taken = f"{counts['like']} like {like}, " if like else ""
    say(
        f"{out}: {len(axes)} axes; {counts['given']} numbers given, {counts['model']} from the "
        f"model, {taken}{counts['assumed']} assumed (see {out / DRIVES}); "
        f"tasks: {', '.join(built.robot.tasks) or 'none'}"
    )


@robot.command()
def check(
    name: Annotated[
        str,
        typer.Argument(help="Name of a robot, a robot folder, or an MJCF or URDF file."),
    ],
    files: Files = None,
    as_json: Json = False,
) -> None:
    """Check a robot or a plain model, and report all findings at once, each with its remedy.

    Checked are names, units, masses and inertias, the resonances of each axis at the zero pose, the
    largest stable time step, the stiffness of the friction's bristles, whether the axes can hold
    the arm, whether the tasks are within reach, and one second of simulation. Of a plain model, the
    command says what 'faultgen robot build' would add.

    The exit status is 0 if the robot is fit, and 1 if something was found.
    """
    existing_robot(name)
    from faultgen.building.check import check as run_check

    checked = run_check(name, files or ())
    _warn(checked.warnings)
    if as_json:
        print_json({"fit": checked.fit, **asdict(checked)})
    else:
        if checked.axes:
            rows = [
                {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in one.items()}
                for one in checked.axes
            ]
            print_table(rows)
        for kind, values in checked.modes.items():
            listed = " ".join(f"{value:.1f}" for value in values)
            say(f"resonances at the zero pose, rotors {kind} [Hz]: {listed}")
        if checked.timestep is not None:
            say(
                f"time step {checked.timestep:g} s; the largest stable one is "
                f"{checked.largest_timestep:.3g} s"
            )
        for task, period in checked.tasks.items():
            say(f"task {task}: a cycle takes {period:.2f} s")
        for what, value in checked.trial.items():
            say(f"one second of simulation: {what} {value:.3g}")
        for finding in checked.findings:
            say(f"finding: {finding}")
        result = "fit" if checked.fit else f"findings: {len(checked.findings)}"
        more = f"; warnings: {len(checked.warnings)}" if checked.warnings else ""
        say(f"{checked.robot}: {result}{more}")
    if not checked.fit:
        raise typer.Exit(1)


@robot.command("export")
def export_command(
    name: Annotated[
        str, typer.Argument(help="Name of a robot, a robot folder, or the path of its MJCF file.")
    ],
    out: Annotated[Path, out_option("Folder for the files.")] = Path("exported_robot"),
    payload: Annotated[
        bool, typer.Option(help="Whether the files contain the payload on the flange.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Write a robot for other programs: plain MJCF, URDF, tables of its joints, Isaac.

    The MJCF file has the plain arm without rotors and gearboxes: each joint has the armature, the
    friction and the limits of its drive, and a position actuator with its gains. The URDF has
    friction, limits and inertias. If 'faultgen robot build' made the robot from your file, your
    own file is edited: only numbers that differ are changed. After 'faultgen calibrate' or
    'faultgen discover', the numbers are the calibrated ones.

    joints.csv and joints.json have all numbers of each axis at the joint, in SI units. isaac.json
    has them with the names and units of Isaac Lab and of USD. The command says what the files
    cannot express, and compares masses and torques of each file with the robot.

    \b
    faultgen robot export my_arm -o my_arm_exported
    faultgen robot export calibrated/model -o calibrated_arm
    """  # noqa: D301
    existing_robot(name)
    from faultgen.robot import load_robot
    from faultgen.robot_formats.joints import UNITS
    from faultgen.robot_formats.write import check_folder, export_robot

    check_folder(out)
    exported = export_robot(load_robot(name), payload=payload)
    exported.write(out)
    files = sorted(exported.files)
    if as_json:
        print_json(
            {
                "folder": str(out),
                "files": files,
                "joints": [asdict(row) for row in exported.rows],
                "agreement": dict(exported.agreement),
                "notes": list(exported.notes),
            }
        )
        return
    units = {key: unit[0] for key, unit in UNITS.items()}
    shown = ("armature", "frictionloss", "damping", "kp", "kd", "effort_limit")
    print_table(
        [
            {
                "joint": row.joint,
                **{f"{key} [{units[key]}]": f"{getattr(row, key):.4g}" for key in shown},
            }
            for row in exported.rows
        ]
    )
    for remark in exported.notes:
        say(f"note: {remark}")
    for file, off in exported.agreement.items():
        say(
            f"{file}: joint torques in random motions are those of the robot within {off:.1g} of "
            "the largest"
        )
    say(f"{out}: {', '.join(files)}")


def _warn(warnings: Sequence[str]) -> None:
    """Write warnings to stderr, so that they also appear beside JSON."""
    for warning in warnings:
        note(f"warning: {warning}")
