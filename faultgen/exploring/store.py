"""Simulated cycles that are kept, and the interpolation between them.

The torque of every sample is interpolated linearly between simulated cycles,

    y(s, T, m) = fault(s) + [healthy(T) - healthy(T0)] + [healthy(m) - healthy(m0)],

where s is the severity, T the temperature of the gearboxes and m the mass of the payload. The last
two terms are needed only where the severities have not been simulated at T and m. The sum leaves
out that a fault may act otherwise at another temperature or payload. The error of the interpolation
over severity is measured: each simulated cycle is compared with what had been interpolated before.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from faultgen.simulation.operation import Operation

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
_FEWEST = 24  # cycles that are kept at least: more than are simulated in advance
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


class Store:
    """The simulated cycles of a robot and task."""

    def __init__(self, usual: Mapping[str, float]) -> None:
        """Keep nothing yet.

        Args:
            usual: Temperature [deg C] and mass of the payload [kg] of the model, by the names of
                the fields of `Operation`.
        """
        self._usual = usual
        self._lock = threading.RLock()
        self._kept: OrderedDict[Place, CycleArrays] = OrderedDict()
        self._checks: dict[Place, list[tuple[float, float, np.ndarray]]] = {}

    def known(self, place: Place) -> CycleArrays | None:
        """Return a simulated cycle, or None.

        Args:
            place: What was simulated.

        Returns:
            The cycle; its arrays have shape (samples, n_axes), with the units of `CycleArrays`.
        """
        with self._lock:
            if place in self._kept:
                self._kept.move_to_end(place)
            return self._kept.get(place)

    def has(self, place: Place) -> bool:
        """Whether a cycle is kept; this does not count as a use of it.

        Args:
            place: What was simulated.
        """
        with self._lock:
            return place in self._kept

    def add(self, place: Place, arrays: CycleArrays) -> None:
        """Keep a simulated cycle, and measure what the interpolation would have been wrong there.

        The cycles that were not used for longest are dropped if all need too much memory.

        Args:
            place: What was simulated.
            arrays: The cycle; each array has shape (samples, n_axes), with the units of
                `CycleArrays`.
        """
        with self._lock:
            self._compare(place, arrays)
            self._kept[place] = arrays
            size = sum(one.nbytes for one in arrays.values())
            while len(self._kept) > max(_MOST_BYTES / size, _FEWEST):
                self._kept.popitem(last=False)

    def near(self, place: Place) -> Found | None:
        """Return a simulated cycle, or interpolate it.

        Args:
            place: What is to be simulated.

        Returns:
            The cycle; None if too little has been simulated.
        """
        with self._lock:
            return self._near(place)

    def _near(self, place: Place) -> Found | None:
        here, operation = self._on_line(place), place.operation
        base = Operation(speed=operation.speed)
        there = self._on_line(replace(place, operation=base))
        if here is not None and (there is None or _width(here) <= _COARSER * _width(there)):
            return here
        change = self._change(operation)
        if there is None or change is None:
            return here
        arrays = {name: there.arrays[name] + change[name] for name in CHANNELS}
        return Found(arrays, there.between, there.error, moved=True)

    def _on_line(self, place: Place) -> Found | None:
        """Interpolate between simulated severities of the same fault."""
        known = self.known(place)
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
        start, end = self.known(Place(base)), self.known(Place(operation))
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
        at = {self._usual[name]: self._kept[Place(base)]}
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

    def _compare(self, place: Place, arrays: CycleArrays) -> None:
        """Measure the error of what would have been interpolated instead of a simulated cycle."""
        guess = self._on_line(place) if place.effect else None
        if guess is None or guess.between is None:
            return
        wrong = guess.arrays["motor_torque"] - arrays["motor_torque"]
        told = (*guess.between, np.sqrt(np.mean(wrong**2, axis=0)))
        self._checks.setdefault(place.line, []).append(told)


def _width(found: Found) -> float:
    """Distance of the simulated severities between which a cycle was interpolated."""
    return found.between[1] - found.between[0] if found.between is not None else 0.0
