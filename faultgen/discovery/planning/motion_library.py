"""Motions from which a plan chooses: what any robot can do within its limits.

Every motion is an ordinary task that begins and ends at a pose of its own and moves all axes:

- a *ladder* is the same way there and back at four speeds;
- *reversals* are small, slow moves there and back in poses of different load;
- a *sweep* goes slowly through a large part of the joint range;
- a *fast* motion runs between poses at full speed;
- a *mixed* motion consists of moves whose lengths and speeds are drawn.

The poses and directions are drawn. A motion is kept if its poses and its whole way are allowed, see
`AllowedPoses`.

    for motion in library(load_robot("puma560"), np.random.default_rng(0)):
        print(motion.task.name, motion.period)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import tomli_w

from faultgen.errors import InputError
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.collisions import FEWEST_FREE, Collisions
from faultgen.simulation.motion import Motion, plan
from faultgen.tasks import Move, Pose, Task

SPEEDS = (0.01, 0.05, 0.25, 1.0)
"""Speeds of a ladder, as shares of the speed limit. The slowest is near the Stribeck velocity."""

_EDGE = 0.05  # share of the joint range at each end that is not used
_FREE_TURN, _FREE_SLIDE = np.pi, 0.5  # largest joint position where the model has no range
_HOLDING = 0.6  # share of the torque limit that gravity may take in a pose
_CLEARANCE = 0.1  # of links above the floor [m], where they are not lower in the middle pose
_LEG = 0.8  # time of a move at constant speed [s]
_SWEEP = 4.5  # the same of a sweep [s]
_LOOK = 0.05  # time between the poses of a motion that are checked [s]
_TRIES = 40  # draws of a motion until one is allowed
_KINDS = (("ladder", 3), ("reversals", 2), ("sweep", 1), ("fast", 4), ("mixed", 3))

Leg = tuple[np.ndarray, float]
"""Joint position at the end of a move [rad or m], and its speed as a share of the limit."""


@dataclass(frozen=True)
class AllowedPoses:
    """The poses of a robot that may be used.

    A pose is allowed if every joint is within its range, if gravity takes at most 60 % of each
    motor's torque, if no link is lower than the floor, and if no links collide with each other or
    with the floor. The floor is the plane z = 0 of the base frame if the robot is above it in the
    middle of its joint ranges; otherwise there is none. Other things around it are not known.
    """

    arm: Arm
    """The rigid arm."""
    low: np.ndarray
    """Smallest joint position that is used, shape (n_axes,), in [rad], or [m] for slides."""
    high: np.ndarray
    """Largest joint position, same shape and unit."""
    speed: np.ndarray
    """Joint speed that counts as full speed, same shape, in [rad/s] or [m/s]."""
    floor: np.ndarray
    """Smallest height of each checked point, shape (points,), in [m]."""
    collisions: Collisions | None
    """Finds collisions; None if the shapes of the model overlap in nearly all poses."""

    @classmethod
    def of(cls, robot: Robot) -> AllowedPoses:
        """Read the limits of a robot."""
        arm = Arm(robot)
        free = np.where(robot.slides, _FREE_SLIDE, _FREE_TURN)
        low, high = robot.joint_range.T
        low, high = np.where(np.isfinite(low), low, -free), np.where(np.isfinite(high), high, free)
        width = high - low
        speed = np.minimum(robot.joint_velocity_limit, width)
        middle = _heights(arm, (low + high) / 2)
        floor = np.minimum(middle, _CLEARANCE) - 1e-6
        if middle.min() < -1e-6:
            floor = np.full(len(middle), -np.inf)
        found = Collisions(robot, None if np.isinf(floor).all() else 0.0)
        collisions = found if found.share_free() >= FEWEST_FREE else None
        return cls(arm, low + _EDGE * width, high - _EDGE * width, speed, floor, collisions)

    def is_clear(self, pose: np.ndarray) -> bool:
        """Whether all links are above the floor and free of collisions in a pose (n_axes,)."""
        if np.any(_heights(self.arm, pose) < self.floor):
            return False
        return self.collisions is None or self.collisions.is_free(pose)

    def is_allowed(self, pose: np.ndarray) -> bool:
        """Whether the robot may rest in a pose of shape (n_axes,), in [rad] or [m]."""
        if np.any(pose < self.low - 1e-9) or np.any(pose > self.high + 1e-9):
            return False
        robot, still = self.arm.robot, np.zeros((1, len(pose)))
        load = robot.gearing.torque(self.arm.inverse_dynamics(pose[None], still, still))[0]
        load = load / robot.gear_ratio
        if np.any(np.abs(load) > _HOLDING * robot.motor_torque_limit):
            return False
        return self.is_clear(pose)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw an allowed pose.

        Args:
            rng: Source of the pose.

        Returns:
            Shape (n_axes,), in [rad], or [m] for slides.

        Raises:
            InputError: No allowed pose was found.
        """
        for _ in range(100 * _TRIES):
            pose = rng.uniform(self.low, self.high)
            if self.is_allowed(pose):
                return np.asarray(pose)
        raise InputError(
            f"robot {self.arm.robot.name}: no pose was found in which its motors can hold it above "
            "the floor and its links do not collide"
        )

    def within(self, pose: np.ndarray) -> np.ndarray:
        """Return the nearest pose within the joint ranges.

        Args:
            pose: Shape (n_axes,), in [rad], or [m] for slides.

        Returns:
            Same shape and unit.
        """
        return np.clip(pose, self.low, self.high)


def _heights(arm: Arm, pose: np.ndarray) -> np.ndarray:
    """Height of the origin and centre of mass of each body, and of the tool, in a pose [m]."""
    data = mujoco.MjData(arm.model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(arm.model, data)
    return np.concatenate([data.xpos[1:, 2], data.xipos[1:, 2], data.site_xpos[:, 2]])


def library(robot: Robot, rng: np.random.Generator) -> list[Motion]:
    """Make the motions from which a plan chooses.

    Args:
        robot: The robot.
        rng: Source of the poses and directions.

    Returns:
        Motions of at most some 15 s each. Kinds that the robot cannot do are missing.

    Raises:
        InputError: The robot can do none of them.
    """
    space = AllowedPoses.of(robot)
    wanted = [(kind, f"{kind}_{k + 1}") for kind, count in _KINDS for k in range(count)]
    drawn = [_drawn(space, kind, name, rng) for kind, name in wanted]
    found = [motion for motion in drawn if motion is not None]
    if not found:
        raise InputError(f"robot {robot.name}: no motion was found that its limits allow")
    return found


def _drawn(space: AllowedPoses, kind: str, name: str, rng: np.random.Generator) -> Motion | None:
    """Draw a motion until one is allowed; None if none is."""
    robot = space.arm.robot
    for _ in range(_TRIES):
        start = space.draw(rng)
        legs = list(_MAKERS[kind](space, start, rng))
        if not all(space.is_allowed(pose) for pose, _ in legs):
            continue
        try:
            motion = plan(_task(robot, name, _TEXTS[kind], start, legs), robot)
        except InputError:
            continue
        way, _, _ = motion(np.arange(0, motion.period, _LOOK))
        if all(space.is_clear(pose) for pose in way):
            return motion
    return None


def _step(
    space: AllowedPoses, here: np.ndarray, size: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Go a step of some size from a pose, each axis in a drawn direction in which there is room."""
    sign = rng.choice([-1.0, 1.0], len(here))
    there = here + sign * size
    outside = (there < space.low) | (there > space.high)
    return space.within(np.where(outside, here - sign * size, there))


def _ladder(space: AllowedPoses, start: np.ndarray, rng: np.random.Generator) -> Iterator[Leg]:
    far = _step(space, start, space.speed * _LEG, rng)
    for speed in SPEEDS:
        yield start + speed * (far - start), speed
        yield start, speed


def _reversals(space: AllowedPoses, start: np.ndarray, rng: np.random.Generator) -> Iterator[Leg]:
    here = start
    for _ in range(2):
        for speed in (0.02, 0.05):
            there = _step(space, here, space.speed * speed * _LEG / 2, rng)
            yield there, speed
            yield here, speed
        here = _step(space, here, space.speed * rng.uniform(0.4, 1.2, len(start)), rng)
        yield here, 0.7
    yield start, 0.7


def _sweep(space: AllowedPoses, start: np.ndarray, rng: np.random.Generator) -> Iterator[Leg]:
    ends = [space.draw(rng) for _ in range(20)]
    far = max(ends, key=lambda end: np.min(np.abs(end - start) / (space.high - space.low)))
    speed = 0.3
    longest = float(np.max(np.abs(far - start) / (speed * space.speed)))
    far = start + (far - start) * min(1.0, _SWEEP / longest)
    yield far, speed
    yield start, speed


def _fast(space: AllowedPoses, start: np.ndarray, rng: np.random.Generator) -> Iterator[Leg]:
    here = start
    for _ in range(5):
        here = _step(space, here, space.speed * rng.uniform(0.2, 1.2, len(start)), rng)
        yield here, 1.0
    yield start, 1.0


def _mixed(space: AllowedPoses, start: np.ndarray, rng: np.random.Generator) -> Iterator[Leg]:
    here = start
    for _ in range(6):
        speed = float(10 ** rng.uniform(-1.7, 0))
        size = space.speed * speed * _LEG * rng.uniform(0.1, 1.0, len(start))
        here = _step(space, here, size, rng)
        yield here, speed
    yield start, 0.5


_MAKERS: dict[str, Callable[..., Iterator[Leg]]] = {
    "ladder": _ladder,
    "reversals": _reversals,
    "sweep": _sweep,
    "fast": _fast,
    "mixed": _mixed,
}
_TEXTS = {
    "ladder": "the same way there and back at four speeds",
    "reversals": "small, slow moves there and back in poses of different load",
    "sweep": "a slow move through a large part of the joint range and back",
    "fast": "moves at full speed between several poses",
    "mixed": "moves of different lengths and speeds",
}


def _task(robot: Robot, name: str, text: str, start: np.ndarray, legs: Sequence[Leg]) -> Task:
    def joints(pose: np.ndarray) -> list[float]:
        # task files have degrees, or metres for slides
        told = robot.to_degrees(pose)
        return [
            round(float(value), 6 if slide else 4)
            for value, slide in zip(told, robot.slides, strict=True)
        ]

    moves = [Move(joints=joints(pose), speed=round(speed, 4)) for pose, speed in legs]
    return Task(
        name=name, robot=robot.name, description=text, start=Pose(joints=joints(start)), move=moves
    )


def task_toml(task: Task) -> str:
    """Write a task as the TOML text that `--task` accepts.

    Args:
        task: The task. Its name and robot are not part of the text.
    """
    return tomli_w.dumps(task.model_dump(exclude={"name", "robot"}, exclude_defaults=True))
