"""Exporting a robot: its plain arm as MJCF and URDF, and tables of its joints.

exported = export_robot(load_robot("my_arm"))
exported.write(Path("my_arm_exported"))
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from copy import copy
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np

from faultgen.errors import InputError
from faultgen.mjcf.compiling import compiled, parsed
from faultgen.mjcf.edit import write_model
from faultgen.mjcf.parsing import parse_xml
from faultgen.robot import Robot
from faultgen.robot_formats.edited import edited_mjcf, edited_urdf, without_shapes
from faultgen.robot_formats.isaac import isaac_numbers
from faultgen.robot_formats.joints import (
    UNITS,
    JointNumbers,
    as_table,
    joint_numbers,
    not_expressed,
)
from faultgen.robot_formats.lumps import rest_pose
from faultgen.robot_formats.plain import plain_mjcf, plain_spec
from faultgen.robot_formats.urdf import urdf_text
from faultgen.system.files import write_text

TABLE = "joints.json"
"""Name of the table by which a folder is known as one that this module wrote."""

_SAMPLES = 16  # random states at which the dynamics are compared
_AGREES = 1e-8  # largest difference of joint torques over the largest torque


@dataclass(frozen=True)
class Exported:
    """A robot in the formats of other programs."""

    files: Mapping[str, str]
    """Text of each file by its name."""
    assets: Mapping[str, bytes]
    """Content of the meshes by path, relative to the files."""
    model: str
    """Name of the MJCF file."""
    rows: tuple[JointNumbers, ...]
    """The numbers of each axis."""
    agreement: Mapping[str, float]
    """By file: largest difference between the joint torques of file and robot in random motions,
    over the largest torque."""
    notes: tuple[str, ...]
    """What the files cannot express, and what was edited."""

    def write(self, folder: Path) -> None:
        """Write all files into a folder.

        Args:
            folder: The folder. It is created if it does not exist.
        """
        folder.mkdir(parents=True, exist_ok=True)
        write_model(folder / self.model, self.files[self.model], self.assets)
        for name, text in self.files.items():
            if name not in (self.model, TABLE):
                write_text(folder / name, text)
        write_text(folder / TABLE, self.files[TABLE])


def check_folder(folder: Path) -> None:
    """Refuse a folder whose files are not those of an earlier export.

    Args:
        folder: The folder, which need not exist.

    Raises:
        InputError: It is a file, or it holds something else, which could be overwritten.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / TABLE).is_file():
        raise InputError(f"{folder}: is not empty, and holds no exported robot; give a new folder")


def export_robot(robot: Robot, *, payload: bool = True) -> Exported:
    """Bring a robot into the formats of other programs.

    Args:
        robot: The robot.
        payload: Whether the files contain the payload on the flange.

    Returns:
        An MJCF file and a URDF of the plain arm, and its numbers as CSV and JSON and for Isaac. If
        the robot keeps the file from which it was built, this file is edited; else both are new.
    """
    rows = joint_numbers(robot)
    spec = plain_spec(robot, rows, payload)
    plain = spec.compile()
    limits, beyond = not_expressed(robot, rows), _beyond_urdf(plain)
    notes: list[str] = []
    files: dict[str, str] = {}
    agreement: dict[str, float] = {}
    assets, more = dict(robot.assets), list[str]()

    for name, text in robot.origin.items():
        is_urdf = name.endswith(".urdf")
        try:
            if is_urdf:
                edited, more = edited_urdf(text, plain, rows), []
            else:
                edited, more = edited_mjcf(text, assets, plain, rows)
            off = _difference(edited.model, _springless(plain) if is_urdf else plain, rows)
            if off > _AGREES:
                raise InputError(f"its dynamics would differ from the robot's by {off:.2g}")
        except (InputError, ValueError) as error:
            notes.append(f"{name}: your file cannot be edited, so a new one was written: {error}")
            continue
        files[name], agreement[name] = edited.text, off
        notes += [f"{name}: {line}" for line in more]
        notes.append(
            f"{name}: your file with {edited.changed} changes; put it where the original "
            "is, because paths of meshes are as there"
        )
    if not any(name.endswith(".xml") for name in files):
        name = f"{robot.name}.xml"
        files[name] = _headed(plain_mjcf(spec), "MJCF", limits)
        agreement[name] = _difference(plain, plain, rows)
        if plain.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT):
            notes.append(f'{name}: contacts are switched off (<flag contact="disable"/>)')
    model = next(name for name in files if name.endswith(".xml"))
    if not any(name.endswith(".urdf") for name in files):
        name = f"{robot.name}.urdf"
        try:
            text = urdf_text(spec, rows, robot.name, notes)
            made = without_shapes(parse_xml(text, name))
            off = _difference(made, _springless(plain), rows)
        except (InputError, ValueError) as error:
            notes.append(f"no URDF is written: {error}")
        else:
            files[name] = _headed(text, "URDF", [*limits, *beyond])
            try:
                compiled(parsed(text, assets, name)[0], name)
            except InputError as error:  # such as a flat mesh, which other programs can show
                notes.append(f"{error}; other programs may read it")
            agreement[name] = off
    notes += [f"not in MJCF or URDF: {line}" for line in limits]
    notes += [f"not in URDF: {line}" for line in beyond]
    files["joints.csv"] = _csv(rows)
    files["isaac.json"] = _json(isaac_numbers(rows))
    files[TABLE] = _json(
        {
            "robot": robot.name,
            "units": {name: list(unit) for name, unit in UNITS.items() if any(unit)},
            "joints": [_finite(asdict(row)) for row in rows],
            "payload_mass": robot.payload_mass if payload and robot.payload_mass > 0 else 0.0,
            "agreement": agreement,
            "notes": notes,
        }
    )
    return Exported(files, assets, model, tuple(rows), agreement, tuple(notes))


def _beyond_urdf(plain: mujoco.MjModel) -> list[str]:
    """What of a plain arm MJCF can express, and URDF cannot."""
    lines = ["the inertia of the rotors (armature) and the gains of the servos"]
    springs = [plain.tendon(k).name for k in range(plain.ntendon)]
    springs += [plain.joint(k).name for k in range(plain.njnt) if plain.jnt_stiffness[k]]
    if springs:
        lines.append(f"springs and tendons, which act on the arm: {', '.join(springs)}")
    return lines


def _springless(plain: mujoco.MjModel) -> mujoco.MjModel:
    """A plain arm without what URDF cannot express."""
    without = copy(plain)
    without.tendon_stiffness[:] = without.tendon_damping[:] = without.jnt_stiffness[:] = 0
    return without


def _difference(model: mujoco.MjModel, plain: mujoco.MjModel, rows: list[JointNumbers]) -> float:
    """How far the joint torques of a model are off in random motions of its axes.

    Args:
        model: The model that was written. Its armature is set to that of the robot, because URDF
            has none; its other joints stand still.
        plain: The plain arm of the robot.
        rows: The numbers of its axes.

    Returns:
        Largest difference over the largest torque.
    """
    rng = np.random.default_rng(0)
    names = [row.joint for row in rows]
    low = np.array([row.lower if np.isfinite(row.lower) else -np.pi for row in rows])
    high = np.array([row.upper if np.isfinite(row.upper) else np.pi for row in rows])
    found = []
    states = rng.random((_SAMPLES, 3, len(rows)))
    for one in (plain, model):
        dofs = [int(one.joint(name).dofadr[0]) for name in names]
        places = [int(one.joint(name).qposadr[0]) for name in names]
        armature, gravity = one.dof_armature.copy(), one.opt.gravity.copy()
        flags = int(one.opt.disableflags)
        one.dof_armature[dofs] = [row.armature for row in rows]
        one.opt.gravity[:] = plain.opt.gravity
        one.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        data = mujoco.MjData(one)
        data.qpos[:] = rest_pose(one)
        torques = []
        for pose, speed, kick in states:
            data.qvel[:] = data.qacc[:] = 0.0
            data.qpos[places] = low + (high - low) * pose
            data.qvel[dofs], data.qacc[dofs] = 2 * speed - 1, 2 * kick - 1
            mujoco.mj_inverse(one, data)
            torques.append(data.qfrc_inverse[dofs].copy())
        one.dof_armature[:], one.opt.gravity[:], one.opt.disableflags = armature, gravity, flags
        found.append(np.array(torques))
    return float(np.abs(found[1] - found[0]).max() / np.abs(found[0]).max())


def _headed(text: str, kind: str, limits: list[str]) -> str:
    """Put what a file cannot express into a comment after its first tag."""
    lines = "".join(f"\n    - {line}" for line in limits).replace("--", "- -")
    first, rest = text.split(">", 1)
    return f"{first}>\n  <!-- {kind} cannot express what else the robot has:{lines} -->{rest}"


def _csv(rows: list[JointNumbers]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(as_table(rows))
    return text.getvalue()


def _finite(row: dict[str, object]) -> dict[str, object]:
    """The numbers of an axis for JSON, which has no infinity: null where there is no limit."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()}


def _json(content: object) -> str:
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
