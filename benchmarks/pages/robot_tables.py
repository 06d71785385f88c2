"""Tables of a robot's tasks: timing, motor torque, tracking, and what 20 % more friction does.

Every number comes of a simulated cycle (noise free, 4 ms); prints markdown.

    python -m benchmarks.pages.robot_tables irb6700
"""

from __future__ import annotations

import sys
from collections.abc import Iterable

import mujoco
import numpy as np

from faultgen.evaluation.markdown import table
from faultgen.monitoring.reductions import SPEED_WINDOW
from faultgen.robot import COULOMB, STICTION, Robot, load_robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import Motion, plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import Cycle, simulate
from faultgen.tasks import load_task, task_names

SAMPLE_PERIOD = 0.004
WEAR = 1.2
THESIS = {  # table 6.1: mean, standard deviation, increment by 20 % wear in that axis [N m]
    "pick_and_place": (
        [18.42, 7.45, 15.20, 1.95, 2.53, 1.90],
        [6.85, 4.29, 2.39, 2.00, 0.97, 1.05],
        [0.24, 0.27, 0.39, -0.06, 0.12, 0.12],
    ),
    "spot_weld": (
        [3.22, 7.67, 10.61, 1.14, 1.45, 1.07],
        [5.10, 7.72, 7.12, 1.34, 1.34, 1.04],
        [0.14],
    ),
    "arc_weld": (
        [6.23, 10.30, 13.99, 1.93, 2.45, 2.27],
        [2.29, 4.16, 5.60, 1.72, 1.01, 0.68],
        [0.45],
    ),
}


def cycle_of(motion: Motion, model: mujoco.MjModel) -> Cycle:
    """Simulate one cycle of a motion.

    Args:
        motion: The motion.
        model: The model.

    Returns:
        The cycle.
    """
    control = control_signal(motion, model.opt.timestep)
    return next(iter(simulate(motion.robot, control, [model], sample_period=SAMPLE_PERIOD)))


def worn(robot: Robot, axis: int) -> mujoco.MjModel:
    """Return the robot with more Coulomb and static friction in one axis.

    Args:
        robot: The healthy robot.
        axis: Axis, from 1.

    Returns:
        The model.
    """
    spec = robot.spec()
    for index in (COULOMB, STICTION):
        spec.actuator(f"friction{axis}").biasprm[index] *= WEAR
    return spec.compile()


def window_torque(cycle: Cycle) -> tuple[np.ndarray, np.ndarray]:
    """Compute mean and standard deviation of |motor torque| while the speed is in the window.

    Args:
        cycle: The cycle.

    Returns:
        Two arrays of shape (n_axes,), in [N m].
    """
    speed, torque = np.abs(cycle.motor_velocity), np.abs(cycle.motor_torque)
    inside = np.where((speed >= SPEED_WINDOW[0]) & (speed <= SPEED_WINDOW[1]), torque, np.nan)
    return np.nanmean(inside, axis=0), np.nanstd(inside, axis=0)


def tracking(motion: Motion, cycle: Cycle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors against the reference, by sample.

    Args:
        motion: The reference.
        cycle: The simulated cycle.

    Returns:
        Error of the motor over its gear ratio, shape (samples, n_axes), in [rad]; and the way of
        the tool from its reference, by the motors and by the joints, shape (samples,), in [m].
    """
    times = np.arange(len(cycle.motor_position)) * SAMPLE_PERIOD
    reference = motion(times)[0]
    motor = cycle.motor_position / motion.robot.gear_ratio
    arm = Arm(motion.robot)
    ideal, driven, real = (
        np.array([arm.tool_pose(q)[0] for q in path])
        for path in (reference, motor, cycle.joint_position)
    )
    off = [np.linalg.norm(path - ideal, axis=1) for path in (driven, real)]
    return motor - reference, off[0], off[1]


def row(*cells: str | float | Iterable[float], digits: int = 2) -> list[str]:
    """Return a row of a table.

    Args:
        cells: Texts, numbers or arrays. Each element of an array is a cell.
        digits: Digits after the point.

    Returns:
        The cells of the row.
    """
    out = []
    for cell in cells:
        if isinstance(cell, str):
            out.append(cell)
        else:
            out += [f"{v + 0.0:.{digits}f}" for v in np.atleast_1d(np.asarray(cell, float))]
    return out


def spread(mean: Iterable[float], deviation: Iterable[float]) -> list[str]:
    """Return cells with mean ± standard deviation.

    Args:
        mean: Means.
        deviation: Standard deviations.

    Returns:
        The cells.
    """
    return [f"{m:.2f} ± {d:.2f}" for m, d in zip(mean, deviation, strict=True)]


def rms(values: np.ndarray) -> np.ndarray:
    """Compute the root mean square over samples.

    Args:
        values: Shape (samples, n_axes), in any unit.

    Returns:
        Shape (n_axes,), in the same unit.
    """
    return np.sqrt(np.mean(np.square(values), axis=0))


def main(name: str) -> None:
    """Print the tables of a robot.

    Args:
        name: A robot that comes with the package, or the path of an MJCF file.
    """
    robot = load_robot(name)
    axes = [f"axis {i + 1}" for i in range(robot.n_axes)]
    motions = {task: plan(load_task(name, task), robot) for task in task_names(name)}
    cycles = {task: cycle_of(motion, robot.model) for task, motion in motions.items()}

    print("### Range of each axis over the cycle [% of its design range]\n")
    rows = []
    for task, motion in motions.items():
        span = np.ptp(motion(np.arange(0, motion.period, SAMPLE_PERIOD))[0], axis=0)
        share = span / np.ptp(robot.joint_range, axis=1)
        rows.append(row(task, f"{motion.period:.2f}", 100 * share))
    print(table(["task", "cycle [s]", *axes], rows))

    print("\n### Share of the cycle with motor speed in 50..120 rad/s [%]\n")
    rows = [row(task, 100 * motion.window_share, digits=1) for task, motion in motions.items()]
    print(table(["task", *axes], rows))

    print("\n### Peak motor torque [% of the limit]\n")
    rows = []
    for task, cycle in cycles.items():
        share = np.abs(cycle.motor_torque).max(axis=0) / robot.motor_torque_limit
        rows.append(row(task, 100 * share, digits=0))
    print(table(["task", *axes], rows))

    print("\n### Tracking: motor error over gear ratio, rms / peak [mrad]; tool error [mm]\n")
    rows = []
    for task, motion in motions.items():
        error, driven, real = tracking(motion, cycles[task])
        pairs = zip(1e3 * rms(error), 1e3 * np.abs(error).max(axis=0), strict=True)
        tool = [f"{1e3 * rms(d):.1f} / {1e3 * d.max():.1f}" for d in (driven, real)]
        rows.append(row(task, *[f"{r:.2f} / {p:.2f}" for r, p in pairs], *tool))
    tools = ["tool by motors, rms / peak", "tool by joints, rms / peak"]
    print(table(["task", *axes, *tools], rows))

    print("\n### Mean ± s.d. of |motor torque| in 50..120 rad/s, and 20 % more friction [N m]\n")
    rows = []
    for task in [task for task in THESIS if task in motions]:
        mean, deviation = window_torque(cycles[task])
        more = [
            window_torque(cycle_of(motions[task], worn(robot, i + 1)))[0][i] - mean[i]
            for i in range(robot.n_axes)
        ]
        rows.append(row(task, "ours", *spread(mean, deviation)))
        rows.append(row("", "ours, increment", *[f"{v:+.2f}" for v in more]))
        if name == "irb6700":
            means, deviations, increments = THESIS[task]
            gap = [""] * (robot.n_axes - len(increments))
            rows.append(row("", "thesis", *spread(means, deviations)))
            rows.append(row("", "thesis, increment", *[f"{v:+.2f}" for v in increments], *gap))
    print(table(["task", "", *axes], rows))

    slow = {task: cycle for task, cycle in cycles.items() if task.startswith("chapter3")}
    if slow:
        print("\n### Joint torque = motor torque x |gear ratio| [N m]; CV is of the samples\n")
        rows = []
        for task, cycle in slow.items():
            torque = np.abs(cycle.motor_torque * robot.gear_ratio)
            sampled = torque[:: round(10 / SAMPLE_PERIOD)]
            rows.append(row(task, "largest", torque.max(axis=0)))
            rows.append(row("", "largest of a sample every 10 s", sampled.max(axis=0)))
            cv = sampled.std(axis=0) / np.maximum(sampled.mean(axis=0), 1e-9)
            rows.append(row("", "CV", cv))
        print(table(["task", "", *axes], rows))


if __name__ == "__main__":
    main(sys.argv[1])
