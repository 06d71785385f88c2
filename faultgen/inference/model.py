"""One model for a difference: y = S b + A a + n.

b are numbers that may differ in a healthy robot. They come in groups (links, friction, stiffness,
...). Each number is normal about zero, with a stated standard deviation times the scale of its
group. The data determine the scales, by their marginal likelihood and a log-normal prior about 1
(empirical Bayes; Bishop 2006, 3.5). a are effects with stated sizes, and n is white noise of
variance 1, because columns and difference were whitened.

    model.healthy.log_evidence         # of a healthy robot
    model.fit([12, 13]).log_evidence   # with the effect of these columns
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from faultgen.inference.products import ROUNDING, Products

LARGEST = 3.5
"""Logarithm of the largest scale, and of the inverse of the smallest: 33 times the literature."""

_STEPS = 60
_STEP = 0.05  # of the logarithm of a scale, for a second derivative


@dataclass(frozen=True)
class Group:
    """A group of numbers that are about equally well known."""

    name: str
    """Of the group."""
    spread: float
    """Factor by which its scale may differ from the centre: one standard deviation of its
    logarithm."""
    centre: float = 1.0
    """Scale that is most probable before the data are seen."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Scales, and what follows from them, for one set of effects."""

    log_evidence: float
    """Of the data, with the best scales and their prior; up to a constant."""
    log_scales: np.ndarray
    """Logarithm of the scale of each group, shape (groups,)."""
    values: np.ndarray
    """Posterior mean of numbers and effects, in their own units, shape (numbers + effects,)."""
    covariance: np.ndarray
    """Their posterior covariance, shape (numbers + effects, numbers + effects)."""
    slope: Callable[[np.ndarray], np.ndarray]
    """Slope of minus the log evidence with logarithms of the scales, all of shape (groups,)."""

    @property
    def errors(self) -> np.ndarray:
        """Posterior standard deviations, shape (numbers + effects,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Model:
    """Numbers first, then effects; see the top of the module."""

    products: Products
    """Of all columns, per unit of each number and effect."""
    std: np.ndarray
    """Standard deviation of each number, and size of each effect, shape (columns,)."""
    mean: np.ndarray
    """Prior mean of each, same shape; 0 for numbers, and the size itself for an effect that is far
    from linear, such as a play, whose column holds for this size only."""
    group: np.ndarray
    """Number of the group of each number, shape (numbers,)."""
    groups: tuple[Group, ...]
    """The groups."""

    @property
    def count(self) -> int:
        """Count the numbers."""
        return len(self.group)

    def _chosen(self, effects: Sequence[int]) -> np.ndarray:
        """Columns of all numbers and of some effects."""
        return np.array([*range(self.count), *(self.count + k for k in effects)], int)

    def fit(self, effects: Sequence[int] = (), start: np.ndarray | None = None) -> Fitted:
        """Find the scales for a set of effects.

        Args:
            effects: Columns of effects, from 0.
            start: Logarithms of scales from which the search starts, shape (groups,).
        """
        chosen = self._chosen(effects)
        centred = self.products.only(chosen).about(self.mean[chosen])
        mine = centred.scaled(self.std[chosen])
        spreads = np.log([one.spread for one in self.groups])
        centres = np.log([one.centre for one in self.groups])
        group = np.append(self.group, np.full(len(effects), len(self.groups)))
        eye = np.eye(len(chosen))

        def cost(log_scales: np.ndarray) -> tuple[float, np.ndarray]:
            scale = np.exp(np.append(log_scales, 0.0))[group]
            gram, right = mine.gram * np.outer(scale, scale), mine.right * scale
            factor = cho_factor(gram + eye + ROUNDING * np.diag(np.diag(gram)), lower=True)
            value = cho_solve(factor, right)
            off = (log_scales - centres) / spreads
            half = np.log(np.diag(factor[0])).sum() - 0.5 * right @ value + 0.5 * mine.energy
            slope = (_inverse(factor[0]) * gram).sum(axis=1) - value * (right - gram @ value)
            by_group = np.bincount(group, slope, len(self.groups) + 1)[:-1]
            return float(half + 0.5 * np.sum(off**2)), by_group + off / spreads

        best = minimize(
            cost,
            centres if start is None else start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-LARGEST, LARGEST)] * len(self.groups),
            options={"maxiter": _STEPS},
        )
        values, covariance = self.at(best.x, effects)
        return Fitted(-float(best.fun), best.x, values, covariance, lambda x: cost(x)[1])

    def at(
        self, log_scales: np.ndarray, effects: Sequence[int] = ()
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the posterior of numbers and effects with given scales.

        Args:
            log_scales: Logarithm of the scale of each group, shape (groups,).
            effects: Columns of effects, from 0.

        Returns:
            Mean, shape (numbers + effects,), and covariance, in their own units.
        """
        chosen = self._chosen(effects)
        group = np.append(self.group, np.full(len(effects), len(self.groups)))
        scale = np.exp(np.append(log_scales, 0.0))[group] * self.std[chosen]
        scaled = self.products.only(chosen).about(self.mean[chosen]).scaled(scale)
        eye = np.eye(len(chosen))
        factor = cho_factor(scaled.gram + eye + ROUNDING * np.diag(np.diag(scaled.gram)))
        values = cho_solve(factor, scaled.right) * scale + self.mean[chosen]
        return values, cho_solve(factor, eye) * np.outer(scale, scale)

    def without(self, names: Collection[str]) -> Model:
        """Return the model without the numbers of some groups, by their names."""
        kept = np.array([self.groups[g].name not in names for g in self.group], bool)
        columns = np.concatenate([kept, np.ones(len(self.std) - self.count, bool)])
        return Model(
            self.products.only(np.flatnonzero(columns)),
            self.std[columns],
            self.mean[columns],
            self.group[kept],
            self.groups,
        )

    @cached_property
    def healthy(self) -> Fitted:
        """The fit without any effect."""
        return self.fit()

    def learned(self) -> tuple[Group, ...]:
        """Return the groups as they are known after the data, which no effect is in.

        The posterior of the logarithms of the scales is taken as normal about its largest value
        (Laplace's approximation).
        """
        best = self.healthy.log_scales
        steps = _STEP * np.eye(len(best))
        slope = self.healthy.slope
        curved = np.array([slope(best + d) - slope(best - d) for d in steps]) / (2 * _STEP)
        spreads = np.log([one.spread for one in self.groups])
        values, vectors = np.linalg.eigh((curved + curved.T) / 2)
        # where the data tell nothing, the prior remains
        inverse = (vectors / np.maximum(values, 1 / spreads.max() ** 2)) @ vectors.T
        stds = np.minimum(np.sqrt(np.diag(inverse)), spreads)
        return tuple(
            Group(one.name, float(np.exp(std)), float(np.exp(value)))
            for one, std, value in zip(self.groups, stds, best, strict=True)
        )

    def without_numbers(self, log_scales: np.ndarray, known: Sequence[int] = ()) -> Products:
        """Take out what the numbers explain, with given scales; effects in units of their sizes.

        Args:
            log_scales: Shape (groups,).
            known: Effects that are taken out like numbers.

        Returns:
            Products of all effects. Their covariance under a healthy robot is their gram.
        """
        scale = np.exp(log_scales)[self.group]
        std = np.concatenate([scale * self.std[: self.count], self.std[self.count :]])
        at = np.zeros(len(std))
        at[[self.count + k for k in known]] = self.mean[[self.count + k for k in known]]
        scaled = self.products.about(at).scaled(std)
        inner = self._chosen(known)
        outer = np.arange(self.count, len(std))
        gram = scaled.gram
        factor = cho_factor(gram[np.ix_(inner, inner)] + np.eye(len(inner)))
        across = cho_solve(factor, gram[np.ix_(inner, outer)])
        left = gram[np.ix_(outer, outer)] - gram[np.ix_(outer, inner)] @ across
        right = scaled.right[outer] - across.T @ scaled.right[inner]
        energy = scaled.energy - scaled.right[inner] @ cho_solve(factor, scaled.right[inner])
        return Products((left + left.T) / 2, right, float(energy), scaled.count)

    def bayes_factors(
        self, log_scales: np.ndarray, sets: Sequence[Sequence[int]], known: Sequence[int] = ()
    ) -> np.ndarray:
        """Compute the logarithm of the Bayes factor of each set of effects against none.

        Args:
            log_scales: Logarithm of the scale of each group, shape (groups,).
            sets: Columns of effects, from 0.
            known: Effects that are there in any case.

        Returns:
            Shape (sets,).
        """
        means = (self.mean / self.std)[self.count :]
        return log_bayes_factors(self.without_numbers(log_scales, known), means, sets)


def _inverse(lower: np.ndarray) -> np.ndarray:
    """Inverse of a matrix from its lower triangular factor; quicker than solving for it."""
    inverse, _ = dpotri(lower, lower=1)
    return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


def log_bayes_factors(
    products: Products, mean: np.ndarray, sets: Sequence[Sequence[int]]
) -> np.ndarray:
    """Compute the logarithm of the Bayes factor of each set of columns against none.

    Args:
        products: Of columns in units of their sizes, without numbers.
        mean: Prior mean of each in this unit, shape (columns,).
        sets: Columns of each effect.

    Returns:
        Shape (sets,). Source: Bayesian linear regression with a normal prior (Bishop 2006, 3.3).
    """
    out = np.empty(len(sets))
    for k, chosen in enumerate(sets):
        columns = np.array(chosen, int)
        alone = products.only(columns)
        mine = alone.about(mean[columns])
        precision = mine.gram + np.eye(len(chosen))
        value = np.linalg.solve(precision, mine.right)
        out[k] = 0.5 * (mine.right @ value - np.linalg.slogdet(precision)[1])
        out[k] += 0.5 * (alone.energy - mine.energy)
    return out
