"""Limits of a model that are too tight for what the real robot has done.

robot, warnings = with_limits_of(recordings, robot)

Data sheets state continuous torques, and URDF files often repeat a placeholder. A simulated drive
or joint stops at such a limit, and the difference would look like a fault.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.mjcf.edit import set_numeric
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import OVER, asked_of, recorded_curve
from faultgen.tasks import Task

_ROOM = 1.2
"""New limit of torque or speed over what is needed: a worn robot needs more."""

_NOISE = 1.1
"""Measured torque over the limit, up to which noise may be the reason."""

_RARE = 0.999
"""Share of the samples whose torque is looked at: single ones may be wrong."""

_ROUNDING = 1e-4
"""Share of a range by which positions may be beyond it; further out, a simulated stop pushes back.
"""

_BEYOND = 0.02
"""Room beyond the positions, over the range that they span."""


def with_limits_of(recordings: Sequence[Recording], robot: Robot) -> tuple[Robot, list[str]]:
    """Raise limits of torque and position that measured robots exceed.

    Args:
        recordings: Recordings of the robot in units of torque, with the axes of the model.
        robot: The model.

    Returns:
        The model, the same one if nothing was exceeded, and a line for each raised limit.
    """
    positions = np.concatenate([one.joint_position(robot) for one in recordings])
    gain = np.abs(robot.torque_gain)
    torque = [
        gain * np.abs(one.torque / (robot.gear_ratio if one.side == "joint" else 1.0))
        for one in recordings
    ]
    top = np.max([np.quantile(one, _RARE, axis=0) for one in torque], axis=0)
    top = np.where(top > _NOISE * robot.motor_torque_limit, top, 0.0)
    return _raised(robot, positions, np.zeros(robot.n_axes), top, "in the recordings")


def with_limits_for(task: Task, robot: Robot) -> tuple[Robot, list[str]]:
    """Raise limits of torque, speed and position that the recorded motions of a task exceed.

    Args:
        task: A task of which some moves were recorded.
        robot: The model.

    Returns:
        The model, the same one if nothing was exceeded, and a line for each raised limit.
    """
    arm = Arm(robot)
    asked = [
        asked_of(arm, recorded_curve(move, robot)) for move in task.move if move.path == "sampled"
    ]
    if not asked:
        return robot, []
    positions, speed, torque = (np.concatenate(one) for one in zip(*asked, strict=True))
    return _raised(
        robot, positions, speed.max(axis=0), torque.max(axis=0), "on the recorded motion"
    )


def _raised(
    robot: Robot, positions: np.ndarray, speed: np.ndarray, torque: np.ndarray, when: str
) -> tuple[Robot, list[str]]:
    """Give a model limits that allow positions, speeds and torques of the motors."""
    least, most = positions.min(axis=0), positions.max(axis=0)
    low, high = robot.joint_range.T
    slack = _ROUNDING * np.where(np.isfinite(high - low), high - low, 0.0)
    turns = (least < low - slack) | (most > high + slack)
    fast = speed > (1 + OVER) * robot.motor_velocity_limit
    strong = torque > robot.motor_torque_limit
    if not (turns | fast | strong).any():
        return robot, []
    spec = robot.spec()
    notes = []
    for k in np.flatnonzero(turns | fast | strong):
        axis = robot.label("axis ", int(k) + 1)
        if turns[k]:
            room = _BEYOND * (most[k] - least[k])
            wide = [min(low[k], least[k] - room), max(high[k], most[k] + room)]
            spec.joint(f"joint{k + 1}").range = wide
            unit = "m" if robot.slides[k] else "rad"
            notes.append(
                f"{axis} leaves its range in the model {when}: the range is widened to "
                f"{wide[0]:.4g} to {wide[1]:.4g} {unit}"
            )
        if strong[k]:
            spec.actuator(f"drive{k + 1}").forcerange = [-_ROOM * torque[k], _ROOM * torque[k]]
            notes.append(
                f"{axis} needs {torque[k] / robot.motor_torque_limit[k]:.3g} times the torque that "
                f"its drive has in the model {when}: the limit is raised"
            )
        if fast[k]:
            notes.append(
                f"{axis} is {speed[k] / robot.motor_velocity_limit[k]:.3g} times as fast {when} as "
                "motor_velocity_limit allows: the limit is raised"
            )
    if fast.any():
        limit = np.where(fast, _ROOM * speed, robot.motor_velocity_limit)
        set_numeric(spec, "motor_velocity_limit", limit.tolist())
    spec.compile()
    return robot.edited(spec), notes
