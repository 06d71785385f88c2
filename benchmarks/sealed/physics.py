"""A robot as the sealed simulator has it, and runs of it.

robot = nominal_physics(load_robot("puma560"))
run = simulate(robot, reference)  # shape (samples, n_axes, channels)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from sealed.chain import Chain, read_chain
from sealed.columns import INDEX, NAMES
from sealed.dynamics import SLOWLY, STEP, integrate
from sealed.rigid import body_arrays, inverse_dynamics

from faultgen.robot import COULOMB, OFFSET, STICTION, STRIBECK_VELOCITY, Robot

SAMPLE_PERIOD = 0.004
"""Of recordings [s]."""
GRID = 5e-4
"""Time between rows of a reference [s]; cubic interpolation in between."""
LEAD = 125
"""Samples at rest before a recording."""
MOTIONLESS = np.array([1.0, 1.0, 1.0, 0.0, 0.0])
"""Row of `SLOWLY` when nothing changes with time."""


@dataclass(frozen=True, kw_only=True)
class Physics:
    """One robot: links and a table of drivetrain parameters."""

    chain: Chain
    table: np.ndarray
    """Shape (n_axes, columns), as in `columns.NAMES`."""

    def column(self, name: str) -> np.ndarray:
        """One column, shape (n_axes,)."""
        return self.table[:, INDEX[name]]

    def changed(self, axis: int, **values: float) -> Physics:
        """Return the parameters with other values for one axis.

        Args:
            axis: Axis, from 1.
            values: New values of the axis by name.

        Returns:
            The changed parameters.
        """
        table = self.table.copy()
        for name, value in values.items():
            table[axis - 1, INDEX[name]] = value
        return replace(self, table=table)


@dataclass(frozen=True)
class Reference:
    """Joint angle, velocity and acceleration every `GRID`, shape (times, n_axes), from rest."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray

    @property
    def samples(self) -> int:
        """Samples of a recording of it."""
        return (len(self.q) - 1) // round(SAMPLE_PERIOD / GRID) + 1

    @property
    def sampled(self) -> np.ndarray:
        """Reference joint angle at the samples, shape (samples, n_axes), in [rad]."""
        return self.q[:: round(SAMPLE_PERIOD / GRID)]


def nominal_physics(robot: Robot) -> Physics:
    """The robot of the MJCF: LuGre friction, linear gearboxes."""
    model = robot.model
    drive, friction = robot.ids("actuator", "drive"), robot.ids("actuator", "friction")
    gearbox = robot.ids("tendon", "gearbox")
    bodies = model.jnt_bodyid[[model.joint(f"motor{i + 1}").id for i in range(robot.n_axes)]]
    bias, dyn = model.actuator_biasprm[friction], model.actuator_dynprm[friction]
    if bias[:, OFFSET + 1].any():
        raise ValueError(f"robot {robot.name}: cogging with poles is not written out here")
    values = {
        "N": robot.gear_ratio,
        "J": model.body_inertia[bodies, 2],
        "K": model.tendon_stiffness[gearbox],
        "D": model.tendon_damping[gearbox],
        "KP": model.actuator_gainprm[drive, 4],
        "KD": model.actuator_gainprm[drive, 6],
        "LIMIT": robot.motor_torque_limit,
        "FC": bias[:, COULOMB],
        "FS": bias[:, STICTION],
        "VS": bias[:, STRIBECK_VELOCITY],
        "EXPONENT": np.full(robot.n_axes, 2.0),
        "FV": model.actuator_damping[friction],
        "F0": bias[:, OFFSET] * np.sin(bias[:, OFFSET + 2]),
        "S0": dyn[:, 5],
        "S1": dyn[:, 6],
        "W0": np.full(robot.n_axes, 0.1),
    }
    table = np.zeros((robot.n_axes, len(NAMES)))
    for name, column in values.items():
        table[:, INDEX[name]] = column
    return Physics(chain=read_chain(robot), table=table)


def set_points(nominal: Physics, reference: Reference) -> np.ndarray:
    """What the controller commands: it knows the nominal robot only.

    Args:
        nominal: The robot of the MJCF.
        reference: The motion.

    Returns:
        Position [rad], velocity [rad/s] and feed-forward [N m], motor side, every `GRID`; shape
        (times, 3, n_axes).
    """
    load = inverse_dynamics(body_arrays(nominal.chain), reference.q, reference.qd, reference.qdd)
    ratio = nominal.column("N")
    speed = ratio * reference.qd
    share = np.tanh(speed / nominal.column("VS"))
    forward = load / ratio + nominal.column("J") * ratio * reference.qdd
    forward += nominal.column("FC") * share - nominal.column("F0") * np.abs(share)
    forward += nominal.column("FV") * speed
    return np.ascontiguousarray(np.stack([ratio * reference.q, speed, forward], axis=1))


def constant(samples: int, n_axes: int) -> np.ndarray:
    """Return a table of `SLOWLY` in which nothing changes.

    Args:
        samples: Number of samples.
        n_axes: Number of axes.

    Returns:
        Shape (samples, n_axes, 5).
    """
    return np.broadcast_to(MOTIONLESS, (samples, n_axes, len(SLOWLY))).copy()


def simulate(
    physics: Physics,
    points: np.ndarray,
    slow: np.ndarray | None = None,
    *,
    step: float = STEP,
    lead: int = LEAD,
) -> np.ndarray:
    """Run a robot along set points, from rest.

    Args:
        physics: The robot.
        points: From `set_points`.
        slow: What changes with time, shape (samples, n_axes, 5); default: nothing.
        step: Step [s].
        lead: Samples at rest before the first one.

    Returns:
        Shape (samples, n_axes, channels), as in `dynamics.CHANNELS`.

    Raises:
        FloatingPointError: The simulation diverged.
        ValueError: The step does not divide the sample period.
    """
    n_axes = len(physics.table)
    samples = (len(points) - 1) // round(SAMPLE_PERIOD / GRID) + 1
    slow = constant(samples, n_axes) if slow is None else slow
    ratio = physics.column("N")
    body = body_arrays(physics.chain)
    motor = points[0, 0] + ratio * physics.column("ENCODER")
    joint = motor / ratio
    still = np.zeros((1, n_axes))
    load = inverse_dynamics(body, joint[None], still, still)[0]
    state = np.stack([joint - load / physics.column("K"), still[0], motor, still[0]])
    every = round(SAMPLE_PERIOD / step)
    if abs(every * step - SAMPLE_PERIOD) > 1e-6 * step:
        raise ValueError(f"a step of {step:g} s does not divide the sample period")
    run = integrate(body, physics.table, points, GRID, slow, state, step, every, lead)
    if not np.isfinite(run).all():
        raise FloatingPointError("the sealed simulation diverged")
    return run
