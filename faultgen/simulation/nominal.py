"""What all runs of a robot and task share: the motion, its control, and what monitoring needs.

shared = nominal("puma560", "spot_weld", 0.004)
shared.control.shape, shared.samples
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from faultgen.errors import InputError
from faultgen.monitoring.reductions import Limits, default_window
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.tasks import load_task

_MOST_STEPS = 5e6  # in a cycle; bounds the memory
_BEYOND = 1.2  # design limit over what a task needs, where the robot gives none


@dataclass(frozen=True)
class Nominal:
    """What all runs of a robot and task share."""

    robot: Robot
    control: np.ndarray
    mean_torque: np.ndarray
    """Mean |torque| of the motors, shape (n_axes,), in [N m]."""
    samples: int
    """In a cycle."""
    speed: np.ndarray
    """Planned |motor speed| of each sample, shape (samples, n_axes), in [rad/s]."""
    limits: Limits
    """Design values that the histograms span."""

    def speed_window(self, chosen: Sequence[Sequence[float]] | None) -> np.ndarray:
        """Speed window of `mean_abs_torque`.

        Args:
            chosen: Low and high motor speed of each axis [rad/s]; None or empty: from the motion.

        Returns:
            Shape (n_axes, 2), in [rad/s].
        """
        return np.array(chosen) if chosen else default_window(self.speed)


@lru_cache(maxsize=4)
def nominal(robot_name: str, task_name: str, sample_period: float) -> Nominal:
    """Plan a task and its control; kept for the runs that follow in this process.

    Raises:
        InputError: The task cannot be done by the robot, takes too many steps, or is shorter than a
            sample.
    """
    robot = load_robot(robot_name)
    motion = plan(load_task(robot.name, task_name), robot)
    timestep = robot.model.opt.timestep
    if motion.period / timestep > _MOST_STEPS:
        raise InputError(
            f"task {task_name}: a cycle of {motion.period:g} s has more than {_MOST_STEPS:g} steps "
            f"of {timestep:g} s; make the task shorter or the step longer"
        )
    control = control_signal(motion, timestep)
    feed_forward = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")] + 2
    every = round(sample_period / timestep)
    if len(control) < 2 * every:
        raise InputError(
            f"sample_period: must be well below the cycle of {motion.period:g} s, "
            f"not {sample_period:g} s"
        )
    speed, torque = np.abs(control[:, feed_forward - 1]), np.abs(control[:, feed_forward])
    angle = control[:, feed_forward - 2] / robot.gear_ratio
    return Nominal(
        robot=robot,
        control=control,
        mean_torque=torque.mean(axis=0),
        samples=-(-len(control) // every),
        speed=speed[::every],
        limits=_limits(robot, angle, speed.max(axis=0), torque.max(axis=0)),
    )


def _limits(robot: Robot, angle: np.ndarray, speed: np.ndarray, torque: np.ndarray) -> Limits:
    """Design values; where the robot gives none, somewhat more than the task needs."""

    def given(limit: np.ndarray, top: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(limit), limit, np.where(top > 0, _BEYOND * top, 1.0))

    middle = (angle.max(axis=0) + angle.min(axis=0)) / 2
    reach = np.maximum(_BEYOND * np.ptp(angle, axis=0) / 2, 1e-3)
    needed = np.stack([middle - reach, middle + reach], axis=1)
    return Limits(
        given(robot.motor_torque_limit, torque),
        given(robot.motor_velocity_limit, speed),
        np.where(np.isfinite(robot.joint_range), robot.joint_range, needed),
        robot.gear_ratio,
    )
