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
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri
from scipy.optimize import OptimizeResult, minimize

from faultgen.inference.products import ROUNDING, Products

LARGEST = 3.5
"""Logarithm of the largest scale, and of the inverse of the smallest: 33 times the literature."""

_STEPS = 60
_FLAT = 0.03  # slope of minus the log evidence at which a search ends: it costs less than 0.001


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

    def fit(self, effects: Sequence[int] = (), *starts: Fitted) -> Fitted:
        """Find the scales for a set of effects.

        Args:
            effects: Columns of effects, from 0.
            *starts: Fits of nearly the same set. The search starts from the best one.
        """
        cost = self.cost_of(effects)
        afar = np.log([one.centre for one in self.groups])  # most probable before data are seen
        if not starts:
            best = _bounded(cost, afar)
        else:
            others = set(starts) - {starts[0]}
            nearest = min(starts, key=lambda one: cost(one.log_scales)[0]) if others else starts[0]
            best = _near(cost, nearest)
            if not best.success:  # a scale stands at its bound, or is far from where it was
                best = min((_bounded(cost, x) for x in (best.x, afar)), key=lambda one: one.fun)
        return Fitted(self, tuple(effects), -float(best.fun), best.x)

    def cost_of(self, effects: Sequence[int]) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
        """Return minus the log evidence and its slope, as a function of the logarithms of scales.

        Args:
            effects: Columns of effects, from 0.

        Returns:
            The function; scales and slope have the shape (groups,).
        """
        chosen = self._chosen(effects)
        mine = self.products.only(chosen).about(self.mean[chosen]).scaled(self.std[chosen])
        spreads = np.log([one.spread for one in self.groups])
        centres = np.log([one.centre for one in self.groups])
        group = np.append(self.group, np.full(len(effects), len(self.groups)))
        squares, own = np.diag(mine.gram), np.arange(len(chosen))

        def cost(log_scales: np.ndarray) -> tuple[float, np.ndarray]:
            scale = np.exp(np.append(log_scales, 0.0))[group]
            precision = mine.gram * scale
            precision *= scale[:, None]
            prior = 1 + ROUNDING * squares * scale**2
            precision[own, own] += prior
            right = mine.right * scale
            # scipy's functions copy what is symmetric, which takes as long
            factor, failed = dpotrf(precision.T, lower=1, clean=1, overwrite_a=1)
            if failed:
                raise np.linalg.LinAlgError("the precision of the numbers is not positive definite")
            value = dpotrs(factor, right, lower=1)[0] if len(own) else right
            half = np.log(np.diag(factor)).sum() - 0.5 * right @ value + 0.5 * mine.energy
            inverse = dtrtri(factor, lower=1, overwrite_c=1)[0] if len(own) else factor
            off = (log_scales - centres) / spreads
            # with products = precision - prior, of which only the inverse's diagonal is needed
            slope = 1 - prior * (np.einsum("ij,ij->j", inverse, inverse) + value**2)
            by_group = np.bincount(group, slope, len(self.groups) + 1)[:-1]
            return float(half + 0.5 * np.sum(off**2)), by_group + off / spreads

        return cost

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
        columns = self.places_without(names)
        return Model(
            self.products.only(columns),
            self.std[columns],
            self.mean[columns],
            self.group[columns[columns < self.count]],
            self.groups,
        )

    def places_without(self, names: Collection[str]) -> np.ndarray:
        """Find all columns but the numbers of some groups.

        Args:
            names: Names of the groups.

        Returns:
            Numbers of the columns, from 0, shape (columns,).
        """
        kept = np.array([self.groups[g].name not in names for g in self.group], bool)
        return np.flatnonzero([*kept, *[True] * (len(self.std) - self.count)])

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
        spreads = np.log([one.spread for one in self.groups])
        inverse = np.linalg.inv(self.healthy.curvature)
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
        own = gram[np.ix_(inner, inner)]
        factor = cho_factor(own + np.eye(len(inner)) + ROUNDING * np.diag(np.diag(own)))
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


@dataclass(frozen=True, eq=False)
class Fitted:
    """Scales, and what follows from them, for one set of effects."""

    model: Model
    """The numbers and all effects."""
    effects: tuple[int, ...]
    """Columns of the effects of the set, from 0."""
    log_evidence: float
    """Of the data, with the best scales and their prior; up to a constant."""
    log_scales: np.ndarray
    """Logarithm of the scale of each group, shape (groups,)."""

    @cached_property
    def _posterior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of numbers and effects."""
        return self.model.at(self.log_scales, self.effects)

    @property
    def values(self) -> np.ndarray:
        """Posterior mean of numbers and effects, in their own units, shape (numbers + effects,)."""
        return self._posterior[0]

    @property
    def covariance(self) -> np.ndarray:
        """Their posterior covariance, shape (numbers + effects, numbers + effects)."""
        return self._posterior[1]

    @property
    def errors(self) -> np.ndarray:
        """Posterior standard deviations, shape (numbers + effects,)."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def curvature(self) -> np.ndarray:
        """Second derivatives of minus the log evidence with log scales, shape (groups, groups).

        With Q, the inverse of the posterior precision in units of scaled standard deviations, and
        v, the values in this unit, they are 2 (tr Q_gg + v_g v_g) - 2 (sum of squares of Q_gh) -
        4 v_g Q_gh v_h, and those of the prior. Where the data tell nothing, the prior remains.
        """
        model, own = self.model, self.model.count
        unit = np.exp(self.log_scales)[model.group] * model.std[:own]
        value = self.values[:own] / unit
        inverse = self.covariance[:own, :own] / np.outer(unit, unit)
        member = np.eye(len(model.groups))[model.group]
        mixed = inverse * (2 * inverse + 4 * np.outer(value, value))
        curved = np.diag(2 * (np.diag(inverse) + value**2) @ member) - member.T @ mixed @ member
        of_prior = np.log([one.spread for one in model.groups]) ** -2.0
        values, vectors = np.linalg.eigh(curved + np.diag(of_prior))
        return np.asarray((vectors * np.maximum(values, of_prior.min())) @ vectors.T)


def _bounded(
    cost: Callable[[np.ndarray], tuple[float, np.ndarray]], start: np.ndarray
) -> OptimizeResult:
    """Search within the bounds of the scales, from anywhere."""
    return minimize(
        cost,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(-LARGEST, LARGEST)] * len(start),
        options={"maxiter": _STEPS},
    )


def _near(cost: Callable[[np.ndarray], tuple[float, np.ndarray]], start: Fitted) -> OptimizeResult:
    """Search from a fit whose curvature nearly holds. It tells if the steps are not enough."""

    def bounded(log_scales: np.ndarray) -> tuple[float, np.ndarray]:
        inside = np.clip(log_scales, -LARGEST, LARGEST)
        value, slope = cost(inside)
        off = log_scales - inside  # beyond a bound, the cost rises from that at the bound
        return value + 0.5 * float(off @ off), np.where(off == 0, slope, off)

    inverse = np.linalg.inv(start.curvature)
    best = minimize(
        bounded,
        start.log_scales,
        jac=True,
        method="BFGS",
        options={"gtol": _FLAT, "maxiter": _STEPS, "hess_inv0": (inverse + inverse.T) / 2},
    )
    inside = np.clip(best.x, -LARGEST, LARGEST)
    return OptimizeResult(x=inside, fun=best.fun, success=best.success)


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
        precision = mine.gram + np.eye(len(chosen)) + ROUNDING * np.diag(np.diag(mine.gram))
        value = np.linalg.solve(precision, mine.right)
        out[k] = 0.5 * (mine.right @ value - np.linalg.slogdet(precision)[1])
        out[k] += 0.5 * (alone.energy - mine.energy)
    return out
