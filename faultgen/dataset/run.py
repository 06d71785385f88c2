"""Making one run: its cycles are simulated, measured and reduced, and its file is written."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import tee
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from faultgen.dataset.conditions import Course
from faultgen.dataset.instance import draw_instance
from faultgen.dataset.interpolated import channels_of, cycle_of, interpolated, sensing_plants
from faultgen.dataset.interpolation_error import BOUNDS
from faultgen.dataset.planning import Run
from faultgen.dataset.run_file import create_arrays, run_attributes, run_provenance
from faultgen.dataset.storage import RunWriter
from faultgen.errors import InputError, SimulationFailed, one_line
from faultgen.monitoring.environment import differences, surroundings
from faultgen.monitoring.reductions import monitor
from faultgen.monitoring.sensors import Sensors, get_sensors, measure
from faultgen.provenance import Provenance
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.plant import Plant
from faultgen.simulation.stepping import simulate

_LARGEST_LAG = 0.3
"""Distance from the commanded motion at which a healthy robot does not do its task [rad], [m]."""


@dataclass(frozen=True, eq=False)
class Stepped:
    """The cycles of a run, if they were simulated elsewhere."""

    cycles: np.ndarray
    """Shape (cycles, channels, samples, n_axes), with the channels of `channels_of`."""
    made_by: Provenance
    """What simulated them."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is known of a run before it is simulated."""

    shared: Nominal
    """What it shares with other runs of its robot and task."""
    sensors: Sensors
    """Its sensors."""
    course: Course
    """What changes from cycle to cycle."""
    rng_sensors: np.random.Generator
    """Random numbers of the noise."""
    rng_faults: np.random.Generator
    """Random numbers of faults of sensors."""


def prepare(run: Run) -> Prepared:
    """Plan a run, and draw what changes from cycle to cycle.

    Args:
        run: The run.

    Returns:
        What is known of it; its fields state the shapes of arrays. All random numbers depend on the
        seed of the run only.
    """
    shared = nominal(run.robot, run.task, run.sample_period, run.operation)
    sensors = get_sensors(run.sensors)
    rngs = np.random.default_rng(run.seed).spawn(5)
    rng_surroundings, rng_sensors, rng_faults, rng_runs, rng_instance = rngs
    healthy = differences(sensors, run.cycles, rng_runs)
    mean = shared.robot.friction_temperature if run.temperature is None else run.temperature
    instance = None
    if run.randomize:
        instance = draw_instance(shared.robot, dict(run.randomize), rng_instance)
        sensors, mean = instance.sensors(sensors), instance.mean_temperature(mean)
    around = surroundings(sensors, run.cycles, mean, rng_surroundings)
    if instance is not None:
        around = replace(around, payload_factor=around.payload_factor * instance.payload)
    course = Course(run, around, healthy, instance)
    return Prepared(shared, sensors, course, rng_sensors, rng_faults)


def get_ready(run: Run) -> None:
    """Plan the motion of a run, so that this process has it when it makes the run.

    Args:
        run: The run. If it cannot be planned, nothing is done: to check it is left to others.
    """
    with suppress(InputError):
        nominal(run.robot, run.task, run.sample_period, run.operation)


def make_run(
    run: Run,
    folder: Path,
    on_cycle: Callable[[int], object] | None = None,
    stepped: Stepped | None = None,
    made_by: Provenance | None = None,
) -> tuple[Run, str | None]:
    """Simulate one run and write its file.

    Args:
        run: The run.
        folder: The folder ``runs`` of the dataset.
        on_cycle: Function that is called with the number of cycles that have been done since its
            last call, or None. The numbers add up to the cycles of the run, also if it fails.
        stepped: Its cycles, if they were simulated before.
        made_by: The versions and the code of this process. None: they are read, which takes long.

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
        with threadpool_limits(limits=1):  # sums in another order would differ in their last digits
            _simulate_and_write(run, folder, count, stepped, made_by or run_provenance())
    except (SimulationFailed, InputError, ValueError, ArithmeticError) as error:
        if on_cycle:
            on_cycle(left)
        return run, one_line(error) or type(error).__name__
    return run, None


def _simulate_and_write(
    run: Run,
    folder: Path,
    on_cycle: Callable[[], None],
    stepped: Stepped | None,
    made_by: Provenance,
) -> None:
    ready = prepare(run)
    shared, sensors, course = ready.shared, ready.sensors, ready.course
    robot = shared.robot
    lacks = None
    if run.speed is None and run.payload is None:  # it was learned on the task as programmed
        lacks = sensors.missing_torque(run.task_sha256, shared.samples, run.sample_period)
    window = shared.speed_window(run.speed_window)
    attributes = run_attributes(run, shared, stepped.made_by if stepped else made_by)
    if course.instance is not None:
        attributes["randomize"] = json.dumps(dict(run.randomize))
        attributes["instance"] = json.dumps(asdict(course.instance))
    cycles: Iterable[Cycle]
    plants: Iterable[Plant]
    if stepped is not None:
        channels = channels_of(run)
        cycles = (cycle_of(channels, one.astype(float)) for one in stepped.cycles)
        plants = sensing_plants(course, robot)
    elif run.interpolated:
        found = interpolated(course, shared)
        cycles, plants = found.cycles(), sensing_plants(course, robot)
        attributes |= {BOUNDS[of]: error for of, error in found.error._asdict().items()}
        attributes["interpolation_noise"] = found.noise
    else:
        plants, to_simulate = tee(course.plants(robot))
        cycles = simulate(robot, shared.control, to_simulate, sample_period=run.sample_period)
    with RunWriter(folder, run.id, attributes, robot.xml) as writer:
        create_arrays(writer, run, shared, course.around)
        for index, (plant, cycle) in enumerate(zip(plants, cycles, strict=True)):
            if index == 0 and not run.axes:
                _check_lag(cycle, shared)
            seen = measure(
                sensors,
                cycle.motor_position,
                cycle.motor_velocity,
                cycle.motor_torque if lacks is None else cycle.motor_torque + lacks,
                gear_ratio=robot.gear_ratio,
                encoder_counts=robot.encoder_counts,
                mean_torque=shared.mean_torque,
                sample_period=run.sample_period,
                rng=ready.rng_sensors,
            )
            seen = plant.sense(seen, run.sample_period, ready.rng_faults)
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


def _check_lag(cycle: Cycle, shared: Nominal) -> None:
    """Refuse a healthy robot that does not follow its task.

    Raises:
        SimulationFailed: A joint is far from its commanded position.
    """
    lag = np.abs(cycle.joint_position - shared.position).max(axis=0)
    axis = int(np.argmax(lag))
    if lag[axis] > _LARGEST_LAG:
        unit = "m" if shared.robot.slides[axis] else "rad"
        raise SimulationFailed(
            f"the healthy robot does not follow the task: {shared.robot.label('axis ', axis + 1)} "
            f"is up to {lag[axis]:.2g} {unit} away from its commanded position; see what "
            "'faultgen robot check' says of the robot"
        )
