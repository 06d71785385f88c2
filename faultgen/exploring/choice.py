"""What a visitor of the page has chosen, as the dataset that `faultgen generate` makes of it.

choice = read_choice({"effect": "friction_wear", "axis": "2", "severity": "0.2"})
subject.command(choice)  # faultgen generate --robot puma560 ...
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from faultgen.applied import Applied
from faultgen.dataset.experiment import Experiment, make_experiment
from faultgen.dataset.planning import Run, plan_runs
from faultgen.effects import Effect, get_effect
from faultgen.errors import InputError
from faultgen.robot import Robot, load_robot
from faultgen.simulation.operation import Operation
from faultgen.tasks import load_task
from faultgen.viewing.playback import first_task

SENSORS = ("none", "thesis")
"""Presets that may be chosen: those in which every cycle has the same temperature and payload."""

MOST_CYCLES = 200
"""Largest number of cycles of the dataset that may be chosen on the page."""


@dataclass(frozen=True)
class Choice:
    """A fault, how the robot is operated, and the dataset that has both."""

    effect: str
    """Name of the effect."""
    axis: int
    """Axis on which it acts, from 1."""
    severity: float
    """Severity in the last cycle, in the unit of the effect; 0 for the healthy robot."""
    operation: Operation = Operation()
    """Speed, payload and temperature."""
    sensors: str = "none"
    """One of `SENSORS`."""
    schedule: str = "exponential"
    """How the severity grows from cycle to cycle."""
    cycles: int = 50
    """Number of cycles in each run."""

    @property
    def faults(self) -> tuple[Applied, ...]:
        """The fault, if there is one."""
        one = Applied(self.effect, self.axis, self.severity, {})
        return (one,) if self.severity else ()


def read_choice(told: Mapping[str, str]) -> Choice:
    """Read a choice from the query of a request.

    Args:
        told: Texts by name, as the fields of `Choice` and `Operation`. Fields that are absent or
            empty have their defaults; the effect and the axis must be there.

    Returns:
        The choice. Whether the robot can have it is checked by `Subject.check`.

    Raises:
        InputError: A value is missing, or is no number.
    """
    try:
        operation = Operation(
            *(
                _number(told[name]) if told.get(name) else None
                for name in ("speed", "payload", "temperature")
            )
        )
        choice = Choice(
            effect=told["effect"],
            axis=int(told["axis"]),
            severity=_number(told.get("severity") or "0"),
            operation=operation,
            sensors=told.get("sensors") or "none",
            schedule=told.get("schedule") or "exponential",
            cycles=int(told.get("cycles") or 50),
        )
    except KeyError as error:
        raise InputError(f"{error.args[0]}: is missing in the request") from None
    except ValueError as error:
        raise InputError(f"the request has a value that is no number: {error}") from None
    if choice.sensors not in SENSORS:
        raise InputError(f"sensors: choose {' or '.join(SENSORS)}, not '{choice.sensors}'")
    if not 1 <= choice.cycles <= MOST_CYCLES:
        raise InputError(f"cycles: must be from 1 to {MOST_CYCLES}, not {choice.cycles}")
    return choice


def _number(text: str) -> float:
    """A number with the digits that the command states."""
    return float(f"{float(text):.12g}")


class Subject:
    """The robot and the task that are explored."""

    def __init__(self, robot: str, task: str | None = None) -> None:
        """Load the robot and its task.

        Args:
            robot: Name of the robot, or path of its MJCF file or folder.
            task: Name of the task, or path of a task file. Default: pick_and_place, or the first
                task of a robot that does not have it.

        Raises:
            InputError: There is no such robot or task.
        """
        self.name = robot
        self.robot: Robot = load_robot(robot)
        self.task = task or first_task(self.robot)
        self.description = load_task(self.robot.name, self.task, self.robot.tasks).description

    @cached_property
    def task_sha256(self) -> str:
        """Hash of the task's file."""
        return load_task(self.robot.name, self.task, self.robot.tasks).sha256

    def why_not(self, effect: Effect, axis: int) -> str:
        """Say why an effect cannot act on an axis.

        Args:
            effect: The effect.
            axis: Axis, from 1.

        Returns:
            The reason; empty if it can.
        """
        allowed = effect.axes_on(self.robot)
        if axis in allowed:
            return ""
        if not allowed and effect.payload is not None:
            return "the robot's model has no payload with a mass"
        if not allowed:
            return f"it acts on no axis of a robot with {self.robot.n_axes} axes"
        return f"it acts on axis {', '.join(map(str, allowed))} only"

    def check(self, choice: Choice) -> None:
        """Refuse a choice that `faultgen generate` would refuse before it plans a motion.

        Args:
            choice: The choice.

        Raises:
            InputError: There is no such effect or axis, the effect cannot act on it, or a value is
                too large or too small.
        """
        effect = get_effect(choice.effect)
        if not 1 <= choice.axis <= self.robot.n_axes:
            raise InputError(
                f"axis {choice.axis}: robot {self.robot.name} has axes 1 to {self.robot.n_axes}"
            )
        reason = self.why_not(effect, choice.axis)
        if reason:
            raise InputError(f"{effect.name} cannot act on axis {choice.axis}: {reason}")
        if not choice.severity >= 0:
            raise InputError(f"severity: must be at least 0, not {choice.severity:g}")
        effect.check_severity(choice.severity, self.robot, choice.axis)
        self.experiment(choice)

    def experiment(self, choice: Choice) -> Experiment:
        """Describe the dataset of a choice: a healthy run, and one with the fault.

        Args:
            choice: The choice.

        Returns:
            The experiment, which `command` states as well.

        Raises:
            InputError: A value is impossible.
        """
        content: dict[str, Any] = {
            "robot": [self.name],
            "task": [self.task],
            "effect": [choice.effect],
            "axis": [[choice.axis]],
            "severity": [choice.severity],
            "schedule": choice.schedule,
            "cycles": choice.cycles,
            "sensors": choice.sensors,
            **{name: [value] for name, value in self._operation(choice).given.items()},
        }
        return make_experiment(content)

    def runs(self, choice: Choice) -> list[Run]:
        """List the runs of the dataset of a choice.

        Args:
            choice: The choice.

        Returns:
            The healthy run and, if the severity is not 0, the run with the fault.

        Raises:
            InputError: The robot cannot have the fault, or a value is impossible.
        """
        return plan_runs(self.experiment(choice))

    def command(self, choice: Choice) -> str:
        """Write the command that makes the dataset of a choice.

        Args:
            choice: The choice.

        Returns:
            The command for a shell, to be run in the folder in which the page was started.
        """
        told = {
            "robot": self.name,
            "task": self.task,
            "effect": choice.effect,
            "axis": choice.axis,
            "severity": f"{choice.severity:.12g}",
            "schedule": choice.schedule,
            "cycles": choice.cycles,
            "sensors": choice.sensors,
            **{k: f"{v:.12g}" for k, v in self._operation(choice).given.items()},
        }
        flags = [part for name, value in told.items() for part in (f"--{name}", str(value))]
        return shlex.join(["faultgen", "generate", *flags, "-o", "out"])

    def _operation(self, choice: Choice) -> Operation:
        """The operation; effects that follow the temperature need it to be stated."""
        given = choice.operation
        if given.temperature is None and "temperature" in get_effect(choice.effect).parameters:
            return replace(given, temperature=self.robot.friction_temperature)
        return given
