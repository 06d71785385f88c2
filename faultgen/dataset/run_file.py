"""The content of a run file: its attributes, labels and arrays."""

from __future__ import annotations

import json
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.applied import to_json
from faultgen.dataset.planning import Run
from faultgen.dataset.storage import RunWriter
from faultgen.dataset.wear import severities
from faultgen.effects import get_effect
from faultgen.effects.elements import numbered
from faultgen.monitoring.environment import Surroundings
from faultgen.monitoring.reductions import BINS
from faultgen.provenance import Provenance, provenance
from faultgen.robot import Robot
from faultgen.simulation.nominal import Nominal

_ARM_SIDE = {
    "joint_position": ("rad", "m"),
    "reference_position": ("rad", "m"),
    "joint_velocity": ("rad/s", "m/s"),
    "gear_torque": ("N m", "N"),
}
"""Units of arrays of the arm side by their name, for joints that turn and joints that slide."""


def run_provenance() -> Provenance:
    """The versions and the hash of the code that the bytes of a run file depend on."""
    return provenance("faultgen.dataset.run")


def growth_of(run: Run) -> np.ndarray:
    """Severity of the main effect of a run in each cycle.

    Args:
        run: The run.

    Returns:
        Shape (cycles,), in the unit of the effect; zeros for a healthy run.
    """
    if not run.axes:
        return np.zeros(run.cycles)
    return severities(run.schedule, run.severity, run.cycles)


def shares_of(run: Run) -> np.ndarray:
    """Severity of the main effect in each cycle as a share of its final severity.

    The further effects of the run grow in the same proportion.

    Args:
        run: The run.

    Returns:
        Shape (cycles,), without unit; 1 where the final severity is reached.
    """
    growth = growth_of(run)
    return growth / run.severity if run.severity else growth


def _units(run: Run, robot: Robot) -> str:
    """SI unit of a run's severity."""
    return get_effect(run.effect).units_on(robot, run.axes[0]) if run.axes else "1"


def _labels(run: Run, robot: Robot) -> dict[str, tuple[np.ndarray, str]]:
    """Severity of every fault, shape (cycles, n_axes), and its unit, by name of the effect.

    A second fault of the same effect on the same axis has an array of its own, ``<effect>_2``.
    """
    labels: dict[str, tuple[np.ndarray, str]] = {}
    seen: list[tuple[str, int]] = []
    growth, shares = growth_of(run), shares_of(run)
    for order, one in enumerate(run.faults):
        seen.append((one.effect, one.axis))
        name = numbered(one.effect, seen.count(seen[-1]))
        units = get_effect(one.effect).units_on(robot, one.axis)
        label, _ = labels.setdefault(name, (np.zeros((run.cycles, robot.n_axes)), units))
        # that of the run itself is exact; those beside grow in proportion
        label[:, one.axis - 1] = growth if order < len(run.axes) else one.severity * shares
    return labels


def run_attributes(run: Run, nominal: Nominal, made_by: Provenance) -> dict[str, Any]:
    """Return the root attributes of a run's file.

    Args:
        run: The run.
        nominal: The nominal cycle of the run's robot and task.
        made_by: The versions and the code that make the run.

    Returns:
        Values of the attributes by name.
    """
    robot = nominal.robot
    # of a robot that has effects beside its MJCF file, the text of the model is not all
    own = {"robot_effects": json.dumps(to_json(robot.effects))} if robot.effects else {}
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
        "severity_units": _units(run, robot),
        "schedule": schedule,
        "parameters": json.dumps(dict(run.parameters)),
        "beside": json.dumps(
            [
                {
                    "effect": one.effect,
                    "axis": one.axis,
                    "severity": one.severity,
                    "parameters": dict(sorted(one.parameters.items())),
                }
                for one in run.beside
            ]
        ),
        "cycles": run.cycles,
        "sensors": run.sensors,
        "seed": run.seed,
        "sample_period": run.sample_period,
        "fidelity": "interpolated" if run.interpolated else "stepped",
        "speed": 1.0 if run.speed is None else run.speed,
        "payload_mass": robot.payload_mass,
        "mean_temperature": (
            robot.friction_temperature if run.temperature is None else run.temperature
        ),
        "thin": run.thin,
        "gear_ratio": robot.gear_ratio,
        "encoder_counts": robot.encoder_counts,
        "nominal_mean_torque": nominal.mean_torque,
        "motor_torque_limit": nominal.limits.torque,
        "motor_velocity_limit": nominal.limits.speed,
        "speed_window": nominal.speed_window(run.speed_window),
        **asdict(made_by),
        "model_sha256": run.model_sha256,
        "task_sha256": run.task_sha256,
        "asset_sha256": json.dumps(
            {name: sha256(content).hexdigest() for name, content in sorted(robot.assets.items())}
        ),
        **own,
    }


def create_arrays(writer: RunWriter, run: Run, nominal: Nominal, around: Surroundings) -> None:
    """Create the arrays of a run's file, and write those that are known before the simulation.

    Args:
        writer: The file that is being written.
        run: The run.
        nominal: The nominal cycle of the run's robot and task.
        around: Temperature and payload in each cycle of the run.
    """
    robot = nominal.robot
    kept = -(-nominal.samples // run.thin)
    n_axes = robot.n_axes
    axis = np.arange(1, n_axes + 1)
    writer.scale("cycle_number", np.arange(1, run.cycles + 1))
    writer.scale("time", np.arange(kept) * run.thin * run.sample_period)
    writer.scale("axis", axis)
    writer.scale("bin", np.arange(1, BINS + 1))
    writer.add("cycle/index", np.arange(1, run.cycles + 1), ("cycle_number",))
    writer.add("cycle/severity", growth_of(run), ("cycle_number",), units=_units(run, robot))
    for name, (label, units) in _labels(run, robot).items():
        writer.add(f"cycle/fault_severity/{name}", label, ("cycle_number", "axis"), units=units)
    writer.add("cycle/temperature", around.measured_temperature, ("cycle_number",))
    writer.add("truth/gearbox_temperature", around.temperature, ("cycle_number",))
    if not np.isnan(robot.payload_mass):
        mass = robot.payload_mass * around.payload_factor
        writer.add("truth/payload_mass", mass, ("cycle_number",))
    for name in ("mean_abs_torque", "torque_indicator", "speed_indicator"):
        writer.create(f"monitoring/{name}", (run.cycles, n_axes), "f8", ("cycle_number", "axis"))
    commanded = nominal.position[:: run.thin]
    writer.add("command/reference_position", commanded, ("time", "axis"))
    window = nominal.speed_window(run.speed_window)
    writer.describe("monitoring/mean_abs_torque", speed_window=window)
    for name in ("torque_histogram", "speed_histogram", "angle_histogram"):
        shape = (run.cycles, n_axes, BINS)
        writer.create(f"monitoring/{name}", shape, "f8", ("cycle_number", "axis", "bin"))
    for name in run.signals:
        writer.create(name, (run.cycles, kept, n_axes), "f4", ("cycle_number", "time", "axis"))
    for name in ("command/reference_position", *run.signals):
        with_slides = units_with_slides(name, robot)
        if with_slides is not None:
            writer.describe(name, units=with_slides)


def units_with_slides(name: str, robot: Robot) -> str | None:
    """Units of an array of the arm side if joints of the robot slide, such as ``rad; axis 1: m``.

    Args:
        name: Path of the array.
        robot: The robot.

    Returns:
        The units, or None if those of turning joints are right.
    """
    pair = _ARM_SIDE.get(name.split("/")[-1])
    if pair is None or not robot.slides.any():
        return None
    turning, sliding = pair
    if robot.slides.all():
        return sliding
    axes = ", ".join(str(axis + 1) for axis in np.flatnonzero(robot.slides))
    return f"{turning}; axis {axes}: {sliding}"
