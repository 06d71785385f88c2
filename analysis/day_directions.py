"""Directions in which healthy recordings differ, and which no known difference of days describes.

    directions = unknown_directions(scores, information, columns, simulated)

Healthy recordings are reduced to scores A C^-1 (x - mean), whitened with their model covariance
A C^-1 A'. Their principal components then have the eigenvalue 1, but for chance. What is larger is
a difference between days that the model lacks. An eigenvalue of few recordings is too large; the
limit for many features and recordings gives what it would be with infinitely many (Baik, Ben Arous
and Peche 2005, doi 10.1214/009117905000000233; Paul 2007).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SETS = 100  # simulated sets of recordings
_SURE = 0.99  # share of them whose largest eigenvalue is below that of an unknown direction
_SEEN = 1.0  # squared standard deviations: a direction in which no usual effect is seen has less


def unknown_directions(
    scores: Floats,
    information: Floats,
    sizes: Floats,
    simulated: Callable[[int], Floats],
) -> Floats:
    """Find what healthy recordings have in common that the model of their days lacks.

    Args:
        scores: Of healthy recordings less their mean, shape (recordings, columns).
        information: Covariance of a recording by the model, shape (columns, columns).
        sizes: Usual size of each column, shape (columns,).
        simulated: Function that draws some sets of as many recordings from the model, less their
            means, shape (sets, recordings, columns).

    Returns:
        Weights of the columns, whose sum is one standard deviation of a direction, shape
        (directions, columns).
    """
    freedom = len(scores) - 1
    values, vectors = np.linalg.eigh(information * np.outer(sizes, sizes))
    seen = values >= _SEEN
    if freedom < 1 or not seen.any():
        return np.zeros((0, len(sizes)))
    turn = sizes[:, None] * vectors[:, seen] / np.sqrt(values[seen])
    limit = float(np.quantile([_squares(one @ turn)[0] for one in simulated(_SETS)], _SURE))
    _, lengths, shapes = np.linalg.svd(scores @ turn / np.sqrt(freedom), full_matrices=False)
    ratio = seen.sum() / freedom
    found = [
        np.sqrt(size - 1) * (turn @ shape)
        for square, shape in zip(lengths**2, shapes, strict=True)
        if square > max(limit, (1 + np.sqrt(ratio)) ** 2)
        for size in [_true(square, ratio)]
    ]
    return np.array(found).reshape(-1, len(sizes))


def _squares(white: Floats) -> Floats:
    """Eigenvalues of the covariance of recordings, largest first."""
    return np.linalg.svd(white, compute_uv=False) ** 2 / (len(white) - 1)


def _true(found: float, ratio: float) -> float:
    """Eigenvalue with infinitely many recordings, from that of a few."""
    middle = found + 1 - ratio
    return float((middle + np.sqrt(middle**2 - 4 * found)) / 2)
