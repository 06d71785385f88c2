"""The faults of an experiment: effects, axes and severities, and the checks that they pass."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeAlias

from faultgen.effects import HEALTHY, Applied, Effect, get_effect
from faultgen.effects.base import DEFAULT_FRACTION
from faultgen.errors import InputError
from faultgen.robot import Robot
from faultgen.simulation.plant import check_axis

if TYPE_CHECKING:
    from faultgen.dataset.experiment import Experiment

Fault: TypeAlias = tuple[str, tuple[int, ...], float]
"""Effect, axes and final severity of a run."""


def default_severity(effects: Mapping[str, Effect]) -> list[float] | dict[str, list[float]]:
    """Return the severities of an experiment that gives none.

    Args:
        effects: The effects of the experiment, by name.

    Returns:
        One list for all effects if the severity of every effect is a fraction of its nominal value;
        else a list for each effect, by name.
    """
    if all(effect.units == "1" for effect in effects.values()):
        return [DEFAULT_FRACTION]
    return {name: [effect.default] for name, effect in effects.items()}


def check_severity(
    effects: Mapping[str, Effect],
    severity: list[float] | dict[str, list[float]],
    schedule: str | list[float],
) -> None:
    """Refuse severities that make no sense in the units of their effects.

    Args:
        effects: The effects of an experiment, by name.
        severity: Final severities: one list for all effects, or a list for each effect.
        schedule: Name of the schedule, or the severity of each cycle.

    Raises:
        InputError: One list is given for effects of different units, an effect has no severity, or
            a severity is too large.
    """
    if isinstance(severity, dict):
        for name in severity:
            if name not in effects:
                raise InputError(f"severity: '{name}' is not among the effects of this experiment")
        for name in effects:
            if name not in severity:
                raise InputError(f"severity: no value is given for the effect {name}")
    elif len({effect.units for effect in effects.values()}) > 1:
        given = "severity" if isinstance(schedule, str) else "schedule"
        units = ", ".join(f"{name} is in {_unit(one)}" for name, one in effects.items())
        entry = ", ".join(f"{name} = {one.default:g}" for name, one in effects.items())
        flag = ",".join(f"{name}={one.default:g}" for name, one in effects.items())
        raise InputError(
            f"{given}: effects of different units ({units}) need severities of their own; write, "
            f"for example, severity = {{{entry}}}, or on the command line --severity {flag}"
        )
    for name, effect in effects.items():
        own = severity[name] if isinstance(severity, dict) else severity
        largest = max(own if isinstance(schedule, str) else schedule, default=0.0)
        if largest > effect.largest:
            raise InputError(
                f"severity: {name} must be at most {effect.largest:g} ({effect.unit}), "
                f"not {largest:g}"
            )


def _unit(effect: Effect) -> str:
    return "fractions" if effect.units == "1" else effect.units


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
        for axes in experiment.axis or [[axis] for axis in effect.axes_on(robot)]:
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
        beside = [
            Applied(one, axis, final) for one, axis, final, _ in beside_of(experiment, worn_axes)
        ]
        _check_faults(own + beside, robot)
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
                f"axis: the severity of {one.effect} is in {units[one.effect]} on some axes of "
                f"robot {robot.name} and in {unit} on axis {one.axis}; put these axes into "
                "separate runs"
            )


def beside_of(
    experiment: Experiment, axes: tuple[int, ...]
) -> tuple[tuple[str, int, float, tuple[tuple[str, int | float | str], ...]], ...]:
    """List the further effects of one run of an experiment.

    Args:
        experiment: The experiment.
        axes: Axes on which the main effect of the run acts; empty for a healthy run.

    Returns:
        Effect, axis, final severity and parameters of each further effect; empty for a healthy run.
    """
    return tuple(
        (one.effect, axis, one.severity, tuple(sorted(one.parameters.items())))
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
