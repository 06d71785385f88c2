"""Simulating runs on a graphics card: many at once, before their files are written as usual.

Labels and noise do not depend on the device, because they come from the seed of a run. The torques
differ from those of a processor by the rounding of single precision; docs/speed.md states by how
much.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from faultgen.dataset.interpolated import channels_of
from faultgen.dataset.planning import Run
from faultgen.dataset.run import Prepared, Stepped, prepare
from faultgen.errors import InputError, SimulationFailed, one_line
from faultgen.provenance import Provenance, provenance
from faultgen.robot import load_robot
from faultgen.simulation.worlds import check_device, refuse_effects, simulate_together, version

_MOST_BYTES = 2**31
"""Of the cycles that are kept in memory until their files are written."""
_MOST_WORLDS = 4096
"""Runs that are stepped at once."""


@dataclass(frozen=True)
class Simulated:
    """Runs that were simulated, and those that could not be."""

    runs: tuple[tuple[Run, Stepped], ...]
    """Runs with their cycles."""
    failed: tuple[tuple[Run, str], ...]
    """Runs with the reason why they failed."""


def device_provenance() -> Provenance:
    """The versions and the code that runs depend on if a device simulates them."""
    made = provenance("faultgen.dataset.run", more=("faultgen.dataset.on_device",))
    return replace(made, mujoco_version=f"{made.mujoco_version} by {version()}")


def check_runs_for(device: str, runs: list[Run]) -> None:
    """Refuse a device that does not exist, and runs that it cannot simulate.

    Args:
        device: Name of the device.
        runs: The runs.

    Raises:
        InputError: The device or a run is refused.
    """
    check_device(device)
    if any(run.interpolated for run in runs):
        raise InputError("device: interpolated runs are not simulated on a device; leave one out")
    used = {one.effect for run in runs for one in run.faults}
    used |= {one.effect for name in {run.robot for run in runs} for one in load_robot(name).effects}
    refuse_effects(used)


def simulate_on(
    device: str, runs: list[Run], on_cycles: Callable[[int], object]
) -> Iterator[Simulated]:
    """Simulate runs on a device, in batches that fit into memory.

    Args:
        device: Name of the device, such as "cuda".
        runs: The runs.
        on_cycles: Function that is called with the number of cycles that have been done.

    Yields:
        The runs of one batch.
    """
    alike: dict[tuple[object, ...], list[Run]] = {}
    for run in runs:
        key = (run.robot, run.task, run.sample_period, run.operation, run.cycles, channels_of(run))
        alike.setdefault(key, []).append(run)
    for group in alike.values():
        most = max(1, min(_MOST_WORLDS, _MOST_BYTES // _bytes(group[0])))
        for start in range(0, len(group), most):
            yield _simulate(device, group[start : start + most], on_cycles)


def _bytes(run: Run) -> int:
    """Memory that the cycles of a run need."""
    shared = prepare(run).shared
    return run.cycles * len(channels_of(run)) * shared.samples * shared.robot.n_axes * 4


def _simulate(device: str, runs: list[Run], on_cycles: Callable[[int], object]) -> Simulated:
    """Simulate runs with the same robot, task, operation and number of cycles."""
    ready: list[Prepared] = [prepare(run) for run in runs]
    shared, channels = ready[0].shared, channels_of(runs[0])
    shape = (runs[0].cycles, len(channels), shared.samples, shared.robot.n_axes)
    kept = [np.empty(shape, dtype=np.float32) for _ in runs]
    failed: dict[int, str] = {}
    courses = [one.course.plants(shared.robot) for one in ready]
    simulated = simulate_together(
        shared.robot, shared.control, courses, sample_period=runs[0].sample_period, device=device
    )
    try:
        for number, cycles in enumerate(simulated):
            for k, cycle in enumerate(cycles):
                if isinstance(cycle, SimulationFailed):
                    failed[k] = one_line(cycle)
                elif cycle is not None:
                    for place, name in enumerate(channels):
                        kept[k][number, place] = getattr(cycle, name)
            on_cycles(len(runs))
    except InputError as error:  # a plant that cannot be built fails its batch
        failed = dict.fromkeys(range(len(runs)), one_line(error))
    made_by = device_provenance()
    return Simulated(
        tuple((run, Stepped(kept[k], made_by)) for k, run in enumerate(runs) if k not in failed),
        tuple((runs[k], reason) for k, reason in failed.items()),
    )
