"""Motions of the laboratories: moves of a task, speed ladders, multi-sines, single axes.

q, qd, qdd = draw_motion("ladder", machine, seconds=5.0, rng=rng)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from laboratories.mjcf import Machine
from laboratories.plant import GRID
from laboratories.robots import set_points

MOTIONS = ("task", "ladder", "multisine", "single_axis")
_TORQUE = 0.7  # share of the torque limit that the nominal robot may need
_SPEED = 0.9  # share of the speed limit
_RUNGS = ((1.0, 1.0), (0.3, 0.35), (0.55, 0.08), (0.1, 0.6), (0.25, 0.15), (0.0, 0.3))
"""Of a ladder: where a move ends over the stroke, and its speed over the first one's."""
_TRIES = 200


@dataclass(frozen=True)
class Motion:
    """Joint motion every `GRID`, from rest to rest; arrays of shape (times, n_axes)."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray

    @property
    def seconds(self) -> float:
        """Length [s]."""
        return (len(self.q) - 1) * GRID


def _septic(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From 0 to 1, without speed, acceleration and jerk at the ends; with two derivatives."""
    s = np.clip(s, 0, 1)
    at = s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    return at, 140 * s**3 * (1 - s) ** 3, 420 * s**2 * (1 - s) ** 2 * (1 - 2 * s)


def _moves(times: np.ndarray, knots: list[tuple[float, float, np.ndarray]]) -> np.ndarray:
    """Moves one after another: start time, duration and step of each; shape (3, times, n_axes)."""
    out = np.zeros((3, len(times), len(knots[0][2])))
    for start, length, step in knots:
        for order, part in enumerate(_septic((times - start) / length)):
            out[order] += part[:, None] * step / length**order
    return out


def _shape(kind: str, machine: Machine, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """A motion about zero that may be larger than the limits allow, shape (3, times, n_axes)."""
    n = machine.n_axes
    times = np.arange(round(seconds / GRID) + 1) * GRID
    reach = 0.5 * (machine.high - machine.low)
    usable = seconds - 0.3
    if kind == "multisine":
        harmonics = np.arange(1, 6)
        rate = 2 * np.pi * harmonics / max(2.5, usable / 2)
        size = rng.uniform(0.3, 1, (5, n)) / harmonics[:, None] * reach
        phase = rng.uniform(0, 2 * np.pi, (5, n))
        angle = times[:, None, None] * rate[:, None] + phase
        waves = np.array(
            [
                (size * np.sin(angle)).sum(axis=1),
                (size * rate[:, None] * np.cos(angle)).sum(axis=1),
                (-size * rate[:, None] ** 2 * np.sin(angle)).sum(axis=1),
            ]
        )
        ramp = 0.6
        up = _septic((times - 0.05) / ramp)
        down = _septic((seconds - 0.15 - times) / ramp)
        w = (up[0] * down[0])[:, None]
        wd = ((up[1] * down[0] - up[0] * down[1]) / ramp)[:, None]
        wdd = ((up[2] * down[0] - 2 * up[1] * down[1] + up[0] * down[2]) / ramp**2)[:, None]
        x, xd, xdd = waves
        return np.array([w * x, w * xd + wd * x, w * xdd + 2 * wd * xd + wdd * x])
    knots: list[tuple[float, float, np.ndarray]] = []
    if kind == "task":
        count = max(2, round(usable / 1.0))
        poses = rng.uniform(-1, 1, (count + 1, n)) * reach
        poses[-1] = poses[0] = 0
        weights = rng.uniform(0.6, 1.6, count)
        lengths = weights / weights.sum() * usable
        clock = 0.1
        for k, length in enumerate(lengths):
            rest = min(0.15, 0.2 * length) * rng.integers(2)
            knots.append((clock, length - rest, poses[k + 1] - poses[k]))
            clock += length
    elif kind == "ladder":
        stroke = rng.choice([-1.0, 1.0], n) * reach * rng.uniform(0.7, 1.0, n)
        rounds = max(1, round(usable / 6))
        path = list(_RUNGS) * rounds
        here, clock = 0.0, 0.1
        slowness = []
        for there, speed in path:
            slowness.append(max(abs(there - here), 0.05) / speed**0.5)
            here = there
        here = 0.0
        for (there, _), slow in zip(path, slowness, strict=True):
            length = slow / sum(slowness) * usable
            late = rng.uniform(0, 0.2, n)
            for axis in range(n):
                step = np.zeros(n)
                step[axis] = (there - here) * stroke[axis]
                knots.append((clock + late[axis] * length, (0.95 - late[axis]) * length, step))
            clock, here = clock + length, there
    elif kind == "single_axis":
        each = usable / n
        for place, axis in enumerate(rng.permutation(n)):
            step = np.zeros(n)
            step[axis] = reach[axis] * rng.choice([-1.0, 1.0])
            start = 0.1 + place * each
            knots.append((start, 0.28 * each, step))
            knots.append((start + 0.3 * each, 0.65 * each, -step))
    else:
        raise ValueError(f"no motion '{kind}'")
    return _moves(times, knots)


def draw_motion(kind: str, machine: Machine, seconds: float, rng: np.random.Generator) -> Motion:
    """Draw a motion that keeps the limits of position, speed, acceleration and torque.

    Args:
        kind: Of `MOTIONS`.
        machine: The model.
        seconds: Length [s].
        rng: Source of randomness.

    Returns:
        The motion.

    Raises:
        ValueError: None was found.
    """
    width = machine.high - machine.low
    speed = machine.speed_limit / np.abs(machine.ratio)
    for _ in range(_TRIES):
        shape = _shape(kind, machine, seconds, rng)
        # each axis as wide as its range, speed and acceleration let it be
        most = np.abs(shape).max(axis=1)
        span = np.maximum(np.ptp(shape[0], axis=0), 1e-9)
        least = np.maximum(most, 1e-9)
        room = np.minimum(
            np.minimum(0.8 * width / span, _SPEED * speed / least[1]),
            machine.acceleration_limit / least[2],
        )
        shape = shape * np.minimum(room, 1.0) * rng.uniform(0.75, 1.0, machine.n_axes)
        low = machine.low + 0.05 * width - shape[0].min(axis=0)
        high = machine.high - 0.05 * width - shape[0].max(axis=0)
        centre = low + rng.uniform(0.1, 0.9, machine.n_axes) * (high - low)
        for _ in range(4):
            q = centre + shape[0]
            thin = slice(None, None, 8)
            forward = set_points(machine, q[thin], shape[1][thin], shape[2][thin])[:, 2]
            share = float((np.abs(forward) / machine.limit).max()) / _TORQUE
            if share <= 1:
                return Motion(q, shape[1], shape[2])
            shape = shape * 0.75
    raise ValueError(f"no motion '{kind}' of {seconds:g} s within the limits was found")
