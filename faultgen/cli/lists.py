"""Commands that list what there is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from faultgen.cli.app import Json, app, names, out_option, print_json, print_table
from faultgen.errors import InputError
from faultgen.system.terminal import say


@app.command()
def robots(as_json: Json = False) -> None:
    """List the robots with the limits of each axis."""
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
    print_json(rows) if as_json else print_table(rows)


@app.command()
def tasks(
    robot: Annotated[
        str | None,
        typer.Option(
            help="Name of a robot, or the path of an MJCF file or robot folder. For several, "
            "write a,b. Default: the robots that come with faultgen."
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(
            help="Name of a task or path of a task file, such as motion_1.toml of 'discover "
            "--plan'. For several, write a,b. Default: all tasks of the robot."
        ),
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="<path>",
            help="Folder to which the planned motions are written for a controller.",
        ),
    ] = None,
    motion_format: Annotated[
        str,
        typer.Option(
            help="With --write: csv (position, velocity and acceleration of the joints), ros2 "
            "(JSON of a trajectory_msgs/JointTrajectory) or urscript (movej and servoj)."
        ),
    ] = "csv",
    sample_period: Annotated[
        float, typer.Option(help="With --write: time between the samples [s].")
    ] = 0.008,
    as_json: Json = False,
) -> None:
    """List the tasks of each robot with their cycle times, or write their motions.

    \b
    faultgen tasks --robot my_arm
    faultgen tasks --robot my_arm --task spot_weld --write motions --motion-format ros2

    The window share is the share of time in which a motor turns at 50 to 120 rad/s. If it is
    above zero, only samples from this time count in the mean torque that monitoring stores. For an
    axis that never turns so fast, generate uses a window of 0.5 to 1.2 times its top speed.
    """  # noqa: D301
    if write is not None and write.is_file():
        raise InputError(f"--write {write}: is a file; give a folder")
    from faultgen.planned_cycles import plan_cycle, planned_cycle
    from faultgen.robot_names import robot_names
    from faultgen.tasks import load_task, task_names

    rows: list[dict[str, Any]] = []
    written: dict[Path, str] = {}
    for name in names(robot) or robot_names():
        own, of_folder = name, dict[str, str]()
        if name not in robot_names():
            from faultgen.robot import load_robot

            machine = load_robot(name)
            own, of_folder = machine.name, dict(machine.tasks)
        known = task_names(own, of_folder)
        for task_name in names(task) or known:
            loaded = load_task(own, task_name, of_folder)
            cycle = planned_cycle(name, task_name) if task_name in known else None
            cycle = cycle or plan_cycle(name, task_name)
            rows.append(
                {
                    "robot": own,
                    "task": loaded.name,
                    "cycle [s]": cycle.period,
                    "window share of each axis [%]": " ".join(map(str, cycle.window_share)),
                    "description": loaded.description,
                }
            )
            if write is not None:
                ending, text = _motion(name, task_name, motion_format, sample_period)
                file = write / f"{own}_{Path(task_name).stem}{ending}"
                written[file] = text
                rows[-1]["file"] = str(file)
    if written:
        from faultgen.system.files import write_text

        for file, text in written.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, text)
    print_json(rows) if as_json else print_table(rows)


def _motion(robot: str, task: str, form: str, sample_period: float) -> tuple[str, str]:
    """Ending and text of the file with the planned motion of a task."""
    from faultgen.robot import load_robot
    from faultgen.robot_formats.motions import FORMATS, motion_text
    from faultgen.simulation.motion import plan
    from faultgen.tasks import load_task

    machine = load_robot(robot)
    motion = plan(load_task(machine.name, task, machine.tasks), machine)
    text = motion_text(motion, form, sample_period)
    return FORMATS[form], text


@app.command()
def effects(
    gallery: Annotated[
        bool,
        typer.Option(
            "--gallery", help="Write effects.html, a page with a picture of every effect, instead."
        ),
    ] = False,
    out: Annotated[Path, out_option("Folder for the page of --gallery.")] = Path("."),
    as_json: Json = False,
) -> None:
    """List the effects with their units, ranges and parameters.

    With --gallery, the command writes a page with a small picture and a sentence for each effect.
    The page needs no network and no other file.
    """
    if gallery:
        from faultgen.report.gallery import gallery_page
        from faultgen.system.files import write_text

        out.mkdir(parents=True, exist_ok=True)
        path = out / "effects.html"
        write_text(path, gallery_page())
        print_json({"gallery": str(path)}) if as_json else say(path)
        return
    from faultgen.effects import EFFECTS

    rows: list[dict[str, Any]] = [
        {
            "effect": effect.name,
            "severity": effect.unit,
            "units": effect.units,
            "default": effect.default,
            "smallest": effect.smallest,
            "largest": effect.largest,
            "parameters": dict(effect.parameters),
            "description": effect.description,
            "signature": effect.signature,
            "element": effect.element,
            "source": effect.source,
        }
        for effect in EFFECTS.values()
    ]
    if as_json:
        print_json(rows)
        return
    for row in rows:
        say(row.pop("effect"))
        row["range"] = f"{row.pop('smallest'):g} to {row.pop('largest'):g}"
        given = row.pop("parameters")
        if given:
            shown = {name: "of the gearbox" if v is None else v for name, v in given.items()}
            row["parameters"] = ", ".join(f"{name} = {value}" for name, value in shown.items())
        for name, value in row.items():
            say(f"  {name + ':':13} {value}")
