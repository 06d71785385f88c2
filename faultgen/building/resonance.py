"""Resonances of a robot's drivetrains, and the largest time step at which they are stable.

All motions are small and about one pose. The rotors are seen through their gear ratios, as outputs
o = q_motor / n of inertia n^2 J, so that the springs are those of the gearboxes:

    M q'' + C' K (C q - o) = 0,   n^2 J o'' + K (o - C q) = 0
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, eigvals, eigvalsh

from faultgen.building.ranges import half_ranges
from faultgen.mjcf.dcmotor import POSITION_GAIN, VELOCITY_GAIN
from faultgen.robot import BRISTLE_DAMPING, BRISTLE_STIFFNESS, Robot
from faultgen.simulation.arm import Arm

BRISTLE_RULE = 0.5
"""Largest step times sqrt(bristle stiffness / rotor inertia)."""

_GRID = np.geomspace(1e-6, 0.05, 48)  # steps that are tried [s]
_STABLE = 1 + 1e-7  # largest spectral radius of one step: rounding


@dataclass(frozen=True)
class Resonances:
    """Resonances at one pose, in [Hz]."""

    axis: np.ndarray
    """Of each axis alone, with its rotor locked and the other axes stiff, shape (n_axes,)."""
    locked: np.ndarray
    """Of the arm with all rotors locked, ascending, shape (n_axes,)."""
    free: np.ndarray
    """Of arm and rotors without friction and servo, without those at zero, ascending."""


def sampled_poses(joint_range: np.ndarray, slides: np.ndarray, count: int) -> np.ndarray:
    """Draw poses from the range of the joints, always the same ones.

    Args:
        joint_range: Lower and upper joint position, shape (n_axes, 2), infinite if unlimited.
        slides: Whether an axis slides, shape (n_axes,).
        count: Number of poses.

    Returns:
        Shape (count, n_axes), in [rad] or [m]. A joint without limits turns by up to 180 deg, or
        slides by up to 1 m, to both sides.
    """
    most = half_ranges(slides)
    low, high = (
        np.where(np.isfinite(x), x, s * most) for x, s in zip(joint_range.T, (-1, 1), strict=True)
    )
    return low + (high - low) * np.random.default_rng(0).random((count, len(most)))


def zero_pose(robot: Robot) -> np.ndarray:
    """Return the pose at zero, or at the nearest limits.

    Args:
        robot: The robot.

    Returns:
        Joint positions, shape (n_axes,), in [rad] or [m].
    """
    return np.clip(np.zeros(robot.n_axes), *robot.joint_range.T)


def resonances(robot: Robot, pose: np.ndarray) -> Resonances:
    """Compute the resonances of a robot.

    Args:
        robot: The robot.
        pose: Joint positions, shape (n_axes,), in [rad] or [m].
    """
    mass, stiffness, _ = _arm(robot, pose)
    turns = robot.gearing.outputs(np.eye(robot.n_axes)).T
    back = np.linalg.inv(turns)
    springs = turns.T @ stiffness @ turns
    both = block_diag(_rotors(robot), mass)
    whole = np.block([[stiffness, -stiffness @ turns], [-turns.T @ stiffness, springs]])
    free = _frequency(eigvalsh(whole, both))
    return Resonances(
        axis=_frequency(np.diag(stiffness) / np.diag(back.T @ mass @ back)),
        locked=_frequency(eigvalsh(springs, mass)),
        free=free[robot.n_axes :],
    )


def _frequency(squared: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(squared, 0)) / (2 * np.pi)


def _arm(robot: Robot, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inertia of the arm, and stiffness and damping of the gearboxes."""
    tendons = robot.ids("tendon", "gearbox")
    stiffness, damping = robot.model.tendon_stiffness, robot.model.tendon_damping
    return Arm(robot).inertia(pose), np.diag(stiffness[tendons]), np.diag(damping[tendons])


def _rotors(robot: Robot) -> np.ndarray:
    """Inertia of the rotors at the outputs of their gearboxes."""
    return np.diag(robot.model.dof_M0[list(robot.motors)] * robot.gear_ratio**2)


def largest_step(robot: Robot, pose: np.ndarray) -> float:
    """Compute the largest time step at which small motions about a pose do not grow.

    The motions are those of the arm and the rotors with gearboxes, servo, viscous friction and the
    bristles of resting friction, integrated as MuJoCo's Euler integrator does.

    Args:
        robot: The robot.
        pose: Joint positions, shape (n_axes,), in [rad] or [m].

    Returns:
        The step [s]; 0.05 if none up to 0.05 s is unstable.
    """
    model, n = robot.model, robot.n_axes
    mass, spring, damper = _arm(robot, pose)
    drive, friction = (robot.ids("actuator", name) for name in ("drive", "friction"))
    at_rest = model.actuator_dynprm[friction]
    servo = model.actuator_gainprm[drive]
    squared = robot.gear_ratio**2
    viscous = model.actuator_damping[friction]
    stiff = squared * (servo[:, POSITION_GAIN] + at_rest[:, BRISTLE_STIFFNESS])
    slow = squared * (servo[:, VELOCITY_GAIN] + at_rest[:, BRISTLE_DAMPING] + viscous)
    turns = robot.gearing.outputs(np.eye(n)).T
    couple = np.block([[np.eye(n), -turns]])
    stiffness = couple.T @ spring @ couple + block_diag(np.diag(stiff), np.zeros((n, n)))
    damping = couple.T @ damper @ couple + block_diag(np.diag(slow), np.zeros((n, n)))
    inverse = np.linalg.inv(block_diag(_rotors(robot), mass))

    def grows(step: float) -> bool:
        kick, drag = -step * inverse @ stiffness, np.eye(2 * n) - step * inverse @ damping
        once = np.block([[np.eye(2 * n) + step * kick, step * drag], [kick, drag]])
        return bool(np.abs(eigvals(once)).max() > _STABLE)

    first = next((k for k, step in enumerate(_GRID) if grows(step)), None)
    if first is None:
        return float(_GRID[-1])
    if first == 0:
        return 0.0
    low, high = _GRID[first - 1], _GRID[first]
    for _ in range(12):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if grows(middle) else (middle, high)
    return float(low)


def bristle_step(robot: Robot) -> np.ndarray:
    """Compute the largest time step that the bristles of each friction element allow.

    Args:
        robot: The robot.

    Returns:
        Shape (n_axes,), in [s]; infinite for an axis without bristles.
    """
    stiffness = robot.model.actuator_dynprm[robot.ids("actuator", "friction"), BRISTLE_STIFFNESS]
    inertia = robot.model.dof_M0[list(robot.motors)]
    with np.errstate(divide="ignore"):
        return BRISTLE_RULE * np.sqrt(inertia / stiffness)
