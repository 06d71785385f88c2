"""Sets of effects, fitted by re-simulation while everything else may be off by its tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.evidence import Evidence
from faultgen.discovery.problem import Problem
from faultgen.discovery.terms import PERIODIC
from faultgen.effects import get_effect
from faultgen.errors import SimulationFailed

Group = tuple[int, ...]
"""Indices of the terms that make one candidate: one, or sine and cosine of a periodic effect."""

_STEPS = 5  # re-simulations of a fit at most
_CLOSE = 0.02  # change of a value, over the value, at which a fit has converged


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of effects and how well it explains the gap."""

    groups: tuple[Group, ...]
    """The effects."""
    values: np.ndarray
    """Severity of each of their terms, in the order of the groups."""
    errors: np.ndarray
    """Standard errors of the values."""
    change: np.ndarray
    """What they add to the torque, simulated, shape (samples, n_axes)."""
    evidence: Evidence
    """Of the gap that they leave, on the parts for fitting."""
    misfit: float
    """Squared whitened error and prior."""
    held_out: np.ndarray
    """Squared whitened error of each part for fitting, fitted to the others."""
    penalty: float
    """Squared distance of all other terms from a healthy robot, in tolerances."""

    @property
    def score(self) -> float:
        """What sets are compared by: errors on recordings that were not fitted, and penalty."""
        return float(self.held_out.sum()) + self.penalty

    @property
    def terms(self) -> list[int]:
        """Indices of all terms."""
        return [term for group in self.groups for term in group]


def fit(problem: Problem, groups: Sequence[Group], start: np.ndarray | None = None) -> Fit | None:
    """Fit a set of effects by re-simulation.

    Gauss-Newton with the columns of the model as it is; the simulation is exact at each step, and
    slopes are taken anew where that does not converge.

    Args:
        problem: The gap and the terms.
        groups: The set; may be empty.
        start: Values to start from; None: the linear estimate.

    Returns:
        The fit, or None where no severity within the bounds of an effect explains anything.
    """
    terms = [term for group in groups for term in group]
    scale = np.array([problem.terms[t].tolerance for t in terms])
    evidence = problem.evidence()
    if not terms:
        _, _, misfit = evidence.solve()
        return _done(problem, (), np.empty(0), np.zeros_like(problem.gap), evidence, misfit)
    value = start
    if value is None:
        solution, _, _ = evidence.solve(free=terms)
        value = solution[terms] * scale
    value = _bounded(problem, terms, value)
    if not np.any(value):
        return None
    white = problem.white
    best: tuple[float, np.ndarray, np.ndarray, Evidence] | None = None
    damping = 1.0
    for step in range(_STEPS):
        try:
            change = problem.replay.torque(_changes(problem, terms, value)) - problem.base
        except SimulationFailed:
            change = np.full_like(problem.gap, np.nan)
        if np.isfinite(change).all():
            evidence = _moved(problem, white, problem.gap - change)
            solution, _, _ = evidence.solve(free=terms)
            _, _, here = evidence.solve(held=terms)
        else:
            here = np.inf
        if best is None or here < best[0]:
            if not np.isfinite(here):
                return None
            best = here, value, change, evidence
            delta = solution[terms] * scale
            damping = 1.0
        else:
            damping *= 0.4
            value = best[1]
        new = _bounded(problem, terms, value + damping * delta)
        if np.all(np.abs(new - value) <= _CLOSE * np.abs(value) + 1e-3 * scale):
            break
        value = new
        if step == 2:  # the columns of the model as it is lead astray
            white = _slopes(problem, terms, best[1], best[2])
            evidence = _moved(problem, white, problem.gap - best[2])
            solution, _, _ = evidence.solve(free=terms)
            delta, damping = solution[terms] * scale, 1.0
            value = _bounded(problem, terms, best[1] + delta)
    assert best is not None
    here, value, change, evidence = best
    return _done(problem, tuple(groups), value, change, evidence, here)


def _done(
    problem: Problem,
    groups: tuple[Group, ...],
    value: np.ndarray,
    change: np.ndarray,
    evidence: Evidence,
    misfit: float,
) -> Fit:
    terms = [term for group in groups for term in group]
    scale = np.array([problem.terms[t].tolerance for t in terms])
    solution, inverse, _ = evidence.solve(free=terms)
    others = np.delete(solution, terms)
    errors = scale * np.sqrt(np.diag(inverse)[terms]) if terms else np.empty(0)
    return Fit(
        groups,
        value,
        errors,
        change,
        evidence,
        misfit,
        evidence.held_out(terms),
        float(others @ others),
    )


def _moved(problem: Problem, white: np.ndarray, gap: np.ndarray) -> Evidence:
    parts = [problem.parts[p] for p in problem.fitting]
    if white is problem.white:
        return problem.evidence(gap)
    return Evidence.of(white, problem.whiten(gap), parts)


def _changes(problem: Problem, terms: Sequence[int], value: np.ndarray) -> list:
    return [(problem.terms[t], float(v)) for t, v in zip(terms, value, strict=True)]


def _bounded(problem: Problem, terms: Sequence[int], value: np.ndarray) -> np.ndarray:
    low = [_smallest(problem, t) for t in terms]
    high = [get_effect(problem.terms[t].name).largest for t in terms]
    return np.clip(value, low, high)


def _smallest(problem: Problem, index: int) -> float:
    term = problem.terms[index]
    if term.name in PERIODIC:  # sine and cosine
        return -get_effect(term.name).largest
    return get_effect(term.name).smallest


def _slopes(
    problem: Problem, terms: Sequence[int], value: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """Columns, those of the set by differences at its present values."""
    white = problem.white.copy()
    for k, term in enumerate(terms):
        step = 0.2 * abs(value[k]) or problem.terms[term].step
        moved = value.copy()
        moved[k] += step
        try:
            run = problem.replay.torque(_changes(problem, terms, moved)) - problem.base
        except SimulationFailed:
            continue
        column = (run - change) / step * problem.terms[term].tolerance
        white[term] = problem.whiten(column.astype(white.dtype))
    return white
