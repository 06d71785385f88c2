"""Motions: the joint angles over one cycle of a task.

`plan` turns a task into a motion. It lays a path through each move (`joint_paths`) and gives each
path a jerk-limited timing (`timing`) that keeps motor speed, joint acceleration and motor torque
within the limits of the robot.

    motion = plan(load_task("irb6700", "spot_weld"), load_robot("irb6700"))
    q, qd, qdd = motion(times)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from faultgen.errors import InputError
from faultgen.monitoring.reductions import SPEED_WINDOW
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.joint_paths import configuration, path_of, resting
from faultgen.simulation.timing import GRID, LONGEST, TORQUE_SHARE, JointPath, Timing, timed
from faultgen.tasks import Move, Task

_TICK = 0.02  # a cycle lasts a whole number of these [s], so that samples fall alike in each
_SAME = 1e-6  # difference of equal joint angles [rad]
_NEAR = np.radians(0.2)  # by which the end of a planned cycle may miss its start
OVER = 0.02
"""Share of a limit of speed or position by which a recorded motion may exceed it."""


@dataclass(frozen=True)
class _Piece:
    """A part of a motion that begins at `start` and lasts for `duration` [s].

    Its path is q(s) and its timing is s(t).
    """

    start: float
    duration: float
    path: JointPath
    timing: Timing
    is_sampled: bool = False


@dataclass(frozen=True)
class Motion:
    """One cycle of a task: joint angles as a periodic function of time."""

    robot: Robot
    """The robot that does the task."""
    task: Task
    """The task."""
    period: float
    """Duration of a cycle [s]."""
    pieces: tuple[_Piece, ...]
    """Moves and pauses in the order of time."""

    def __call__(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the motion of the joints at given times.

        Args:
            times: Shape (samples,), in [s]. Times outside the cycle are taken modulo its period.

        Returns:
            Joint angle [rad], velocity [rad/s] and acceleration [rad/s^2], each of shape
            (samples, n_axes).
        """
        times = np.mod(np.asarray(times, float), self.period)
        starts = np.array([piece.start for piece in self.pieces])
        which = np.searchsorted(starts, times, side="right") - 1
        out = np.empty((3, len(times), self.robot.n_axes))
        for index, piece in enumerate(self.pieces):
            chosen = which == index
            if not chosen.any():
                continue
            s, sd, sdd = piece.timing(times[chosen] - piece.start)
            slope, curvature = piece.path(s, 1), piece.path(s, 2)
            out[0, chosen] = piece.path(s, 0)
            out[1, chosen] = slope * sd[:, None]
            out[2, chosen] = curvature * sd[:, None] ** 2 + slope * sdd[:, None]
        return out[0], out[1], out[2]

    @property
    def sampled(self) -> list[tuple[float, float]]:
        """Start and duration of each sampled path of the task [s]."""
        return [(one.start, one.duration) for one in self.pieces if one.is_sampled]

    @cached_property
    def window_share(self) -> np.ndarray:
        """Share of the cycle that each motor spends in `SPEED_WINDOW`, shape (n_axes,)."""
        times = np.arange(0, self.period, GRID)
        speed = np.abs(self.robot.gearing.outputs(self(times)[1]) * self.robot.gear_ratio)
        low, high = SPEED_WINDOW
        return ((speed >= low) & (speed <= high)).mean(axis=0)


def plan(task: Task, robot: Robot) -> Motion:
    """Plan the motion of a task.

    Args:
        task: The task.
        robot: The robot that does it.

    Returns:
        The motion, within 85 % of the motor torque limits and all of the others.

    Raises:
        InputError: A pose cannot be reached, a move needs too much torque at any speed, or a cycle
            would last longer than `LONGEST`.
    """
    arm = Arm(robot)
    pieces: list[_Piece] = []
    clock = 0.0
    start = here = configuration(task.start, arm, task, np.zeros(robot.n_axes), "start")
    for number, move in enumerate(task.move, start=1):
        is_last = number == len(task.move)
        piece: _Piece | None
        if move.path == "sampled":
            piece, here = _sampled(move, arm, here, task, number, clock)
            if is_last:
                _check_end(task, here, start, _SAME)
        else:
            _check_planned(move, task, number)
            there = configuration(move, arm, task, here, f"move {number}")
            if is_last:
                _check_end(task, there, start, _NEAR)
                there = start
            piece, here = _planned(move, arm, here, there, task, number, clock)
        if piece is not None:
            pieces.append(piece)
            clock += piece.duration
        clock = _rest(pieces, clock, here, move.dwell, is_last)
    if clock > LONGEST:
        raise InputError(
            f"task {task.name}: a cycle would last {clock:.3g} s; it may last at most {LONGEST:g} s"
        )
    return Motion(robot, task, float(round(clock / _TICK) * _TICK), tuple(pieces))


def _check_planned(move: Move, task: Task, number: int) -> None:
    if move.samples is not None or move.sample_period is not None:
        raise InputError(
            f"task {task.name}, move {number}: only path = \"sampled\" has 'samples' and "
            "'sample_period'"
        )


def _check_end(task: Task, end: np.ndarray, start: np.ndarray, most: float) -> None:
    if np.abs(end - start).max() > most:
        raise InputError(f"task {task.name}: the last move must end at the start pose")


def _planned(
    move: Move,
    arm: Arm,
    here: np.ndarray,
    there: np.ndarray,
    task: Task,
    number: int,
    clock: float,
) -> tuple[_Piece | None, np.ndarray]:
    """A move with its timing, if it goes anywhere, and the joint angles at its end."""
    if np.abs(there - here).max() <= 1e-9 and not move.via:
        return None, there
    path, length, there = path_of(move, arm, here, there, task, number)
    timing, duration = timed(move, path, length, arm, f"task {task.name}, move {number}")
    return _Piece(clock, duration, path, timing), there


def _rest(pieces: list[_Piece], clock: float, here: np.ndarray, dwell: float, last: bool) -> float:
    """Add the pause after a move, and return the time at its end [s]."""
    rest = np.ceil((clock + dwell) / _TICK - 1e-9) * _TICK - clock if last else dwell
    if rest > 0:
        pieces.append(_Piece(clock, rest, resting(here), _still))
        clock += rest
    return clock


def _sampled(
    move: Move, arm: Arm, here: np.ndarray, task: Task, number: int, clock: float
) -> tuple[_Piece, np.ndarray]:
    """A recorded motion as a piece, with its own timing, and the joint angles at its end."""
    robot, where = arm.robot, f"task {task.name}, move {number}"
    if move.samples is None or move.sample_period is None:
        raise InputError(f"{where}: a sampled path needs 'samples' and 'sample_period'")
    if any(len(row) != robot.n_axes for row in move.samples):
        raise InputError(f"{where}: each of the samples needs {robot.n_axes} numbers")
    way = robot.from_degrees(move.samples)
    if not np.isfinite(way).all():
        raise InputError(f"{where}: the samples must be finite")
    if np.abs(way[0] - here).max() > _SAME:
        raise InputError(f"{where}: the samples must begin where the move before them ends")
    spline = recorded_curve(move, robot)
    _check_sampled(arm, spline, where)

    def timing(at: np.ndarray) -> np.ndarray:
        return np.stack([at, np.ones_like(at), np.zeros_like(at)])

    piece = _Piece(clock, float(spline.x[-1]), lambda at, order: spline(at, order), timing, True)
    return piece, way[-1]


def recorded_curve(move: Move, robot: Robot) -> CubicSpline:
    """Return the smooth curve through the samples of a recorded move, from rest to rest.

    Args:
        move: A move with samples.
        robot: The robot that does it.

    Returns:
        Joint positions as a function of the time since the move began [s].
    """
    assert move.samples is not None and move.sample_period is not None
    way = robot.from_degrees(move.samples)
    return CubicSpline(np.arange(len(way)) * move.sample_period, way, bc_type="clamped")


def asked_of(arm: Arm, curve: CubicSpline) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute what a recorded move asks of a robot.

    Args:
        arm: The rigid arm of the robot.
        curve: The move, from `recorded_curve`.

    Returns:
        Joint position, |motor speed| [rad/s] and |motor torque| [N m] every `GRID` seconds, shape
        (times, n_axes) each.
    """
    robot = arm.robot
    times = np.arange(0, curve.x[-1], GRID)
    q, qd, qdd = curve(times), curve(times, 1), curve(times, 2)
    speed = np.abs(robot.gearing.outputs(qd) * robot.gear_ratio)
    return q, speed, np.abs(motor_torque(arm, q, qd, qdd))


def _check_sampled(arm: Arm, curve: CubicSpline, where: str) -> None:
    """Refuse a recorded motion that exceeds a limit of the model. A real robot has done it."""
    robot = arm.robot
    low, high = robot.joint_range.T
    q, speed, torque = asked_of(arm, curve)
    for what, excess in (
        ("leaves its range", np.maximum(low - q, q - high) - OVER * np.abs(high - low)),
        ("is faster than motor_velocity_limit", speed - (1 + OVER) * robot.motor_velocity_limit),
        ("needs more torque than its drive has", torque - robot.motor_torque_limit),
    ):
        beyond = np.nan_to_num(excess, nan=-1.0).max(axis=0)
        if (beyond > 0).any():
            axis = int(np.argmax(beyond > 0)) + 1
            raise InputError(
                f"{where}: on the recorded motion, {robot.label('axis ', axis)} {what} in the "
                "model; correct this limit of the model, or record a gentler motion"
            )


def _still(times: np.ndarray) -> np.ndarray:
    return np.zeros((3, len(times)))


def shifted(motion: Motion, robot: Robot, shift: np.ndarray, speed: float) -> Motion:
    """Shift a motion to other joint angles and change its speed.

    Args:
        motion: The motion.
        robot: Its robot, which may have another payload.
        shift: Angles that are added to the joint angles, shape (n_axes,), in [rad].
        speed: Speed override, above 0 and up to 1. All velocities are multiplied by it.

    Returns:
        The new motion.

    Raises:
        InputError: A joint angle or a motor torque would exceed its limits.
    """

    def moved(piece: _Piece) -> _Piece:
        path, timing = piece.path, piece.timing

        def elsewhere(s: np.ndarray, order: int) -> np.ndarray:
            return path(s, order) + shift if order == 0 else path(s, order)

        def slower(times: np.ndarray) -> np.ndarray:
            s, rate, change = timing(times * speed)
            return np.array([s, rate * speed, change * speed**2])

        return _Piece(
            piece.start / speed, piece.duration / speed, elsewhere, slower, piece.is_sampled
        )

    pieces = [moved(piece) for piece in motion.pieces]
    end = pieces[-1].start + pieces[-1].duration
    period = float(np.ceil(end / _TICK - 1e-9) * _TICK)
    if period > end + 1e-9:
        rest = pieces[-1].path(pieces[-1].timing(np.array([pieces[-1].duration]))[0], 0)[0]
        pieces.append(_Piece(end, period - end, resting(rest), _still))
    new = Motion(robot, motion.task, round(period / _TICK) * _TICK, tuple(pieces))
    q, qd, qdd = new(np.arange(0, new.period, GRID))
    low, high = robot.joint_range.T
    outside = (q < low - 1e-9) | (q > high + 1e-9)
    if outside.any():
        axis = int(np.flatnonzero(outside.any(axis=0))[0]) + 1
        raise InputError(
            f"task {motion.task.name}: {robot.label('axis ', axis)} leaves its range when the "
            "motion is shifted"
        )
    torque = np.abs(motor_torque(Arm(robot), q, qd, qdd)).max(axis=0)
    over = torque > TORQUE_SHARE * robot.motor_torque_limit * (1 + 1e-6)
    if over.any():
        axis = int(np.flatnonzero(over)[0]) + 1
        raise InputError(
            f"task {motion.task.name}: {robot.label('axis ', axis)} needs too much torque when the "
            "motion is shifted"
        )
    return new
