"""The protocol of a robot: six separate motions of about 3.5 s, of three types.

Point-to-point ladder, Fourier series, a stretch of the robot's own tasks; then each again. Poses
and sizes were found once by a seeded search among motions within all limits (`protocol.json`, by
``python -m sealed.motions`` in the folder ``benchmarks``), and are the same for every case.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
from sealed.physics import GRID, SAMPLE_PERIOD, Physics, Reference, nominal_physics, set_points

from faultgen.robot import Robot, load_robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

SECONDS = 3.5
"""Of a motion [s]; stretches of tasks last as their moves do."""
KINDS = ("point-to-point", "fourier", "task") * 2
"""Types of the six motions, in their order."""
TASKS = {"puma560": ("pick_and_place", "spot_weld"), "irb6700": ("pick_and_place", "spot_weld")}
FOUND = Path(__file__).with_name("protocol.json")
"""Pose, seed and size of the ladders and Fourier series of each robot."""
SEED = 20240607
_TRIALS = 400
_TORQUE_SHARE = 0.75  # of the limit that the nominal robot may need
_HARMONICS = 5
_RAMP = 0.5  # of a Fourier series, at both ends [s]
_EDGE = 0.08  # of its range that an axis keeps off the ends [rad]
_FLOOR, _COLUMN = 0.15, 0.30  # where the tool does not go: under this height, near the base [m]

Maker = Callable[[np.ndarray, float], Reference]
"""Pose and seed, shape (n_axes + 1,), and size to a motion."""

# ladder: (share of the stroke where a move ends, share of the axis' speed that it may take, hold)
_LADDER = (
    (1.0, 1.0, 0.16),
    (0.45, 0.4, 0.12),
    (0.62, 0.10, 0.12),
    (0.30, 0.25, 0.12),
    (0.0, 0.35, 0.0),
)


def _quintic(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest to rest from 0 to 1, with two derivatives."""
    s = np.clip(s, 0, 1)
    at = s**3 * (10 - 15 * s + 6 * s**2)
    return at, 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)


def _ladder(start: np.ndarray, stroke: np.ndarray, shares: np.ndarray) -> Reference:
    """All axes up and down their strokes at several speeds; holds are met from both sides."""
    lengths = np.abs(np.diff([0.0, *[rung[0] for rung in _LADDER]]))
    slowness = lengths / np.array([rung[1] for rung in _LADDER]) ** 0.5
    holds = np.array([rung[2] for rung in _LADDER])
    durations = slowness / slowness.sum() * (SECONDS - holds.sum())
    times = np.arange(0, SECONDS + GRID / 2, GRID)
    q, qd, qdd = (np.zeros((len(times), len(start))) for _ in range(3))
    clock, here = 0.0, 0.0
    for (there, _, hold), duration in zip(_LADDER, durations, strict=True):
        for axis in range(len(start)):
            # axes set off one after another, so that their reversals differ
            late = shares[axis] * 0.25 * duration
            span = duration - late
            at, rate, change = _quintic((times - clock - late) / span)
            step = (there - here) * stroke[axis]
            q[:, axis] += step * at
            qd[:, axis] += step * rate / span
            qdd[:, axis] += step * change / span**2
        clock, here = clock + duration + hold, there
    return Reference(q + start, qd, qdd)


def _fourier(middle: np.ndarray, sines: np.ndarray, cosines: np.ndarray) -> Reference:
    """Five harmonics an axis, faded in and out so that the motion starts and ends at rest."""
    times = np.arange(0, SECONDS + GRID / 2, GRID)
    rate = 2 * np.pi / SECONDS * np.arange(1, _HARMONICS + 1)
    angle = times[:, None] * rate
    x = np.sin(angle) @ sines.T + np.cos(angle) @ cosines.T
    xd = (np.cos(angle) * rate) @ sines.T - (np.sin(angle) * rate) @ cosines.T
    xdd = -(np.sin(angle) * rate**2) @ sines.T - (np.cos(angle) * rate**2) @ cosines.T
    up, down = _quintic(times / _RAMP), _quintic((SECONDS - times) / _RAMP)
    w = (up[0] * down[0])[:, None]
    wd = ((up[1] * down[0] - up[0] * down[1]) / _RAMP)[:, None]
    wdd = ((up[2] * down[0] - 2 * up[1] * down[1] + up[0] * down[2]) / _RAMP**2)[:, None]
    return Reference(middle + w * x, wd * x + w * xd, wdd * x + 2 * wd * xd + w * xdd)


class _Judge:
    """How far within the limits a motion is, and how much it tells."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.nominal: Physics = nominal_physics(robot)
        self.arm = Arm(robot)

    def excess(self, motion: Reference) -> float:
        """Largest share of a limit of speed, acceleration and torque; above 1 is beyond."""
        robot = self.robot
        speed = np.abs(motion.qd * robot.gear_ratio) / robot.motor_velocity_limit
        change = np.abs(motion.qdd) / robot.joint_acceleration_limit
        forward = set_points(self.nominal, thinned(motion, 16))[:, 2]
        torque = np.abs(forward) / robot.motor_torque_limit / _TORQUE_SHARE
        return float(max(speed.max() / 0.95, change.max(), torque.max()))

    def inside(self, motion: Reference) -> bool:
        """Whether joints stay in their ranges, and the tool off the floor and the column."""
        low, high = self.robot.joint_range.T
        if (motion.q < low + _EDGE).any() or (motion.q > high - _EDGE).any():
            return False
        points = np.array([self.arm.tool_pose(q)[0] for q in motion.q[::100]])
        return bool(
            points[:, 2].min() > _FLOOR and np.hypot(points[:, 0], points[:, 1]).min() > _COLUMN
        )

    def worth(self, motion: Reference) -> float:
        """Turns of the laziest motor, and whether loads cross zero."""
        ratio = self.nominal.column("N")
        turns = np.abs(np.ptp(motion.q, axis=0) * ratio) / (2 * np.pi)
        few = thinned(motion, 16)
        forward = set_points(self.nominal, few)[:, 2]
        friction = np.abs(ratio * few.qd) > 1
        load = forward - self.nominal.column("FC") * np.sign(ratio * few.qd) * friction
        load = load / self.robot.motor_torque_limit
        crossing = np.clip(np.minimum(load.max(axis=0), -load.min(axis=0)) / 0.05, 0, 1)
        return float(
            np.minimum(turns, 8).min()
            + 0.3 * np.minimum(turns, 12).mean()
            + crossing.sum()
            + 5 * np.ptp(load, axis=0).clip(0, 0.6).mean()
        )


def thinned(motion: Reference, every: int) -> Reference:
    """Keep only some rows of a motion.

    Args:
        motion: The motion.
        every: Distance of the rows that are kept.

    Returns:
        The thinned motion.
    """
    return Reference(motion.q[::every], motion.qd[::every], motion.qdd[::every])


def _search(judge: _Judge, rng: np.random.Generator, make: Maker) -> tuple[list[float], float]:
    """The best of many motions about random poses, each as wide as the limits let it be.

    Returns:
        What `make` takes: pose and seed, and size.
    """
    low, high = judge.robot.joint_range.T
    best, best_worth = None, -np.inf
    for _ in range(_TRIALS):
        share = rng.uniform(0.2, 0.8, len(low))
        pose = low + share * (high - low)
        seed = int(rng.integers(2**32))
        scale = 1.0
        for _ in range(6):
            drawn = [*(float(round(angle, 4)) for angle in pose), float(seed)]
            motion = make(np.array(drawn), scale)
            over = judge.excess(motion)
            if over <= 1:
                break
            scale = round(scale * max(0.5, 0.97 / over), 4)
        if over > 1 or judge.worth(motion) <= best_worth or not judge.inside(motion):
            continue
        best, best_worth = (drawn, scale), judge.worth(motion)
    if best is None:
        raise ValueError(f"robot {judge.robot.name}: no motion within the limits was found")
    return best


def _make_ladder(robot: Robot) -> Maker:
    speed = robot.motor_velocity_limit / np.abs(robot.gear_ratio)
    reach = np.minimum(0.5 * speed, 0.16 * robot.joint_acceleration_limit)

    def make(drawn: np.ndarray, scale: float) -> Reference:
        rng = np.random.default_rng(int(drawn[-1]))
        sign = rng.choice([-1.0, 1.0], robot.n_axes)
        stroke = sign * reach * rng.uniform(0.8, 1.1, robot.n_axes) * scale
        return _ladder(drawn[:-1] - stroke / 2, stroke, rng.uniform(0, 1, robot.n_axes))

    return make


def _make_fourier(robot: Robot) -> Maker:
    speed = robot.motor_velocity_limit / np.abs(robot.gear_ratio)
    rate = 2 * np.pi / SECONDS * np.arange(1, _HARMONICS + 1)
    reach = np.minimum(
        0.8 * speed[:, None] / rate, robot.joint_acceleration_limit[:, None] / rate**2
    )

    def make(drawn: np.ndarray, scale: float) -> Reference:
        rng = np.random.default_rng(int(drawn[-1]))
        size = scale * 0.6 * reach * rng.uniform(0.2, 1.0, reach.shape)
        angle = rng.uniform(0, 2 * np.pi, reach.shape)
        return _fourier(drawn[:-1], size * np.sin(angle), size * np.cos(angle))

    return make


def _stretch(robot: Robot, task: str) -> Reference:
    """The moves of a task that fill the time best: busiest of those within 20 %, rest to rest."""
    motion = plan(load_task(robot.name, task), robot)
    starts = [piece.start for piece in motion.pieces]
    ends = [piece.start + piece.duration for piece in motion.pieces]
    ratio = np.abs(robot.gear_ratio) / robot.motor_velocity_limit
    found: list[tuple[float, float, float]] = []
    for start in starts:
        for end in ends:
            length = end - start
            if 0.8 * SECONDS <= length <= 1.2 * SECONDS:
                speed = np.abs(motion(np.arange(start, end, 0.01))[1] * ratio)
                found.append((float(speed.mean(axis=0).min()), start, end))
    if not found:
        raise ValueError(f"robot {robot.name}, task {task}: no stretch of {SECONDS} s")
    _, start, end = max(found)
    length = np.ceil((end - start) / SAMPLE_PERIOD) * SAMPLE_PERIOD
    times = np.minimum(start + np.arange(0, length + GRID / 2, GRID), end - 1e-9)
    q, qd, qdd = motion(times)
    return Reference(q, qd, qdd)


@lru_cache
def protocol(name: str) -> tuple[Reference, ...]:
    """The six motions of a robot that comes with the package, in the order of `KINDS`."""
    robot = load_robot(name)
    makers = (_make_ladder(robot), _make_fourier(robot))
    drawn = json.loads(FOUND.read_text())[name]
    found = [makers[k % 2](np.array(pose), size) for k, (pose, size) in enumerate(drawn)]
    tasks = [_stretch(robot, task) for task in TASKS[name]]
    return (*found[:2], tasks[0], *found[2:], tasks[1])


def _find() -> None:
    """Search the motions of both robots and write them to `FOUND`."""
    found = {}
    for name in TASKS:
        robot = load_robot(name)
        judge, rng = _Judge(robot), np.random.default_rng(SEED)
        makers = (_make_ladder(robot), _make_fourier(robot))
        found[name] = [_search(judge, rng, maker) for maker in makers * 2]
    FOUND.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    _find()
