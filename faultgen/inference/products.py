"""Inner products of whitened columns and a whitened difference, which are all that a fit needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

ROUNDING = 1e-13
"""Share by which a matrix is raised: products of single columns are not exact."""


@dataclass(frozen=True, eq=False)
class Products:
    """Inner products over the samples of all axes."""

    gram: np.ndarray
    """Of the columns among each other, shape (columns, columns)."""
    right: np.ndarray
    """Of the columns with the difference, shape (columns,)."""
    energy: float
    """Of the difference with itself."""
    count: int
    """Samples that were used."""

    @staticmethod
    def of(columns: np.ndarray, difference: np.ndarray, count: int) -> Products:
        """Compute the inner products.

        Args:
            columns: Whitened, shape (columns, samples, n_axes); 0 where a sample is not used.
            difference: Whitened, shape (samples, n_axes).
            count: Samples that are used, all axes together.
        """
        x = columns.reshape(len(columns), -1).astype(float)
        y = difference.ravel().astype(float)
        return Products(x @ x.T, x @ y, float(y @ y), count)

    def only(self, chosen: np.ndarray) -> Products:
        """Return the inner products of some columns, by their numbers."""
        gram = self.gram[np.ix_(chosen, chosen)]
        return Products(gram, self.right[chosen], self.energy, self.count)

    def scaled(self, std: np.ndarray) -> Products:
        """Return the inner products of columns in units of `std`, shape (columns,)."""
        gram = self.gram * np.outer(std, std)
        return Products(gram, self.right * std, self.energy, self.count)

    def about(self, values: np.ndarray) -> Products:
        """Return the inner products with the difference less columns times values, (columns,)."""
        if not values.any():
            return self
        moved = self.gram @ values
        energy = self.energy - 2 * float(self.right @ values) + float(values @ moved)
        return Products(self.gram, self.right - moved, energy, self.count)

    def posterior(self, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values of the columns, each with a prior standard deviation of 1.

        Args:
            normal: Standard normal numbers, shape (draws, columns).

        Returns:
            Their mean, shape (columns,), and draws from their distribution, (draws, columns). The
            order of the columns does not matter: a number belongs to a rank of their energies, and
            the root of the covariance is the symmetric one.
        """
        size, vectors = eigh(self._precision())
        mean = vectors @ (vectors.T @ self.right / size)
        of_column = np.empty_like(normal)
        of_column[:, np.argsort(np.diag(self.gram))] = normal
        return mean, mean + (of_column @ vectors / np.sqrt(size)) @ vectors.T

    def _precision(self) -> np.ndarray:
        """Inverse of the covariance of the values."""
        # products of single precision may lack a little to be positive
        return self.gram + (1 + ROUNDING * np.trace(self.gram)) * np.eye(len(self.right))
