"""Building a robot from a plain model: `build` does everything up to the folder on the disk.

built = build(Path("arm.urdf"), Drives(), "my_arm")
built.robot.write(Path("my_arm"))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from faultgen.building.alike import Like, find_like
from faultgen.building.chain import HOME
from faultgen.building.doubts import weight_warnings
from faultgen.building.drive_numbers import Value, disbelieved, drive_of
from faultgen.building.drives import Coupling, Drives, check_names, drives_text, mass_entries
from faultgen.building.elements import add_drives, add_payload
from faultgen.building.findings import computable
from faultgen.building.limits import disbelieved_limits, limit_warnings
from faultgen.building.plain import Plain, plain_arm
from faultgen.building.ranges import mark_assumed
from faultgen.building.resonance import bristle_step, largest_step, sampled_poses, zero_pose
from faultgen.building.seen import Seen, loads
from faultgen.building.told import keep_warnings
from faultgen.building.workplan import plan_tasks
from faultgen.errors import InputError
from faultgen.mjcf.compiling import compiled, parsed
from faultgen.mjcf.edit import mjcf_text, resolve_inertias
from faultgen.robot import Robot, robot_names
from faultgen.system.files import write_text

DRIVES = "drives.toml"
"""Name of the file with all numbers of the drives, in the folder of a robot."""

STEPS = (1e-3, 5e-4, 2.5e-4, 2e-4, 1e-4, 5e-5, 4e-5, 2e-5)
"""Time steps from which one is chosen [s]; 4 ms is a whole number of each."""
MARGIN = 0.5
"""Largest chosen step over the largest stable one."""

_POSES, _STABLE_POSES = 256, 12  # at which inertias are looked at; at which stability is


@dataclass(frozen=True)
class Built:
    """A robot that was built from a plain model."""

    robot: Robot
    """The robot, with its tasks."""
    plain: Plain
    """The plain arm that it was built from."""
    values: tuple[dict[str, Value], ...]
    """Numbers of the drive of each axis, by name."""
    drives: str
    """Text of drives.toml, with all numbers."""
    notes: tuple[str, ...]
    """What was left out, changed, or could not be done."""
    warnings: tuple[str, ...]
    """What is probably not what the user wants."""

    def write(self, folder: Path) -> None:
        """Write the robot, its tasks and drives.toml into a folder.

        Args:
            folder: The folder. It is created if it does not exist.
        """
        self.robot.write(folder)
        write_text(folder / DRIVES, self.drives)


def build(
    path: Path, drives: Drives, name: str, folders: Sequence[Path] = (), like: str | None = None
) -> Built:
    """Build a robot from a plain model.

    Args:
        path: An MJCF or URDF file.
        drives: What is known about the drives.
        name: Name of the robot.
        folders: Further folders, beside those of the model, whose files it may use.
        like: Name of a known arm, or a payload such as "5 kg", whose numbers replace assumed ones.

    Returns:
        The robot, and everything that was assumed.

    Raises:
        InputError: The file cannot be read, no robot can be built from it, or the drives do not fit
            to it.
    """
    if name in robot_names():
        raise InputError(f"'{name}' is the name of a robot that comes with faultgen; use another")
    plain = plain_arm(path, drives.joints, drives.tool, folders, drives.mass)
    check_names(drives, plain.joints)
    alike = None if like is None else find_like(like, plain.joints)
    with computable(path.name):
        return _build(path, plain, drives, name, alike)


def _build(path: Path, plain: Plain, drives: Drives, name: str, like: Like | None) -> Built:
    spec, _ = parsed(plain.xml, plain.assets, path.name)
    spec.modelname = name
    mark_assumed(spec, plain.assumed_ranges)
    payload = add_payload(spec, plain.flange, drives.payload)
    turns = turns_of(plain.joints, drives.coupling)
    seen = look(spec, plain, turns)
    values = tuple(
        drive_of(drives.of(joint), one, like, axis)
        for axis, (joint, one) in enumerate(zip(plain.joints, seen, strict=True))
    )
    heavy = weight_warnings(compiled(spec.copy(), path.name))
    add_drives(spec, plain.joints, values, drives.coupling)
    kept = [*plain.masses.warnings, *unused_limits(plain.joints, seen, drives)]
    keep_warnings(spec, kept)
    warnings = (*plain.warnings, *kept, *heavy)
    robot, step = _with_step(spec, plain, name, drives.timestep)
    home = plain.home if drives.home is None else robot.from_degrees(drives.home)
    if home is not None:
        where = "drives: home" if drives.home else f"{path.name}: keyframe '{HOME}'"
        outside = robot.out_of_range(np.array(home))
        if outside:
            raise InputError(f"{where}: {'; '.join(outside)}")
    robot, pose, notes = plan_tasks(robot, None if home is None else np.array(home))
    degrees = [float(f"{x:.6g}") for x in robot.to_degrees(pose)]
    source = Value(0, "given") if drives.home else Value(0, "assumed", "start of the tasks")
    general: list[tuple[str, str, Value | None]] = [
        ("joints", _list(plain.joints), Value(0, "given") if drives.joints else _ASSUMED_JOINTS),
        ("tool", f'"{plain.flange.name}"', _origin(plain.flange.why)),
        ("timestep", f"{robot.model.opt.timestep!r}", step),
        ("home", str(degrees), source),
        *mass_entries(plain.masses),
    ]
    entries = {
        key: (str(found if len(found) > 1 else found[0]), source)
        for key, (found, source) in payload.items()
    }
    text = drives_text(name, plain.joints, values, general, entries, drives.coupling)
    friction = [
        f"joint '{joint}', {line}"
        for joint, numbers, one in zip(plain.joints, values, seen, strict=True)
        for line in disbelieved(numbers, one)
    ]
    told = [] if like is None else _told_like(like, plain.joints, values)
    return Built(robot, plain, values, text, (*plain.notes, *friction, *told, *notes), warnings)


def _told_like(like: Like, joints: Sequence[str], values: Sequence[dict[str, Value]]) -> list[str]:
    """What was taken from a similar arm."""
    taken: dict[str, list[str]] = {}
    for joint, numbers in zip(joints, values, strict=True):
        for name, one in numbers.items():
            if one.source == "like":
                taken.setdefault(name, []).append(joint)
    lines = [like.remark] if like.remark else []
    every = [name for name, of in taken.items() if len(of) == len(joints)]
    some = [f"{name} of {', '.join(of)}" for name, of in taken.items() if name not in every]
    what = "; ".join(filter(None, [", ".join(every), *some])) or "nothing, because all is stated"
    return [*lines, f"taken from {like.name} (sources in drives.toml): {what}"]


def unused_limits(
    joints: Sequence[str], seen: Sequence[Seen], drives: Drives | None = None
) -> list[str]:
    """Write in one line which torque limits of a plain model are not used.

    Args:
        joints: Names of the axes.
        seen: What each drive sees.
        drives: What the user gives; a torque limit in it makes that of the model irrelevant.

    Returns:
        One line, or none.
    """
    given = [() if drives is None else drives.of(joint) for joint in joints]
    reasons = [
        "" if "torque_limit" in numbers else one.disbelief
        for numbers, one in zip(given, seen, strict=True)
    ]
    return limit_warnings(joints, [one.stated.get("torque_limit") for one in seen], reasons)


_ASSUMED_JOINTS = Value(
    0, "assumed", "the hinges and slides that are not of a gripper and follow no other joint"
)


def _list(names: Sequence[str]) -> str:
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


def _origin(why: str) -> Value:
    return (
        Value(0, "given") if why == "given" else Value(0, "assumed", why.removeprefix("assumed: "))
    )


def turns_of(joints: Sequence[str], couplings: Sequence[Coupling]) -> np.ndarray:
    """Return how the outputs of the gearboxes turn with the joints.

    Args:
        joints: Names of the axes.
        couplings: Gearboxes that also turn with another joint.

    Returns:
        C of outputs = C joints, shape (n_axes, n_axes).

    Raises:
        InputError: The couplings leave a motion of the joints that no motor sees.
    """
    turns = np.eye(len(joints))
    for one in couplings:
        turns[list(joints).index(one.gearbox), list(joints).index(one.joint)] += one.factor
    if abs(np.linalg.det(turns)) < 1e-6:
        raise InputError("drives: coupling: with these factors the motors cannot hold the arm")
    return turns


def look(spec: mujoco.MjSpec, plain: Plain, turns: np.ndarray) -> list[Seen]:
    """Look at an arm from its drives: inertias and weight over many poses.

    Args:
        spec: The plain arm with its payload.
        plain: What was read from the file.
        turns: How the outputs of the gearboxes turn with the joints, shape (n_axes, n_axes).

    Returns:
        What each drive sees.
    """
    model = compiled(spec.copy(), "arm")
    limited = model.jnt_limited.astype(bool)[:, None]
    joint_range = np.where(limited, model.jnt_range, [-np.inf, np.inf])
    poses = sampled_poses(joint_range, np.array(plain.slides), _POSES)
    poses = np.vstack([np.clip(np.zeros(model.nv), *joint_range.T), poses])
    seen = loads(model, poses, np.linalg.inv(turns))
    gravity = np.abs(seen.gravity).max(axis=0)
    stated = [plain.stated[joint] for joint in plain.joints]
    efforts = [one.get("torque_limit") for one in stated]
    disbelief = disbelieved_limits(plain.joints, efforts, seen.weight, gravity)
    return [
        Seen(
            slide=plain.slides[k],
            most=float(seen.inertia[:, k].max()),
            least=float(seen.inertia[:, k].min()),
            gravity=float(gravity[k]),
            weight=float(seen.weight[k]),
            arm_weight=float(seen.weight.max()),
            stated=stated[k],
            disbelief=disbelief[k],
        )
        for k in range(len(plain.joints))
    ]


def _with_step(
    spec: mujoco.MjSpec, plain: Plain, name: str, given: float | None
) -> tuple[Robot, Value]:
    """The robot with the time step that was given, or one that is small enough."""
    resolve_inertias(spec)
    compiled(spec, f"robot {name}")
    robot = Robot(name, mjcf_text(spec), plain.assets, origin=plain.origin)
    source = Value(0, "given")
    if given is None:
        poses = sampled_poses(robot.joint_range, robot.slides, _STABLE_POSES)
        stable = min(largest_step(robot, pose) for pose in (zero_pose(robot), *poses))
        most = min(MARGIN * stable, float(bristle_step(robot).min()))
        given = next((step for step in STEPS if step <= most), STEPS[-1])
        source = Value(0, "assumed", f"at most {MARGIN:g} of the largest stable step")
    spec.option.timestep = given
    compiled(spec, f"robot {name}")
    return replace(robot, xml=mjcf_text(spec)), source
