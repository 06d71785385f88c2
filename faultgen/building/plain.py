"""A plain arm: links, joints and limits, without motors, gearboxes and friction.

`plain_arm` brings any MJCF or URDF file into this form. It renames the axes to ``joint1``, ...,
takes out what belongs to other programs (actuators, sensors, ...), and keeps as data what the file
states about the drives, such as armature and damping.

    arm = plain_arm(Path("arm.urdf"))
    arm.joints, arm.stated, arm.notes
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from faultgen.building.axes import HINGE, SLIDE, Axes, choose_axes
from faultgen.building.chain import HOME, moving_links, name_elements, strip
from faultgen.building.findings import Finding, refuse
from faultgen.building.flange import Flange, find_flange
from faultgen.building.inertias import inertia_findings, repair_inertias
from faultgen.building.masses import Given, Masses, settle_masses
from faultgen.building.numbers import MOST
from faultgen.building.ranges import assume_ranges, range_warnings
from faultgen.building.source import Source, read_source
from faultgen.building.units import gravity_warnings, impossible_links
from faultgen.errors import one_line
from faultgen.mjcf.compiling import compiled
from faultgen.mjcf.edit import forget_defaults, mjcf_text

_WIDEST, _NARROWEST = 30.0, 0.12  # usual ranges of a hinge [rad]: 5 turns, and 7 degrees

STATED_UNITS = {
    "armature": ("kg m^2", "kg"),
    "damping": ("N m s/rad", "N s/m"),
    "frictionloss": ("N m", "N"),
    "torque_limit": ("N m", "N"),
    "speed_limit": ("rad/s", "m/s"),
    "gear_ratio": ("1", "rad/m"),
}
"""Units of what a file states about the drive of a hinge and of a slide, joint side."""


@dataclass(frozen=True)
class Plain:
    """A plain arm, whose axes are ``joint1``, ``joint2``, ..."""

    name: str
    """Name of the file without its ending."""
    xml: str
    """The MJCF text."""
    assets: Mapping[str, bytes]
    """Content of the files that the text refers to, by name."""
    joints: tuple[str, ...]
    """Names of the axes in the file, from the base to the tool."""
    slides: tuple[bool, ...]
    """Whether the axis slides."""
    assumed_ranges: tuple[int, ...]
    """Axes whose range the file does not state, from 1; they have an assumed one."""
    stated: Mapping[str, Mapping[str, float]]
    """What the file states about the drive of a joint, by joint: some of `STATED_UNITS`."""
    flange: Flange
    """Where the payload is attached."""
    home: tuple[float, ...] | None
    """Joint positions of the keyframe ``home``, in [rad] or [m]."""
    notes: tuple[str, ...]
    """What was left out or changed."""
    masses: Masses
    """What was used for links that state no mass; the robot keeps its warnings."""
    warnings: tuple[str, ...]
    """What is probably not what the user wants."""
    origin: Mapping[str, str]
    """Text of the file by its name, as the user wrote it."""


def plain_arm(
    path: Path,
    joints: Sequence[str] | None = None,
    flange: str | None = None,
    folders: Sequence[Path] = (),
    mass: Given = None,
) -> Plain:
    """Read a plain arm.

    Args:
        path: An MJCF or URDF file.
        joints: Names of the joints that are axes, from the base to the tool. Default: all that are
            neither of a gripper nor follow another joint.
        flange: Name of the body or site to which the payload is attached. Default: found by name.
        folders: Further folders, beside those of the model, whose files it may use.
        mass: Mass of the arm, or of single links by name, that the user gives [kg].

    Returns:
        The arm.

    Raises:
        InputError: The file cannot be read, or no robot can be built from it. The message has all
            findings, in one line.
    """
    source = read_source(path, folders)
    spec = source.spec
    name_elements(spec)
    findings, axes = survey(source, joints, mass)
    refuse(path.name, findings)
    names = axes.names
    stated = _stated(source, names)
    pose = _home(spec)
    assumed, unlimited = assume_ranges(spec, names, source.unstated)
    notes = [*source.notes, *axes.notes, *unlimited]
    notes += strip(spec, names, pose, path.name)
    masses = settle_masses(spec, names, mass)
    notes += [*masses.notes, *repair_inertias(spec)]
    place = find_flange(spec, names[-1], flange)
    if flange is None:
        others = f"; its other sites: {', '.join(place.passed_over)}" if place.passed_over else ""
        notes.append(
            f"the payload is attached to '{place.name}' of the last link{others}; for another "
            'place, write tool = "NAME" in drives.toml'
        )
    slides = tuple(spec.joint(name).type == SLIDE for name in names)
    _rename(spec, names)
    forget_defaults(spec)
    spec.modelname = path.stem
    warned: list[str] = []
    model = compiled(spec, path.name, warned)
    refuse(path.name, impossible_links(model, names))
    ranges = np.array([model.joint(f"joint{k + 1}").range for k in range(len(names))])
    notes += _angle_notes(model, names)
    text = mjcf_text(spec)
    return Plain(
        name=source.name,
        xml=text,
        assets=source.assets,
        joints=names,
        slides=slides,
        assumed_ranges=tuple(assumed),
        stated=stated,
        flange=place,
        home=tuple(pose[name] for name in names) if pose else None,
        notes=tuple(notes),
        masses=masses,
        warnings=(
            *range_warnings(names, assumed, ranges, slides),
            *gravity_warnings(model),
            *(f"MuJoCo: {one_line(line)}" for line in warned),
        ),
        origin=source.origin,
    )


def _angle_notes(model: mujoco.MjModel, names: Sequence[str]) -> list[str]:
    """What looks as if degrees were read as radians, or radians as degrees.

    Args:
        model: The arm, whose axes are ``joint1``, ``joint2``, ...
        names: Names of the axes in the file.
    """
    notes = []
    for k, name in enumerate(names):
        joint = model.joint(f"joint{k + 1}")
        if joint.type[0] != HINGE or not joint.limited[0]:
            continue
        width = float(np.ptp(joint.range))
        if _NARROWEST <= width <= _WIDEST:
            continue
        unit = "degree" if width > _WIDEST else "radian"
        notes.append(
            f"joint '{name}': its range of {width:.3g} rad is unusual; if the file states {unit}s, "
            f'write <compiler angle="{unit}"/> into it'
        )
    return notes


def survey(
    source: Source, joints: Sequence[str] | None, mass: Given = None
) -> tuple[list[Finding], Axes]:
    """List what is wrong with the axes, masses and inertias of a model.

    Args:
        source: The model, whose elements have names.
        joints: Names of the joints that are axes. None: they are found.
        mass: Mass of the arm, or of single links by name, that the user gives [kg].

    Returns:
        The findings, and the axes.
    """
    axes = choose_axes(source.spec, joints, source.leaders)
    moving = moving_links(source.spec, axes.names)
    given = mass if isinstance(mass, Mapping) else {}
    found = [*axes.findings, *inertia_findings(source.spec, moving, given)]
    limits = _stated(source, axes.names)
    for name in axes.names:
        found += [
            Finding(
                f"joint '{name}'",
                f"states a {key} of {value:g}, which no drive has",
                f"write at most {MOST:g}, or 0 if it is not known",
            )
            for key, value in limits[name].items()
            if value > MOST
        ]
    return found, axes


def _stated(source: Source, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """What a model states about the drive of each axis, joint side."""
    spec, found = source.spec, {}
    for name in names:
        joint = spec.joint(name)
        values = {
            "armature": float(joint.armature),
            "damping": float(joint.damping[0]),
            "frictionloss": float(joint.frictionloss),
            "torque_limit": float(joint.actfrcrange[1]),
            "speed_limit": source.speed_limit.get(name, 0.0),
            "gear_ratio": source.gear_ratio.get(name, 0.0),
        }
        for actuator in spec.actuators:
            if actuator.target == name and actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
                limit = _actuator_limit(actuator)
                values["torque_limit"] = values["torque_limit"] or limit
        found[name] = {key: v for key, v in values.items() if v > 0}
    return found


def _actuator_limit(actuator: mujoco.MjsActuator) -> float:
    """Largest torque that an actuator can exert on its joint; 0 if it has no limit."""
    if actuator.forcerange[1] > 0:
        return float(abs(actuator.gear[0]) * actuator.forcerange[1])
    plain_motor = actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
    if plain_motor and actuator.ctrlrange[1] > 0:
        return float(abs(actuator.gear[0] * actuator.gainprm[0]) * actuator.ctrlrange[1])
    return 0.0


def _home(spec: mujoco.MjSpec) -> dict[str, float]:
    """Joint positions of the keyframe ``home``; empty without one value for each joint."""
    widths = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}
    for key in spec.keys:
        values = list(key.qpos)
        address, at = 0, {}
        for joint in spec.joints:
            at[joint.name] = address
            address += widths.get(joint.type, 1)
        if key.name == HOME and len(values) == address:
            return {name: float(values[address]) for name, address in at.items()}
    return {}


def _rename(spec: mujoco.MjSpec, names: Sequence[str]) -> None:
    """Name the axes joint1, ..., and take out of them what their drives will have."""
    for k, joint in enumerate([spec.joint(name) for name in names], start=1):
        joint.name = f"axis_{k}_of_{len(names)}"  # no other joint is called so
    for k in range(1, len(names) + 1):
        joint = spec.joint(f"axis_{k}_of_{len(names)}")
        joint.name = f"joint{k}"
        joint.armature = joint.frictionloss = 0.0
        joint.damping = np.zeros(3)
        joint.actfrcrange = np.zeros(2)
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
