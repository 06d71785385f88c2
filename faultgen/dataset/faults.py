"""The faults of an experiment: effects, axes and severities, and the checks that they pass."""

from __future__ import annotations

from typing import TypeAlias

from faultgen.dataset.experiment import Experiment
from faultgen.effects import HEALTHY, Applied, get_effect
from faultgen.errors import InputError
from faultgen.robot import Robot
from faultgen.simulation.plant import check_axis

Fault: TypeAlias = tuple[str, tuple[int, ...], float]
"""Effect, axes and final severity of a run."""


def list_faults(experiment: Experiment, robot: Robot) -> list[Fault]:
    """List the fault of every run of an experiment on one robot.

    Args:
        experiment: The experiment.
        robot: The robot.

    Returns:
        Effect, axes and final severity of each run. A run of severity 0 is that of the healthy
        robot, and occurs once.

    Raises:
        InputError: The robot does not have an axis, an effect cannot act on an axis or on the
            robot, a severity is too large, or the severities of one run have no common unit.
    """
    healthy: Fault = (HEALTHY, (), 0.0)
    found: dict[Fault, None] = {healthy: None} if experiment.healthy else {}
    for axes in experiment.axis or []:
        _check_axes(axes, robot)
    for name in experiment.effect:
        if name == HEALTHY:
            found[healthy] = None
            continue
        effect = get_effect(name)
        for axes in experiment.axis or [[axis] for axis in effect.usual_axes_on(robot)]:
            for severity in experiment.severities_of(name):
                worn = severity > 0 or not isinstance(experiment.schedule, str)
                fault: Fault = (name, tuple(sorted(axes)), float(severity)) if worn else healthy
                found[fault] = None
        if experiment.axis is None and not effect.axes_on(robot):
            reason = ", whose payload has no mass" if effect.payload is not None else ""
            raise InputError(f"effect: {name} cannot act on robot {robot.name}{reason}")
    for name, worn_axes, severity in found:
        peak = severity if isinstance(experiment.schedule, str) else max(experiment.schedule)
        own = [Applied(name, axis, peak) for axis in worn_axes]
        _check_faults([*own, *beside_of(experiment, worn_axes)], robot)
    return list(found)


def _check_faults(faults: list[Applied], robot: Robot) -> None:
    """Refuse faults of one run that are impossible, too large, or have no common unit."""
    units: dict[str, str] = {}
    for one in faults:
        effect = get_effect(one.effect)
        check_axis(effect, one.axis, robot)
        effect.check_severity(one.severity, robot, one.axis)
        unit = effect.units_on(robot, one.axis)
        if units.setdefault(one.effect, unit) != unit:
            raise InputError(
                f"axis: the severity of {one.effect} is {_in_words(units[one.effect])} on some "
                f"axes of robot {robot.name} and {_in_words(unit)} on axis {one.axis}; put these "
                "axes into separate runs"
            )


def _in_words(unit: str) -> str:
    return "a fraction" if unit == "1" else f"in {unit}"


def beside_of(experiment: Experiment, axes: tuple[int, ...]) -> tuple[Applied, ...]:
    """List the further effects of one run of an experiment.

    Args:
        experiment: The experiment.
        axes: Axes on which the main effect of the run acts; empty for a healthy run.

    Returns:
        The further effects with their final severities; empty for a healthy run.
    """
    return tuple(
        Applied(one.effect, axis, one.severity, one.parameters)
        for one in experiment.beside
        for axis in ((one.axis,) if one.axis is not None and axes else axes)
    )


def _check_axes(axes: list[int], robot: Robot) -> None:
    for axis in axes:
        if not 1 <= axis <= robot.n_axes:
            raise InputError(
                f"axis {axis}: robot {robot.name} has axes 1 to {robot.n_axes} "
                f"(to run only the healthy robot, give the effect '{HEALTHY}')"
            )
    if len(set(axes)) != len(axes):
        raise InputError(f"axis {axes}: the same axis is given twice")


def window_of(experiment: Experiment, robot: Robot) -> tuple[tuple[float, float], ...]:
    """Return the speed window that an experiment gives for each axis of a robot.

    Args:
        experiment: The experiment.
        robot: The robot.

    Returns:
        Low and high motor speed of each axis [rad/s]; empty if the experiment gives none.

    Raises:
        InputError: The number of pairs is neither one nor the number of axes.
    """
    given = experiment.speed_window or []
    if len(given) not in (0, 1, robot.n_axes):
        raise InputError(
            f"speed_window: has {len(given)} pairs, but robot {robot.name} has "
            f"{robot.n_axes} axes; give one pair for all, or one for each axis"
        )
    pairs = [(low, high) for low, high in given]
    return tuple(pairs * robot.n_axes if len(pairs) == 1 else pairs)
