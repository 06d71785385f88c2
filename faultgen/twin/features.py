"""Numbers of a cycle by which a detector judges it. Each kind is a candidate of `train`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from faultgen.twin.alignment import KnownMotion

FINE, COARSE = 60, 20
"""Windows of a cycle for each axis."""

_TURNING = 0.02  # share of its highest speed above which an axis turns


def features_of(kind: str, torque: np.ndarray, motion: KnownMotion) -> np.ndarray:
    """Compute the features of cycles.

    Args:
        kind: A name of `KINDS`.
        torque: Torque of the motors, shape (cycles, samples, n_axes), in [N m].
        motion: The motion.

    Returns:
        Shape (cycles, features).
    """
    return KINDS[kind](torque[:, motion.compared], motion)


def _by_place(windows: int) -> Callable[[np.ndarray, KnownMotion], np.ndarray]:
    def means(torque: np.ndarray, motion: KnownMotion) -> np.ndarray:
        parts = np.array_split(torque, min(windows, torque.shape[1]), axis=1)
        return np.concatenate([part.mean(axis=1) for part in parts], axis=1)

    return means


def _friction_terms(torque: np.ndarray, motion: KnownMotion) -> np.ndarray:
    """What of each axis' torque goes with the sign of speed, with speed, with neither, and is slow.

    These are the coefficients of a regression over the cycle.
    """
    velocity = np.gradient(motion.path, motion.sample_period, axis=0)[motion.compared]
    found = []
    for axis, speed in enumerate(velocity.T):
        top = max(float(np.abs(speed).max()), 1e-12)
        share = speed / top
        turns = np.sign(share) * (np.abs(share) > _TURNING)
        slow = turns * np.exp(-((share / 0.15) ** 2))
        columns = np.stack([turns, share, np.ones_like(share), slow], axis=1)
        found.append(torque[:, :, axis] @ np.linalg.pinv(columns).T)
    return np.concatenate(found, axis=1)


def _mean_abs(torque: np.ndarray, motion: KnownMotion) -> np.ndarray:
    """Mean |torque| of each axis, as `faultgen isolate` uses it."""
    return np.abs(torque).mean(axis=1)


KINDS: dict[str, Callable[[np.ndarray, KnownMotion], np.ndarray]] = {
    "torque by place, 60 windows": _by_place(FINE),
    "torque by place, 20 windows": _by_place(COARSE),
    "friction terms": _friction_terms,
    "mean |torque|": _mean_abs,
}
"""Functions from torques of shape (cycles, places, n_axes) to features, by name. Those with more
features come first."""
