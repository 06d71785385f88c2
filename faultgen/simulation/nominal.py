"""What all runs of a robot and task share: the control signal and what monitoring needs.

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
from faultgen.simulation.motion import plan, shifted
from faultgen.simulation.operation import AS_PROGRAMMED, Operation
from faultgen.simulation.servo import commanded, planned
from faultgen.tasks import load_task

_MOST_STEPS = 5e6  # in a cycle; bounds the memory
_BEYOND = 1.2  # design limit over what a task needs, where the robot gives none


@dataclass(frozen=True)
class Nominal:
    """What all runs of a robot and task share."""

    robot: Robot
    """The healthy robot with its payload."""
    control: np.ndarray
    """Control signal of one cycle, shape (steps, n_controls), from `control_signal`."""
    mean_torque: np.ndarray
    """Mean |torque| of the motors in the planned motion, shape (n_axes,), in [N m]."""
    samples: int
    """Number of samples in a cycle."""
    position: np.ndarray
    """Commanded joint position of each sample, shape (samples, n_axes), in [rad], or [m]."""
    speed: np.ndarray
    """Planned |motor speed| of each sample, shape (samples, n_axes), in [rad/s]."""
    limits: Limits
    """Design values of the robot, which set the ranges of the histograms."""

    def speed_window(self, chosen: Sequence[Sequence[float]] | None) -> np.ndarray:
        """Return the speed window of `mean_abs_torque`.

        Args:
            chosen: Low and high motor speed of each axis [rad/s]. If it is None or empty, the
                default for the planned motion is used.

        Returns:
            Low and high motor speed, shape (n_axes, 2), in [rad/s].
        """
        return np.array(chosen) if chosen else default_window(self.speed)


def nominal(
    robot_name: str, task_name: str, sample_period: float, operation: Operation = AS_PROGRAMMED
) -> Nominal:
    """Plan a task and compute its control signal.

    The results of the last calls are kept in memory for the following runs of this process.

    Args:
        robot_name: Name of the robot, or path of an MJCF file.
        task_name: Name of the task, or path of a task file.
        sample_period: Time between samples [s].
        operation: Speed and payload. Default: those of the task and the model. The temperature
            changes nothing here.

    Returns:
        What the runs of this robot and task share.

    Raises:
        InputError: The robot cannot do the task, or a cycle has too many steps or fewer than two
            samples.
    """
    return _nominal(
        robot_name, task_name, sample_period, Operation(operation.speed, operation.payload)
    )


@lru_cache(maxsize=4)
def _nominal(
    robot_name: str, task_name: str, sample_period: float, operation: Operation
) -> Nominal:
    robot = operation.loaded(load_robot(robot_name))
    motion = plan(load_task(robot.name, task_name, robot.tasks), robot)
    if operation.speed is not None:
        motion = shifted(motion, robot, np.zeros(robot.n_axes), operation.speed)
    timestep = robot.model.opt.timestep
    if motion.period / timestep > _MOST_STEPS:
        raise InputError(
            f"task {task_name}: a cycle of {motion.period:g} s has more than {_MOST_STEPS:g} steps "
            f"of {timestep:g} s; make the task shorter or the step longer"
        )
    needed = planned(motion, timestep)
    control = commanded(robot, needed)
    every = round(sample_period / timestep)
    if len(control) < 2 * every:
        raise InputError(
            f"sample_period: must be well below the cycle of {motion.period:g} s, "
            f"not {sample_period:g} s"
        )
    # not the set points: a controller may command positions only
    speed, torque = np.abs(needed.speed), np.abs(needed.torque)
    angle = needed.angle / robot.gear_ratio
    return Nominal(
        robot=robot,
        control=control,
        mean_torque=torque.mean(axis=0),
        samples=-(-len(control) // every),
        position=robot.gearing.joints(needed.angle[::every]),
        speed=speed[::every],
        limits=_limits(robot, angle, speed.max(axis=0), torque.max(axis=0)),
    )


def _limits(robot: Robot, angle: np.ndarray, speed: np.ndarray, torque: np.ndarray) -> Limits:
    """Design values of the robot; where it gives none, 1.2 times what the task needs."""

    def given(limit: np.ndarray, top: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(limit), limit, np.where(top > 0, _BEYOND * top, 1.0))

    middle = (angle.max(axis=0) + angle.min(axis=0)) / 2
    reach = np.maximum(_BEYOND * np.ptp(angle, axis=0) / 2, 1e-3)
    needed = np.stack([middle - reach, middle + reach], axis=1)
    # the angle of a coupled gearbox is not that of a joint
    known = np.isfinite(robot.joint_range).all(axis=1) & ~robot.gearing.coupled
    return Limits(
        given(robot.motor_torque_limit, torque),
        given(robot.motor_velocity_limit, speed),
        np.where(known[:, None], robot.joint_range, needed),
        robot.gear_ratio,
    )
