"""A measured operating condition, such as temperature, that acts nonlinearly on features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROUNDING = 1e-12
"""Largest relative spread of a feature that counts as constant."""

_USUAL = 0.95  # share of healthy cycles whose condition is known well enough


class Condition:
    """A measured condition, predicted from the features that wear does not move.

    Args:
        healthy: Features of healthy cycles, one of which is the condition. Shape (cycles,
            features).
        directions: By how much a severity of 1 of each axis moves the features. Shape (n_axes,
            features).
        column: Index of the feature that is the condition.
    """

    _DEGREE = 4

    def __init__(self, healthy: Floats, directions: Floats, column: int) -> None:
        self.mean, self.scale = healthy.mean(axis=0), healthy.std(axis=0)
        self.scale[self.scale <= ROUNDING * np.abs(healthy).max(axis=0)] = 1.0
        self.features = healthy.shape[1]
        scaled = (healthy - self.mean) / self.scale
        n, features = scaled.shape
        towards = directions / self.scale
        kernel = least_squares_kernel(towards, scaled.T @ scaled / n + 1e-9 * np.eye(features))
        without_wear = np.eye(features) - kernel.T @ towards
        others = np.arange(features) != column
        inputs = scaled @ without_wear[:, others]
        ridge = 1e-3 * n * np.eye(features - 1)
        slope = np.linalg.solve(inputs.T @ inputs + ridge, inputs.T @ scaled[:, column])
        self.weights = without_wear[:, others] @ slope
        spread = self.value(healthy).std()
        self.weights = self.weights / spread if spread > 1e-9 else np.zeros(features)
        powers = self._design(self.value(healthy))
        self.information = np.linalg.pinv(powers.T @ powers / n, hermitian=True)
        self.usual = float(np.quantile(self._leverage(powers), _USUAL))

    def value(self, x: Floats) -> Floats:
        """Predict the condition of each cycle.

        Args:
            x: Features of cycles. Shape (cycles, features); further columns are ignored.

        Returns:
            The condition in units of its spread in healthy cycles. Shape (cycles,).
        """
        return (x[:, : self.features] - self.mean) / self.scale @ self.weights

    def powers(self, x: Floats) -> Floats:
        """Compute the square and the higher powers of the predicted condition.

        Args:
            x: Features of cycles, as for `value`.

        Returns:
            The powers, from the square on. Shape (cycles, degree - 1).
        """
        return self._design(self.value(x))[:, 2:]

    def outside(self, x: Floats) -> float:
        """Factor by which errors grow if healthy cycles hardly contain the condition."""
        mean = float(self._leverage(self._design(self.value(x))).mean())
        return max(1.0, np.sqrt(mean / self.usual))

    def _design(self, value: Floats) -> Floats:
        return np.stack([value**k for k in range(self._DEGREE + 1)], axis=1)

    def _leverage(self, powers: Floats) -> Floats:
        return np.einsum("ck,kl,cl->c", powers, self.information, powers)


def least_squares_kernel(directions: Floats, covariance: Floats) -> Floats:
    """Compute (D' C^-1 D)^-1 D' C^-1, with a pseudo-inverse if directions are not independent.

    Args:
        directions: D', the direction of each axis. Shape (n_axes, features).
        covariance: C, the covariance of the features. Shape (features, features).

    Returns:
        The kernel. Shape (n_axes, features), in the unit of the severity over that of the feature.
    """
    weighted = np.linalg.solve(covariance, directions.T)
    gram = directions @ weighted
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    size[size == 0] = 1.0
    inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-9, hermitian=True)
    return inverse / np.outer(size, size) @ weighted.T
