"""Checking a robot or a plain model: all findings at once, each with a remedy.

checked = check("my_arm")
checked.fit, checked.findings
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from faultgen.building.build import look, unused_limits
from faultgen.building.chain import moving_links, name_elements
from faultgen.building.doubts import drive_doubts, weight_warnings
from faultgen.building.elements import add_payload
from faultgen.building.findings import Finding, computable
from faultgen.building.inertias import inertia_findings
from faultgen.building.masses import unstated_warnings
from faultgen.building.plain import STATED_UNITS, Plain, plain_arm, survey
from faultgen.building.ranges import assumed_axes, range_warnings
from faultgen.building.resonance import (
    BRISTLE_RULE,
    bristle_step,
    largest_step,
    resonances,
    sampled_poses,
    zero_pose,
)
from faultgen.building.source import Source, read_source
from faultgen.building.told import kept_warnings
from faultgen.building.trial import trial
from faultgen.building.units import gravity_warnings, unit_findings
from faultgen.errors import InputError
from faultgen.mjcf.compiling import compiled, parsed
from faultgen.mjcf.elements import stated_name
from faultgen.robot import Robot, load_robot, robot_names
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task, task_names

_POSES, _STABLE_POSES = 128, 12  # at which weight and stability are looked at


@dataclass
class Checked:
    """What a check found."""

    robot: str
    """Name of the robot."""
    complete: bool = False
    """Whether the model is a complete robot; a plain model is not."""
    findings: list[Finding] = field(default_factory=list)
    """Everything that is wrong."""
    warnings: list[str] = field(default_factory=list)
    """What is assumed or unusual, so that the robot may not be what the user wants."""
    axes: list[dict[str, Any]] = field(default_factory=list)
    """Resonances and limits of each axis."""
    modes: dict[str, list[float]] = field(default_factory=dict)
    """Resonances of the whole robot at the zero pose [Hz], with rotors locked and free."""
    timestep: float | None = None
    """Time step of the model [s]."""
    largest_timestep: float | None = None
    """Largest stable time step [s]."""
    tasks: dict[str, float] = field(default_factory=dict)
    """Cycle time of each task that the robot can do [s]."""
    trial: dict[str, float] = field(default_factory=dict)
    """What one second of simulation showed."""

    @property
    def fit(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings


def check(name_or_path: str, folders: Sequence[Path] = ()) -> Checked:
    """Check a robot or a plain model.

    Args:
        name_or_path: Name of a robot, a robot folder, or an MJCF or URDF file.
        folders: Further folders, beside those of the model, whose files it may use.

    Returns:
        What was found. Nothing stops at the first finding.

    Raises:
        InputError: There is no such robot or file.
    """
    path = Path(name_or_path)
    if name_or_path in robot_names() or path.is_dir():
        return _check_loaded(name_or_path, path.name, folders)
    if not path.exists():
        load_robot(name_or_path)  # says what there is
    try:
        source = read_source(path, folders)
    except InputError as error:
        return Checked(path.stem, findings=[Finding("file", str(error), "correct it")])
    name_elements(source.spec)
    if _is_meant_complete(source.spec):
        return _check_loaded(name_or_path, path.stem, folders, source)
    return _check_plain(path, source, folders)


def _is_meant_complete(spec: mujoco.MjSpec) -> bool:
    """Whether a model has elements that only robots of faultgen have."""
    names = {joint.name for joint in spec.joints} | {tendon.name for tendon in spec.tendons}
    return bool(names & {"motor1", "gearbox1"})


def _check_loaded(
    given: str, name: str, folders: Sequence[Path], source: Source | None = None
) -> Checked:
    checked = Checked(name)
    try:
        robot = load_robot(given, folders)
    except InputError as error:
        text = str(error).removeprefix(f"robot {name}: ").removesuffix(" (see docs/robots.md)")
        remedy = "docs/robots.md says what a robot needs; 'faultgen robot build' adds it"
        checked.findings = [Finding("model", one, remedy) for one in text.split("; ")]
        if source is not None:
            moving = [j.parent.name for j in source.spec.joints if j.name.startswith("joint")]
            checked.findings += inertia_findings(source.spec, moving)
        return checked
    checked.complete, checked.robot = True, robot.name
    spec, _ = parsed(robot.xml, robot.assets, f"robot {robot.name}")
    name_elements(spec)
    axes = [f"joint{k + 1}" for k in range(robot.n_axes)]
    checked.findings += inertia_findings(spec, moving_links(spec, axes))
    has_payload = any(body.name == "payload" for body in spec.bodies)
    names = [robot.label("joint", k + 1) for k in range(robot.n_axes)]
    checked.findings += unit_findings(Arm(robot).model, names, has_payload)
    stated = [stated_name(robot.model, k + 1) or f"joint{k + 1}" for k in range(robot.n_axes)]
    assumed = assumed_axes(robot.model, robot.n_axes)
    checked.warnings += range_warnings(stated, assumed, robot.joint_range, robot.slides.tolist())
    checked.warnings += gravity_warnings(robot.model)
    checked.warnings += kept_warnings(robot.model)
    checked.warnings += unstated_warnings(spec, axes)
    if not any(site.name == "tool" for site in spec.sites):
        remedy = "add a site of this name to the last link"
        checked.findings.append(Finding("site 'tool'", "is missing", remedy))
        return checked
    try:
        with computable(robot.name):
            checked.findings += _drivetrain(robot, checked)
            checked.findings += _weight(robot)
            impossible, doubtful = drive_doubts(robot)
            checked.findings += impossible
            checked.warnings += doubtful
            checked.findings += _tasks(robot, checked)
            checked.findings += trial(robot, sorted(checked.tasks), checked.trial)
    except InputError as error:
        checked.findings.append(Finding("model", str(error), "correct the file"))
    return checked


def _drivetrain(robot: Robot, checked: Checked) -> list[Finding]:
    """Resonances, and the time step that they allow."""
    pose = zero_pose(robot)
    at_zero = resonances(robot, pose)
    checked.modes = {"locked": at_zero.locked.tolist(), "free": at_zero.free.tolist()}
    bristles = bristle_step(robot)
    for k in range(robot.n_axes):
        checked.axes.append(
            {
                "axis": k + 1,
                "joint": stated_name(robot.model, k + 1) or f"joint{k + 1}",
                "gear_ratio": float(robot.gear_ratio[k]),
                "resonance, rotor locked [Hz]": float(at_zero.axis[k]),
                "largest step of the bristles [s]": float(bristles[k]),
            }
        )
    step = checked.timestep = float(robot.model.opt.timestep)
    poses = sampled_poses(robot.joint_range, robot.slides, _STABLE_POSES)
    stable = min(largest_step(robot, one) for one in (pose, *poses))
    checked.largest_timestep = stable
    found = []
    if step > stable:
        found.append(
            Finding(
                "timestep",
                f"{step:g} s is above the largest stable one, {stable:.3g} s",
                f"make it at most {stable / 2:.2g} s, or the gearboxes softer",
            )
        )
    for k in np.flatnonzero(step > bristles * (1 + 1e-9)).tolist():
        found.append(
            Finding(
                robot.label("friction", k + 1),
                f"its bristles are too stiff for a step of {step:g} s: the step times the root of "
                f"bristle stiffness over rotor inertia is {BRISTLE_RULE * step / bristles[k]:.2g}",
                f"it must be at most {BRISTLE_RULE:g}: make the bristles softer or the step at "
                f"most {bristles[k]:.2g} s",
            )
        )
    euler = int(mujoco.mjtIntegrator.mjINT_EULER)
    if robot.model.opt.integrator != euler:
        what, remedy = "is not Euler, for which set points are timed", 'use integrator="Euler"'
        found.append(Finding("integrator", what, remedy))
    return found


def _weight(robot: Robot) -> list[Finding]:
    """Axes that cannot hold the arm against gravity in some poses."""
    arm, poses = Arm(robot), sampled_poses(robot.joint_range, robot.slides, _POSES)
    still = np.zeros_like(poses)
    load = np.abs(robot.gearing.torque(arm.inverse_dynamics(poses, still, still))).max(axis=0)
    limit = robot.motor_torque_limit * np.abs(robot.gear_ratio)
    units = [STATED_UNITS["torque_limit"][int(slides)] for slides in robot.slides]
    return [
        Finding(
            robot.label("axis ", k + 1),
            f"needs {load[k]:.3g} {units[k]} to hold the arm, but its torque limit is "
            f"{limit[k]:.3g} {units[k]} at the joint",
            "raise the torque limit, or make the links or the payload lighter",
        )
        for k in np.flatnonzero(load > limit).tolist()
    ]


def _tasks(robot: Robot, checked: Checked) -> list[Finding]:
    """Tasks that the robot cannot do."""
    found = []
    names = task_names(robot.name, robot.tasks)
    for name in names:
        try:
            motion = plan(load_task(robot.name, name, robot.tasks), robot)
            checked.tasks[name] = motion.period
        except InputError as error:
            remedy = "change the task, or the limits of the robot"
            found.append(Finding(f"task {name}", str(error), remedy))
    return found


def _check_plain(path: Path, source: Source, folders: Sequence[Path]) -> Checked:
    checked = Checked(path.stem)
    findings, chosen = survey(source, None)
    names = chosen.names
    checked.findings += findings
    checked.warnings += chosen.notes
    n = len(names)
    if _right_names(names) < n:
        what = f"its {n} axes have other names than joint1 to joint{n}: {', '.join(names)}"
        checked.findings.append(_lacking("joints", what))
    kinds = f"{n} rotors (motor1, ...), gearboxes, drives and friction elements"
    checked.findings.append(_lacking("model", f"a plain model, which lacks {kinds}"))
    if not any(site.name == "tool" for site in source.spec.sites):
        checked.findings.append(_lacking("site 'tool'", "is missing"))
    if not any(body.name == "payload" for body in source.spec.bodies):
        checked.findings.append(_lacking("body 'payload'", "is missing"))
    if not any(finding.fatal for finding in findings):
        try:
            arm = plain_arm(path, folders=folders)
        except InputError as error:
            checked.findings.append(Finding("model", str(error), "correct the file"))
            return checked
        spec, _ = parsed(arm.xml, arm.assets, path.name)
        model = compiled(spec, path.name)
        checked.warnings += [*arm.warnings, *arm.masses.warnings, *_placeholders(arm, spec)]
        checked.warnings += weight_warnings(model)
        has_payload = any(model.body(k).name == "payload" for k in range(model.nbody))
        checked.findings += unit_findings(model, names, has_payload)
        checked.axes = [
            {
                "axis": k + 1,
                "joint": name,
                **{
                    f"{key} [{STATED_UNITS[key][arm.slides[k]]}]": value
                    for key, value in arm.stated[name].items()
                },
            }
            for k, name in enumerate(names)
        ]
    return checked


def _placeholders(arm: Plain, spec: mujoco.MjSpec) -> list[str]:
    """Torque limits of a plain arm that a build does not use; its model gets the payload."""
    add_payload(spec, arm.flange, None)
    seen = look(spec, arm, np.eye(len(arm.joints)))
    return unused_limits(arm.joints, seen)


def _right_names(names: Sequence[str]) -> int:
    """How many axes have the name that faultgen gives them."""
    return sum(name == f"joint{k}" for k, name in enumerate(names, start=1))


def _lacking(where: str, what: str) -> Finding:
    return Finding(where, what, "run 'faultgen robot build'", fatal=False)
