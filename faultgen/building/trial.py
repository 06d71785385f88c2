"""One second of simulation: does a robot follow its reference without diverging?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.building.findings import Finding
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import Robot
from faultgen.simulation.motion import Motion, plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import Task, load_task

SECONDS = 1.0
"""Time that is simulated [s]."""

_LARGEST_LAG = 0.02  # of a joint behind its reference [rad or m]
_SPAN = 0.05  # of the move that is made where the robot has no task [rad or m]


def trial(robot: Robot, tasks: Sequence[str], figures: dict[str, float]) -> list[Finding]:
    """Simulate one second of a robot's first task, or of a small move where it has none.

    Args:
        robot: The robot.
        tasks: Names of the tasks that it can do.
        figures: Largest lag and torque are written here, by name.

    Returns:
        Findings.
    """
    try:
        motion = _motion(robot, tasks)
        control = control_signal(motion, robot.model.opt.timestep)
        steps = round(SECONDS / robot.model.opt.timestep)
        control = np.resize(control, (max(steps, len(control)), control.shape[1]))[:steps]
        period = robot.model.opt.timestep
        (cycle,) = simulate(robot, control, [assemble(robot)], sample_period=period, lead_in=0.0)
    except SimulationFailed as error:
        remedy = "make the time step smaller, the gearboxes softer, or the servo gains lower"
        return [Finding("simulation", str(error), remedy)]
    except InputError as error:
        return [Finding("simulation", str(error), "see the other findings")]
    at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
    lag = np.abs(control[:, at] - cycle.motor_position) / np.abs(robot.gear_ratio)
    used = np.abs(cycle.motor_torque) / robot.motor_torque_limit
    units = np.where(robot.slides, "m", "rad")
    for unit in np.unique(units):
        figures[f"largest lag of a joint [{unit}]"] = float(lag[:, units == unit].max())
    figures["largest torque, as a share of its limit"] = float(used.max())
    return [
        Finding(
            robot.label("axis ", k + 1),
            f"its motor is {lag[:, k].max():.3g} {units[k]} (at the joint) behind its reference in "
            "the first second",
            "raise its servo gains or its torque limit",
        )
        for k in np.flatnonzero(lag.max(axis=0) > _LARGEST_LAG).tolist()
    ]


def _motion(robot: Robot, tasks: Sequence[str]) -> Motion:
    if tasks:
        return plan(load_task(robot.name, tasks[0], robot.tasks), robot)
    low, high = robot.joint_range.T
    middle = np.clip(np.zeros(robot.n_axes), low, high)
    away = np.clip(middle + _SPAN, low, high)
    there, back = ({"joints": robot.to_degrees(pose).tolist()} for pose in (away, middle))
    moves = [{**there, "speed": 0.5}, {**back, "speed": 0.5, "dwell": SECONDS}]
    content = {"name": "trial", "robot": robot.name, "description": "a small move"}
    return plan(Task.model_validate({**content, "start": back, "move": moves}), robot)
