"""Cycles of a robot without noise: simulated where they are known, and interpolated in between.

A slider needs an answer at once, and a simulated cycle takes some tenths of a second. While nobody
waits, cycles are simulated at severities on a grid, and for the healthy robot at some temperatures
and payloads. The torque of every sample is interpolated linearly between simulated ones,

    y(s, T, m) = fault(s) + [healthy(T) - healthy(T0)] + [healthy(m) - healthy(m0)],

where s is the severity, T the temperature of the gearboxes and m the mass of the payload. The last
two terms are needed only where the severities have not been simulated at T and m. The sum leaves
out that a fault may act otherwise at another temperature or payload. The error of the interpolation
over severity is measured: each simulated cycle is compared with what had been interpolated before.

    cycles = Cycles(subject)
    cycles.near(choice).arrays["motor_torque"]       # at once
    cycles.exact(choice).arrays["motor_torque"]      # simulated
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from faultgen.applied import Applied
from faultgen.dataset.planning import check_runs
from faultgen.effects import get_effect
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.errors import InputError, SimulationFailed
from faultgen.exploring.choice import Choice, Subject
from faultgen.exploring.ranges import payload_range, severity_top
from faultgen.exploring.work import Work
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.operation import Operation
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate
from faultgen.viewing.playback import SAMPLE_PERIOD

CHANNELS = (
    "motor_position",
    "motor_velocity",
    "motor_torque",
    "friction_torque",
    "joint_position",
)
"""Names of the channels of a cycle that are kept."""

CycleArrays = dict[str, np.ndarray]
"""Channels by name, each of shape (samples, n_axes), in [rad], [rad/s], [N m], [rad] or [m]."""

_MOST_BYTES = 600e6  # of the simulated cycles that are kept
_FIRST = (1.0, 0.5, 0.25, 0.75)  # severities that are simulated first, over the largest one
_LAST = (0.125, 0.375, 0.625, 0.875)
_TEMPERATURES = (0.0, 1.0, 0.5, 0.25, 0.75)  # places in the range of temperatures
_PAYLOADS = (0.0, 1.0)
_PAUSE = 0.25  # without work in advance after a slider has moved, which needs the processor [s]
_COARSER = 2.0  # steps between severities over those at the usual temperature and payload


@dataclass(frozen=True)
class Place:
    """What is simulated in one cycle."""

    operation: Operation
    """Speed, payload and temperature."""
    effect: str = ""
    """Name of the effect; empty for the healthy robot."""
    axis: int = 0
    """Its axis, from 1; 0 for the healthy robot."""
    severity: float = 0.0
    """Its severity."""

    @property
    def line(self) -> Place:
        """The place of all severities of the same fault."""
        return replace(self, severity=0.0)


@dataclass(frozen=True, eq=False)
class Found:
    """A cycle, simulated or interpolated."""

    arrays: CycleArrays
    """The channels."""
    between: tuple[float, float] | None = None
    """Simulated severities between which it was interpolated; None if it was simulated."""
    error: np.ndarray | None = None
    """RMS error of the interpolated torque of each axis in the middle between severities that lie
    at least as far apart, shape (n_axes,), in [N m]; None if it is not known."""
    moved: bool = False
    """Whether changes of temperature or payload of the healthy robot were added."""

    @property
    def is_exact(self) -> bool:
        """Whether the cycle was simulated as it is."""
        return self.between is None and not self.moved


class Cycles:
    """The simulated cycles of a robot and task, and the interpolation between them."""

    def __init__(self, subject: Subject) -> None:
        """Start the thread that simulates.

        Args:
            subject: The robot and the task.
        """
        self.subject = subject
        self._lock = threading.RLock()
        self._kept: OrderedDict[Place, CycleArrays] = OrderedDict()
        self._failed: dict[Place, str] = {}
        self._checks: dict[Place, list[tuple[float, float, np.ndarray]]] = {}
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
        known = self._known(place)
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
        with self._lock:
            found = self._near(place, choice.operation)
        if found is not None:
            self._moved = time.monotonic()
        return found

    def _near(self, place: Place, operation: Operation) -> Found | None:
        here = self._on_line(place)
        base = Operation(speed=operation.speed)
        there = self._on_line(replace(place, operation=base))
        if here is not None and (there is None or _width(here) <= _COARSER * _width(there)):
            return here
        change = self._change(operation)
        if there is None or change is None:
            return here
        arrays = {name: there.arrays[name] + change[name] for name in CHANNELS}
        return Found(arrays, there.between, there.error, moved=True)

    def is_settled(self) -> bool:
        """Whether everything has been simulated that helps to answer the next moves."""
        with self._lock:
            return self._wanted is None or self._lacking(self._wanted) is None

    def close(self) -> None:
        """End the thread that simulates, after the cycle that it simulates now."""
        self.work.close()

    def _known(self, place: Place) -> CycleArrays | None:
        with self._lock:
            if place in self._kept:
                self._kept.move_to_end(place)
            return self._kept.get(place)

    def _on_line(self, place: Place) -> Found | None:
        """Interpolate between simulated severities of the same fault."""
        known = self._known(place)
        if known is not None:
            return Found(known)
        nodes = self._nodes(place.line)
        below = [one for one in nodes if one <= place.severity]
        above = [one for one in nodes if one >= place.severity]
        if not below or not above:
            return None
        low, high = below[-1], above[0]
        arrays = self._mixed(self._node(place, low), self._node(place, high), place.severity)
        fitting = [
            (right - left, error)
            for left, right, error in self._checks.get(place.line, [])
            if left <= low and high <= right
        ]
        error = min(fitting, key=lambda one: one[0])[1] if fitting else None
        return Found(arrays, (low, high), error)

    def _nodes(self, line: Place) -> list[float]:
        """Simulated severities of a fault, with 0 for the healthy robot, ascending."""
        found = {one.severity for one in self._kept if one.line == line and one.effect}
        if Place(line.operation) in self._kept:
            found.add(0.0)
        return sorted(found)

    def _node(self, place: Place, severity: float) -> Place:
        return replace(place, severity=severity) if severity else Place(place.operation)

    def _mixed(self, low: Place, high: Place, severity: float) -> CycleArrays:
        share = (severity - low.severity) / (high.severity - low.severity)
        first, second = self._kept[low], self._kept[high]
        return {name: first[name] + share * (second[name] - first[name]) for name in CHANNELS}

    def _change(self, operation: Operation) -> CycleArrays | None:
        """How the healthy robot changes from what task and model say to an operation."""
        base = Operation(speed=operation.speed)
        start, end = self._known(Place(base)), self._known(Place(operation))
        if start is None:
            return None
        if end is not None:
            return {name: end[name] - start[name] for name in CHANNELS}
        total = {name: np.zeros_like(start[name]) for name in CHANNELS}
        for name in ("temperature", "payload"):
            value = getattr(operation, name)
            if value is None:
                continue
            part = self._between_operations(base, name, value)
            if part is None:
                return None
            total = {one: total[one] + part[one] - start[one] for one in CHANNELS}
        return total

    def _between_operations(self, base: Operation, name: str, value: float) -> CycleArrays | None:
        """The healthy cycle at a temperature or payload, between simulated ones."""
        at = {self._usual(name): self._kept[Place(base)]}
        for one, arrays in self._kept.items():
            own = getattr(one.operation, name)
            if not one.effect and own is not None and one.operation == replace(base, **{name: own}):
                at[own] = arrays
        below = [one for one in at if one <= value]
        above = [one for one in at if one >= value]
        if not below or not above:
            return None
        low, high = max(below), min(above)
        if low == high:
            return at[low]
        share = (value - low) / (high - low)
        return {one: at[low][one] + share * (at[high][one] - at[low][one]) for one in CHANNELS}

    def _usual(self, name: str) -> float:
        robot = self.subject.robot
        return robot.friction_temperature if name == "temperature" else robot.payload_mass

    def _checked(self, choice: Choice) -> CycleArrays:
        """Simulate a choice after the checks that `faultgen generate` makes."""
        check_runs(self.subject.runs(choice))
        return self._simulate(place_of(choice))

    def _simulate(self, place: Place) -> CycleArrays:
        """Simulate a cycle as the only one of a run; its lead-in has the same fault."""
        known = self._known(place)
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
        with self._lock:
            self._compare(place, arrays)
            self._kept[place] = arrays
            size = sum(one.nbytes for one in arrays.values())
            while len(self._kept) > max(_MOST_BYTES / size, 12):
                self._kept.popitem(last=False)
        return arrays

    def _compare(self, place: Place, arrays: CycleArrays) -> None:
        """Measure the error of what would have been interpolated instead of a simulated cycle."""
        guess = self._on_line(place) if place.effect else None
        if guess is None or guess.between is None:
            return
        wrong = guess.arrays["motor_torque"] - arrays["motor_torque"]
        told = (*guess.between, np.sqrt(np.mean(wrong**2, axis=0)))
        self._checks.setdefault(place.line, []).append(told)

    def _spare(self) -> Callable[[], object] | None:
        """What to simulate while nobody waits: around the choice that was looked at last."""
        choice = self._wanted
        if choice is None or time.monotonic() < self._moved + _PAUSE:
            return None
        with self._lock:
            place = self._lacking(choice)
        return None if place is None else partial(self._try, place)

    def _lacking(self, choice: Choice) -> Place | None:
        """The most useful place that has not been simulated."""
        untried = (
            place
            for place in self._useful(choice)
            if place not in self._kept and place not in self._failed
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


def _width(found: Found) -> float:
    """Distance of the simulated severities between which a cycle was interpolated."""
    return found.between[1] - found.between[0] if found.between is not None else 0.0
