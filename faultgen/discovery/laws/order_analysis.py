"""Periodic effects of unknown order: how many cycles per motor turn does a residual show?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from faultgen.inference.limits import ORDER_CHANCE
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

SMALLEST_ORDER, LARGEST_ORDER = 0.5, 12.0
"""Cycles a motor turn that are looked for: assumed. Slower ones are not told from load."""

_BINS = 64  # a motor turn
_PAD = 4  # finer than the resolution of the angle that was travelled
_FEWEST = 3.0  # cycles within the travelled angle; fewer are not told from gravity
_MOST = 2  # orders an axis


@dataclass(frozen=True)
class Order:
    """A periodic component of a residual."""

    axis: int
    """From 1."""
    order: float
    """Cycles per motor turn. Whole numbers are what motors and couplings cause, so the nearest one
    counts if the travelled angle does not resolve the difference."""
    strength: float
    """Chi-square with two degrees of freedom for each direction and level of speed."""


def find_orders(
    recording: Recording, robot: Robot, error: np.ndarray, inside: np.ndarray
) -> list[Order]:
    """Find torque that is periodic in the motor's angle.

    Args:
        recording: The measured data.
        robot: The model.
        error: Whitened error, shape (samples, n_axes).
        inside: Samples that are used, same shape.

    Returns:
        Orders that noise does not explain, strongest first.
    """
    position = recording.motor_position(robot)
    turns = position / (2 * np.pi)
    _, velocity, _ = recording.derivatives(position)
    found = []
    for axis in range(turns.shape[1]):
        rows = inside[:, axis]
        if rows.sum() < 100:
            continue
        classes = _classes(velocity[rows, axis])
        found += _orders(axis + 1, turns[rows, axis], error[rows, axis], classes)
    return sorted(found, key=lambda one: -one.strength)


def _classes(velocity: np.ndarray) -> np.ndarray:
    """Class of each sample by direction and speed: the servo's phase depends on the frequency."""
    speed = np.abs(velocity)
    level = np.searchsorted(np.quantile(speed, [1 / 3, 2 / 3]), speed)
    return level + 3 * (velocity > 0)


def _orders(axis: int, turns: np.ndarray, error: np.ndarray, classes: np.ndarray) -> list[Order]:
    travelled = float(np.ptp(turns))
    if travelled < _FEWEST / LARGEST_ORDER:
        return []
    index = np.round((turns - turns.min()) * _BINS).astype(int)
    length = _PAD * (index.max() + 1)
    order = np.arange(length // 2 + 1) * _BINS / length
    outside = (order < max(SMALLEST_ORDER, _FEWEST / travelled)) | (order > LARGEST_ORDER)
    kinds = np.unique(classes)
    chance = ORDER_CHANCE / (6 * max(travelled * LARGEST_ORDER, 1.0))
    least = float(chi2.isf(chance, 2 * len(kinds)))
    left, found = error.copy(), []
    for _ in range(_MOST):
        strength = np.zeros(len(order))
        for kind in kinds:
            rows = classes == kind
            binned = np.bincount(index[rows], weights=left[rows])
            power = np.abs(np.fft.rfft(binned, length)) ** 2
            # noise has a mean square of 1; less means that the residual lacks some of its noise
            strength += 2 * power / max(float(left[rows] @ left[rows]), rows.sum())
        strength[outside] = 0
        k = int(np.argmax(strength))
        if strength[k] < least:
            break
        top = _top(order[k], order[1], turns, left, classes)
        whole = round(top)
        is_whole = whole > 0 and abs(top - whole) < 1 / travelled
        found.append(Order(axis, whole if is_whole else top, float(strength[k])))
        left = left - _fitted(top, turns, left, classes)
    return found


def _waves(order: float, turns: np.ndarray, classes: np.ndarray) -> np.ndarray:
    """Sine and cosine, separately for each class; shape (samples, 2 classes)."""
    angle = 2 * np.pi * order * turns
    member = classes[:, None] == np.unique(classes)
    return np.hstack([member * np.sin(angle)[:, None], member * np.cos(angle)[:, None]])


def _fitted(order: float, turns: np.ndarray, error: np.ndarray, classes: np.ndarray) -> np.ndarray:
    waves = _waves(order, turns, classes)
    answer, *_ = np.linalg.lstsq(waves, error, rcond=None)
    return waves @ answer


def _top(
    order: float, width: float, turns: np.ndarray, error: np.ndarray, classes: np.ndarray
) -> float:
    """Maximum of a peak, between its neighbours on the grid."""

    def loss(at: float) -> float:
        return -float(np.sum((error @ _waves(at, turns, classes)) ** 2))

    bounds = (order - width, order + width)
    return float(minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 1e-5}).x)
