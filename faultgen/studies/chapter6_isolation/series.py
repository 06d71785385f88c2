"""Series for the study `isolation`: healthy, worn and twice worn robots under each noise."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from faultgen.dataset.wear import severities
from faultgen.evaluation.features import Features
from faultgen.monitoring.sensors import SENSORS, Sensors
from faultgen.provenance import provenance
from faultgen.simulation.surrogate import Surrogate
from faultgen.studies.chapter6_isolation.monitored import STORED, Monitored
from faultgen.system.arrays import read_arrays, write_arrays

CYCLES = 100
WEAR = 0.2

_NOISE = np.asarray(SENSORS["thesis"].torque_noise).item()

NOISES: dict[str, Sensors] = {
    "thesis / 10": replace(SENSORS["thesis"], torque_noise=_NOISE / 10),
    "thesis": SENSORS["thesis"],
    "realistic": SENSORS["realistic"],
}
"""Noise levels: a tenth of the thesis' torque noise, the thesis' own, and `realistic`."""

REFERENCE, HEALTHY, WORN, PAIR = range(4)


@dataclass(frozen=True)
class Block:
    """All series of one robot, task and noise."""

    robot: str
    """Name of the robot."""
    task: str
    """Name of the task."""
    noise: str
    """Name of the preset of sensor noise."""
    seed: int
    """Root of all draws."""
    reference: int
    """Healthy runs from which isolators learn."""
    healthy: int
    """Healthy runs that they are tested on."""
    worn: int
    """Runs of each worn axis."""
    pairs: int
    """Runs of each pair of worn axes."""

    def runs(self, n_axes: int) -> list[tuple[int, tuple[int, ...], int]]:
        """Role, worn axes from 0, and number of every run."""
        runs: list[tuple[int, tuple[int, ...], int]] = []
        runs += [(REFERENCE, (), k) for k in range(self.reference)]
        runs += [(HEALTHY, (), k) for k in range(self.healthy)]
        runs += [(WORN, (axis,), k) for axis in range(n_axes) for k in range(self.worn)]
        pairs = combinations(range(n_axes), 2)
        return runs + [(PAIR, pair, k) for pair in pairs for k in range(self.pairs)]

    def rng(self, role: int, axes: tuple[int, ...], number: int) -> np.random.Generator:
        """Make a random generator for one run that depends on nothing else.

        Args:
            role: Role of the run, such as WORN.
            axes: Worn axes, from 0.
            number: Number of the run.

        Returns:
            The generator.
        """
        place = f"{self.robot} {self.task} {self.noise}".encode()
        where = int.from_bytes(hashlib.sha256(place).digest()[:4])
        return np.random.default_rng([self.seed, where, role, *(a + 1 for a in axes), number])


@dataclass(frozen=True, eq=False)
class Series:
    """The runs of a block, and the features of each run."""

    block: Block
    """Robot, task and noise of the runs."""
    surrogate: Path
    """File of the surrogate of the robot and task."""
    role: np.ndarray
    """REFERENCE, HEALTHY, WORN or PAIR; shape (runs,)."""
    worn: np.ndarray
    """Which axes are worn, shape (runs, n_axes)."""
    stored: dict[str, np.ndarray]
    """The features `STORED` of all runs, shape (runs, cycles, ...)."""

    def of(self, role: int) -> np.ndarray:
        """Numbers of the runs with a role.

        Returns:
            Shape (runs,).
        """
        return np.flatnonzero(self.role == role)

    def seen(self, run: int, names: Collection[str] = STORED) -> Features:
        """Return features of one run.

        Args:
            run: Number of the run.
            names: Names of the features. Those that are not stored are computed again from the
                random numbers of the run, since signals of all runs would fill the memory.

        Returns:
            The features by name; arrays have shape (cycles, ...).
        """
        if set(names) <= set(self.stored):
            return {name: self.stored[name][run] for name in names}
        robot = monitored(self.surrogate)
        return _observed(robot, self.block, self.worn[run], run, names)


def growth() -> np.ndarray:
    """Compute the wear of the worn axis, thesis eq. 6.6.

    Returns:
        Severity of each cycle, a fraction of the nominal friction. Shape (cycles,).
    """
    return severities("exponential", WEAR, CYCLES)


@lru_cache(maxsize=2)
def monitored(path: Path) -> Monitored:
    """Load a robot and task from the file of its surrogate, and keep it for the next blocks."""
    return Monitored.of(Surrogate.load(path))


def make_series(block: Block, surrogate: Path, folder: Path) -> Series:
    """Draw all series of a block, or read them if they exist.

    Args:
        block: The block.
        surrogate: File of the surrogate of its robot and task.
        folder: Folder in which series are kept.

    Returns:
        The series.
    """
    made_by = provenance("faultgen.studies.chapter6_isolation.series").key
    told = f"{asdict(block)} {NOISES[block.noise]} {surrogate.name} {made_by}"
    key = hashlib.sha256(told.encode()).hexdigest()[:12]
    path = folder / f"{Path(block.robot).stem}_{Path(block.task).stem}_{key}.h5"
    if path.is_file():
        stored = read_arrays(path)[0]
        role, worn = stored.pop("role"), stored.pop("worn")
        return Series(block, surrogate, role, worn, stored)
    robot = monitored(surrogate)
    n_axes = robot.surrogate.n_axes
    runs = block.runs(n_axes)
    worn = np.zeros((len(runs), n_axes), bool)
    for row, (_, axes, _) in zip(worn, runs, strict=True):
        row[list(axes)] = True
    seen = [_observed(robot, block, row, run) for run, row in enumerate(worn)]
    series = Series(
        block=block,
        surrogate=surrogate,
        role=np.array([role for role, _, _ in runs]),
        worn=worn,
        stored={name: np.array([one[name] for one in seen]) for name in STORED},
    )
    write_arrays(path, {"role": series.role, "worn": series.worn, **series.stored}, {})
    return series


def _observed(
    robot: Monitored, block: Block, worn: np.ndarray, run: int, names: Collection[str] = STORED
) -> Features:
    """Features of one run of a block."""
    rng = block.rng(*block.runs(len(worn))[run])
    return robot.observe(NOISES[block.noise], growth()[:, None] * worn, rng, names)
