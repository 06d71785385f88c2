"""Where an arm can work: safe poses, and how good they are for a task."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from faultgen.building.plain import STATED_UNITS
from faultgen.building.ranges import half_ranges
from faultgen.building.resonance import sampled_poses
from faultgen.errors import InputError
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.collisions import Collisions
from faultgen.simulation.timing import TORQUE_SHARE

_SAMPLES = 800  # poses that are looked at
_FEWEST = 20  # poses above the floor; with fewer it does not count, as for an arm on a ceiling
_FEWEST_HELD = 20  # poses that the drives hold; with fewer the arm is of no use
_INSET = 0.05  # share of the range that stays free at both of its ends
_WANTED = 0.6  # distance of the tool over the reach at which an arm works best
_BELOW = 1e-4  # share of the reach by which a link may be below the base, because of rounding
_NEAR = 0.5  # weight of the distance from the home pose


@dataclass(frozen=True)
class Place:
    """The tool at one pose."""

    pose: np.ndarray
    """Joint positions, shape (n_axes,), in [rad] or [m]."""
    point: np.ndarray
    """Position of the tool, shape (3,), in [m]."""
    turned: Rotation
    """Orientation of the tool."""


class Workspace:
    """What an arm reaches.

    Args:
        robot: The robot.
        home: Pose near which it should work, shape (n_axes,), in [rad] or [m]. None: anywhere.

    Raises:
        InputError: The drives cannot hold the arm.
    """

    def __init__(self, robot: Robot, home: np.ndarray | None) -> None:
        self.robot, self.home = robot, home
        self.arm = Arm(robot)
        self._data = mujoco.MjData(self.arm.model)
        gravity = np.array(robot.model.opt.gravity)
        size = float(np.linalg.norm(gravity))
        self.down = gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])
        """Direction of gravity, shape (3,)."""
        link = self.arm.model.jnt_bodyid[0]
        self._moving = np.arange(link + 1, self.arm.model.nbody)  # the first one is on the base
        self._points(np.clip(np.zeros(robot.n_axes), *robot.joint_range.T))
        self.base = self._data.xpos[self.arm.model.body_parentid[link]].copy()
        """Position of the base, shape (3,), in [m]."""
        spread = half_ranges(robot.slides)
        low, high = robot.joint_range.T
        # a joint that can turn further works within half a turn of home, and not a turn away
        middle = np.zeros(robot.n_axes) if home is None else home
        wide = ~robot.slides & (high - low > 2 * np.pi)
        middle = np.where(wide, np.clip(middle, low + np.pi, high - np.pi), middle)
        low = np.where(wide, np.maximum(low, middle - np.pi), low)
        high = np.where(wide, np.minimum(high, middle + np.pi), high)
        self.span = np.where(np.isfinite(high - low), high - low, 2 * spread)
        """Width of the range in which each joint works, shape (n_axes,)."""
        inset = _INSET * self.span
        limits = np.stack([low + inset, high - inset], axis=1)
        drawn = sampled_poses(limits, robot.slides, _SAMPLES)
        points = np.array([self._points(pose) for pose in drawn])
        self.reach = float(np.linalg.norm(points[:, -1] - self.base, axis=1).max())
        """Largest distance of the tool from the base [m]."""
        held = self._held(drawn)
        self._floor = float(-self.base @ self.down) - _BELOW * self.reach
        above = (-points @ self.down).min(axis=1) >= self._floor
        if (held & above).sum() < _FEWEST:
            self._floor, above = -np.inf, np.ones(len(drawn), bool)
        height = None if np.isinf(self._floor) else self._floor
        self._collisions: Collisions | None = Collisions(robot, height)
        good = drawn[held & above]
        free = np.array([self.is_free(pose) for pose in good], bool)
        self.notes: tuple[str, ...] = ()
        """What the user has to know about the poses."""
        if free.sum() < _FEWEST:
            self._collisions, free = None, np.ones(len(good), bool)
            self.notes = (
                "tasks: collisions are not checked, because the shapes of the model overlap in "
                "nearly all poses",
            )
        self.poses = good[free]
        """Poses above the floor in which the drives can hold the arm, shape (poses, n_axes)."""

    def _held(self, poses: np.ndarray) -> np.ndarray:
        """In which of some poses, shape (poses, n_axes), the drives can hold the arm."""
        share = self._share_of_torque(poses)
        held = np.asarray((share <= TORQUE_SHARE).all(axis=1))
        if held.sum() >= _FEWEST_HELD:
            return held
        robot, k = self.robot, int(np.argmax(np.median(share, axis=0)))
        limit = float(robot.motor_torque_limit[k] * abs(robot.gear_ratio[k]))
        unit = STATED_UNITS["torque_limit"][int(robot.slides[k])]
        raise InputError(
            f"{robot.label('axis ', k + 1)}: with a torque limit of {limit:.3g} {unit} it cannot "
            f"hold the arm, which needs up to {limit * share[:, k].max():.3g} {unit}; raise its "
            "torque_limit or make the payload lighter in drives.toml"
        )

    def _share_of_torque(self, poses: np.ndarray) -> np.ndarray:
        """Motor torque at rest over its limit, in some poses; both of shape (poses, n_axes)."""
        still = np.zeros_like(poses)
        return np.abs(motor_torque(self.arm, poses, still, still)) / self.robot.motor_torque_limit

    def _points(self, pose: np.ndarray) -> np.ndarray:
        """Positions of the links and of the tool, shape (links + 1, 3), in [m]."""
        self._data.qpos[:] = pose
        mujoco.mj_kinematics(self.arm.model, self._data)
        tool = self._data.site("tool").xpos
        return np.vstack([self._data.xpos[self._moving], tool])

    def is_free(self, pose: np.ndarray) -> bool:
        """Tell whether no links collide with each other or with the floor.

        Args:
            pose: Joint positions, shape (n_axes,), in [rad] or [m].
        """
        return self._collisions is None or self._collisions.is_free(pose)

    def is_safe(self, pose: np.ndarray) -> bool:
        """Tell whether an arm can be in a pose.

        The joints must be in their range, the links and the tool above the floor and free of
        collisions, and the drives must hold the arm.

        Args:
            pose: Joint positions, shape (n_axes,), in [rad] or [m].
        """
        low, high = self.robot.joint_range.T
        return (
            bool(np.all((pose >= low) & (pose <= high)))
            and bool((-self._points(pose) @ self.down).min() >= self._floor)
            and bool((self._share_of_torque(pose[None]) <= TORQUE_SHARE).all())
            and self.is_free(pose)
        )

    def is_clear(self, here: np.ndarray, there: np.ndarray) -> bool:
        """Tell whether the arm can be everywhere on the straight way between two poses.

        Args:
            here: Joint positions, shape (n_axes,), in [rad] or [m].
            there: Joint positions, shape (n_axes,), in [rad] or [m].
        """
        return all(self.is_safe(here + s * (there - here)) for s in np.linspace(0, 1, 15))

    def place(self, pose: np.ndarray) -> Place:
        """Return where the tool is.

        Args:
            pose: Joint positions, shape (n_axes,), in [rad] or [m].
        """
        return Place(pose, *self.arm.tool_pose(pose))

    def at(self, point: np.ndarray, turned: Rotation, near: np.ndarray) -> Place | None:
        """Find a pose of the arm for a pose of the tool.

        Args:
            point: Position of the tool, shape (3,), in [m].
            turned: Orientation of the tool.
            near: Joint positions from which the search starts, shape (n_axes,).

        Returns:
            The place; None if it cannot be reached from there, or if the arm cannot be there.
        """
        pose = self.arm.follow(point, turned, near)
        return None if pose is None or not self.is_safe(pose) else Place(pose, point, turned)

    def outward(self, point: np.ndarray) -> np.ndarray:
        """Return the horizontal direction from the base to a point.

        Args:
            point: Shape (3,), in [m].

        Returns:
            Unit vector, shape (3,).
        """
        level = (point - self.base) - ((point - self.base) @ self.down) * self.down
        return np.asarray(level / max(float(np.linalg.norm(level)), 1e-9))

    def best(self, downward: bool, count: int) -> list[np.ndarray]:
        """Choose poses in which the tool points downward, or outward, with room on all sides.

        Args:
            downward: Whether the tool points downward.
            count: Number of poses.

        Returns:
            Poses, the best first, shape (n_axes,) each.
        """
        scores = []
        for pose in self.poses:
            place = self.place(pose)
            goal = self.down if downward else self.outward(place.point)
            aimed = float(place.turned.as_matrix()[:, 2] @ goal)
            distance = float(np.linalg.norm(place.point - self.base)) / self.reach
            score = aimed - 2 * abs(distance - _WANTED) + 2 * min(self._dexterity(pose), 0.2)
            if self.home is not None:
                score -= _NEAR * float(np.mean(np.abs(pose - self.home) / self.span)) * 4
            scores.append(score)
        order = np.argsort(scores)[::-1][:count]
        return [self.poses[k] for k in order]

    def _dexterity(self, pose: np.ndarray) -> float:
        """The smallest singular value of the tool's Jacobian, lengths over the reach."""
        model = self.arm.model
        self._points(pose)
        mujoco.mj_comPos(model, self._data)
        both = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, self._data, both[:3], both[3:], self._data.site("tool").id)
        both[:3] /= self.reach
        return float(np.linalg.svd(both, compute_uv=False)[-1])

    def far_from(self, here: np.ndarray, there: np.ndarray, count: int) -> list[np.ndarray]:
        """Choose poses between two others on whose way every axis turns much.

        Args:
            here: Joint positions before, shape (n_axes,), in [rad] or [m].
            there: Joint positions after, shape (n_axes,), in [rad] or [m].
            count: Number of poses.

        Returns:
            Poses, the best first, shape (n_axes,) each.
        """
        change = np.minimum(np.abs(self.poses - here), np.abs(self.poses - there)) / self.span
        order = np.argsort(change.min(axis=1))[::-1]
        found: list[np.ndarray] = []
        for pose in self.poses[order]:
            if self.is_clear(here, pose) and self.is_clear(pose, there):
                found.append(pose)
            if len(found) == count:
                break
        return found
