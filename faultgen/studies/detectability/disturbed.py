"""Healthy cycles as they are logged: at any temperature, with any payload, after another cycle.

An axis that stands still at the beginning of a cycle holds a torque that depends on how it stopped,
and so on temperature and payload of the cycle before. Cycles are logged hours apart, but the cycle
before a logged one ends when it begins: the temperature has changed by little in between, and the
payload is another one.

    drawn = draw(bench, sensors, rng)                      # for the ideal detector
    before = Before.of(shared, sensors, temperatures, 0.004)   # for the detectors of the package
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.dataset.nodes import carried_over, grid_up_to, weights_of_changes
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.monitoring.environment import Surroundings, differences
from faultgen.monitoring.sensors import Sensors
from faultgen.simulation.grid import Grid, chebyshev, lagrange
from faultgen.simulation.nominal import Nominal
from faultgen.simulation.state import Condition
from faultgen.simulation.surrogate import CHANNELS
from faultgen.studies.detectability.ideal import View
from faultgen.studies.detectability.limits import Bench

DRAWN = 60
"""Healthy cycles that are drawn to find their covariance. With 40 of them, the scatter of others
along the best direction is at most 1.5 % larger than this covariance says, and with 60 at most
0.7 % (PUMA at `pick_and_place`)."""

_TEMPERATURES = 9  # nodes of the cycle at a measured temperature
_WIDE = 4.0  # changes up to so many standard deviations lie between the nodes


def temperature_step(sensors: Sensors) -> float:
    """Return the standard deviation of the temperature's change from a cycle to the next [K].

    It is that of a first-order autoregression, as `surroundings` draws it.

    Args:
        sensors: Noise and disturbances.
    """
    memory = np.exp(-1 / sensors.temperature_memory)
    return float(sensors.temperature_wander * np.sqrt(2 * (1 - memory)))


@dataclass(frozen=True, eq=False)
class Drawn:
    """What is unknown in healthy cycles, as changes of the logged signals without noise."""

    known: np.ndarray
    """Cycles less the one that is expected at the measured temperature, shape (cycles, 3, samples,
    n_axes): position [rad], velocity [rad/s] and torque [N m] of the motors."""
    unknown: np.ndarray
    """The same, less their mean: where no temperature is measured."""
    mean: np.ndarray
    """Mean of the cycles, shape (3, samples, n_axes)."""


def draw(bench: Bench, sensors: Sensors, rng: np.random.Generator) -> Drawn | None:
    """Simulate healthy cycles as they are logged, each after a cycle of its own.

    Args:
        bench: The robot at its task.
        sensors: Noise and disturbances.
        rng: Source of randomness.

    Returns:
        Their changes, each divided by the root of their number; None if all cycles are the same.
    """
    if not sensors.changes_motion:
        return None
    reference = bench.robot.friction_temperature
    kicks, steps, errors, *loads = _matched(rng.standard_normal((5, DRAWN)))
    warm = np.clip(reference + sensors.temperature_wander * kicks, *TEMPERATURE_RANGE)
    before = np.clip(warm - temperature_step(sensors) * steps, *TEMPERATURE_RANGE)
    load = 1 + sensors.payload_scatter * np.array(loads)
    own = [differences(sensors, DRAWN, rng) for _ in range(2)]
    cycles = np.stack(
        [
            bench.cycle(
                Condition(float(warm[k]), float(load[1, k]), own[1][k]),
                Condition(float(before[k]), float(load[0, k]), own[0][k]),
            )
            for k in range(DRAWN)
        ]
    )
    measured = np.clip(warm + sensors.temperature_error * errors, *TEMPERATURE_RANGE)
    expected = expected_cycles(bench, measured)
    count = np.sqrt(DRAWN)
    mean = cycles.mean(axis=0)
    return Drawn((cycles - expected) / count, (cycles - mean) / count, mean)


def _matched(drawn: np.ndarray) -> np.ndarray:
    """Turn draws into ones whose sample mean is 0 and whose sample covariance is 1.

    What depends linearly on them, such as the torque on the payload, then has its exact variance,
    also with few draws.

    Args:
        drawn: Normal draws, shape (variables, draws).
    """
    centred = drawn - drawn.mean(axis=1, keepdims=True)
    root = np.linalg.cholesky(centred @ centred.T / centred.shape[1])
    return np.asarray(np.linalg.solve(root, centred))


def disturbances(view: View, drawn: Drawn | None) -> list[np.ndarray]:
    """List what differs from cycle to cycle in a view.

    Args:
        view: What is logged.
        drawn: Healthy cycles.

    Returns:
        Changes for `matched_filter`, each of shape (3, samples, n_axes).
    """
    if drawn is None or not view.sensors.changes_motion:
        return []
    return list(drawn.known if view.knows_temperature else drawn.unknown)


def expected_cycles(bench: Bench, temperature: np.ndarray) -> np.ndarray:
    """Simulate healthy cycles with the nominal payload, each after one like it.

    Args:
        bench: The robot at its task.
        temperature: Temperature of each cycle, shape (cycles,), in [deg C].

    Returns:
        Shape (cycles, 3, samples, n_axes): position [rad], velocity [rad/s] and torque [N m] of the
        motors. They are a polynomial through simulated ones.
    """
    low, high = float(temperature.min()), float(temperature.max())
    warm = chebyshev(low, high, _TEMPERATURES) if high > low else (low,)
    nodes = np.stack([bench.cycle(Condition(one)) for one in warm])
    return np.tensordot(lagrange(warm, temperature), nodes, axes=1)


@dataclass(frozen=True, eq=False)
class Before:
    """What cycles before the logged ones leave in these."""

    grid: Grid
    """Grid of the changes from the cycle before."""
    nodes: np.ndarray
    """Change of a cycle at each node, shape (nodes, 3, samples, n_axes)."""
    temperature_step: float
    """Standard deviation of the change of temperature [K]."""
    payload_scatter: float
    """Standard deviation of the payload factor."""

    @classmethod
    def of(
        cls, shared: Nominal, sensors: Sensors, temperatures: np.ndarray, sample_period: float
    ) -> Before:
        """Simulate the nodes.

        Args:
            shared: The nominal cycle of a robot and task.
            sensors: Noise and disturbances of consecutive cycles.
            temperatures: Ascending nodes in temperature, an odd number [deg C].
            sample_period: Time between samples [s].
        """
        step, scatter = temperature_step(sensors), sensors.payload_scatter
        if not shared.robot.payload_mass > 0:
            scatter = 0.0
        heavier = _WIDE * np.sqrt(2) * scatter
        grid = grid_up_to(tuple(temperatures.tolist()), _WIDE * step, heavier)
        return cls(grid, carried_over(shared, sample_period, grid, CHANNELS), step, scatter)

    def changes(self, around: Surroundings, rng: np.random.Generator) -> np.ndarray:
        """Draw what the cycles before have left.

        Args:
            around: Temperature and payload of the logged cycles.
            rng: Source of randomness.

        Returns:
            Weight of each node in each logged cycle, shape (cycles, nodes).
        """
        steps, loads = rng.standard_normal((2, len(around.temperature)))
        before = 1 + self.payload_scatter * loads
        changes = np.column_stack(
            [self.temperature_step * steps, around.payload_factor - before, 0 * steps]
        )
        temperature = np.clip(around.temperature, *TEMPERATURE_RANGE)
        return weights_of_changes(self.grid, temperature, changes)
