"""The numbers of each axis of a robot, all at the joint and in SI units.

rows = joint_numbers(load_robot("puma560"))
rows[0].armature, rows[0].kp
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from faultgen.mjcf.dcmotor import INTEGRAL_GAIN, OFFSET, POSITION_GAIN, VELOCITY_GAIN
from faultgen.mjcf.elements import stated_name
from faultgen.mjcf.rotors import COUPLING
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot


@dataclass(frozen=True)
class JointNumbers:
    """Numbers of one axis, at the joint.

    The units are those of a hinge; a slide has m for rad and N for N m.
    """

    joint: str
    """Name of the joint in the user's file, or joint1, ..."""
    kind: str
    """hinge or slide."""
    kp: float
    """Position gain of the servo, n^2 times that of the motor [N m/rad]."""
    kd: float
    """Velocity gain of the servo, n^2 times that of the motor [N m s/rad]."""
    armature: float
    """Inertia of the rotor at the joint, n^2 J, with what the joint has itself [kg m^2]."""
    frictionloss: float
    """Coulomb friction, n times that of the motor [N m]."""
    damping: float
    """Viscous friction, n^2 times that of the motor [N m s/rad]."""
    static_friction: float
    """Friction at rest, at least the Coulomb friction [N m]."""
    stribeck_velocity: float
    """Speed over which static friction falls to Coulomb friction [rad/s]."""
    gear_ratio: float
    """Rotor turns per joint turn, with sign [1]; [rad/m] for a slide."""
    rotor_inertia: float
    """Inertia of the rotor at the motor [kg m^2]."""
    gear_stiffness: float
    """Stiffness of the gearbox [N m/rad]."""
    gear_damping: float
    """Damping of the gearbox [N m s/rad]."""
    lower: float
    """Lower end of the range [rad]; -inf without one."""
    upper: float
    """Upper end of the range [rad]; inf without one."""
    velocity_limit: float
    """Largest speed [rad/s]; inf without one."""
    effort_limit: float
    """Largest torque of the drive [N m]; inf without one."""


UNITS = {
    "joint": ("", ""),
    "kind": ("", ""),
    "kp": ("N m/rad", "N/m"),
    "kd": ("N m s/rad", "N s/m"),
    "armature": ("kg m^2", "kg"),
    "frictionloss": ("N m", "N"),
    "damping": ("N m s/rad", "N s/m"),
    "static_friction": ("N m", "N"),
    "stribeck_velocity": ("rad/s", "m/s"),
    "gear_ratio": ("1", "rad/m"),
    "rotor_inertia": ("kg m^2", "kg m^2"),
    "gear_stiffness": ("N m/rad", "N/m"),
    "gear_damping": ("N m s/rad", "N s/m"),
    "lower": ("rad", "m"),
    "upper": ("rad", "m"),
    "velocity_limit": ("rad/s", "m/s"),
    "effort_limit": ("N m", "N"),
}
"""Unit of each number on a hinge and on a slide."""


def joint_numbers(robot: Robot) -> list[JointNumbers]:
    """Read the numbers of each axis from a robot.

    Args:
        robot: The robot. Effects that MJCF cannot express are not in the numbers.

    Returns:
        One for each axis, at the joint.
    """
    model, ratio = robot.model, np.abs(robot.gear_ratio)
    drive, friction = (robot.ids("actuator", name) for name in ("drive", "friction"))
    gearbox, joints = robot.ids("tendon", "gearbox"), list(robot.joints)
    servo, law = model.actuator_gainprm[drive], model.actuator_biasprm[friction]
    rotor = model.dof_M0[list(robot.motors)]
    viscous = model.actuator_damping[friction] + model.dof_damping[list(robot.motors)]
    coulomb = ratio * np.abs(law[:, COULOMB]) + model.dof_frictionloss[joints]
    columns = {
        "kp": ratio**2 * servo[:, POSITION_GAIN],
        "kd": ratio**2 * servo[:, VELOCITY_GAIN],
        "armature": ratio**2 * rotor + model.dof_armature[joints],
        "frictionloss": coulomb,
        "damping": ratio**2 * viscous + model.dof_damping[joints],
        "static_friction": np.maximum(ratio * np.abs(law[:, STICTION]), coulomb),
        "stribeck_velocity": law[:, STRIBECK_VELOCITY] / ratio,
        "gear_ratio": robot.gear_ratio,
        "rotor_inertia": rotor,
        "gear_stiffness": model.tendon_stiffness[gearbox],
        "gear_damping": model.tendon_damping[gearbox],
        "lower": robot.joint_range[:, 0],
        "upper": robot.joint_range[:, 1],
        "velocity_limit": robot.joint_velocity_limit,
        "effort_limit": ratio * robot.motor_torque_limit,
    }
    return [
        JointNumbers(
            stated_name(model, axis + 1) or f"joint{axis + 1}",
            "slide" if robot.slides[axis] else "hinge",
            **{name: float(values[axis]) for name, values in columns.items()},
        )
        for axis in range(robot.n_axes)
    ]


def as_table(rows: list[JointNumbers]) -> list[list[str]]:
    """Return the numbers as the rows of a CSV file, with the units in the header.

    Args:
        rows: The numbers of each axis.
    """
    names = [field.name for field in fields(JointNumbers)]
    slide = any(row.kind == "slide" for row in rows)
    hinge = any(row.kind == "hinge" for row in rows)

    def head(name: str) -> str:
        units = [
            unit for unit, is_there in zip(UNITS[name], (hinge, slide), strict=True) if is_there
        ]
        units = list(dict.fromkeys(filter(None, units)))
        return f"{name} [{'; slides '.join(units)}]" if units else name

    cells = [[getattr(row, name) for name in names] for row in rows]
    return [
        [head(name) for name in names],
        *([one if isinstance(one, str) else repr(one) for one in row] for row in cells),
    ]


def not_expressed(robot: Robot, rows: list[JointNumbers]) -> list[str]:
    """Tell what of a robot neither MJCF without its drives nor URDF can express.

    Args:
        robot: The robot.
        rows: Its numbers.

    Returns:
        One line for each thing that the robot has.
    """
    model = robot.model
    lines = []
    rising = [row.joint for row in rows if row.static_friction > row.frictionloss]
    if rising:
        lines.append(
            "static friction above Coulomb friction, and its fall with the speed (Stribeck), of "
            f"{_list(rising)}: frictionloss and friction are the Coulomb friction only"
        )
    lines.append(
        "the bristles of resting friction (LuGre): resting friction is a constraint of MuJoCo or "
        "of the other simulator"
    )
    lines.append(
        "stiffness and damping of the gearboxes: rotor and joint turn as one, so that resonances "
        "and the twist between motor and joint are missing"
    )
    low, high = model.tendon_lengthspring[robot.ids("tendon", "gearbox")].T
    if np.any(low) or np.any(high):
        lines.append("backlash of the gearboxes")
    if np.any(model.tendon_stiffnesspoly[robot.ids("tendon", "gearbox")]):
        lines.append("hardening of the gearboxes")
    if robot.gearing.coupled.any():
        coupled = [rows[k].joint for k in np.flatnonzero(robot.gearing.coupled)]
        lines.append(
            f"gearboxes that also turn with another joint, those of {_list(coupled)}: the inertia "
            "and friction of their rotors act on their own joint only"
        )
    names = [model.actuator(k).name for k in range(len(model.actuator_gainprm))]
    if any(name.startswith(COUPLING) for name in names):
        lines.append("friction and inertia that two axes of the wrist share")
    if np.any(model.actuator_biasprm[robot.ids("actuator", "friction"), OFFSET]):
        lines.append("constant offsets of the motor torque")
    if np.any(model.actuator_gainprm[robot.ids("actuator", "drive"), INTEGRAL_GAIN]):
        lines.append("the integral gain of the servos")
    if np.any(robot.set_points[1:]):
        lines.append(
            "the set points of velocity and torque that the controller of the robot sends: the "
            "position actuators have the position only, so that kd brakes the motion"
        )
    if np.any(robot.torque_gain != 1):
        lines.append(
            "the factor between the torque of a motor and what its drive logs: all torques are "
            "those of the motors"
        )
    lines += [
        f"the effect {one.effect} of axis {one.axis}, which the robot has outside of its model file"
        for one in robot.effects
    ]
    return lines


def _list(names: list[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
