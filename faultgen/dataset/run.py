"""Making one run: its cycles are simulated, measured and reduced, and its file is written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import tee
from pathlib import Path

import numpy as np

from faultgen.applied import Applied
from faultgen.dataset.planning import Run
from faultgen.dataset.run_file import create_arrays, growth_of, run_attributes, shares_of
from faultgen.dataset.storage import RunWriter
from faultgen.errors import InputError, SimulationFailed, one_line
from faultgen.monitoring.environment import Surroundings, differences, surroundings
from faultgen.monitoring.reductions import monitor
from faultgen.monitoring.sensors import get_sensors, measure
from faultgen.robot import Robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.plant import Plant
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate


def make_run(
    run: Run, folder: Path, on_cycle: Callable[[int], object] | None = None
) -> tuple[Run, str | None]:
    """Simulate one run and write its file.

    Args:
        run: The run.
        folder: The folder ``runs`` of the dataset.
        on_cycle: Function that is called with the number of cycles that have been done since its
            last call, or None. The numbers add up to the cycles of the run, also if it fails.

    Returns:
        The run, and either None or the reason why it failed.

    Raises:
        StorageFailed: The file could not be written; other runs would fail in the same way.
    """
    left = run.cycles

    def count() -> None:
        nonlocal left
        left -= 1
        if on_cycle:
            on_cycle(1)

    try:
        _simulate_and_write(run, folder, count)
    except (SimulationFailed, InputError, ValueError, ArithmeticError) as error:
        if on_cycle:
            on_cycle(left)
        return run, one_line(error) or type(error).__name__
    return run, None


def _simulate_and_write(run: Run, folder: Path, on_cycle: Callable[[], None]) -> None:
    shared = nominal(run.robot, run.task, run.sample_period, run.operation)
    robot, sensors = shared.robot, get_sensors(run.sensors)
    rngs = np.random.default_rng(run.seed).spawn(4)
    rng_surroundings, rng_sensors, rng_faults, rng_runs = rngs
    healthy = differences(sensors, run.cycles, rng_runs)
    lacks = None
    if run.speed is None and run.payload is None:  # it was learned on the task as programmed
        lacks = sensors.missing_torque(run.task_sha256, shared.samples, run.sample_period)
    mean = robot.friction_temperature if run.temperature is None else run.temperature
    around = surroundings(sensors, run.cycles, mean, rng_surroundings)
    window = shared.speed_window(run.speed_window)
    with RunWriter(folder, run.id, run_attributes(run, shared), robot.xml) as writer:
        create_arrays(writer, run, shared, around)
        plants, simulated = tee(_plants(run, robot, around, healthy))
        cycles = simulate(robot, shared.control, simulated, sample_period=run.sample_period)
        for index, (plant, cycle) in enumerate(zip(plants, cycles, strict=True)):
            seen = measure(
                sensors,
                cycle.motor_position,
                cycle.motor_velocity,
                cycle.motor_torque if lacks is None else cycle.motor_torque + lacks,
                gear_ratio=robot.gear_ratio,
                encoder_counts=robot.encoder_counts,
                mean_torque=shared.mean_torque,
                sample_period=run.sample_period,
                rng=rng_sensors,
            )
            seen = plant.sense(seen, run.sample_period, rng_faults)
            reduced = monitor(
                seen.motor_position, seen.motor_velocity, seen.motor_torque, shared.limits, window
            )
            for name, values in reduced.items():
                writer.put(f"monitoring/{name}", index, values)
            for name in run.signals:
                group, channel = name.split("/")
                values = getattr(seen if group == "signals" else cycle, channel)
                writer.put(name, index, values[:: run.thin])
            on_cycle()


def _plants(
    run: Run, robot: Robot, around: Surroundings, healthy: Sequence[tuple[Applied, ...]]
) -> Iterator[Plant]:
    """Yield the robot as it is in each cycle. It is assembled anew only where something changed."""
    spec = robot.spec()
    before: Condition | None = None
    plant = Plant(robot.model)
    growth, shares = growth_of(run), shares_of(run)
    for severity, share, temperature, load, own in zip(
        growth, shares.tolist(), around.temperature, around.payload_factor, healthy, strict=True
    ):
        now = Condition(
            temperature=float(temperature),
            payload_factor=float(load),
            faults=(
                *own,
                *(replace(one, severity=float(severity)) for one in run.own_faults),
                *(replace(one, severity=one.severity * share) for one in run.beside),
            ),
        )
        if now != before:
            plant = plant_at(robot, spec, now)
            before = now
        yield plant
