"""Cycles of a run that are interpolated between simulated ones (`fidelity = "interpolated"`).

Cycles at the nodes of a grid of conditions are simulated, and every cycle of the run is computed
from them, see `faultgen.simulation.grid`. The grid spans the temperatures, payloads and severities
of the run, so that no cycle is outside of it. An axis that stands still at the beginning of a cycle
holds a torque that depends on how it stopped. With the condition c of a cycle, and its change d
from the cycle before:

    y(c, d) = f(c) + g(d, T) - g(0, T)

f is a cycle after cycles like it, and g a healthy cycle at its temperature T after one that differs
in temperature and payload. g is left out if it is not needed. Some cycles of the run are simulated
as well; the difference is the error. A run whose error is too large is refused.

    found = interpolated(course, nominal(run.robot, run.task, run.sample_period))
    for cycle in found.cycles(): ...
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from faultgen.dataset.conditions import Course
from faultgen.dataset.nodes import (
    conditions_of,
    grid_of,
    grid_of_changes,
    nodes_of,
    nodes_of_changes,
    simulated,
)
from faultgen.dataset.planning import Run
from faultgen.dataset.run_file import growth_of
from faultgen.effects import get_effect
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.errors import InputError
from faultgen.monitoring.sensors import SENSORS, Sensors, get_sensors
from faultgen.robot import Robot
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.grid import Grid
from faultgen.simulation.nominal import Nominal
from faultgen.simulation.plant import Plant

LARGEST_ERROR = 0.1
"""Largest error of the torque that is accepted, over the standard deviation of its noise."""

MEASURED = ("motor_position", "motor_velocity", "motor_torque")
"""Names of the channels that sensors see."""

_TORQUE = MEASURED.index("motor_torque")
_LEVELS = (3, 5)  # nodes in severity, with 0; the second number if the first one is not enough
_SMALLEST = 1e-6  # an error below this share of a motor's torque limit is none
_AT_ONCE = 8  # cycles that are computed together
_MOST_BYTES = 2**30  # of the simulated cycles


@dataclass(frozen=True, eq=False)
class Interpolated:
    """The cycles of a run, interpolated."""

    channels: tuple[str, ...]
    """Names of the channels that are computed."""
    nodes: np.ndarray
    """Simulated cycles, shape (nodes, channels, samples, n_axes), in [rad], [rad/s] and [N m]."""
    weights: np.ndarray
    """Weight of each node in each cycle, shape (cycles, nodes)."""
    error: np.ndarray
    """RMS error of the torque in the cycles that were simulated as well, with the most extreme ones
    among them; shape (n_axes,), in [N m]; 0 if every condition of the run was simulated."""
    noise: np.ndarray
    """Standard deviation of the noise with which the error is compared, shape (n_axes,), in
    [N m]."""

    def cycles(self) -> Iterator[Cycle]:
        """Yield the cycles. Channels that are not computed are empty."""
        flat = self.nodes.reshape(len(self.nodes), -1)
        for start in range(0, len(self.weights), _AT_ONCE):
            for one in self.weights[start : start + _AT_ONCE] @ flat:
                yield cycle_of(self.channels, one.reshape(self.nodes.shape[1:]))


def channels_of(run: Run) -> tuple[str, ...]:
    """Names of the channels of a cycle that the file of a run is made from.

    Args:
        run: The run.
    """
    needed = {name.split("/")[1] for name in run.signals if name.startswith("truth/")}
    if not run.axes:
        needed.add("joint_position")  # a healthy robot has to follow its task
    return (*MEASURED, *sorted(needed.difference(MEASURED)))


def cycle_of(channels: Sequence[str], values: np.ndarray) -> Cycle:
    """Put channels together to a cycle, in which all other channels are empty.

    Args:
        channels: Their names.
        values: Their values, shape (channels, samples, n_axes), in the units of `Cycle`.
    """
    missing = np.empty((0, values.shape[-1]))
    computed = dict(zip(channels, values, strict=True))
    return Cycle(**{of.name: computed.get(of.name, missing) for of in fields(Cycle)})


def sensing_plants(course: Course, robot: Robot) -> Iterator[Plant]:
    """Yield what the faults of sensors need in each cycle of a run that is not simulated here.

    Args:
        course: What changes from cycle to cycle.
        robot: The healthy robot.

    Yields:
        The robot of each cycle, or always the healthy one if no effect is a fault of sensors.
    """
    if any(get_effect(one.effect).sense for one in (*course.run.faults, *robot.effects)):
        yield from course.plants(robot)
    else:
        plant = Plant(robot.model)
        yield from (plant for _ in range(course.run.cycles))


def interpolated(course: Course, shared: Nominal) -> Interpolated:
    """Simulate what is needed to interpolate all cycles of a run.

    Args:
        course: What changes from cycle to cycle of the run.
        shared: The nominal cycle of the run's robot and task.

    Returns:
        The interpolated cycles. If the run has few different conditions, all are simulated.

    Raises:
        InputError: The error is too large, or the cycles are too long.
        SimulationFailed: A condition could not be simulated.
    """
    run, around = course.run, course.around
    channels = channels_of(run)
    temperature = np.clip(around.temperature, *TEMPERATURE_RANGE)
    every = np.column_stack([temperature, around.payload_factor, growth_of(run)])
    pairs = np.hstack([every[[0, *range(len(every) - 1)]], every])  # with the cycle before
    noise = noise_of(get_sensors(run.sensors), shared.mean_torque)
    grids = [grid_of(every, levels) for levels in _LEVELS]
    changes = (every - pairs[:, :3])[:, :2]
    of_changes = grid_of_changes(grids[0].temperatures, changes)
    checked = _checked(every)

    def last_of(rows: np.ndarray, channels: tuple[str, ...]) -> np.ndarray:
        before, after = (conditions_of(run, half) for half in np.hsplit(rows, 2))
        sequences = [(a, b) if a != b else (b,) for a, b in zip(before, after, strict=True)]
        return simulated(shared, run.sample_period, sequences, channels)

    distinct, which = np.unique(pairs, axis=0, return_inverse=True)
    if 2 * len(distinct) <= len(grids[0].nodes) + 2 * len(checked):
        _check_size(len(distinct) * len(channels), shared)
        weights = np.zeros((run.cycles, len(distinct)))
        weights[np.arange(run.cycles), which.reshape(-1)] = 1.0
        nodes = last_of(distinct, channels)
        return Interpolated(channels, nodes, weights, 0 * noise, noise)
    _check_size((len(grids[-1].nodes) + len(of_changes.nodes)) * len(channels), shared)
    (true,) = last_of(pairs[checked], MEASURED[_TORQUE:]).swapaxes(0, 1)
    limit = np.maximum(LARGEST_ERROR * noise, _SMALLEST * shared.limits.torque)
    worst, over = 0, np.inf
    for grid in dict.fromkeys(grids):
        nodes = nodes_of(shared, run, grid, channels)
        weights = grid.weights(every[:, 0], every[:, 1], every[:, 2 : 2 + len(grid.wear)])
        for with_changes in (False, True):
            if with_changes:
                nodes = np.concatenate([nodes, nodes_of_changes(run, of_changes, channels)])
                change = _weights_of_changes(of_changes, every[:, 0], changes)
                weights = np.hstack([weights, change])
            told = np.tensordot(weights[checked], nodes[:, _TORQUE], axes=1)
            error = np.sqrt(np.mean((told - true) ** 2, axis=(0, 1)))
            if np.all(error <= limit):
                return Interpolated(channels, nodes, weights, error, noise)
            worst, over = int(np.argmax(error / limit)), float(np.max(error / limit))
    raise InputError(
        f"fidelity: the interpolated torque of axis {worst + 1} would be off by "
        f"{LARGEST_ERROR * over:.3g} of its noise, and at most {LARGEST_ERROR:g} is accepted; "
        "generate this run with fidelity 'stepped'"
    )


def noise_of(sensors: Sensors, mean_torque: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the torque noise with which an error is compared.

    Args:
        sensors: The sensors. If they have no torque noise, that of 'thesis' counts.
        mean_torque: Mean |torque| of each axis in the nominal cycle, shape (n_axes,), in [N m].

    Returns:
        Shape (n_axes,), in [N m].
    """
    level = np.asarray(sensors.torque_noise)
    if not np.any(level):
        level = np.asarray(SENSORS["thesis"].torque_noise)
    return np.asarray(level * mean_torque)


def _weights_of_changes(grid: Grid, temperature: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Weights of the changes in each cycle, less those of no change, shape (cycles, nodes)."""
    warmer, heavier = changes[:, : len(grid.wear)], changes[:, 1]
    still = grid.weights(temperature, np.ones(len(changes)), 0 * warmer)
    return grid.weights(temperature, 1 + heavier, warmer) - still


def _checked(every: np.ndarray) -> list[int]:
    """Cycles that are simulated as well: extreme ones, those after a large change, a middle one."""
    change = np.abs(np.diff(every, axis=0, prepend=every[:1])).T
    extreme = {int(np.argmax(one)) for one in (*every.T, *-every.T[:2], *change)}
    return sorted({*extreme, len(every) // 2})


def _check_size(arrays: int, shared: Nominal) -> None:
    """Refuse cycles that are too long to be kept in memory."""
    needed = arrays * shared.samples * shared.robot.n_axes * 8
    if needed > _MOST_BYTES:
        raise InputError(
            f"fidelity: the simulated cycles between which this run is interpolated need "
            f"{needed / 2**30:.1f} GB of memory, and at most {_MOST_BYTES / 2**30:g} GB is "
            "accepted; generate this run with fidelity 'stepped'"
        )
