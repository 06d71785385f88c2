"""How far the friction of a real robot may depart from the law of the catalogue's effect.

The friction of a worn gearbox does not grow exactly with the speed, or with its square. An effect
that explains most of a residual may therefore leave a small rest that looks like another kind of
speed-dependent friction on the same axis. The rest is allowed for in proportion to the effect, so
that the effect is neither rejected for it nor joined by a second one.

    evidence = problem.evidence().weighted(weights(problem, terms, values))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.discovery.fit.evidence import Evidence
from faultgen.discovery.fit.regression import Problem
from faultgen.effects import get_effect

LAW_ERROR = 0.1
"""RMS of what the law of an effect of speed-dependent friction misses, over that of the effect:
assumed."""

_SAME = 0.98  # correlation from which two laws are one, so that neither misses the other: assumed


def weights(problem: Problem, terms: Sequence[int], values: np.ndarray) -> np.ndarray | None:
    """Compute the weight of the square of each term in the misfit, beside a set of effects.

    Args:
        problem: The residual and the terms.
        terms: Indices of the terms of the set.
        values: Their values, in the units of the terms; shape (terms of the set,).

    Returns:
        Shape (terms of the problem,), or None if all are 1: with a baseline, and beside effects
        other than speed-dependent friction.
    """
    groups = [get_effect(problem.terms[t].name).prior.group for t in terms]
    if problem.baseline or not any(groups):
        return None
    weight = np.ones(len(problem.terms))
    for term, value, group in zip(terms, values, groups, strict=True):
        axis = problem.terms[term].axis
        if not group:
            continue
        size = abs(float(value)) * _size(problem, term)
        for other, one in enumerate(problem.terms):
            alike = one.is_effect and get_effect(one.name).prior.group == group
            if alike and one.axis == axis and other not in terms:
                own = _size(problem, other) * one.prior_std
                if own == 0 or _likeness(problem, term, other) > _SAME:
                    continue  # it has no torque on this motion, or is the same law
                weight[other] = 1 / (1 / weight[other] + (LAW_ERROR * size / own) ** 2)
    return weight


def gains(
    problem: Problem,
    evidence: Evidence,
    groups: Sequence[Sequence[int]],
    free: Sequence[int],
    values: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Compute by how much each candidate decreases the misfit, with what its law may miss.

    Args:
        problem: The residual and the terms.
        evidence: Inner products beside the effects that are there already.
        groups: Indices of the terms of each candidate.
        free: Terms that are there already.
        values: Their values, in the units of the terms; shape (free terms,).

    Returns:
        As from `Evidence.gains`, shape (groups,) each.
    """
    gain, first = evidence.gains(groups, free)
    _, _, before = evidence.solve(free)
    for k, group in enumerate(groups):
        if gain[k] < 1 or not get_effect(problem.terms[group[0]].name).prior.group:
            continue
        own = first[k] * problem.terms[group[0]].prior_std
        weight = weights(problem, [*free, *group], np.append(values, own))
        solution, _, after = evidence.weighted(weight).solve([*free, *group])
        gain[k], first[k] = before - after, solution[group[0]]
    return gain, first


def score(evidence: Evidence, free: Sequence[int]) -> float:
    """Compute `Evidence.score` with what laws may miss, or without it if that foretells better.

    Freedom that the data do not need must not make an effect seem worse than one without it.

    Args:
        evidence: Inner products beside a set of effects.
        free: Terms of the set.
    """
    own = evidence.score(free)
    return own if evidence.weight is None else min(own, evidence.weighted(None).score(free))


def _size(problem: Problem, term: int) -> float:
    """RMS of the torque of its axis per unit of a term."""
    axis = problem.terms[term].axis - 1
    rows = problem.inside[:, axis]
    return float(np.sqrt(np.mean(problem.raw[term, rows, axis] ** 2))) if rows.any() else 0.0


def _likeness(problem: Problem, term: int, other: int) -> float:
    """Correlation of the torques of two terms on the axis of the first."""
    axis = problem.terms[term].axis - 1
    rows = problem.inside[:, axis]
    one, two = (problem.raw[k, rows, axis].astype(float) for k in (term, other))
    size = float(np.sqrt((one @ one) * (two @ two)))
    return abs(float(one @ two)) / size if size > 0 else 0.0
