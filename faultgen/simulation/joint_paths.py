"""Paths of the joints through the moves of a task, before they have a timing.

A path gives the joint angles q(s), with s from 0 to 1. Poses of the tool become joint angles by
inverse kinematics. The tool moves on a straight line or on a spline, or all joints move in
proportion to each other.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from faultgen.errors import InputError
from faultgen.simulation.arm import Arm
from faultgen.simulation.timing import JointPath
from faultgen.tasks import Move, Pose, Task


def configuration(pose: Pose, arm: Arm, task: Task, before: np.ndarray, where: str) -> np.ndarray:
    """Find the joint angles of a pose.

    Args:
        pose: The pose, with joint angles or with position and orientation of the tool.
        arm: The arm.
        task: The task, for messages.
        before: Joint angles of the pose before, shape (n_axes,), in [rad]. Of several solutions,
            the one near these angles is used, unless the pose has `near`.
        where: Which pose of the task it is, for messages.

    Returns:
        Joint angles, shape (n_axes,), in [rad].

    Raises:
        InputError: The pose is incomplete, has a wrong number of angles, or cannot be reached.
    """
    robot = arm.robot
    for name in ("joints", "near"):
        value = getattr(pose, name)
        if value is not None and len(value) != robot.n_axes:
            raise InputError(f"task {task.name}, {where}: '{name}' needs {robot.n_axes} angles")
    if pose.joints is not None:
        angles = robot.from_degrees(pose.joints)
    else:
        if pose.position is None or pose.rpy is None:
            raise InputError(
                f"task {task.name}, {where}: give 'position' and 'rpy', or give 'joints'"
            )
        near = before if pose.near is None else robot.from_degrees(pose.near)
        turned = Rotation.from_euler("xyz", pose.rpy, degrees=True)
        try:
            angles = arm.inverse_kinematics(np.array(pose.position), turned, near)
        except InputError as error:
            raise InputError(f"task {task.name}, {where}: {error}") from None
    outside = robot.out_of_range(angles)
    if outside:
        raise InputError(f"task {task.name}, {where}: {outside[0]}")
    return angles


def path_of(
    move: Move, arm: Arm, here: np.ndarray, there: np.ndarray, task: Task, number: int
) -> tuple[JointPath, float, np.ndarray]:
    """Lay a path through a move.

    An arm of more than six axes reaches a pose of the tool with many joint angles. There, a line or
    spline ends with those to which it leads, except the last move, which ends at the start.

    Args:
        move: The move.
        arm: The arm.
        here: Joint angles at its start, shape (n_axes,), in [rad].
        there: Joint angles at its end, shape (n_axes,), in [rad].
        task: The task of which the move is a part.
        number: Number of the move in the task, from 1.

    Returns:
        The path, the length of the tool's path [m], 0 for a joint path, and the joint angles at the
        end, shape (n_axes,), in [rad].

    Raises:
        InputError: The move is incomplete, or the arm cannot follow its path.
    """
    if move.path == "joint":
        change = there - here

        def straight(s: np.ndarray, order: int) -> np.ndarray:
            if order == 0:
                return here + s[:, None] * change
            return np.broadcast_to(change if order == 1 else 0 * change, (len(s), len(change)))

        return straight, 0.0, there
    if move.path == "line" and move.via:
        raise InputError(f"task {task.name}, move {number}: a line has no 'via'; use a spline")
    first, turned_first = arm.tool_pose(here)
    last, turned_last = arm.tool_pose(there)
    points, turns = [first], [turned_first]
    for pose in move.via:
        if pose.position is None or pose.rpy is None:
            raise InputError(f"task {task.name}, move {number}: 'via' needs 'position' and 'rpy'")
        points.append(np.array(pose.position))
        turns.append(Rotation.from_euler("xyz", pose.rpy, degrees=True))
    points.append(last)
    turns.append(turned_last)
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    knots = np.concatenate([[0], np.cumsum(chords)])
    closed = len(points) > 2 and np.allclose(first, last, atol=1e-9)
    points[-1] = points[0] if closed else points[-1]
    curve = CubicSpline(knots, np.array(points), bc_type="periodic" if closed else "natural")
    turn = RotationSpline(knots, Rotation.concatenate(turns))
    fine = np.linspace(0, knots[-1], 4001)
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))])
    count = max(12, int(way[-1] / 0.01))
    s = np.linspace(0, 1, count + 1)
    angles = [here]
    for value in s[1:]:
        knot = np.interp(value * way[-1], way, fine)
        point, turned = curve(knot), turn(knot)
        try:
            angles.append(arm.inverse_kinematics(point, turned, angles[-1], is_close=True))
        except InputError as error:
            raise InputError(f"task {task.name}, move {number}: {error}") from None
    if len(there) > 6 and number < len(task.move):
        there = angles[-1]
    if np.abs(angles[-1] - there).max() > 1e-3:
        raise InputError(
            f"task {task.name}, move {number}: the path ends at other joint angles than those of "
            "the pose; change 'near' or use path = \"joint\""
        )
    angles[-1] = there
    spline = CubicSpline(s, np.array(angles))
    return (lambda at, order: spline(at, order)), float(way[-1]), there


def resting(angles: np.ndarray) -> JointPath:
    """Make the path of an arm that rests.

    Args:
        angles: Its joint angles, shape (n_axes,), in [rad].

    Returns:
        The path, a function to joint angles and their derivatives, shape (samples, n_axes).
    """

    def path(s: np.ndarray, order: int) -> np.ndarray:
        return np.broadcast_to(angles if order == 0 else 0 * angles, (len(s), len(angles)))

    return path
