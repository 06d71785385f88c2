"""What all recordings of a laboratory share: robot, servo, motions, noise and gain of the log.

setup = set_up(draw_laboratory("development", 3))
setup.robot, setup.points, setup.noise
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from laboratories.draw import Laboratory
from laboratories.motions import MOTIONS, Motion, draw_motion
from laboratories.noise import TorqueNoise, draw_noise
from laboratories.robots import Plant, nominal, random_robot, set_points, simulate
from laboratories.servo import with_servo

CURRENT = (0.03, 0.005)
"""Largest error of a current's gain, and of its zero over the torque limit; even distributions."""
LOG_GAIN = (0.03, 0.2)
"""Smallest and largest error of the gain of a torque log, drawn evenly in its logarithm."""


@dataclass(frozen=True)
class Setup:
    """What all recordings of a laboratory share."""

    lab: Laboratory
    ideal: Plant
    """The model with the laboratory's servo."""
    robot: Plant
    """The healthy robot."""
    bandwidth: float
    """Of the servo that was possible [Hz]."""
    motions: tuple[Motion, ...]
    """Of the recordings, then of the one to score on."""
    points: tuple[np.ndarray, ...]
    runs: tuple[np.ndarray, ...]
    """Of the ideal robot."""
    noise: TorqueNoise
    gain: np.ndarray
    """Of the logged torque, shape (n_axes,)."""
    zero: np.ndarray
    """Of the logged torque [N m], shape (n_axes,)."""
    n_measured: int
    """Motions that are in the recording; the others are to score on."""

    @property
    def period(self) -> float:
        """Sample period [s]."""
        return 1.0 / float(self.lab.factors["rate"])


def log_gain(lab: Laboratory) -> np.ndarray:
    """Gain of the torque log of each axis, shape (n_axes,): wrong for none, for all or for some."""
    n, rng = lab.machine.n_axes, np.random.default_rng([lab.seed, 8])
    low, high = np.log(LOG_GAIN)
    size = rng.choice([-1.0, 1.0], n) * np.exp(rng.uniform(low, high, n))
    some = rng.uniform(size=n) < 0.5
    some[rng.integers(n)] = True
    kinds = {"right": 0 * size, "robot": np.full(n, size[0]), "axes": np.where(some, size, 0)}
    gain: np.ndarray = 1 + kinds[lab.factors["log_gain"]]
    return gain


def beside(lab: Laboratory, mode: str) -> list[dict[str, Any]]:
    """What a recording has in every case of a laboratory, and a perfect answer may list.

    A log whose gain is g shows what a motor does whose torque constant is lower by 1 - 1 / g. A
    healthy recording of the same robot has it as well.
    """
    gain = log_gain(lab) if mode == "alone" else np.ones(lab.machine.n_axes)
    return [
        {"name": "torque_constant", "axis": axis + 1, "severity": float(1 - 1 / gain[axis])}
        for axis in np.flatnonzero(gain != 1).tolist()
    ]


def set_up(lab: Laboratory) -> Setup:
    """Draw everything that the recordings of a laboratory share.

    Args:
        lab: The laboratory.
    """
    rng = np.random.default_rng([lab.seed, 5])
    factors, machine = lab.factors, lab.machine
    ideal, bandwidth = with_servo(
        nominal(machine), factors["servo"], factors["bandwidth"], factors["servo_period"]
    )
    count = int(factors["segments"])
    length = round(float(factors["seconds"]) / count, 2)
    kinds = MOTIONS if factors["motion"] == "mixed" else (factors["motion"],)
    first = int(rng.integers(len(kinds)))
    motions = [
        draw_motion(kinds[(first + k) % len(kinds)], machine, length, rng) for k in range(count)
    ]
    # two motions of other types to score on, of 5 s together
    motions += [draw_motion(kind, machine, 2.5, rng) for kind in ("task", "multisine")]
    points = tuple(set_points(machine, m.q, m.qd, m.qdd) for m in motions)
    runs = tuple(simulate(ideal, one) for one in points)
    rows = np.concatenate(runs)
    ideal = ideal.with_columns(
        X_REF=np.sqrt(np.mean(rows[:, :, 1] ** 2, axis=0)),
        X_LOAD_REF=np.sqrt(np.mean((rows[:, :, 3] / machine.ratio) ** 2, axis=0)),
        X_TWIST_REF=np.sqrt(np.mean((rows[:, :, 3] / machine.stiffness) ** 2, axis=0)),
    )
    noise = draw_noise(
        factors["noise"],
        factors["level"],
        rows[:, :, 2],
        rows[:, :, 1],
        n_motions=len(motions),
        sample_period=1 / factors["rate"],
        limit=machine.limit,
        rng=rng,
    )
    n = machine.n_axes
    current = factors["torque"] == "current"
    return Setup(
        lab=lab,
        ideal=ideal,
        robot=random_robot(ideal, factors["model_error"], rng),
        bandwidth=bandwidth,
        motions=tuple(motions),
        points=points,
        runs=runs,
        noise=noise,
        gain=log_gain(lab) * (1 + current * CURRENT[0] * rng.uniform(-1, 1, n)),
        zero=current * CURRENT[1] * machine.limit * rng.uniform(-1, 1, n),
        n_measured=count,
    )
