"""Planned motions for controllers: CSV, a ROS 2 trajectory, and a program for Universal Robots.

motion = plan(load_task("puma560", "spot_weld"), load_robot("puma560"))
text = motion_text(motion, "csv", 0.008)
"""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.mjcf.elements import stated_name
from faultgen.simulation.motion import Motion

FORMATS = {"csv": ".csv", "ros2": ".json", "urscript": ".script"}
"""Formats, and the endings of their files."""
SHORTEST, LONGEST = 0.001, 0.1
"""Times between samples that are written [s]."""

_MOVEJ_SPEED, _MOVEJ_ACCELERATION = 0.5, 0.5  # to the start [rad/s], [rad/s^2]: slow, assumed
_LOOKAHEAD, _GAIN = 0.1, 300  # of servoj: defaults of Universal Robots' script manual
_STOP = 2.0  # deceleration at the end [rad/s^2]


def motion_text(motion: Motion, form: str, sample_period: float) -> str:
    """Write one cycle of a motion for a controller.

    Args:
        motion: The motion.
        form: One of `FORMATS`.
        sample_period: Time between samples [s]. The last one is where the cycle ends.

    Returns:
        Text of the file.

    Raises:
        InputError: The format is unknown or cannot express the motion, or the time between samples
            is outside of its range.
    """
    if form not in FORMATS:
        raise InputError(f"--motion-format: must be {', '.join(FORMATS)}, not '{form}'")
    if not SHORTEST <= sample_period <= LONGEST:
        raise InputError(
            f"--sample-period: must be {SHORTEST:g} to {LONGEST:g} s, not {sample_period:g}"
        )
    count = int(np.ceil(motion.period / sample_period - 1e-9))
    times = np.append(sample_period * np.arange(count), motion.period)
    states = motion(np.where(times < motion.period, times, 0.0))  # a cycle ends where it begins
    robot = motion.robot
    names = [stated_name(robot.model, k + 1) or f"joint{k + 1}" for k in range(robot.n_axes)]
    if form == "csv":
        return _csv(names, robot.slides, times, states)
    if form == "ros2":
        return _ros2(names, times, states)
    if robot.n_axes != 6 or robot.slides.any():
        raise InputError(
            f"--motion-format urscript: needs an arm with six hinges; {robot.name} has other axes, "
            "so write csv or ros2"
        )
    return _urscript(motion.task.name, times, states[0], sample_period)


def _csv(
    names: list[str], slides: np.ndarray, times: np.ndarray, states: tuple[np.ndarray, ...]
) -> str:
    units = ["m" if slide else "rad" for slide in slides]
    kinds = (("position", ""), ("velocity", "/s"), ("acceleration", "/s^2"))
    head = ["time [s]"]
    head += [
        f"{name} {what} [{unit}{per}]"
        for what, per in kinds
        for name, unit in zip(names, units, strict=True)
    ]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in np.column_stack([times, *states]):
        writer.writerow([_short(x) for x in row])
    return text.getvalue()


def _ros2(names: list[str], times: np.ndarray, states: tuple[np.ndarray, ...]) -> str:
    """A message trajectory_msgs/msg/JointTrajectory with the fields of ROS 2."""
    points: list[dict[str, Any]] = []
    for time, position, velocity, acceleration in zip(times, *states, strict=True):
        nanoseconds = round(float(time) * 1e9)
        points.append(
            {
                "positions": [_rounded(x) for x in position],
                "velocities": [_rounded(x) for x in velocity],
                "accelerations": [_rounded(x) for x in acceleration],
                "effort": [],
                "time_from_start": {
                    "sec": nanoseconds // 10**9,
                    "nanosec": nanoseconds % 10**9,
                },
            }
        )
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    message = {"header": header, "joint_names": names, "points": points}
    return json.dumps(message, allow_nan=False) + "\n"


def _urscript(name: str, times: np.ndarray, positions: np.ndarray, period: float) -> str:
    """A program that goes to the start with movej, and follows the motion with servoj.

    Source: Universal Robots, The URScript Programming Language: movej(q, a, v),
    servoj(q, a, v, t, lookahead_time, gain), in which a and v are not used, and stopj(a).
    """
    lines = [
        f"# {name}: {times[-1]:.3f} s, a position every {period:g} s.",
        "# The last step is shorter than the others, and takes as long as they.",
        f"def {_identifier(name)}():",
        f"  movej({_pose(positions[0])}, a={_MOVEJ_ACCELERATION}, v={_MOVEJ_SPEED})",
    ]
    lines += [
        f"  servoj({_pose(pose)}, t={period:g}, lookahead_time={_LOOKAHEAD}, gain={_GAIN})"
        for pose in positions[1:]
    ]
    return "\n".join([*lines, f"  stopj({_STOP})", "end", ""])


def _identifier(name: str) -> str:
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)
    return plain if plain[:1].isalpha() else f"motion_{plain}"


def _pose(pose: np.ndarray) -> str:
    return "[" + ", ".join(f"{x:.6f}" for x in pose) + "]"


def _rounded(value: float) -> float:
    return float(_short(value))


def _short(value: float) -> str:
    return f"{value:.9g}"
