"""The simulated cycles between which the cycles of a run are interpolated."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from faultgen.dataset.conditions import faults_at
from faultgen.dataset.planning import Run
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.simulation.grid import Grid, chebyshev
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.operation import Operation
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate

_TEMPERATURES = 9  # nodes in temperature
_BEFORE = 3  # the same for the cycle before
_WHOLE = 5.0  # ends of the grid in temperature are multiples of it [K], so that runs share nodes
_LOAD = 0.01  # the same for the payload


def grids_of(every: np.ndarray, levels: int) -> tuple[Grid, Grid]:
    """Choose grids that span all conditions of a run.

    Args:
        every: Temperature, payload factor and severity of each cycle, shape (cycles, 3).
        levels: Number of nodes in severity, with 0.

    Returns:
        The grid of the cycles themselves, and a coarser one of the cycles before them.
    """
    temperature, payload, severity = every.T
    fine: tuple[float, ...] = (float(temperature[0]),)
    before = fine
    if np.ptp(temperature) > 0:
        low = _WHOLE * np.floor(temperature.min() / _WHOLE)
        high = _WHOLE * np.ceil(temperature.max() / _WHOLE)
        low, high = np.clip([low, high], *TEMPERATURE_RANGE).tolist()
        fine, before = chebyshev(low, high, _TEMPERATURES), chebyshev(low, high, _BEFORE)
    away = _LOAD * float(np.ceil(np.abs(payload - 1).max() / _LOAD))
    loads = (-away, away) if away else ()
    own = [float(one) for one in np.unique(severity) if one != 0]
    wear = tuple(own) if len(own) < levels else chebyshev(0.0, own[-1], levels)[1:]
    ways = (wear,) if own else ()
    return Grid(fine, loads, ways), Grid(before, loads, ways)


def conditions_of(run: Run, rows: np.ndarray) -> list[Condition]:
    """List conditions of a run.

    Args:
        run: The run.
        rows: Temperature, payload factor and severity, shape (conditions, 3).
    """
    return [Condition(one, load, faults_at(run, worn)) for one, load, worn in rows.tolist()]


def nodes_of(
    shared: Nominal, run: Run, grid: Grid, channels: tuple[str, ...], *, before: bool
) -> np.ndarray:
    """Simulate the nodes of a grid. Those without wear are kept for the next run.

    Args:
        shared: The nominal cycle of the run's robot and task.
        run: The run.
        grid: The grid.
        channels: Names of the channels.
        before: Whether the nodes are conditions of the cycle before one under usual conditions,
            which is recorded.

    Returns:
        Shape (nodes, channels, samples, n_axes), in [rad], [rad/s] and [N m].
    """
    operated = (run.robot, run.task, run.sample_period, run.operation)
    healthy = Grid(grid.temperatures, grid.loads, ())
    hashes = (run.model_sha256, run.task_sha256)
    base = _healthy_nodes(*operated, hashes, healthy, channels, before)
    worn = [
        Condition(node.temperature, node.payload_factor, faults_at(run, node.wear))
        for node in grid.nodes
        if node.way is not None
    ]
    own = simulated(shared, run.sample_period, _sequences(worn, grid, before), channels)
    return np.concatenate([base, own])


@lru_cache(maxsize=2)
def _healthy_nodes(
    robot: str,
    task: str,
    sample_period: float,
    operation: Operation,
    _hashes: tuple[str, ...],
    grid: Grid,
    channels: tuple[str, ...],
    before: bool,
) -> np.ndarray:
    """Simulate the nodes of a grid without wear."""
    shared = nominal(robot, task, sample_period, operation)
    conditions = [Condition(node.temperature, node.payload_factor) for node in grid.nodes]
    return simulated(shared, sample_period, _sequences(conditions, grid, before), channels)


def _sequences(
    conditions: Sequence[Condition], grid: Grid, before: bool
) -> list[tuple[Condition, ...]]:
    """Conditions of the cycles that are simulated for each node, of which the last is recorded."""
    usual = Condition(grid.temperatures[len(grid.temperatures) // 2])
    return [(one, usual) if before else (one,) for one in conditions]


def simulated(
    shared: Nominal,
    sample_period: float,
    sequences: Sequence[tuple[Condition, ...]],
    channels: Sequence[str],
) -> np.ndarray:
    """Simulate short sequences of cycles and record the last cycle of each.

    Args:
        shared: The nominal cycle of a robot and task.
        sample_period: Time between samples [s].
        sequences: Conditions of the cycles. The first one also holds before the first cycle.
        channels: Names of the channels.

    Returns:
        Shape (sequences, channels, samples, n_axes), in [rad], [rad/s] and [N m].

    Raises:
        SimulationFailed: A cycle could not be simulated.
    """
    robot, spec = shared.robot, shared.robot.spec()
    out = np.empty((len(sequences), len(channels), shared.samples, robot.n_axes))
    for last, sequence in zip(out, sequences, strict=True):
        plants = [plant_at(robot, spec, condition) for condition in sequence]
        *_, cycle = simulate(robot, shared.control, plants, sample_period=sample_period)
        last[:] = [getattr(cycle, name) for name in channels]
    return out
