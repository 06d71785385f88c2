"""Cycles of a run that are interpolated between simulated ones (`fidelity = "interpolated"`).

Cycles at the nodes of a grid of conditions are simulated, and every cycle of the run is computed
from them, see `faultgen.simulation.grid`. The grid spans the temperatures, payloads and severities
of the run, so that no cycle is outside of it. An axis that stands still at the beginning of a cycle
holds a torque that depends on how it stopped. With the condition c of a cycle, and its change d
from the cycle before:

    y(c, d) = f(c) + g(d, T)

f is a cycle after cycles like it. g is how a cycle differs at its temperature T if the one before
had another temperature, payload or severity; g is 0 without a change, and left out where it is not
needed. Some cycles of the run are simulated as well, and their differences bound the error of all
others, see `interpolation_error`. A run whose error may be too large is refused.

    found = interpolated(course, nominal(run.robot, run.task, run.sample_period))
    for cycle in found.cycles(): ...
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from faultgen.dataset.conditions import Course
from faultgen.dataset.interpolation_error import Bounds, bounds, checked
from faultgen.dataset.nodes import (
    after_growth,
    conditions_of,
    grid_of,
    grid_of_changes,
    nodes_of,
    nodes_of_changes,
    simulated,
    weights_of_changes,
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
"""Largest bound of the RMS error of a run's torque that is accepted, over the noise's standard
deviation."""

MEASURED = ("motor_position", "motor_velocity", "motor_torque")
"""Names of the channels that sensors see."""

_TORQUE = MEASURED.index("motor_torque")
_LEVELS = (3, 5)  # nodes in severity, with 0; the second number if the first one is not enough
_SMALLEST = 1e-6  # an error below this share of a motor's torque limit is none
_TRIED = 3  # cycles on which it is tried early whether a severity that jumps can be interpolated
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
    error: Bounds
    """Bounds of the error of the torque; 0 if every condition of the run was simulated."""
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
    changes = every - pairs[:, :3]
    of_changes = grid_of_changes(grids[0].temperatures, changes)
    limit = np.maximum(LARGEST_ERROR * noise, _SMALLEST * shared.limits.torque)
    rows = checked(every, changes, _between(grids[-1]))

    def last_of(rows: np.ndarray, channels: tuple[str, ...]) -> np.ndarray:
        before, after = (conditions_of(run, half) for half in np.hsplit(rows, 2))
        sequences = [(a, b) if a != b else (b,) for a, b in zip(before, after, strict=True)]
        return simulated(shared, run.sample_period, sequences, channels)

    distinct, which = np.unique(pairs, axis=0, return_inverse=True)
    if 2 * len(distinct) <= len(grids[0].nodes) + 2 * len(rows):
        _check_size(len(distinct) * len(channels), shared)
        weights = np.zeros((run.cycles, len(distinct)))
        weights[np.arange(run.cycles), which.reshape(-1)] = 1.0
        nodes = last_of(distinct, channels)
        return Interpolated(channels, nodes, weights, Bounds(*np.zeros((3, len(noise)))), noise)
    _check_size((len(grids[-1].nodes) + len(of_changes.nodes)) * len(channels), shared)
    _refuse_jumps(run, shared, every, limit)
    (true,) = last_of(pairs[rows], MEASURED[_TORQUE:]).swapaxes(0, 1)
    error = bounds(np.full(true.shape, np.inf))
    for grid in dict.fromkeys(grids):
        nodes = nodes_of(shared, run, grid, channels)
        weights = grid.weights(every[:, 0], every[:, 1], every[:, 2 : 2 + len(grid.wear)])
        for with_changes in (False, True):
            if with_changes:
                after = nodes_of_changes(shared, run, of_changes, every, channels)
                nodes = np.concatenate([nodes, after])
                weights = np.hstack([weights, weights_of_changes(of_changes, every[:, 0], changes)])
            told = np.tensordot(weights[rows], nodes[:, _TORQUE], axes=1)
            error = bounds(told - true)
            # changes are left out if they matter in no cycle
            if np.all((error.run if with_changes else error.cycle) <= limit):
                return Interpolated(channels, nodes, weights, error, noise)
    raise _too_large(error.run, limit)


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


def _between(grid: Grid) -> list[float]:
    """Severities in the middle between neighbouring nodes."""
    levels = np.array([0.0, *sorted(level for way in grid.wear for level in way)])
    return ((levels[1:] + levels[:-1]) / 2).tolist()


def _refuse_jumps(run: Run, shared: Nominal, every: np.ndarray, limit: np.ndarray) -> None:
    """Refuse severities that jump so that cycles cannot be interpolated, before all else.

    The influence of the cycle before is taken as proportional to the change of the severity. This
    is tried on some cycles of the run, of which none has the largest or the smallest change.
    """
    severity = every[:, 2]
    change = np.diff(severity)
    order = np.argsort(np.abs(change))[np.count_nonzero(change == 0) :]
    if isinstance(run.schedule, str) or len(order) < _TRIED:
        return
    temperature = float(every[:, 0].mean())

    def carried(at: int) -> np.ndarray:
        before, after = severity[at : at + 2].tolist()
        return after_growth(shared, run, temperature, before, after, MEASURED[_TORQUE:])[0]

    most = {at: carried(at) for at in map(int, (np.argmin(change), np.argmax(change)))}
    errors = []
    for at in order[np.linspace(0, len(order) - 1, _TRIED + 2).astype(int)[1:-1]].tolist():
        end = int(np.argmax(change) if change[at] > 0 else np.argmin(change))
        errors.append(carried(at) - most[end] * change[at] / change[end])
    error = np.sqrt(np.mean(np.square(errors), axis=(0, 1)) * len(order) / len(change))
    if np.any(error > limit):
        raise _too_large(error, limit, "the severity jumps from cycle to cycle, so that ")


def _too_large(error: np.ndarray, limit: np.ndarray, why: str = "") -> InputError:
    """The refusal of a run whose error exceeds the limit, shape (n_axes,) each, in [N m]."""
    worst = int(np.argmax(error / limit))
    return InputError(
        f"fidelity: {why}the interpolated torque of axis {worst + 1} may be off by "
        f"{LARGEST_ERROR * error[worst] / limit[worst]:.3g} of its noise, and at most "
        f"{LARGEST_ERROR:g} is accepted; generate this run with fidelity 'stepped'"
    )


def _check_size(arrays: int, shared: Nominal) -> None:
    """Refuse cycles that are too long to be kept in memory."""
    needed = arrays * shared.samples * shared.robot.n_axes * 8
    if needed > _MOST_BYTES:
        raise InputError(
            f"fidelity: the simulated cycles between which this run is interpolated need "
            f"{needed / 2**30:.1f} GB of memory, and at most {_MOST_BYTES / 2**30:g} GB is "
            "accepted; generate this run with fidelity 'stepped'"
        )
