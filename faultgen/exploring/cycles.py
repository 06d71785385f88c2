"""Cycles of a robot without noise: simulated where they are known, and interpolated in between.

A slider needs an answer at once, and a simulated cycle takes some tenths of a second. While nobody
waits, cycles are simulated at severities on a grid, and for the healthy robot at some temperatures
and payloads. `store` interpolates between them.

    cycles = Cycles(subject)
    cycles.near(choice).arrays["motor_torque"]       # at once
    cycles.exact(choice).arrays["motor_torque"]      # simulated
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from faultgen.applied import Applied
from faultgen.dataset.planning import check_runs
from faultgen.effects import get_effect
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.errors import InputError, SimulationFailed
from faultgen.exploring.choice import Choice, Subject
from faultgen.exploring.ranges import payload_range, severity_top
from faultgen.exploring.store import CHANNELS, CycleArrays, Found, Place, Store
from faultgen.exploring.work import Work
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.operation import Operation
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate
from faultgen.viewing.playback import SAMPLE_PERIOD

_FIRST = (1.0, 0.5, 0.25, 0.75)  # severities that are simulated first, over the largest one
_LAST = (0.125, 0.375, 0.625, 0.875)
_TEMPERATURES = (0.0, 1.0, 0.5, 0.25, 0.75)  # places in the range of temperatures
_PAYLOADS = (0.0, 1.0)
_PAUSE = 0.25  # without work in advance after a slider has moved, which needs the processor [s]


class Cycles:
    """The simulated cycles of a robot and task, and the interpolation between them."""

    def __init__(self, subject: Subject) -> None:
        """Start the thread that simulates.

        Args:
            subject: The robot and the task.
        """
        self.subject = subject
        robot = subject.robot
        usual = {"temperature": robot.friction_temperature, "payload": robot.payload_mass}
        self.store = Store(usual)
        self._failed: dict[Place, str] = {}
        self._wanted: Choice | None = None
        self._moved = -_PAUSE  # when a slider was last answered [s]
        self.work = Work(self._spare)

    def shared(self, operation: Operation) -> Nominal:
        """Return what the healthy robot does when it is operated in some way.

        Args:
            operation: Speed and payload; the temperature changes nothing here.

        Raises:
            InputError: The robot cannot do it.
        """
        return nominal(self.subject.name, self.subject.task, SAMPLE_PERIOD, operation)

    def exact(self, choice: Choice) -> Found:
        """Simulate the last cycle of a choice, unless it is known, and wait for it.

        Args:
            choice: The choice, after `Subject.check`.

        Returns:
            The cycle.

        Raises:
            InputError: The robot cannot have the fault, or cannot be operated so.
            SimulationFailed: The simulation diverged.
        """
        self._wanted = choice
        place = place_of(choice)
        known = self.store.known(place)
        if known is None:
            known = self.work.do(lambda: self._checked(choice))
        return Found(known)

    def near(self, choice: Choice) -> Found | None:
        """Return the last cycle of a choice at once.

        Args:
            choice: The choice, after `Subject.check`.

        Returns:
            The cycle; None if too little has been simulated. More will then be simulated while
            nobody waits.
        """
        self._wanted = choice
        self.work.look()
        place = place_of(choice)
        found = self.store.near(place)
        if found is not None:
            self._moved = time.monotonic()
        return found

    def is_settled(self) -> bool:
        """Whether everything has been simulated that helps to answer the next moves."""
        return self._wanted is None or self._lacking(self._wanted) is None

    def close(self) -> None:
        """End the thread that simulates, after the cycle that it simulates now."""
        self.work.close()

    def _checked(self, choice: Choice) -> CycleArrays:
        """Simulate a choice after the checks that `faultgen generate` makes."""
        check_runs(self.subject.runs(choice))
        return self._simulate(place_of(choice))

    def _simulate(self, place: Place) -> CycleArrays:
        """Simulate a cycle as the only one of a run; its lead-in has the same fault."""
        known = self.store.known(place)
        if known is not None:
            return known
        shared = self.shared(place.operation)
        robot = shared.robot
        warm = place.operation.temperature
        condition = Condition(
            robot.friction_temperature if warm is None else warm,
            faults=(Applied(place.effect, place.axis, place.severity, {}),) if place.effect else (),
        )
        plant = plant_at(robot, robot.spec(), condition)
        cycle = next(simulate(robot, shared.control, [plant], sample_period=SAMPLE_PERIOD))
        arrays = {name: getattr(cycle, name) for name in CHANNELS}
        self.store.add(place, arrays)
        return arrays

    def _spare(self) -> Callable[[], object] | None:
        """What to simulate while nobody waits: around the choice that was looked at last."""
        choice = self._wanted
        if choice is None or time.monotonic() < self._moved + _PAUSE:
            return None
        place = self._lacking(choice)
        return None if place is None else partial(self._try, place)

    def _lacking(self, choice: Choice) -> Place | None:
        """The most useful place that has not been simulated."""
        untried = (
            place
            for place in self._useful(choice)
            if not self.store.has(place) and place not in self._failed
        )
        return next(untried, None)

    def _try(self, place: Place) -> None:
        try:
            self._simulate(place)
        except (InputError, SimulationFailed, ValueError, ArithmeticError) as error:
            self._failed[place] = str(error)

    def _useful(self, choice: Choice) -> Iterator[Place]:
        """Places that help to answer the next moves of the sliders, the most useful first."""
        here, base = choice.operation, Operation(speed=choice.operation.speed)
        yield Place(base)
        yield Place(here)
        yield from self._severities(choice, here, _FIRST)
        for name, low, high, places in (
            ("temperature", *TEMPERATURE_RANGE, _TEMPERATURES),
            ("payload", *payload_range(self.subject.robot), _PAYLOADS),
        ):
            if np.isfinite(low):
                for share in places:
                    yield Place(replace(base, **{name: low + share * (high - low)}))
        yield from self._severities(choice, here, _LAST)

    def _severities(
        self, choice: Choice, operation: Operation, shares: tuple[float, ...]
    ) -> Iterator[Place]:
        top = severity_top(self.subject.robot, get_effect(choice.effect), choice.axis)
        for share in shares:
            severity = float(f"{share * top:.12g}")
            place = place_of(replace(choice, severity=severity, operation=operation))
            if place.effect:
                yield place


def place_of(choice: Choice) -> Place:
    """Find what has to be simulated for a choice.

    Args:
        choice: The choice.

    Returns:
        The place. A fault that only the sensors have moves nothing, so that it is the healthy one.
    """
    effect = get_effect(choice.effect)
    hooks = (effect.edit, effect.command, effect.log, effect.between)
    if not choice.severity or all(hook is None for hook in hooks):
        return Place(choice.operation)
    return Place(choice.operation, choice.effect, choice.axis, choice.severity)
