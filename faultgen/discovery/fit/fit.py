"""A set of effects with severities, and what they change."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.terms.candidates import PAYLOAD, Term
from faultgen.effects import get_effect

Group = tuple[int, ...]
"""Indices of the terms of one candidate: one term, or sine and cosine of a periodic effect."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of effects with severities."""

    groups: tuple[Group, ...]
    """The effects."""
    values: np.ndarray
    """Severity of each term of the effects, in the order of the groups. Shape (terms,)."""
    covariance: np.ndarray
    """Covariance of the values. Shape (terms, terms)."""
    change: np.ndarray
    """Change of the torque by the effects, shape (samples, n_axes)."""
    lost: tuple[float, ...] = ()
    """By how much the logarithm of the odds of each effect is less than its linear signature
    promised, where a simulation explains most at quite another severity; () if none was found."""

    @property
    def terms(self) -> list[int]:
        """Indices of all terms."""
        return [term for group in self.groups for term in group]

    def members(self) -> Iterator[tuple[Group, np.ndarray, np.ndarray]]:
        """Iterate over the effects.

        Yields:
            The group of each effect, its values, shape (terms of the group,), and their
            covariance.
        """
        at = 0
        for group in self.groups:
            own = slice(at, at + len(group))
            yield group, self.values[own], self.covariance[own, own]
            at = own.stop


def fit_at(
    problem: Problem, groups: Sequence[Group], values: np.ndarray, covariance: np.ndarray
) -> Fit:
    """Simulate a set of effects with given severities.

    Args:
        problem: The residual and the terms.
        groups: The effects; there may be none.
        values: Severity of each term, shape (terms,).
        covariance: Their covariance, shape (terms, terms).

    Returns:
        The set. Its change of the torque is simulated, or linear if the simulation diverges.
    """
    terms = [term for group in groups for term in group]
    change: np.ndarray | None = np.zeros_like(problem.residual)
    if terms:
        pairs = zip(terms, values.tolist(), strict=True)
        change = problem.change([(problem.terms[t], value) for t, value in pairs])
    if change is None:
        change = np.tensordot(values.astype(np.float32), problem.raw[terms], axes=1)
    return Fit(tuple(groups), values, covariance, change)


def changes_of(problem: Problem, fitted: Fit) -> list[tuple[Term, float]]:
    """List the terms of a set and their values.

    Args:
        problem: The residual and the terms.
        fitted: The set of effects.

    Returns:
        Each term with its value, in the unit of the term.
    """
    return [(problem.terms[t], float(v)) for t, v in zip(fitted.terms, fitted.values, strict=True)]


def first_of(problem: Problem, fitted: Fit, count: int) -> Fit:
    """Return the first effects of a set, with the severities that they have in the whole set.

    Args:
        problem: The residual and the terms.
        fitted: The whole set of effects.
        count: Number of effects to keep.

    Returns:
        The smaller set.
    """
    if count == len(fitted.groups):
        return fitted
    size = sum(len(group) for group in fitted.groups[:count])
    own = slice(0, size)
    return fit_at(problem, fitted.groups[:count], fitted.values[own], fitted.covariance[own, own])


def no_effect(problem: Problem) -> Fit:
    """Return the empty set.

    Args:
        problem: The residual and the terms.
    """
    return fit_at(problem, (), np.zeros(0), np.zeros((0, 0)))


def bounds_of(problem: Problem, terms: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds of the values of terms.

    Args:
        problem: The residual and the terms.
        terms: Indices of the terms.

    Returns:
        Smallest and largest value of each term in its unit, shape (terms,) each.
    """
    pairs = np.array([_range(problem.terms[t]) for t in terms]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _range(term: Term) -> tuple[float, float]:
    """Smallest and largest severity."""
    effect = get_effect(term.name)
    if get_effect(term.name).prior.use == "periodic":  # sine and cosine
        return -effect.largest, effect.largest
    if term.name == PAYLOAD and term.parameters:  # points, of which only the sum is a mass
        return -np.inf, np.inf
    return effect.smallest, effect.largest
