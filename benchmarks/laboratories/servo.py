"""Servos of the laboratories: structure, bandwidth and period.

plant = with_servo(plant, "cascade", bandwidth=8.0, period=1e-3)
"""

from __future__ import annotations

import numpy as np
from laboratories.arm import body_arrays, inverse
from laboratories.mjcf import Machine
from laboratories.plant import DENSE, GRID
from laboratories.robots import Plant, simulate

SERVOS = ("model", "pd", "pd_ff", "pid_ff", "cascade", "cascade_ff")
"""The model's own; PD, with feed-forward, with integral; P on position over PI on speed."""
_DIRECT, _CASCADE = 1, 2
_SHRINK = 0.75  # of the bandwidth, when a servo rings
_DECAYED = 0.25  # of the first speed, after `_HOLD`
_HOLD = 0.7  # [s]


def motor_inertia(machine: Machine) -> np.ndarray:
    """Inertia that each motor turns, with that of the arm in the middle of its range [kg m^2]."""
    n = machine.n_axes
    middle = np.tile(0.5 * (machine.low + machine.high), (n + 1, 1))
    push = np.vstack([np.eye(n), np.zeros(n)])
    torque = inverse(body_arrays(machine), middle, np.zeros((n + 1, n)), push)
    inertia: np.ndarray = machine.rotor + np.diag(torque[:n] - torque[n]) / machine.ratio**2
    return inertia


def _gains(machine: Machine, kind: str, bandwidth: np.ndarray) -> dict[str, np.ndarray | float]:
    inertia, rate = motor_inertia(machine), 2 * np.pi * bandwidth
    feeds = 1.0 if kind.endswith("ff") else 0.0
    if kind == "model":
        gains: dict[str, np.ndarray | float] = {"KP": machine.kp, "KD": machine.kd, "KI": 0.0}
        return gains | {"TYPE": _DIRECT, "FORWARD": 1.0, "FORWARD_SPEED": 1.0}
    if kind.startswith("cascade"):
        speed = 3.5 * rate
        gains = {"KP": rate, "KD": inertia * speed, "KI": inertia * speed**2 / 6}
        return gains | {"TYPE": _CASCADE, "FORWARD": feeds, "FORWARD_SPEED": 1.0}
    kp = inertia * rate**2
    integral = kp * rate / 8 if kind.startswith("pid") else 0.0
    gains = {"KP": kp, "KD": 1.8 * inertia * rate, "KI": integral}
    return gains | {"TYPE": _DIRECT, "FORWARD": feeds, "FORWARD_SPEED": feeds}


def _rings(plant: Plant) -> np.ndarray:
    """Whether an axis still moves some time after a push, with little friction; (n_axes,)."""
    machine = plant.machine
    rows = round(_HOLD / GRID) + 1
    points = np.zeros((rows, 3, machine.n_axes))
    middle = machine.ratio * 0.5 * (machine.low + machine.high)
    still = np.zeros((1, machine.n_axes))
    load = inverse(body_arrays(machine), (middle / machine.ratio)[None], still, still)
    points[:, 0], points[:, 2] = middle, load / machine.ratio
    points[: round(0.005 / GRID), 0] += 0.02  # the push: a step of the set point [rad]
    slick = plant.with_columns(
        COULOMB=0.05 * plant.column("COULOMB"), RISE=0.05 * plant.column("RISE")
    )
    try:
        speed = np.abs(simulate(slick, points)[:, :, 1])
    except FloatingPointError:
        return np.ones(machine.n_axes, bool)
    part = round(0.15 / DENSE)
    ringing: np.ndarray = speed[-part:].max(axis=0) > _DECAYED * speed[:part].max(axis=0) + 1e-3
    return ringing


def with_servo(plant: Plant, kind: str, bandwidth: float, period: float) -> tuple[Plant, float]:
    """Give a robot its servos. The bandwidth shrinks for all axes until none of them rings.

    Args:
        plant: The nominal robot.
        kind: Of `SERVOS`.
        bandwidth: Of the position loop [Hz]; without meaning for 'model'.
        period: Of the servo [s].

    Returns:
        The robot, and the bandwidth that was possible.

    Raises:
        ValueError: It rings at any bandwidth.
    """
    for _ in range(12):
        bands = np.full(plant.machine.n_axes, bandwidth)
        trial = plant.with_columns(PERIOD=period, **_gains(plant.machine, kind, bands))
        if kind == "model" or not _rings(trial).any():
            return trial, bandwidth
        bandwidth *= _SHRINK
    raise ValueError(f"servo {kind} at {1e3 * period:g} ms rings at any bandwidth")
