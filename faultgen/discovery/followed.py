"""The measured position that a model follows: smoothed as far as noise and torque require.

A position is first smoothed according to its own noise, which is taken as white. Noise of real logs
may last for some milliseconds, for example because the samples are late by different times. Smooth
positions then still have far too large accelerations. The measured torque shows this: a rigid arm
on a motion that is smoothed further explains it better.
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.recording import Recording
from faultgen.discovery.smoothing import smoothings
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque

STRONGER = tuple(range(11))
"""Common logarithms of the factors of the penalty of smoothing that are tried. A factor of a
million lowers the bandwidth to a tenth."""

_CLEARLY = 0.75  # squared torque error, over that without more smoothing, that requires it: assumed
_NEARLY = 1.02  # the same over the smallest one, up to which weaker smoothing is preferred: assumed
_FEWEST = 100  # samples of an axis that can tell


def followed(
    recording: Recording, robot: Robot, inside: np.ndarray, position: np.ndarray | None = None
) -> np.ndarray:
    """Smooth the measured positions.

    All axes are smoothed equally much more than their own noise requires, because what is late in a
    log is late on all axes, and because the torque of an axis with little inertia tells nothing.

    Args:
        recording: The measured data.
        robot: The model.
        inside: Samples whose torque is compared, shape (samples, n_axes).
        position: Its position, joint side, shape (samples, n_axes); None if no gearbox turns with
            another joint.

    Returns:
        Joint side, shape (samples, n_axes), in [rad], or [m] for slides.
    """
    if position is None:
        position = recording.joint_position(robot)
    arm = Arm(robot)
    trials = _smoothed(position, recording)
    errors = [_error(recording, arm, one, inside) for one in trials]
    clearly = min(errors) < _CLEARLY * errors[0]
    best = next(k for k, one in enumerate(errors) if one <= _NEARLY * min(errors))
    return trials[best if clearly else 0]


def _smoothed(position: np.ndarray, recording: Recording) -> np.ndarray:
    """The position for each of `STRONGER`, shape (trials, samples, n_axes)."""
    out = np.empty((len(STRONGER), *position.shape))
    for part in recording.parts:
        for axis in range(position.shape[1]):
            out[:, part, axis] = smoothings(position[part, axis], STRONGER)
    return out


def _error(recording: Recording, arm: Arm, position: np.ndarray, inside: np.ndarray) -> float:
    """Mean squared torque that a rigid arm with friction of any size leaves.

    It is the geometric mean over the axes, as a share of the squared torque of each.
    """
    q, qd, qdd = position, np.empty_like(position), np.empty_like(position)
    for part in recording.parts:
        qd[part] = np.gradient(q[part], recording.sample_period, axis=0)
        qdd[part] = np.gradient(qd[part], recording.sample_period, axis=0)
    torque = arm.inverse_dynamics(q, qd, qdd) if recording.link else motor_torque(arm, q, qd, qdd)
    left = []
    for axis in range(q.shape[1]):
        rows = inside[:, axis]
        measured, speed = recording.torque[rows, axis], qd[rows, axis]
        if rows.sum() < _FEWEST or not measured.any():
            continue
        known = np.stack([torque[rows, axis], np.sign(speed), speed, np.ones_like(speed)], axis=1)
        size = np.linalg.lstsq(known, measured, rcond=None)[0]
        left.append(np.mean((measured - known @ size) ** 2) / np.mean(measured**2))
    return float(np.exp(np.mean(np.log(np.maximum(left, 1e-12))))) if left else 1.0
