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
_WHOLE = 5.0  # ends of the grid in temperature are multiples of it [K], so that runs share nodes
_LOAD = 0.01  # the same for the payload
_CHANGE, _LOAD_CHANGE = 1.0, 0.02  # the same for changes from one cycle to the next
_COARSER = 2  # every so many-th of the nodes in temperature is one of the grid of changes
_GROWTH = 1  # way of the grid of changes that is a change of the severity


def grid_of(every: np.ndarray, levels: int) -> Grid:
    """Choose a grid that spans all conditions of a run.

    Args:
        every: Temperature, payload factor and severity of each cycle, shape (cycles, 3).
        levels: Number of nodes in severity, with 0.
    """
    temperature, payload, severity = every.T
    temperatures: tuple[float, ...] = (float(temperature[0]),)
    if np.ptp(temperature) > 0:
        low = _WHOLE * np.floor(temperature.min() / _WHOLE)
        high = _WHOLE * np.ceil(temperature.max() / _WHOLE)
        low, high = np.clip([low, high], *TEMPERATURE_RANGE).tolist()
        temperatures = chebyshev(low, high, _TEMPERATURES)
    away = _rounded_up(payload - 1, _LOAD)
    own = [float(one) for one in np.unique(severity) if one != 0]
    wear = tuple(own) if len(own) < levels else chebyshev(0.0, own[-1], levels)[1:]
    return Grid(temperatures, (-away, away) if away else (), (wear,) if own else ())


def grid_of_changes(temperatures: tuple[float, ...], changes: np.ndarray) -> Grid:
    """Choose a grid that spans the changes from one cycle of a run to the next.

    Args:
        temperatures: Nodes in temperature of the cycles themselves, ascending [deg C].
        changes: Changes of temperature, payload factor and severity, shape (cycles, 3).

    Returns:
        The grid. Its payloads are changes of the payload factor. Its first way of wear is the
        change of the temperature [K], and its second way that of the severity.
    """
    warmer, heavier = (
        _rounded_up(change, whole)
        for change, whole in zip(changes.T, (_CHANGE, _LOAD_CHANGE), strict=False)
    )
    grown = changes[:, 2]
    growth = tuple(float(one) for one in (grown.min(), grown.max()) if one != 0)
    return grid_up_to(temperatures[::_COARSER], warmer, heavier, growth)


def grid_up_to(
    temperatures: tuple[float, ...], warmer: float, heavier: float, growth: tuple[float, ...] = ()
) -> Grid:
    """Make a grid of changes up to given ones, to both sides.

    Args:
        temperatures: Nodes in temperature of the cycles, ascending [deg C].
        warmer: Largest change of the temperature [K].
        heavier: Largest change of the payload factor.
        growth: Nodes in the change of the severity, but for 0.

    Returns:
        The grid, as from `grid_of_changes`.
    """
    loads = (-heavier, -heavier / 2, heavier / 2, heavier) if heavier else ()
    warmth = (-warmer, warmer) if warmer else ()
    return Grid(temperatures, loads, (warmth, growth))


def weights_of_changes(grid: Grid, temperature: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Compute the weight of each node of a grid of changes, but for those of the base.

    Args:
        grid: The grid, see `grid_of_changes`.
        temperature: Temperature of each cycle, shape (cycles,), in [deg C].
        changes: Changes of temperature [K], payload factor and severity from the cycle before,
            shape (cycles, 3).

    Returns:
        Shape (cycles, nodes), without unit.
    """
    every_node = grid.weights(temperature, 1 + changes[:, 1], changes[:, [0, 2]])
    return every_node[:, len(grid.temperatures) :]


def _rounded_up(values: np.ndarray, whole: float) -> float:
    """The largest magnitude, rounded up to a multiple."""
    return whole * float(np.ceil(np.abs(values).max() / whole))


def conditions_of(run: Run, rows: np.ndarray) -> list[Condition]:
    """List conditions of a run.

    Args:
        run: The run.
        rows: Temperature, payload factor and severity, shape (conditions, 3).
    """
    return [Condition(one, load, faults_at(run, worn)) for one, load, worn in rows.tolist()]


def nodes_of(shared: Nominal, run: Run, grid: Grid, channels: tuple[str, ...]) -> np.ndarray:
    """Simulate the nodes of a grid. Those without wear are kept for the next run.

    Args:
        shared: The nominal cycle of the run's robot and task.
        run: The run.
        grid: The grid.
        channels: Names of the channels.

    Returns:
        Shape (nodes, channels, samples, n_axes), in [rad], [rad/s] and [N m].
    """
    worn = [
        (Condition(node.temperature, node.payload_factor, faults_at(run, node.wear)),)
        for node in grid.nodes
        if node.way is not None
    ]
    base = _healthy_nodes(*_made_of(run), Grid(grid.temperatures, grid.loads, ()), channels)
    return np.concatenate([base, simulated(shared, run.sample_period, worn, channels)])


def nodes_of_changes(
    shared: Nominal, run: Run, grid: Grid, every: np.ndarray, channels: tuple[str, ...]
) -> np.ndarray:
    """Simulate how cycles differ that follow another condition than their own.

    Args:
        shared: The nominal cycle of the run's robot and task.
        run: The run.
        grid: The grid of changes.
        every: Temperature, payload factor and severity of each cycle of the run, shape (cycles, 3).
        channels: Names of the channels.

    Returns:
        A cycle after the change, less the same cycle after one like it, for every node but those of
        the base; shape (nodes, channels, samples, n_axes), in [rad], [rad/s] and [N m]. Changes of
        temperature and payload are those of the healthy robot, and are kept for the next run.
    """
    warmth, growth = grid.wear
    nodes = grid.nodes[len(grid.temperatures) :]
    grown = np.array([node.way == _GROWTH for node in nodes], bool)
    out = np.empty((len(nodes), len(channels), shared.samples, shared.robot.n_axes))
    out[~grown] = _after_changes(
        *_made_of(run), Grid(grid.temperatures, grid.loads, (warmth, ())), channels
    )
    severity = every[:, 2]
    for k in np.flatnonzero(grown).tolist():
        at = int(np.argmin(np.abs(np.diff(severity) - nodes[k].wear)))
        before, after = severity[at : at + 2].tolist()
        out[k] = after_growth(shared, run, nodes[k].temperature, before, after, channels)
    return out


def after_growth(
    shared: Nominal,
    run: Run,
    temperature: float,
    before: float,
    after: float,
    channels: tuple[str, ...],
) -> np.ndarray:
    """Simulate how a cycle differs that follows one with another severity.

    Args:
        shared: The nominal cycle of the run's robot and task.
        run: The run.
        temperature: Temperature of both cycles [deg C].
        before: Severity of the cycle before.
        after: Severity of the cycle.
        channels: Names of the channels.

    Returns:
        The cycle less the same cycle after one like it, shape (channels, samples, n_axes), in
        [rad], [rad/s] and [N m].
    """
    old, new = conditions_of(run, np.array([[temperature, 1.0, one] for one in (before, after)]))
    changed, still = simulated(shared, run.sample_period, [(old, new), (new, new)], channels)
    return np.asarray(changed - still)


def _made_of(run: Run) -> tuple[str, str, float, Operation, tuple[str, str]]:
    """What the healthy cycles of a run depend on."""
    hashes = (run.model_sha256, run.task_sha256)
    return run.robot, run.task, run.sample_period, run.operation, hashes


@lru_cache(maxsize=1)
def _healthy_nodes(
    robot: str,
    task: str,
    sample_period: float,
    operation: Operation,
    _hashes: tuple[str, str],
    grid: Grid,
    channels: tuple[str, ...],
) -> np.ndarray:
    """Simulate the nodes of a grid without wear."""
    shared = nominal(robot, task, sample_period, operation)
    sequences = [(Condition(node.temperature, node.payload_factor),) for node in grid.nodes]
    return simulated(shared, sample_period, sequences, channels)


@lru_cache(maxsize=1)
def _after_changes(
    robot: str,
    task: str,
    sample_period: float,
    operation: Operation,
    _hashes: tuple[str, str],
    grid: Grid,
    channels: tuple[str, ...],
) -> np.ndarray:
    """Simulate the changes of `nodes_of_changes` without wear."""
    return carried_over(
        nominal(robot, task, sample_period, operation), sample_period, grid, channels
    )


def carried_over(
    shared: Nominal, sample_period: float, grid: Grid, channels: Sequence[str]
) -> np.ndarray:
    """Simulate how healthy cycles differ that follow another temperature or payload.

    Args:
        shared: The nominal cycle of a robot and task.
        sample_period: Time between samples [s].
        grid: A grid of changes without changes of the severity, see `grid_of_changes`.
        channels: Names of the channels.

    Returns:
        A cycle after the change, less the same cycle after one like it, for every node but those of
        the base; shape (nodes, channels, samples, n_axes), in [rad], [rad/s] and [N m].

    Raises:
        SimulationFailed: A cycle could not be simulated.
    """
    nodes = grid.nodes[len(grid.temperatures) :]
    warm = sorted({node.temperature for node in nodes})
    still = [(Condition(one), Condition(one)) for one in warm]
    changed = [
        (
            Condition(node.temperature - node.wear, 2 - node.payload_factor),
            Condition(node.temperature),
        )
        for node in nodes
    ]
    cycles = simulated(shared, sample_period, [*still, *changed], channels)
    of = [warm.index(node.temperature) for node in nodes]
    return np.asarray(cycles[len(still) :] - cycles[of])


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
