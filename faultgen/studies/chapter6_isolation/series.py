"""Series for the study `isolation`: healthy, worn and twice worn robots under each noise."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from faultgen.dataset.wear import severities
from faultgen.evaluation.wear_model import Observed
from faultgen.monitoring.sensors import SENSORS, Sensors
from faultgen.provenance import provenance
from faultgen.simulation.surrogate import Surrogate
from faultgen.studies.chapter6_isolation.monitored import Monitored
from faultgen.system.arrays import read_arrays, write_arrays

CYCLES = 100
WEAR = 0.2

NOISES: dict[str, Sensors] = {
    "thesis / 10": replace(SENSORS["thesis"], torque_noise=SENSORS["thesis"].torque_noise / 10),
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
    """Reductions of all runs of a block."""

    role: np.ndarray
    """REFERENCE, HEALTHY, WORN or PAIR; shape (runs,)."""
    worn: np.ndarray
    """Which axes are worn, shape (runs, n_axes)."""
    mean_torque: np.ndarray
    """Shape (runs, cycles, n_axes), in [N m]."""
    friction: np.ndarray
    """Shape (runs, cycles, features)."""
    temperature: np.ndarray
    """Shape (runs, cycles), in [deg C]."""

    def seen(self, run: int) -> Observed:
        """What was observed of one run."""
        return Observed(self.mean_torque[run], self.friction[run], self.temperature[run])


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
        return Series(**read_arrays(path)[0])
    robot = monitored(surrogate)
    n_axes = robot.surrogate.n_axes
    grown = growth()
    runs = block.runs(n_axes)
    worn = np.zeros((len(runs), n_axes), bool)
    seen = []
    for row, (role, axes, number) in zip(worn, runs, strict=True):
        row[list(axes)] = True
        rng = block.rng(role, axes, number)
        seen.append(robot.observe(NOISES[block.noise], grown[:, None] * row, rng))
    series = Series(
        role=np.array([role for role, _, _ in runs]),
        worn=worn,
        mean_torque=np.array([s.mean_torque for s in seen]),
        friction=np.array([s.friction for s in seen]),
        temperature=np.array([s.temperature for s in seen]),
    )
    write_arrays(path, vars(series), {})
    return series
