"""Fits of sets of effects by re-simulation. All other terms may vary within their priors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from faultgen.discovery.fit.evidence import Evidence
from faultgen.discovery.fit.law_error import score, weights
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.terms.candidates import PAYLOAD, Term
from faultgen.effects import get_effect

Group = tuple[int, ...]
"""Indices of the terms of one candidate: one term, or sine and cosine of a periodic effect."""

_STEPS = 6  # re-simulations of a fit at most
_SHORT = 0.1  # share of a linear gain that simulation may fall short of
_CLOSE = 0.02  # change of a value, over the value, at which a fit has converged
_SHARES = (0.1, 0.2, 0.35, 0.6, 1.0, 1.7, 3.0, 5.0)  # of a severity, tried in turn
_FAR = 100.0  # decrease of the misfit from which a play is searched for without a baseline: assumed
_REFINED = 7  # simulations to refine the best of them


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of effects and how well it explains the residual."""

    groups: tuple[Group, ...]
    """The effects."""
    values: np.ndarray
    """Severity of each term of the effects, in the order of the groups. Shape (terms,)."""
    errors: np.ndarray
    """Standard errors of the values. Shape (terms,)."""
    change: np.ndarray
    """Simulated change of the torque by the effects, shape (samples, n_axes)."""
    evidence: Evidence
    """Inner products with the residual that remains, on the parts for fitting."""
    misfit: float
    """Squared whitened error plus the term of the prior."""
    score: float
    """The number by which sets are compared: error on recordings that were not fitted, plus a
    penalty."""

    @property
    def terms(self) -> list[int]:
        """Indices of all terms."""
        return [term for group in self.groups for term in group]

    def members(self) -> Iterator[tuple[Group, np.ndarray, np.ndarray]]:
        """Iterate over the effects.

        Yields:
            The group of each effect, its values and their standard errors. The arrays have shape
            (terms of the group,).
        """
        at = 0
        for group in self.groups:
            until = at + len(group)
            yield group, self.values[at:until], self.errors[at:until]
            at = until


def fit(
    problem: Problem,
    groups: Sequence[Group],
    start: np.ndarray | None = None,
    *,
    simulating: Callable[[], None] = lambda: None,
) -> Fit | None:
    """Fit a set of effects by re-simulation, with the Gauss-Newton method.

    Each step simulates the effects exactly. The slopes are the columns of the unchanged model. If
    the simulation explains less than these slopes predict, new slopes are computed at each step.
    The severity of a play is searched over a wide range: always if there is a baseline, and
    otherwise where the slopes lead nowhere or promise much, because the errors of a model look like
    some small play or other.

    Args:
        problem: The residual and the terms.
        groups: The set of effects. It may be empty.
        start: Values from which the fit starts, shape (terms,). None: the linear estimate.
        simulating: Called before each simulation.

    Returns:
        The fit, or None if no severity within the bounds of an effect explains anything.
    """
    terms = [term for group in groups for term in group]
    if not terms:
        evidence = problem.evidence()
        _, _, misfit = evidence.solve()
        return _done(problem, (), np.empty(0), np.zeros_like(problem.residual), evidence, misfit)
    new = terms if start is None else groups[-1]
    plays = [t for t in new if get_effect(problem.terms[t].name).prior.play]
    if problem.baseline:
        return _fit(problem, groups, start, plays, simulating)
    found = _fit(problem, groups, start, (), simulating)
    if plays and (found is None or _promised(problem, plays) > _FAR):
        scanned = _fit(problem, groups, start, plays, simulating)
        both = [one for one in (found, scanned) if one is not None]
        return min(both, key=lambda one: one.misfit) if both else None
    return found


def _promised(problem: Problem, plays: Sequence[int]) -> float:
    """Largest decrease of the misfit by a play of any size, to first order."""
    keys = {problem.terms[t].key for t in plays}
    groups = [(t,) for t, term in enumerate(problem.terms) if term.key in keys]
    gains, _ = problem.evidence().gains(groups)
    return float(gains.max())


def _fit(
    problem: Problem,
    groups: Sequence[Group],
    start: np.ndarray | None,
    plays: Sequence[int],
    simulating: Callable[[], None],
) -> Fit | None:
    """Fit a set of effects, of which some are searched over a wide range of severities.

    Args:
        problem: The residual and the terms.
        groups: The set of effects, at least one.
        start: As for `fit`.
        plays: Indices of the terms that are searched.
        simulating: As for `fit`.

    Returns:
        As for `fit`.
    """
    terms = [term for group in groups for term in group]
    scale = np.array([problem.terms[t].prior_std for t in terms])
    evidence = problem.evidence()

    def simulate(value: np.ndarray) -> np.ndarray | None:
        simulating()
        pairs = zip(terms, value.tolist(), strict=True)
        return problem.change([(problem.terms[t], v) for t, v in pairs])

    value = start
    if value is None:
        solution, _, _ = evidence.solve(free=terms)
        value = solution[terms] * scale
    value = _bounded(problem, terms, value)
    if not np.any(value):
        return None
    for k, t in enumerate(terms):
        if t in plays:
            value = _scanned(problem, terms, value, k, simulate)
    # fixed, because freedom that grows with the severity would make it grow further
    weight = weights(problem, terms, value)

    def beside(evidence: Evidence) -> Evidence:
        return evidence.weighted(weight)

    told = np.tensordot(value.astype(np.float32), problem.raw[terms], axes=1)
    _, _, expected = beside(problem.evidence(problem.residual - told)).solve(held=terms)
    _, _, nothing = evidence.solve(held=terms)
    straight = all(len(get_effect(problem.terms[t].name).prior.steps) < 2 for t in terms)
    best: tuple[float, np.ndarray, np.ndarray, Evidence] | None = None
    for _ in range(_STEPS):
        change = simulate(value)
        here = np.inf
        if change is not None:
            evidence = beside(problem.evidence(problem.residual - change))
            _, _, here = evidence.solve(held=terms)
        if best is None:
            if not here < nothing:  # the first step was too long
                straight = False
                value = 0.4 * value
                continue
            if here - expected > max(1.0, _SHORT * (nothing - expected)):
                straight = False
        if change is not None and (best is None or here < best[0]):
            if not straight:
                steps = {k: -0.02 * v or problem.terms[terms[k]].step for k, v in enumerate(value)}
                slopes = differences(simulate, value, change, steps)
                by_term = {terms[k]: slope for k, slope in slopes.items()}
                evidence = beside(problem.evidence(problem.residual - change, by_term))
            best = here, value, change, evidence
            solution, _, _ = evidence.solve(free=terms)
            delta = solution[terms] * scale
        else:
            delta = 0.4 * delta
        assert best is not None
        new = _bounded(problem, terms, best[1] + delta)
        if np.all(np.abs(new - best[1]) <= _CLOSE * np.abs(best[1]) + 1e-3 * scale):
            break
        value = new
    if best is None or not _within(problem, terms, best[1]):
        return None
    here, value, change, evidence = best
    return _done(problem, tuple(groups), value, change, evidence, here)


def _scanned(
    problem: Problem,
    terms: Sequence[int],
    value: np.ndarray,
    place: int,
    simulate: Callable[[np.ndarray], np.ndarray | None],
) -> np.ndarray:
    """Find the severity of one effect with the smallest misfit over a wide range.

    A play shifts the moment at which the gears meet again. A play of another size meets them at
    other moments, so that the misfit rises before it falls, and slopes lead nowhere.

    Args:
        problem: The residual and the terms.
        terms: Indices of all terms of the set.
        value: Value of each term, shape (terms,).
        place: Which of the values is searched.
        simulate: Function from values to the torque.

    Returns:
        The values with the best severity, shape (terms,).
    """

    def moved(severity: float) -> np.ndarray:
        new = value.copy()
        new[place] = severity
        return _bounded(problem, terms, new)

    def misfit(severity: float) -> float:
        change = simulate(moved(severity))
        if change is None:
            return np.inf
        _, _, here = problem.evidence(problem.residual - change).solve(held=terms)
        return here

    name = problem.terms[terms[place]].name
    own = get_effect(name).prior.steps
    tried = sorted({share * size for share in _SHARES for size in (value[place], max(own)) if size})
    misfits = [misfit(severity) for severity in tried]
    k = int(np.argmin(misfits))
    low, high = tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)]
    found = minimize_scalar(
        misfit, bounds=(low, high), method="bounded", options={"maxiter": _REFINED}
    )
    return moved(float(found.x) if found.fun < misfits[k] else tried[k])


def differences(
    simulate: Callable[[np.ndarray], np.ndarray | None],
    value: np.ndarray,
    change: np.ndarray,
    steps: Mapping[int, float],
) -> dict[int, np.ndarray]:
    """Compute slopes of a torque by finite differences, if they can be simulated.

    Args:
        simulate: Function from values to the torque. It returns None if the simulation diverges.
        value: Values at which the slopes are computed, shape (terms,).
        change: Torque at these values, shape (samples, n_axes).
        steps: Step of each value whose slope is wanted, by its index.

    Returns:
        Slopes by index, shape (samples, n_axes) each.
    """
    slopes = {}
    for k, step in steps.items():
        moved = value.copy()
        moved[k] += step
        run = simulate(moved)
        if run is not None:
            slopes[k] = (run - change) / step
    return slopes


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
        The smaller set. Its change of the torque is simulated, or linear if the simulation
        diverges.
    """
    if count == len(fitted.groups):
        return fitted
    groups = fitted.groups[:count]
    size = sum(len(group) for group in groups)
    terms, values = fitted.terms[:size], fitted.values[:size]
    change = problem.change(
        [(problem.terms[t], float(v)) for t, v in zip(terms, values, strict=True)]
    )
    if change is None:  # to first order where it cannot be simulated without the others
        change = np.tensordot(values.astype(np.float32), problem.raw[terms], axes=1)
    return replace(fitted, groups=groups, values=values, errors=fitted.errors[:size], change=change)


def _done(
    problem: Problem,
    groups: tuple[Group, ...],
    value: np.ndarray,
    change: np.ndarray,
    evidence: Evidence,
    misfit: float,
) -> Fit:
    terms = [term for group in groups for term in group]
    scale = np.array([problem.terms[t].prior_std for t in terms])
    _, inverse, _ = evidence.solve(free=terms)
    errors = scale * np.sqrt(np.diag(inverse)[terms]) if terms else np.empty(0)
    return Fit(groups, value, errors, change, evidence, misfit, score(evidence, terms))


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


def _bounded(problem: Problem, terms: Sequence[int], value: np.ndarray) -> np.ndarray:
    return np.clip(value, *bounds_of(problem, terms))


def _within(problem: Problem, terms: Sequence[int], value: np.ndarray) -> bool:
    """Whether no severity has reached its bound. An effect at its bound explains nothing."""
    low, high = bounds_of(problem, terms)
    return bool(np.all((value > low) & (value < high)))
