"""What is recorded of a sealed robot: noise, quantisation, temperature, the file.

torque, position, velocity = measure(runs, spec, robot, rng)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from sealed.motions import protocol
from sealed.physics import SAMPLE_PERIOD

from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

LEVELS = (0.005, 0.01, 0.02)
"""Noise of the torque over its RMS in the nominal protocol."""
BITS = 12
"""Of the torque, over twice its limit."""
QUADRATURE = 4
"""Counts of a quadrature encoder a line."""
TEMPERATURES = (30.0, 55.0)
"""Between which each motion has its own [deg C]."""
_DRIFT = 1.5  # of a motion's temperature, at most [K]


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Torque noise by axis: white, and first-order autoregressive. Arrays: shape (n_axes,)."""

    white: np.ndarray
    """Standard deviation [N m]."""
    coloured: np.ndarray
    """Standard deviation [N m]."""
    memory: np.ndarray
    """Correlation from sample to sample of the coloured part."""


def draw_noise(level: float, rms: np.ndarray, rng: np.random.Generator) -> Noise:
    """Noise of another size and colour on each axis.

    Args:
        level: Of `LEVELS`.
        rms: RMS of the nominal torque, shape (n_axes,), in [N m].
        rng: Source of randomness.
    """
    axes = len(rms)
    total = level * rms * rng.uniform(0.8, 1.25, axes)
    share = rng.uniform(0.3, 0.7, axes)
    time = rng.uniform(0.008, 0.03, axes)
    return Noise(
        white=total * np.sqrt(1 - share),
        coloured=total * np.sqrt(share),
        memory=np.exp(-SAMPLE_PERIOD / time),
    )


def torque_noise(noise: Noise, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the noise of the torque.

    Args:
        noise: The noise.
        samples: Number of samples.
        rng: Source of randomness.

    Returns:
        Torque [N m], shape (samples, n_axes).
    """
    axes = len(noise.white)
    white, kicks = rng.standard_normal((2, samples, axes))
    for axis, memory in enumerate(noise.memory):
        kicks[1:, axis] *= np.sqrt(1 - memory**2)
        kicks[:, axis] = lfilter([1.0], [1.0, -memory], kicks[:, axis])
    return noise.white * white + noise.coloured * kicks


def draw_temperatures(lengths: Sequence[int], rng: np.random.Generator) -> list[np.ndarray]:
    """Draw slowly drifting temperatures.

    The motions cover the whole range, in random order.

    Args:
        lengths: Number of samples of each motion.
        rng: Source of randomness.

    Returns:
        Temperature of each motion [deg C], shape (samples,) each.
    """
    low, high = TEMPERATURES
    start = low + (high - low) * (np.arange(len(lengths)) + rng.uniform(0, 1, len(lengths))) / len(
        lengths
    )
    drift = rng.uniform(-_DRIFT, _DRIFT, len(lengths))
    return [
        np.clip(at + rise * np.linspace(0, 1, n), low, high)
        for at, rise, n in zip(rng.permutation(start), drift, lengths, strict=True)
    ]


def measure(
    runs: Sequence[np.ndarray],
    torque: Sequence[np.ndarray],
    temperatures: Sequence[np.ndarray],
    robot: Robot,
    noise: Noise,
    rng: np.random.Generator,
) -> Recording:
    """Measure the runs of a protocol.

    Args:
        runs: By motion, from `physics.simulate`.
        torque: What the torque sensor sees of each, shape (samples, n_axes), in [N m].
        temperatures: By motion, shape (samples,), in [deg C].
        robot: The robot.
        noise: Of the torque.
        rng: Source of randomness.

    Returns:
        The recording, a segment a motion.
    """
    count = 2 * np.pi / (QUADRATURE * robot.encoder_counts)
    step = robot.motor_torque_limit / 2 ** (BITS - 1)
    position, velocity, seen = [], [], []
    for run, clean in zip(runs, torque, strict=True):
        counted = np.round(run[:, :, 0] / count) * count
        position.append(counted)
        velocity.append(np.gradient(counted, SAMPLE_PERIOD, axis=0))
        noisy = clean + torque_noise(noise, len(clean), rng)
        seen.append(np.round(noisy / step) * step)
    starts = np.cumsum([0, *[len(run) for run in runs[:-1]]])
    return Recording(
        source="sealed",
        robot=robot.name,
        side="motor",
        sample_period=SAMPLE_PERIOD,
        position=np.concatenate(position),
        torque=np.concatenate(seen),
        velocity=np.concatenate(velocity),
        reference_position=np.concatenate([motion.sampled for motion in protocol(robot.name)]),
        temperature=np.concatenate(list(temperatures)),
        segments=tuple(int(start) for start in starts),
    )
