"""Robots of the laboratories: nominal tables, robots that are off, runs of them.

plant = nominal(machine)
run = simulate(plant, points)      # shape (rows, n_axes, channels) every 0.5 ms
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from laboratories.arm import Body, body_arrays, inverse
from laboratories.laws import steady_friction
from laboratories.mjcf import Machine, read_machine
from laboratories.parameters import INDEX, NAMES
from laboratories.plant import DENSE, GRID, STEP, integrate, motor_speeds

PACKAGE = Path(__file__).parents[2] / "robots"
OWN = Path(__file__).with_name("robots")
ROBOTS = ("puma560", "irb6700", "lift1", "scara4", "arm7")
"""Six, six, one, four and seven axes. `lift1` is a slide, `scara4` has one."""
LEAD = 0.6
"""Time at rest before a recording [s]."""
STILL = np.array([1.0, 1.0, 1.0, 1.0, 1.0])
"""Row of what is fixed for a motion, when nothing changes: see `plant.integrate`."""
_SAME_AREA = 0.886  # area under exp(-x^2) over that under exp(-x), from 0


@dataclass(frozen=True)
class Plant:
    """A robot: its arm, and the table of its drivetrains, effects and servos."""

    machine: Machine
    table: np.ndarray
    """Shape (n_axes, columns), as in `parameters.NAMES`."""

    def column(self, name: str) -> np.ndarray:
        """One column, shape (n_axes,)."""
        return self.table[:, INDEX[name]]

    def changed(self, axis: int, **values: float) -> Plant:
        """The robot with other values for one axis, counted from 1."""
        table = self.table.copy()
        for name, value in values.items():
            table[axis - 1, INDEX[name]] = value
        return replace(self, table=table)

    def with_columns(self, **columns: np.ndarray | float) -> Plant:
        """The robot with other values of all axes."""
        table = self.table.copy()
        for name, values in columns.items():
            table[:, INDEX[name]] = values
        return replace(self, table=table)


def robot_file(name: str) -> Path:
    """The MJCF file of a robot of `ROBOTS`."""
    own = OWN / f"{name}.xml"
    return own if own.is_file() else PACKAGE / name / f"{name}.xml"


@lru_cache
def machine_of(name: str) -> Machine:
    """The numbers of a robot of `ROBOTS`."""
    return read_machine(robot_file(name))


def nominal(machine: Machine) -> Plant:
    """The robot as its file says, with the friction law of this simulator and no servo yet."""
    table = np.zeros((machine.n_axes, len(NAMES)))
    plant = Plant(machine, table)
    # the bristle's own stiffness grows from 1 to this where the motor turns back
    return plant.with_columns(
        RATIO=machine.ratio,
        ROTOR=machine.rotor,
        STIFF=machine.stiffness,
        DAMP=machine.damping,
        LIMIT=machine.limit,
        OFFSET=machine.offset,
        COULOMB=machine.coulomb,
        RISE=machine.static - machine.coulomb,
        SPEED=_SAME_AREA * machine.stribeck,
        VISCOUS=machine.viscous,
        REST=machine.bristle,
        TANH=0.1 * machine.stribeck,
        X_REF=0.3 * machine.speed_limit,
        X_LOAD_REF=0.2 * machine.limit,
        X_TWIST_REF=0.2 * machine.limit * np.abs(machine.ratio) / machine.stiffness,
        PERIOD=STEP,
    )


def set_points(machine: Machine, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """What a controller commands that knows the model's numbers.

    Args:
        machine: The model.
        q: Joint motion, shape (times, n_axes).
        qd: Its velocity.
        qdd: Its acceleration.

    Returns:
        Motor angle, motor speed and feed-forward torque, shape (times, 3, n_axes).
    """
    load = inverse(body_arrays(machine), q, qd, qdd) / machine.ratio
    w = machine.ratio * qd
    forward = load + machine.rotor * machine.ratio * qdd + _told_friction(machine, w)
    return np.ascontiguousarray(np.stack([machine.ratio * q, w, forward], axis=1))


def _told_friction(machine: Machine, w: np.ndarray) -> np.ndarray:
    """Friction by the model's numbers at motor speeds, without its rise at rest [N m]."""
    share = np.tanh(w / (0.5 * machine.stribeck))
    out: np.ndarray = machine.coulomb * share + machine.viscous * w
    return out - machine.offset * np.abs(share)


def with_worn_forward(
    points: np.ndarray, model: Machine, plant: Plant, slow: np.ndarray
) -> np.ndarray:
    """Set points of a controller that was told the present friction of the robot.

    Args:
        points: From `set_points` of the model.
        model: The model.
        plant: The robot as it is now.
        slow: See `plant.integrate`, shape (n_axes, 5).

    Returns:
        The set points; friction in the feed-forward torque is that of the robot.
    """
    w = points[:, 1]
    rotor = model.rotor * np.gradient(w, GRID, axis=0)
    load = points[:, 2] - _told_friction(model, w) - rotor
    friction = steady_friction(plant.table, w, points[:, 0] / model.ratio, load, slow)
    out = points.copy()
    out[:, 2] += friction - _told_friction(model, w)
    return out


def _at_rest(plant: Plant, points: np.ndarray) -> tuple[Body, np.ndarray, np.ndarray]:
    """Arm, state and integral of the servo before a motion, as `plant.integrate` takes them."""
    body = body_arrays(plant.machine)
    ratio = plant.column("RATIO")
    motor = points[0, 0] + ratio * plant.column("X_ENCODER")
    joint, still = motor / ratio, np.zeros(len(plant.table))
    load = inverse(body, joint[None], still[None], still[None])[0]
    state = np.stack([joint - load / plant.column("STIFF"), still, motor, still])
    # the integral holds the load already, as after a long rest
    gain = plant.column("KI")
    hold = load / ratio - plant.column("FORWARD") * points[0, 2]
    integral = np.where(gain > 0, hold / np.where(gain > 0, gain, 1.0), 0.0)
    return body, state, integral


def simulate(
    plant: Plant,
    points: np.ndarray,
    slow: np.ndarray | None = None,
    *,
    step: float = STEP,
    follow: np.ndarray | None = None,
) -> np.ndarray:
    """Run a robot along set points, from rest.

    Args:
        plant: The robot with its servo.
        points: From `set_points`.
        slow: See `plant.integrate`, shape (n_axes, 5); default: nothing changes.
        step: [s].
        follow: From `rotor_motion`: the rotors move like that, and there is no servo.

    Returns:
        Shape (rows, n_axes, channels), as in `plant.CHANNELS`, every `plant.DENSE`.

    Raises:
        FloatingPointError: The simulation diverged.
    """
    slow = np.tile(STILL, (len(plant.table), 1)) if slow is None else slow
    body, state, integral = _at_rest(plant, points)
    run = integrate(body, plant.table, points, slow, state, step, LEAD, True, integral, follow)
    if not np.isfinite(run).all() or np.abs(run[:, :, 1]).max() > 1e4:
        raise FloatingPointError("the simulation diverged")
    return run


def rotor_motion(plant: Plant, points: np.ndarray, slow: np.ndarray | None = None) -> np.ndarray:
    """How the rotors of a robot move along set points, for `simulate`.

    Args:
        plant: The robot with its servo.
        points: From `set_points`.
        slow: See `plant.integrate`, shape (n_axes, 5); default: nothing changes.

    Returns:
        Motor speed at every `plant.STEP`, shape (steps, n_axes), in [rad/s].
    """
    slow = np.tile(STILL, (len(plant.table), 1)) if slow is None else slow
    body, state, integral = _at_rest(plant, points)
    return motor_speeds(body, plant.table, points, slow, state, STEP, LEAD, integral)


def sample_times(rows: int, period: float) -> np.ndarray:
    """Times of the samples of a motion.

    Args:
        rows: Rows of the motion, one every `plant.GRID`.
        period: Between two samples [s].

    Returns:
        Times from 0 to the end of the motion [s].
    """
    return period * np.arange(int((rows - 1) * GRID / period + 1e-6) + 1)


def sampled(run: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Rows of a run at any times, linear in between.

    Args:
        run: From `simulate`.
        times: [s], shape (samples,).

    Returns:
        Shape (samples, n_axes, channels).
    """
    x = np.clip(times / DENSE, 0, len(run) - 1.000001)
    k = x.astype(int)
    f = (x - k)[:, None, None]
    out: np.ndarray = run[k] * (1 - f) + run[k + 1] * f
    return out


def length_scale(machine: Machine) -> np.ndarray:
    """Lengths of which centres of mass are off by a share [m]: (n_axes + 1,), payload last."""
    com = np.concatenate([machine.com, machine.payload[None, 1:4]])
    return np.maximum(2 * np.linalg.norm(com, axis=1), 0.05)


ARM_PARTS = ("mass", "com0", "com1", "com2", "inertia0", "inertia1", "inertia2")
DRIVE_PARTS = ("COULOMB", "RISE", "SPEED", "VISCOUS", "ROTOR", "STIFF", "DAMP", "OFFSET")


def parameters(n_axes: int) -> list[tuple[str, int]]:
    """What is off in a robot: name and link (payload last), or name and axis from 0."""
    arm = [(part, link) for part in ARM_PARTS for link in range(n_axes + 1)]
    return arm + [(part, axis) for part in DRIVE_PARTS for axis in range(n_axes)]


def perturbed(plant: Plant, changes: dict[tuple[str, int], float]) -> Plant:
    """The robot with relative changes of its parameters; centres of mass by `length_scale`."""
    machine, table = plant.machine, plant.table.copy()
    mass = np.append(machine.mass, machine.payload[0])
    com = np.concatenate([machine.com, machine.payload[None, 1:4]])
    inertia = np.concatenate([machine.inertia, machine.payload[None, 4:].reshape(1, 3, 3)])
    scale = length_scale(machine)
    for (name, k), change in changes.items():
        if name == "mass":
            mass[k] *= 1 + change
            inertia[k] *= 1 + change
        elif name.startswith("com"):
            com[k, int(name[3])] += change * scale[k]
        elif name.startswith("inertia"):
            values, frame = np.linalg.eigh(inertia[k])
            values[int(name[7])] *= 1 + change
            inertia[k] = frame @ np.diag(values) @ frame.T
        else:
            table[k, INDEX[name]] *= 1 + change
    payload = np.concatenate([[mass[-1]], com[-1], inertia[-1].ravel()])
    machine = machine.changed(mass=mass[:-1], com=com[:-1], inertia=inertia[:-1], payload=payload)
    return Plant(machine, table)


def random_robot(plant: Plant, error: float, rng: np.random.Generator) -> Plant:
    """A healthy robot that differs from its model.

    Args:
        plant: The nominal robot with its servo.
        error: Standard deviation of the parameters, relative; stiffness and damping twice that.
        rng: Source of randomness.

    Returns:
        The robot. Its friction at rest is its own in any case.
    """
    n = plant.machine.n_axes
    names = parameters(n)
    sizes = np.clip(rng.standard_normal(len(names)), -2.5, 2.5) * error
    changes = dict(zip(names, sizes.tolist(), strict=True))
    for name, k in names:
        if name in ("STIFF", "DAMP"):
            changes[name, k] *= 2
    robot = perturbed(plant, changes)
    smooth = rng.uniform(0, 0.8) if rng.uniform() < 0.5 else 0.0
    return robot.with_columns(
        REST=robot.column("REST") * rng.uniform(0.5, 2.0, n),
        SMOOTH=smooth,
        TANH=robot.column("SPEED") * rng.uniform(0.05, 0.3, n),
    )
