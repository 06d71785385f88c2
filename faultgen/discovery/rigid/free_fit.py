"""Least squares with free factors, judged on blocks that were not fitted."""

from __future__ import annotations

import numpy as np

BLOCKS = 8
"""Blocks of a recording, each of which is left out of a fit once: assumed."""

_RIDGES = (1e-4, 1e-2, 1.0)  # of the fit with free parameters, over the number of samples


def left_by(x: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Compute the error of each block with factors that were fitted to the other blocks.

    Args:
        x: Columns, shape (samples, columns).
        torque: What they have to explain, shape (samples,).

    Returns:
        Shape (samples,), with the ridge of `_RIDGES` that predicts best.
    """
    x = x / np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-12)
    gram, right = x.T @ x, x.T @ torque
    blocks = np.array_split(np.arange(len(x)), BLOCKS)
    own = [(x[one].T @ x[one], x[one].T @ torque[one]) for one in blocks]
    tried = []
    for ridge in _RIDGES:
        more = ridge * len(x) * np.eye(len(gram))
        tried.append(
            np.concatenate(
                [
                    torque[one] - x[one] @ np.linalg.solve(gram - theirs + more, right - product)
                    for one, (theirs, product) in zip(blocks, own, strict=True)
                ]
            )
        )
    return min(tried, key=lambda left: float(left @ left))


def independent(error: np.ndarray) -> float:
    """Count the independent values of a series, from its autocorrelation until it is negative.

    Args:
        error: Shape (samples,).

    Returns:
        The number, at least 1.
    """
    count = len(error)
    around = error - error.mean()
    spectrum = np.abs(np.fft.rfft(around, 2 * count)) ** 2
    correlation = np.fft.irfft(spectrum)[:count]
    if correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation < 0)
    stop = int(below[0]) if len(below) else count
    return max(count / (1 + 2 * float(correlation[1:stop].sum())), 1.0)
