"""What all runs of a robot and task share: the motion, its control, and what monitoring needs.

shared = nominal("puma560", "spot_weld", 0.004)
shared.control.shape, shared.samples
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from faultgen.errors import InputError
from faultgen.experiment import Run
from faultgen.machine import assemble
from faultgen.monitoring import SPEED_WINDOW, Limits, default_window
from faultgen.motion import plan
from faultgen.robot import Robot, load_robot
from faultgen.servo import control_signal
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

    def speed_window(self, run: Run) -> np.ndarray:
        """Speed window of `mean_abs_torque` in a run, shape (n_axes, 2), in [rad/s]."""
        return np.array(run.speed_window) if run.speed_window else default_window(self.speed)


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


def check_runs(runs: Sequence[Run]) -> list[str]:
    """Plan the motions of runs and put their faults into the robot, before anything is simulated.

    Args:
        runs: All runs of a dataset.

    Returns:
        For each robot and task at most one line: which axes never turn within the speed window.

    Raises:
        InputError: A task cannot be done, a fault cannot be put into the robot, or no more than
            one sample of a cycle would be kept.
    """
    notes = []
    for run in {(r.robot, r.task, r.sample_period): r for r in runs}.values():
        shared = nominal(run.robot, run.task, run.sample_period)
        if run.thin > 1 and run.thin >= shared.samples:
            raise InputError(
                f"thin: must be below the {shared.samples} samples of a cycle, not {run.thin}"
            )
        note = _window_note(shared, run)
        if note:
            notes.append(f"{shared.robot.name}, {Path(run.task).stem}: {note}")
    faulty = {(r.robot, r.effect, r.axes, r.parameters, r.beside): r for r in runs if r.axes}
    for run in faulty.values():
        shared = nominal(run.robot, run.task, run.sample_period)
        try:
            assemble(shared.robot, run.faults)
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{run.label}: cannot be simulated ({reason})") from None
    return notes


def _window_note(shared: Nominal, run: Run) -> str:
    """Which axes never turn within the speed window, and what is done about them."""
    low, high = shared.speed_window(run).T
    inside = ((shared.speed >= low) & (shared.speed <= high)).any(axis=0)
    thesis = (low == SPEED_WINDOW[0]) & (high == SPEED_WINDOW[1])
    own = np.flatnonzero(~thesis) + 1 if not run.speed_window else np.empty(0, int)
    parts = []
    if len(own):
        used = ", ".join(f"{low[a - 1]:.3g} to {high[a - 1]:.3g} (axis {a})" for a in own.tolist())
        window = "{:g} to {:g} rad/s".format(*SPEED_WINDOW)
        parts.append(f"{_never(own)} at {window}; mean_abs_torque uses {used} rad/s")
    if not inside.all():
        never = _never(np.flatnonzero(~inside) + 1)
        parts.append(f"{never} within the speed window; mean_abs_torque is nan there")
    return "; ".join(parts)


def _never(axes: np.ndarray) -> str:
    listed = ", ".join(map(str, axes.tolist()))
    return f"axis {listed} never turns" if len(axes) == 1 else f"axes {listed} never turn"
