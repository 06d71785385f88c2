"""A recorded motion as a task, so that the robot can be simulated doing what it really does.

text = recorded_task(recording, robot, "healthy1")   # TOML, for `faultgen.tasks`
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import tomli_w
from scipy.interpolate import CubicSpline, make_lsq_spline

from faultgen.errors import InputError
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.tasks import Move, load_task

KNOT = 0.02
"""Time between the samples of the task [s]; a smooth curve goes through them."""

_CALM = 0.04  # time between knots of a smoothed measured motion [s]
_SAME = 0.01  # largest difference of two separate recordings of one motion, over its range
_AT_REST = 0.02  # speed over the largest one, below which an axis counts as being at rest
_LONGEST = 120.0  # longest cycle [s]
_RETURN = 0.5  # share of the limits of speed and acceleration on the way back to the start


def distinct(ways: Sequence[np.ndarray]) -> list[int]:
    """Find the different motions among separate recordings.

    Args:
        ways: Joint positions of each, shape (samples, n_axes).

    Returns:
        Numbers of the first recording of each motion, from 0.
    """
    found: list[int] = []
    for number, way in enumerate(ways):
        reach = np.maximum(np.ptp(way, axis=0), 1e-3 * np.ptp(way, axis=0).max() + 1e-9)
        repeats = any(
            abs(len(ways[other]) - len(way)) <= 2
            and np.all(
                np.abs(ways[other][: len(way)] - way[: len(ways[other])]).max(axis=0)
                <= _SAME * reach
            )
            for other in found
        )
        if not repeats:
            found.append(number)
    return found


def recorded_task(recording: Recording, robot: Robot, name: str) -> str:
    """Write a recorded motion as the text of a task file.

    Separate recordings of different motions follow each other in one cycle, and the robot moves
    from each to the next along straight lines in joint angles. Such a move also leads from the last
    one back to the start. A motion that begins or ends while the robot moves gets a short ramp from
    or to rest.

    The task leads through the commanded positions. Without them it leads through the measured ones,
    smoothed, because the servo would answer their noise with torque.

    Args:
        recording: The recording.
        robot: The model.
        name: Name of the task.

    Returns:
        The text (TOML).

    Raises:
        InputError: The recorded motions are too long.
    """
    wanted = recording.commanded(robot)
    ways = [wanted[part] for part in recording.parts]
    if recording.reference_position is None:
        ways = [_calmed(way, recording.sample_period) for way in ways]
    chosen = distinct(ways)
    seconds = recording.sample_period * sum(len(ways[k]) for k in chosen)
    if seconds > _LONGEST:
        raise InputError(
            f"{recording.source}: its motions take {seconds:.0f} s, and a task of at most "
            f"{_LONGEST:g} s is simulated in reasonable time; give a recording of one cycle"
        )
    moves: list[dict[str, object]] = []
    here: list[float] | None = None
    start: list[float] = []
    for number in chosen:
        period, samples = _knots(ways[number], recording.sample_period, robot)
        rows = [[float(f"{x:.7g}") for x in row] for row in robot.to_degrees(samples).tolist()]
        if here is None:
            start = rows[0]
        elif here != rows[0]:
            moves.append({"joints": rows[0], "speed": _RETURN})
        moves.append({"path": "sampled", "sample_period": period, "samples": rows})
        here = rows[-1]
    if here != start:
        moves.append({"joints": start, "speed": _RETURN})
    told = {
        "name": name,
        "robot": robot.name,
        "description": f"the recorded motion of {recording.source.rsplit('/', 1)[-1]}",
        "start": {"joints": start},
        "move": moves,
    }
    return tomli_w.dumps(told)


def _calmed(way: np.ndarray, sample_period: float) -> np.ndarray:
    """A measured motion without its noise: a spline with knots some samples apart."""
    times = np.arange(len(way)) * sample_period
    count = max(4, round(times[-1] / _CALM))
    inner = np.linspace(0, times[-1], count + 1)[1:-1]
    knots = np.concatenate([np.zeros(6), inner, np.full(6, times[-1])])
    return np.asarray(make_lsq_spline(times, way, knots, k=5)(times))


def known_task(recording: Recording, robot: Robot) -> str | None:
    """Find the recorded motion among the tasks in a robot's folder.

    Args:
        recording: The recording.
        robot: The model with its tasks.

    Returns:
        Name of the first task with sampled paths that are the motions of the recording; None if
        there is none.
    """
    position = recording.joint_position(robot)
    ways = [position[part] for part in recording.parts]
    ways = [ways[k] for k in distinct(ways)]
    for name in robot.tasks:
        moves = [m for m in load_task(robot.name, name, robot.tasks).move if m.path == "sampled"]
        if len(moves) == len(ways) and all(
            _is_same(way, move, recording.sample_period, robot)
            for way, move in zip(ways, moves, strict=True)
        ):
            return name
    return None


def _is_same(way: np.ndarray, move: Move, sample_period: float, robot: Robot) -> bool:
    """Whether a recorded motion is that of a sampled path, up to the error of the servo."""
    assert move.samples is not None and move.sample_period is not None
    path = robot.from_degrees(move.samples)
    seconds = (len(way) - 1) * sample_period
    # ramps may have been added to the path
    longest = seconds + min(2.0, 0.3 * seconds)
    if not 0.98 * seconds <= (len(path) - 1) * move.sample_period <= longest:
        return False
    reach = np.ptp(way, axis=0)
    apart = np.abs(np.percentile(way, (0, 100), axis=0) - np.percentile(path, (0, 100), axis=0))
    return bool(np.all(apart <= 0.05 * reach + 1e-3 * reach.max()))


def _knots(way: np.ndarray, sample_period: float, robot: Robot) -> tuple[float, np.ndarray]:
    """A motion at knots, from rest to rest, and the time between them [s]."""
    times = np.arange(len(way)) * sample_period
    count = max(4, round(times[-1] / KNOT) + 1)
    period = float(times[-1] / (count - 1))
    curve = CubicSpline(times, way)
    samples = curve(np.arange(count) * period)
    speed = np.abs(curve(times, 1)).max(axis=0)
    limit = np.where(np.isfinite(robot.joint_acceleration_limit), robot.joint_acceleration_limit, 5)
    for at_end in (False, True):
        rate = curve(times[-1] if at_end else 0.0, 1)
        if np.all(np.abs(rate) <= _AT_REST * speed + 1e-9):
            continue
        # v (t^3 / T^2 - t^4 / (2 T^3)): from rest to speed v, with at most 1.5 v / T
        needed = float(np.max(1.5 * np.abs(rate) / limit))
        steps = max(5, int(np.ceil(needed / period)))
        length = steps * period
        t = np.arange(steps) * period
        ramp = (t**3 / length**2 - t**4 / (2 * length**3) - length / 2)[:, None] * rate
        if at_end:
            samples = np.concatenate([samples, samples[-1] - ramp[::-1]])
        else:
            samples = np.concatenate([samples[0] + ramp, samples])
    return period, samples
