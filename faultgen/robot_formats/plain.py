"""The plain arm of a robot as native MJCF: no rotors, no tendons, its joints named as by the user.

text = plain_mjcf(robot, joint_numbers(robot))
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.mjcf.compiling import compiled
from faultgen.mjcf.edit import mjcf_text
from faultgen.mjcf.rotors import delete_drives
from faultgen.robot import Robot
from faultgen.robot_formats.joints import JointNumbers

_STEP = 0.002  # MuJoCo's default [s]: what needed a smaller one, stiff gearboxes, is gone


def plain_spec(robot: Robot, rows: list[JointNumbers], payload: bool) -> mujoco.MjSpec:
    """Make the plain arm of a robot.

    Args:
        robot: The robot.
        rows: Its numbers.
        payload: Whether the payload stays on the flange.

    Returns:
        The arm, compiled. Each joint has the armature, friction and limits of its drive, and a
        position actuator with its gains.
    """
    spec = robot.spec()
    delete_drives(spec, robot.n_axes)
    if not payload and spec.body("payload") is not None:
        spec.delete(spec.body("payload"))
    for kind in ("sensors", "numerics", "texts", "keys", "tuples"):
        for one in list(getattr(spec, kind)):
            spec.delete(one)
    joints = [spec.joint(f"joint{k + 1}") for k in range(len(rows))]
    for k, joint in enumerate(joints):
        joint.name = f"axis_{k + 1}_of_{len(rows)}"  # the user may call joint 1 joint2
    for joint, row in zip(joints, rows, strict=True):
        joint.name = row.joint
        joint.armature, joint.frictionloss = row.armature, row.frictionloss
        joint.damping = np.array([row.damping, 0, 0])
        if np.isfinite(row.effort_limit):
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_TRUE
            joint.actfrcrange = np.array([-row.effort_limit, row.effort_limit])
        _add_actuator(spec, row)
    spec.option.timestep = _STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    compiled(spec, f"plain arm of {robot.name}")
    return spec


def _add_actuator(spec: mujoco.MjSpec, row: JointNumbers) -> None:
    actuator = spec.add_actuator(
        name=row.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=row.joint
    )
    actuator.set_to_position(kp=row.kp, kv=row.kd)
    if np.isfinite(row.effort_limit):
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.forcerange = np.array([-row.effort_limit, row.effort_limit])
    if np.isfinite(row.lower) and np.isfinite(row.upper):
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.ctrlrange = np.array([row.lower, row.upper])


def plain_mjcf(spec: mujoco.MjSpec) -> str:
    """Return the text of a plain arm, with all digits.

    Args:
        spec: The arm, from `plain_spec`.
    """
    return mjcf_text(spec)
