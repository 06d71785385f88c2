"""One cycle of a robot, healthy and worn, as `faultgen view` plays it.

healthy, worn = play("puma560", "spot_weld", effect="friction_wear", axis=2, severity=0.5)
worn.torque - healthy.torque
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.effects import Applied, get_effect
from faultgen.errors import InputError
from faultgen.monitoring.sensors import Measured
from faultgen.robot import Robot, load_robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.plant import assemble
from faultgen.simulation.stepping import simulate
from faultgen.tasks import task_names

SAMPLE_PERIOD = 0.004
"""Time between samples [s]."""

_USUAL_TASK = "pick_and_place"
_USUAL_EFFECT = "friction_wear"


@dataclass(frozen=True)
class Playback:
    """One cycle of one robot."""

    robot: Robot
    """The healthy robot."""
    task: str
    """Name of the task, or path of its file."""
    name: str
    """'healthy', or the fault in words."""
    axis: int
    """Axis with the fault, from 1; 0 for the healthy robot."""
    times: np.ndarray
    """Time since the start of the cycle, shape (samples,), in [s]."""
    position: np.ndarray
    """Positions of the joints, shape (samples, n_axes), in [rad], or [m] for slides."""
    torque: np.ndarray
    """Motor torque as the controller logs it, same shape, in [N m]."""


def play(
    robot: str,
    task: str | None = None,
    *,
    effect: str | None = None,
    axis: int | None = None,
    severity: float | None = None,
) -> list[Playback]:
    """Simulate a cycle of the healthy robot and, if a fault is given, one of the faulty robot.

    Args:
        robot: Name of the robot, or path of its MJCF file or folder.
        task: Name of the task, or path of a task file. Default: pick_and_place, or the first task
            of a robot that does not have it.
        effect: Name of the effect. Default: none, or friction_wear if an axis or severity is given.
        axis: Axis on which it acts, from 1. Default: the first one on which it can act.
        severity: Severity in the unit of the effect. Default: that of datasets.

    Returns:
        The healthy cycle and, if there is a fault, the faulty one.

    Raises:
        InputError: There is no such robot, task, effect or axis, or the severity is out of range.
        SimulationFailed: The simulation diverged.
    """
    machine = load_robot(robot)
    fault = _fault(machine, effect, axis, severity)
    shared = nominal(robot, task or first_task(machine), SAMPLE_PERIOD)
    cycles = [
        _cycle(machine, shared.control, fault_of) for fault_of in ([], fault)[: 1 + len(fault)]
    ]
    names = ["healthy", *(_in_words(one, machine) for one in fault)]
    return [
        Playback(
            robot=machine,
            task=task or first_task(machine),
            name=name,
            axis=fault[0].axis if number else 0,
            times=np.arange(len(torque)) * SAMPLE_PERIOD,
            position=position,
            torque=torque,
        )
        for number, (name, (position, torque)) in enumerate(zip(names, cycles, strict=True))
    ]


def first_task(robot: Robot) -> str:
    """Choose the task of a robot if none is given.

    Args:
        robot: The robot.

    Returns:
        pick_and_place, or the first of its tasks if it does not have that one.

    Raises:
        InputError: The robot has no tasks.
    """
    names = task_names(robot.name, robot.tasks)
    if not names:
        raise InputError(f"robot {robot.name}: has no tasks of its own; give --task FILE.toml")
    return _USUAL_TASK if _USUAL_TASK in names else names[0]


def _fault(
    robot: Robot, effect: str | None, axis: int | None, severity: float | None
) -> list[Applied]:
    """The fault that was asked for, as a list of at most one."""
    if effect is None and axis is None and severity is None:
        return []
    law = get_effect(effect or _USUAL_EFFECT)
    possible = law.usual_axes_on(robot)
    if not possible:
        raise InputError(f"effect {law.name}: cannot act on any axis of robot {robot.name}")
    chosen = possible[0] if axis is None else axis
    strength = law.default if severity is None else severity
    if not law.smallest <= strength <= max(law.largest, law.point_largest):
        raise InputError(
            f"severity: {law.name} takes {law.smallest:g} to {law.largest:g} ({law.unit}), "
            f"not {strength:g}"
        )
    if 1 <= chosen <= robot.n_axes:
        law.check_severity(strength, robot, chosen)
    return [Applied(law.name, chosen, strength, {})]


def _in_words(fault: Applied, robot: Robot) -> str:
    effect = get_effect(fault.effect)
    shown = effect.shown(fault.severity, effect.units_on(robot, fault.axis))
    return f"axis {fault.axis}: {fault.effect} {shown}"


def _cycle(
    robot: Robot, control: np.ndarray, faults: list[Applied]
) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions and logged motor torques of one cycle."""
    plant = assemble(robot, faults)
    (cycle,) = simulate(robot, control, [plant], sample_period=SAMPLE_PERIOD)
    logged = Measured(cycle.motor_position, cycle.motor_velocity, cycle.motor_torque)
    # the only random numbers are those of faulty sensors
    logged = plant.sense(logged, SAMPLE_PERIOD, np.random.default_rng(0))
    return cycle.joint_position, logged.motor_torque
