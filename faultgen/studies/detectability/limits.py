"""The severity from which the ideal detector sees an effect on an axis.

A change need not be proportional to the severity, so the severity is simulated again until the
distance d' is the one that is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from faultgen.effects import Applied, Effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import Robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate
from faultgen.simulation.surrogate import CHANNELS
from faultgen.studies.detectability.ideal import NEEDED

_CLOSE = 0.03  # relative error of d' with which a limit is found
_TRIES = 8  # simulations for a limit
_RANGE = 1e-6  # smallest severity that is tried, over the first one
_FINE = 9e-4  # samples are not closer than that [s]
_FACTOR = 30.0  # by which one try may differ from the one before


@dataclass(frozen=True)
class Bench:
    """A robot at one task, at the rate at which cycles are simulated."""

    robot: Robot
    """The healthy robot."""
    control: np.ndarray
    """Control signal of one cycle."""
    step: float
    """Time between samples [s]."""

    @classmethod
    def of(cls, robot: str, task: str, sample_period: float) -> Bench:
        """Plan a task.

        Args:
            robot: Name of the robot, or path of its MJCF file or folder.
            task: Name of a task, or path of a task file.
            sample_period: Time between samples [s], of which `step` is a fraction.
        """
        shared = nominal(robot, task, sample_period)
        timestep = shared.robot.model.opt.timestep
        whole = round(sample_period / timestep)
        # the smallest fraction of the sample period that is a millisecond or more
        parts = max(
            k for k in range(1, whole + 1) if whole % k == 0 and whole / k * timestep > 9e-4
        )
        return cls(shared.robot, shared.control, whole // parts * timestep)

    def cycle(self, condition: Condition, before: Condition | None = None) -> np.ndarray:
        """Simulate one cycle.

        Args:
            condition: Its condition.
            before: Condition of the cycle before. Default: the same one.

        Returns:
            Shape (3, samples, n_axes): position [rad], velocity [rad/s] and torque [N m] of the
            motors.

        Raises:
            SimulationFailed: The simulation diverges.
        """
        conditions = [condition] if before is None else [before, condition]
        plants = [plant_at(self.robot, self.robot.spec(), one) for one in conditions]
        *_, cycle = simulate(self.robot, self.control, plants, sample_period=self.step)
        return np.stack([getattr(cycle, name) for name in CHANNELS])

    def worn(self, effect: Effect, axis: int, severity: float) -> np.ndarray | None:
        """Simulate one cycle with an effect.

        Args:
            effect: The effect.
            axis: Axis, from 1.
            severity: Severity in the unit of the effect.

        Returns:
            Shape (3, samples, n_axes), as from `cycle`; None if the severity is impossible or the
            simulation diverges.
        """
        reference = self.robot.friction_temperature
        try:
            effect.check_severity(severity, self.robot, axis)
            fault = Applied(effect.name, axis, severity, {})
            return self.cycle(Condition(reference, 1.0, (fault,)))
        except (InputError, SimulationFailed):
            return None


@dataclass(frozen=True)
class Limit:
    """What the ideal detector needs."""

    severity: float | None
    """Smallest severity that it detects, in the unit of the effect; None if it detects none."""
    distance: float
    """d' there, or at the largest severity that was tried."""
    largest: float
    """Largest severity that was simulated."""


def find_limit(effect: Effect, axis: int, bench: Bench, of: Callable[[np.ndarray], float]) -> Limit:
    """Find the smallest severity that is detected.

    Args:
        effect: The effect.
        axis: Axis, from 1.
        bench: The robot at its task.
        of: Function from a cycle to d' of a day.

    Returns:
        The limit.
    """
    severity = first = effect.step
    tried: dict[float, float] = {}
    impossible = np.inf
    for _ in range(_TRIES):
        cycle = bench.worn(effect, axis, severity)
        if cycle is None:
            impossible = min(impossible, severity)
            below = max(tried, default=0.0)
            severity = (below + severity) / 2 if below else severity / 4
            continue
        found = of(cycle)
        tried[severity] = found
        if abs(found / NEEDED - 1) < _CLOSE:
            return Limit(severity, found, max(tried))
        following = _next(tried, severity, effect)
        following = float(np.clip(following, _RANGE * first, min(effect.largest, impossible)))
        if following == severity or (following == impossible and severity > 0.9 * impossible):
            break
        severity = following if following < impossible else (severity + impossible) / 2
    if not tried:
        return Limit(None, 0.0, 0.0)
    above = [s for s, d in tried.items() if d >= NEEDED * (1 - _CLOSE)]
    if above:
        return Limit(min(above), tried[min(above)], max(tried))
    return Limit(None, tried[max(tried)], max(tried))


def _next(tried: dict[float, float], severity: float, effect: Effect) -> float:
    """The severity at which a power law through the nearest tries reaches the distance."""
    low = max((s for s, d in tried.items() if d < NEEDED), default=None)
    high = min((s for s, d in tried.items() if d >= NEEDED), default=None)
    if low is not None and high is not None and low < high:
        if tried[low] <= 0:
            return float(np.sqrt(low * high))
        way = np.log(NEEDED / tried[low]) / np.log(tried[high] / tried[low])
        return float(low * (high / low) ** np.clip(way, 0.05, 0.95))
    found = tried[severity]
    if found <= 0:
        return min(severity * _FACTOR, effect.largest)
    return severity * float(np.clip(NEEDED / found, 1 / _FACTOR, _FACTOR))
