"""Which terms explain a residual if every term may differ from zero a little?

The whitened residual is g = X b + n. Each column of X belongs to one term, and n is white noise. In
a healthy robot each b is normal, with the prior standard deviation of its term as standard
deviation. A term that is considered as a missing effect has no prior: it is free. Columns are in
units of the prior_std, so that the prior covariance of b is the unit matrix. The misfit of a set of
free terms is

    min over b of |g - X b|^2 + sum of b^2 over the terms that are not in the set.

Source: Bayesian linear regression (Bishop 2006, 3.3) with the healthy spread as prior, the linear
case of the discrepancy model of Kennedy and O'Hagan (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

FREE = 1e-8
"""Weight of the prior of a free term: it allows values of 10000 prior standard deviations."""

_RAISED = 10.0 ** np.arange(-14, -3)  # shares by which a diagonal is raised if rounding needs it


def factored(precision: np.ndarray) -> tuple[np.ndarray, bool]:
    """Factorise a precision matrix (Cholesky), also where rounding has made it indefinite.

    Recordings without noise determine sums of terms so well that the priors, which determine the
    rest, are lost to rounding. The diagonal is then raised by as little as is needed.

    Args:
        precision: Shape (terms, terms).

    Returns:
        The factor for `scipy.linalg.cho_solve`, shape (terms, terms), and whether it is lower.

    Raises:
        LinAlgError: No small change makes the matrix positive definite.
    """
    for share in (0.0, *_RAISED):
        raised = precision + np.diag(share * np.diag(precision))
        with suppress(LinAlgError):
            return cho_factor(raised)
    return cho_factor(precision)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Inner products of whitened columns and the residual, for each separate recording."""

    gram: np.ndarray
    """Shape (parts, terms, terms)."""
    right: np.ndarray
    """Products of the columns with the residual, shape (parts, terms)."""
    energy: np.ndarray
    """Product of the residual with itself, shape (parts,)."""
    weight: np.ndarray | None = None
    """Weight of the square of each term in the misfit, shape (terms,). None: 1 for all."""

    @staticmethod
    def of(columns: np.ndarray, residual: np.ndarray, parts: Sequence[slice]) -> Evidence:
        """Compute the inner products.

        Args:
            columns: Whitened, in units of the prior standard deviations, shape (terms, samples,
                n_axes).
            residual: Whitened, shape (samples, n_axes).
            parts: Samples of each separate recording.

        Returns:
            The inner products.
        """
        gram = []
        for part in parts:
            x = columns[:, part].reshape(len(columns), -1).astype(float)
            gram.append(x @ x.T)
        nothing = np.zeros((len(gram), len(columns)))
        return Evidence(np.array(gram), nothing, nothing[:, 0]).against(columns, residual, parts)

    def against(
        self, columns: np.ndarray, residual: np.ndarray, parts: Sequence[slice]
    ) -> Evidence:
        """Return the inner products of the same columns with another residual.

        Args:
            columns: The same columns as for `of`, shape (terms, samples, n_axes).
            residual: The other residual, whitened, shape (samples, n_axes).
            parts: Samples of each separate recording.

        Returns:
            The inner products. Those among the columns are not computed again.
        """
        right, energy = [], []
        for part in parts:
            y = residual[part].ravel()
            right.append(columns[:, part].reshape(len(columns), -1) @ y.astype(columns.dtype))
            energy.append(float(y.astype(float) @ y))
        return Evidence(self.gram, np.array(right, float), np.array(energy), self.weight)

    def replaced(
        self,
        new: dict[int, np.ndarray],
        columns: np.ndarray,
        residual: np.ndarray,
        parts: Sequence[slice],
    ) -> Evidence:
        """Return the inner products with other columns for some terms.

        Args:
            new: New whitened column of each such term, shape (samples, n_axes).
            columns: All columns before the change, shape (terms, samples, n_axes).
            residual: Whitened, shape (samples, n_axes).
            parts: Samples of each separate recording.

        Returns:
            The inner products.
        """
        gram, right = self.gram.copy(), self.right.copy()
        for k, part in enumerate(parts):
            others = columns[:, part].reshape(len(columns), -1)
            own = {term: column[part].ravel().astype(float) for term, column in new.items()}
            for term, column in own.items():
                products = (others @ column.astype(others.dtype)).astype(float)
                for other, again in own.items():
                    products[other] = column @ again
                gram[k, term] = gram[k, :, term] = products
                right[k, term] = column @ residual[part].ravel()
        return Evidence(gram, right, self.energy, self.weight)

    def only(self, parts: Sequence[int]) -> Evidence:
        """Return the inner products of some of the recordings."""
        chosen = list(parts)
        return Evidence(self.gram[chosen], self.right[chosen], self.energy[chosen], self.weight)

    def weighted(self, weight: np.ndarray | None) -> Evidence:
        """Return the same inner products with other weights of the terms.

        Args:
            weight: As in the class, shape (terms,) or None.
        """
        return replace(self, weight=weight)

    def _weights(self, free: Sequence[int] = ()) -> np.ndarray:
        """Weight of each term, where some terms have practically none; shape (terms,)."""
        weight = np.ones(len(self.right[0])) if self.weight is None else self.weight.copy()
        weight[list(free)] = FREE
        return weight

    def solve(
        self, free: Sequence[int] = (), held: Sequence[int] = ()
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Fit all terms.

        Args:
            free: Terms without a prior.
            held: Terms that stay zero.

        Returns:
            Values in units of the prior standard deviations, shape (terms,); their posterior
            covariance, shape (terms, terms); and the misfit.
        """
        weight = self._weights(free)
        weight[list(held)] = 1e12
        precision = self.gram.sum(axis=0)
        precision[np.diag_indices_from(precision)] += weight
        right = self.right.sum(axis=0)
        factor = factored(precision)
        value = cho_solve(factor, right)
        inverse = cho_solve(factor, np.eye(len(right)))
        return value, inverse, float(self.energy.sum() - right @ value)

    def gains(
        self, groups: Sequence[Sequence[int]], free: Sequence[int] = ()
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute by how much the misfit decreases if a group of terms becomes free.

        Args:
            groups: Indices of the terms that become free together.
            free: Terms that are already free.

        Returns:
            Decrease of the misfit for each group, shape (groups,), and the fitted value of the
            first term of each group in units of its prior_std, shape (groups,).
        """
        value, inverse, _ = self.solve(free)
        spread = 1 / self._weights()
        gain, first = np.zeros(len(groups)), np.zeros(len(groups))
        for k, group in enumerate(groups):
            index = list(group)
            block = inverse[np.ix_(index, index)]
            # taking the prior of a block away: Woodbury's identity
            left = np.linalg.solve(np.diag(spread[index] * (1 + 1e-9)) - block, value[index])
            gain[k] = value[index] @ left
            first[k] = (value[index] + block @ left)[0]
        return gain, first

    def held_out(self, free: Sequence[int]) -> np.ndarray:
        """Compute the misfit of each recording with values that were fitted to the others.

        Args:
            free: Terms without a prior.

        Returns:
            Squared whitened error, shape (parts,).
        """
        errors = np.empty(len(self.energy))
        every = range(len(self.energy))
        for part in every:
            value, _, _ = self.only([p for p in every if p != part]).solve(free)
            errors[part] = (
                self.energy[part] - 2 * value @ self.right[part] + value @ self.gram[part] @ value
            )
        return errors
