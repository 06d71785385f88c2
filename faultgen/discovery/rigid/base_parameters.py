"""Base parameters: the combinations of parameters that measured torques determine.

The torque is a linear function of the parameters. `identify` finds them by least squares from the
inner products of regressor and torque, in which each axis is weighted by its noise.

    value = identify(products)  # shape (parameters,)
    held_out_error(products)  # relative torque error on blocks that were not fitted

Source: Swevers, Verdonck and De Schutter (2007) for the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_RANK = 1e-3  # smallest singular value that counts, over the largest: assumed
_ROUNDING = 1e-10  # size of a column over the largest below which it is zero


@dataclass(frozen=True, eq=False)
class Products:
    """Inner products of a regressor and a torque, for each block and axis. They can be added."""

    gram: np.ndarray
    """Shape (blocks, n_axes, parameters, parameters)."""
    right: np.ndarray
    """Products of the columns with the torque, shape (blocks, n_axes, parameters)."""
    energy: np.ndarray
    """Sum of the squared torque that the parameters have to explain, shape (blocks, n_axes)."""
    torque: np.ndarray
    """Sum of the squared torque, shape (blocks, n_axes)."""
    count: np.ndarray
    """Number of samples, shape (blocks, n_axes)."""

    def only(self, chosen: Sequence[int]) -> Products:
        """Return the inner products of some of the blocks."""
        at = list(chosen)
        return Products(
            self.gram[at], self.right[at], self.energy[at], self.torque[at], self.count[at]
        )

    def without(self, columns: Sequence[int]) -> Products:
        """Return the inner products without some parameters."""
        keep = np.setdiff1d(np.arange(self.right.shape[2]), list(columns))
        gram = self.gram[:, :, keep][..., keep]
        return Products(gram, self.right[..., keep], self.energy, self.torque, self.count)

    def squares(self, value: np.ndarray, gain: np.ndarray | float = 1.0) -> np.ndarray:
        """Compute the sum of squared errors of each block and axis.

        Args:
            value: Parameters, shape (parameters,).
            gain: Factor of the predicted torque, a number or shape (n_axes,).

        Returns:
            Shape (blocks, n_axes), in [(N m)^2].
        """
        error = self.energy - 2 * gain * (self.right @ value)
        return np.maximum(error + gain**2 * np.einsum("bapq,p,q->ba", self.gram, value, value), 0)

    def relative(self, squares: np.ndarray) -> float:
        """Compute the relative error of all blocks together: the RMS of the axes' relative errors.

        Args:
            squares: From `squares`, shape (blocks, n_axes).
        """
        seen = self.torque.sum(axis=0) > 0
        share = squares.sum(axis=0)[seen] / self.torque.sum(axis=0)[seen]
        return float(np.sqrt(np.mean(share))) if seen.any() else float("nan")


def identify(products: Products) -> np.ndarray:
    """Solve for the parameters by least squares, weighted by the noise of each axis.

    Combinations of parameters that the motion does not determine stay as small as possible. They do
    not change the predicted torque.

    Args:
        products: Inner products of the blocks to fit.

    Returns:
        Parameters, shape (parameters,).
    """
    weight = 1 / np.maximum(products.torque.sum(axis=0) / _samples(products), 1e-30)
    value = np.zeros(products.right.shape[2])
    for _ in range(3):
        gram = np.einsum("a,bapq->pq", weight, products.gram)
        scale = np.sqrt(np.diag(gram))
        scale[scale <= _ROUNDING * scale.max()] = np.inf  # columns of zeros, but for rounding
        size, direction = np.linalg.eigh(gram / np.outer(scale, scale))
        kept = direction[:, size > _RANK**2 * size[-1]]
        right = np.einsum("a,bap->p", weight, products.right) / scale
        value = kept @ ((kept.T @ right) / size[size > _RANK**2 * size[-1]]) / scale
        weight = axis_weights(products, value)
    return value


def axis_weights(products: Products, value: np.ndarray) -> np.ndarray:
    """Compute the inverse variance of the error of each axis.

    Args:
        products: Inner products of the blocks.
        value: Parameters, shape (parameters,).

    Returns:
        Shape (n_axes,), in [1/(N m)^2]; 0 for an axis without torque.
    """
    variance = products.squares(value).sum(axis=0) / _samples(products)
    floor = 1e-8 * products.torque.sum(axis=0) / _samples(products)
    return np.where(floor > 0, 1 / np.maximum(np.maximum(variance, floor), 1e-300), 0.0)


def _samples(products: Products) -> np.ndarray:
    return np.maximum(products.count.sum(axis=0), 1)


def held_out_error(products: Products) -> float:
    """Compute the error of each block with parameters that were identified on the other blocks.

    Args:
        products: Inner products of at least two blocks.

    Returns:
        Relative error, as `Products.relative`.
    """
    every = range(len(products.energy))
    squares = [
        products.only([k]).squares(identify(products.only([j for j in every if j != k])))
        for k in every
    ]
    return products.relative(np.concatenate(squares))
