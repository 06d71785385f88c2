"""Cycles at any temperature, payload and wear, interpolated between simulated ones.

A study needs many thousand cycles that differ only a little. Every condition on a grid is simulated
once, and a cycle at any other condition is computed sample by sample, see `grid`. Each axis is a
way of wear of its own. `benchmarks/simulation/surrogate_error.py` measures the error against direct
simulation, and docs/surrogate.md compares it with the noise.

    surrogate = build_surrogate("irb6700", "spot_weld")
    cycles = surrogate.cycles(temperature=[36.0], payload_factor=[1.01], severity=severity)
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from faultgen.effects import Applied
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.errors import InputError
from faultgen.provenance import provenance
from faultgen.robot import load_robot
from faultgen.simulation.grid import Grid, chebyshev
from faultgen.simulation.nominal import nominal
from faultgen.simulation.operation import AS_PROGRAMMED, Operation
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate
from faultgen.system.arrays import read_arrays, write_arrays
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import follow

CHANNELS = ("motor_position", "motor_velocity", "motor_torque")
"""Names of the channels that are interpolated."""

SAMPLE_PERIOD = 0.004
"""Time between samples, as in datasets [s]."""

_SPREAD = 20.0  # temperatures up to so far from the reference, five standard deviations [K]
_BASE_NODES = 9
_LOAD = (-0.03, 0.03)
_WEAR = (0.1, 0.2)


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Simulated cycles at the nodes of a grid, and the interpolation between them."""

    robot_path: str
    """Name of the robot, or path of its MJCF file."""
    task_path: str
    """Name of the task, or path of its file."""
    effect: str
    """Name of the effect whose severity is interpolated."""
    sample_period: float
    """Time between samples [s]."""
    temperatures: np.ndarray
    """Nodes of `base`, ascending [deg C]."""
    nodes: np.ndarray
    """Simulated cycles; shape (nodes, channels, samples, n_axes), in [rad], [rad/s], [N m]."""
    gear_ratio: np.ndarray
    """Shape (n_axes,)."""
    encoder_counts: np.ndarray
    """Counts a motor turn, shape (n_axes,)."""
    mean_torque: np.ndarray
    """Mean |torque| of each axis that the nominal cycle asks for, shape (n_axes,), in [N m]."""

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return len(self.gear_ratio)

    def weights(
        self, temperature: np.ndarray, payload_factor: np.ndarray, severity: np.ndarray
    ) -> np.ndarray:
        """Compute the weight of each simulated node in each cycle.

        Args:
            temperature: Gearbox temperature of each cycle, shape (cycles,), in [deg C].
            payload_factor: Payload mass divided by its nominal value, shape (cycles,).
            severity: Severity of each axis as a fraction, shape (cycles, n_axes).

        Returns:
            Weights, shape (cycles, nodes), without unit.

        Raises:
            ValueError: A condition is outside the grid.
        """
        temperature = np.clip(temperature, *TEMPERATURE_RANGE)
        if temperature.min() < self.temperatures[0] or temperature.max() > self.temperatures[-1]:
            raise ValueError(
                f"temperature must be within {self.temperatures[0]:g} and "
                f"{self.temperatures[-1]:g} deg C, got {temperature.min():g} to "
                f"{temperature.max():g}"
            )
        if severity.min() < 0 or severity.max() > _WEAR[-1] * (1 + 1e-9):
            raise ValueError(f"severity must be within 0 and {_WEAR[-1]}, got {severity.max()}")
        return self._grid.weights(temperature, payload_factor, severity)

    @property
    def _grid(self) -> Grid:
        return _grid(self.temperatures.tolist(), self.n_axes)

    def cycles(
        self, temperature: np.ndarray, payload_factor: np.ndarray, severity: np.ndarray
    ) -> np.ndarray:
        """Compute cycles without noise.

        Args:
            temperature: Gearbox temperature of each cycle, shape (cycles,), in [deg C].
            payload_factor: Payload mass divided by its nominal value, shape (cycles,).
            severity: Severity of each axis as a fraction, shape (cycles, n_axes).

        Returns:
            Shape (cycles, channels, samples, n_axes), with the channels of `CHANNELS`, in [rad],
            [rad/s] and [N m].

        Raises:
            ValueError: A condition is outside the grid.
        """
        weights = self.weights(temperature, payload_factor, severity)
        used = np.flatnonzero(np.any(weights != 0, axis=0))
        flat = self.nodes.reshape(len(self.nodes), -1)
        if len(used) < len(flat):
            flat = flat[used]
        return (weights[:, used] @ flat).reshape(len(weights), *self.nodes.shape[1:])

    def at(self, conditions: Sequence[Condition]) -> np.ndarray:
        """Compute cycles at given conditions.

        Args:
            conditions: The condition of each cycle.

        Returns:
            Shape (cycles, channels, samples, n_axes), as from `cycles`, in [rad], [rad/s] and
            [N m].

        Raises:
            ValueError: A condition is outside the grid.
        """
        severity = np.zeros((len(conditions), self.n_axes))
        for row, condition in zip(severity, conditions, strict=True):
            for fault in condition.faults:
                row[fault.axis - 1] = fault.severity
        temperature = np.array([condition.temperature for condition in conditions])
        payload = np.array([condition.payload_factor for condition in conditions])
        return self.cycles(temperature, payload, severity)

    def save(self, path: Path) -> None:
        """Write the surrogate to an HDF5 file. If that fails, no file is left.

        Args:
            path: The file.

        Raises:
            StorageFailed: The file cannot be written.
        """
        arrays = {k: v for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        plain = {k: v for k, v in vars(self).items() if k not in arrays}
        write_arrays(path, arrays, plain)

    @classmethod
    def load(cls, path: Path) -> Surrogate:
        """Read a surrogate from the file that `save` wrote.

        Args:
            path: The file.

        Returns:
            The surrogate.

        Raises:
            InputError: The file cannot be read, or is damaged.
        """
        try:
            arrays, plain = read_arrays(path)
            values: dict[str, Any] = {**arrays, **plain}
            return cls(**values)
        except (InputError, TypeError) as error:
            raise InputError(f"{error}; this is not a surrogate: delete {path}") from None


def _grid(temperatures: Sequence[float], n_axes: int) -> Grid:
    return Grid(tuple(temperatures), _LOAD, (_WEAR,) * n_axes)


def simulate_at(
    robot: str,
    task: str,
    sample_period: float,
    condition: Condition,
    controller: str | None = None,
    operation: Operation = AS_PROGRAMMED,
) -> np.ndarray:
    """Simulate one cycle at a condition that also held before the cycle.

    Args:
        robot: Name of the robot, or path of an MJCF file.
        task: Name of the task, or path of a task file.
        sample_period: Time between samples [s].
        condition: The condition.
        controller: Robot for which motion and feed-forward are planned. Default: the robot itself.
        operation: Speed and payload.

    Returns:
        Shape (channels, samples, n_axes), with the channels of `CHANNELS`, in [rad], [rad/s] and
        [N m].
    """
    control = nominal(controller or robot, task, sample_period, operation).control
    simulated = operation.loaded(load_robot(robot))
    plant = plant_at(simulated, simulated.spec(), condition)
    cycle = next(simulate(simulated, control, [plant], sample_period=sample_period))
    return np.stack([getattr(cycle, name) for name in CHANNELS])


def build_surrogate(
    robot: str,
    task: str,
    *,
    effect: str = "friction_wear",
    sample_period: float = SAMPLE_PERIOD,
    controller: str | None = None,
    workers: int = 1,
    progress: bool = True,
) -> Surrogate:
    """Simulate all nodes of a robot and task.

    Args:
        robot: Name of the robot, or path of an MJCF file.
        task: Name of the task, or path of a task file.
        effect: Effect whose severity is interpolated, from 0 to 0.2. It must act on every axis, and
            its severity must be a fraction of the nominal value.
        sample_period: Time between samples [s].
        controller: Robot for which motion and feed-forward are planned. Default: the robot itself.
        workers: Number of processes. The result does not depend on it.
        progress: Whether to show a progress bar on stderr.

    Returns:
        The surrogate, for temperatures within 20 K of the robot's reference temperature.

    Raises:
        InputError: There is no such robot, task or effect.
        SimulationFailed: A node could not be simulated.
    """
    shared = nominal(controller or robot, task, sample_period)
    simulated = load_robot(robot)
    reference = simulated.friction_temperature
    low = max(reference - _SPREAD, TEMPERATURE_RANGE[0])
    high = min(reference + _SPREAD, TEMPERATURE_RANGE[1])
    temperatures = chebyshev(low, high, _BASE_NODES)
    conditions = [
        Condition(
            node.temperature,
            node.payload_factor,
            () if node.way is None else (Applied(effect, node.way + 1, node.wear),),
        )
        for node in _grid(temperatures, simulated.n_axes).nodes
    ]
    calls = [
        delayed(simulate_at)(robot, task, sample_period, condition, controller)
        for condition in conditions
    ]
    what = f"simulating {simulated.name} {Path(task).stem}"
    shown = follow(in_parallel(calls, workers), what, len(conditions), "cycle", progress)
    return Surrogate(
        robot_path=robot,
        task_path=task,
        effect=effect,
        sample_period=sample_period,
        temperatures=np.array(temperatures),
        nodes=np.stack(list(shown)),
        gear_ratio=simulated.gear_ratio,
        encoder_counts=simulated.encoder_counts,
        mean_torque=shared.mean_torque,
    )


def surrogate_file(
    folder: Path,
    robot: str,
    task: str,
    *,
    sample_period: float = SAMPLE_PERIOD,
    workers: int = 1,
) -> Path:
    """Return the file of the surrogate of a robot and task; simulate and write it if needed.

    Args:
        folder: Folder that keeps the files of surrogates.
        robot: Name of the robot, or path of an MJCF file.
        task: Name of the task, or path of a task file.
        sample_period: Time between samples [s].
        workers: Number of processes. The result does not depend on it.

    Returns:
        Path of the file, for `Surrogate.load`. The axes wear by `friction_wear`.

    Raises:
        InputError: There is no such robot or task.
        SimulationFailed: A node could not be simulated.
    """
    shared = nominal(robot, task, sample_period)
    told = [
        shared.robot.sha256,
        hashlib.sha256(shared.control.tobytes()).hexdigest(),
        repr(sample_period),
        provenance("faultgen.simulation.surrogate").key,
    ]
    key = hashlib.sha256(" ".join(told).encode()).hexdigest()[:12]
    path = folder / f"{shared.robot.name}_{Path(task).stem}_{key}.h5"
    if not path.is_file():
        build_surrogate(robot, task, sample_period=sample_period, workers=workers).save(path)
    return path
