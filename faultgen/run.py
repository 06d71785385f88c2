"""Making one run: simulate its cycles, measure and reduce them, write its file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import tee
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from faultgen.condition import Condition, machine_at
from faultgen.effects import Applied
from faultgen.errors import InputError, SimulationFailed
from faultgen.experiment import Run
from faultgen.machine import Machine
from faultgen.monitoring import BINS, Limits, monitor
from faultgen.motion import plan
from faultgen.provenance import Provenance, provenance
from faultgen.robot import Robot, load_robot
from faultgen.sensors import Surroundings, get_sensors, measure, surroundings
from faultgen.servo import control_signal
from faultgen.simulate import simulate
from faultgen.storage import RunWriter
from faultgen.tasks import load_task
from faultgen.wear import severities


def make_run(
    run: Run, folder: Path, on_cycle: Callable[[], object] | None = None
) -> tuple[Run, str | None]:
    """Simulate one run and write its file.

    Args:
        run: What to simulate.
        folder: The folder ``runs`` of the dataset.
        on_cycle: Called after each cycle.

    Returns:
        The run, and None or the reason for which it failed.

    Raises:
        StorageFailed: The file could not be written; other runs would fail in the same way.
    """
    try:
        _simulate_and_write(run, folder, on_cycle)
    except (SimulationFailed, InputError, ValueError, ArithmeticError) as error:
        return run, " ".join(str(error).split()) or type(error).__name__
    return run, None


def run_provenance() -> Provenance:
    """What makes runs: the versions and the code that their bytes depend on."""
    return provenance("faultgen.run")


@dataclass(frozen=True)
class Nominal:
    """What all runs of a robot and task share."""

    robot: Robot
    control: np.ndarray
    mean_torque: np.ndarray
    samples: int


@lru_cache(maxsize=4)
def nominal(robot_name: str, task_name: str, sample_period: float) -> Nominal:
    """Plan a task and its control; kept for the runs that follow in this process.

    Raises:
        InputError: The task cannot be done by the robot, or is shorter than a sample.
    """
    robot = load_robot(robot_name)
    motion = plan(load_task(robot.name, task_name), robot)
    timestep = robot.model.opt.timestep
    control = control_signal(motion, timestep)
    feed_forward = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")] + 2
    every = round(sample_period / timestep)
    if len(control) < 2 * every:
        raise InputError(
            f"sample_period: must be well below the cycle of {motion.period:g} s, "
            f"not {sample_period:g} s"
        )
    return Nominal(
        robot=robot,
        control=control,
        mean_torque=np.abs(control[:, feed_forward]).mean(axis=0),
        samples=-(-len(control) // every),
    )


def _simulate_and_write(run: Run, folder: Path, on_cycle: Callable[[], object] | None) -> None:
    shared = nominal(run.robot, run.task, run.sample_period)
    robot, sensors = shared.robot, get_sensors(run.sensors)
    rng_surroundings, rng_sensors, rng_faults = np.random.default_rng(run.seed).spawn(3)
    around = surroundings(sensors, run.cycles, robot.friction_temperature, rng_surroundings)
    growth = _growth(run)
    limits = Limits(
        robot.motor_torque_limit, robot.motor_velocity_limit, robot.joint_range, robot.gear_ratio
    )
    with RunWriter(folder, run.id, _attributes(run, shared), robot.xml) as writer:
        _create_arrays(writer, run, shared, around, growth)
        machines, simulated = tee(_machines(run, robot, around, growth))
        cycles = simulate(robot, shared.control, simulated, sample_period=run.sample_period)
        for index, (machine, cycle) in enumerate(zip(machines, cycles, strict=True)):
            seen = measure(
                sensors,
                cycle.motor_position,
                cycle.motor_velocity,
                cycle.motor_torque,
                gear_ratio=robot.gear_ratio,
                encoder_counts=robot.encoder_counts,
                mean_torque=shared.mean_torque,
                sample_period=run.sample_period,
                rng=rng_sensors,
            )
            seen = machine.sense(seen, run.sample_period, rng_faults)
            reduced = monitor(seen.motor_position, seen.motor_velocity, seen.motor_torque, limits)
            for name, values in reduced.items():
                writer.put(f"monitoring/{name}", index, values)
            for name in run.signals:
                group, channel = name.split("/")
                values = getattr(seen if group == "signals" else cycle, channel)
                writer.put(name, index, values[:: run.thin])
            if on_cycle:
                on_cycle()


def _growth(run: Run) -> np.ndarray:
    """Severity in each cycle, shape (cycles,)."""
    if not run.axes:
        return np.zeros(run.cycles)
    return severities(run.schedule, run.severity, run.cycles)


def _machines(
    run: Run, robot: Robot, around: Surroundings, growth: np.ndarray
) -> Iterator[Machine]:
    """The robot as it is in each cycle; assembled anew only where something changed."""
    healthy = robot.spec()
    before: Condition | None = None
    machine = Machine(robot.model)
    shares = growth / run.severity if run.severity else growth
    for severity, share, temperature, load in zip(
        growth, shares.tolist(), around.temperature, around.payload_factor, strict=True
    ):
        now = Condition(
            temperature=float(temperature),
            payload_factor=float(load),
            effect=run.effect,
            wear=tuple((axis, float(severity)) for axis in run.axes),
            parameters=run.parameters,
            beside=tuple(
                Applied(name, axis, final * share, dict(parameters))
                for name, axis, final, parameters in run.beside
            ),
        )
        if now != before:
            machine = machine_at(robot, healthy, now)
            before = now
        yield machine


def _attributes(run: Run, nominal: Nominal) -> dict[str, Any]:
    robot = nominal.robot
    schedule = run.schedule if isinstance(run.schedule, str) else list(run.schedule)
    return {
        "schema_version": run.schema_version,
        "run_id": run.id,
        "robot": robot.name,
        "task": Path(run.task).stem,
        "effect": run.effect,
        "axis": run.axes[0] if run.axes else 0,
        "axes": np.array(run.axes, dtype=np.int64),
        "severity": run.severity,
        "schedule": schedule,
        "parameters": json.dumps(dict(run.parameters)),
        "beside": json.dumps(
            [
                {"effect": name, "axis": axis, "severity": final, "parameters": dict(parameters)}
                for name, axis, final, parameters in run.beside
            ]
        ),
        "cycles": run.cycles,
        "sensors": run.sensors,
        "seed": run.seed,
        "sample_period": run.sample_period,
        "thin": run.thin,
        "gear_ratio": robot.gear_ratio,
        "encoder_counts": robot.encoder_counts,
        "nominal_mean_torque": nominal.mean_torque,
        **asdict(run_provenance()),
        "model_sha256": run.model_sha256,
        "task_sha256": run.task_sha256,
    }


def _create_arrays(
    writer: RunWriter, run: Run, nominal: Nominal, around: Surroundings, growth: np.ndarray
) -> None:
    robot = nominal.robot
    kept = -(-nominal.samples // run.thin)
    n_axes = robot.n_axes
    axis = np.arange(1, n_axes + 1)
    writer.scale("cycle_number", np.arange(1, run.cycles + 1))
    writer.scale("time", np.arange(kept) * run.thin * run.sample_period)
    writer.scale("axis", axis)
    writer.scale("bin", np.arange(1, BINS + 1))
    writer.add("cycle/index", np.arange(1, run.cycles + 1), ("cycle_number",))
    writer.add("cycle/severity", growth, ("cycle_number",))
    worn = np.isin(axis, run.axes)
    writer.add("cycle/axis_severity", growth[:, None] * worn, ("cycle_number", "axis"))
    writer.add("cycle/temperature", around.measured_temperature, ("cycle_number",))
    writer.add("truth/gearbox_temperature", around.temperature, ("cycle_number",))
    body = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    if body >= 0:
        mass = robot.model.body_mass[body] * around.payload_factor
        writer.add("truth/payload_mass", mass, ("cycle_number",))
    for name in ("mean_abs_torque", "torque_indicator", "speed_indicator"):
        writer.create(f"monitoring/{name}", (run.cycles, n_axes), "f8", ("cycle_number", "axis"))
    for name in ("torque_histogram", "speed_histogram", "angle_histogram"):
        shape = (run.cycles, n_axes, BINS)
        writer.create(f"monitoring/{name}", shape, "f8", ("cycle_number", "axis", "bin"))
    for name in run.signals:
        writer.create(name, (run.cycles, kept, n_axes), "f4", ("cycle_number", "time", "axis"))
