"""How certain an effect of an answer is: the interval of its severity, and the misfit without it.

Both are computed from the same simulated misfit. An interval contains the severities whose misfit
is less than 3.84 above its minimum (95 % of chi-square with one degree of freedom; Wilks 1938). The
confidence treats the misfit without the effect like the misfit of any other explanation. If the
misfit is larger than noise explains, both divide it by the overdispersion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from faultgen.discovery.fit.fit import Fit, bounds_of
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.terms.candidates import PAYLOAD
from faultgen.effects import get_effect

LEVEL = 0.95
"""Probability that an interval contains the true severity, if the model of the effect is right."""

_LIMIT = float(chi2.ppf(LEVEL, 1))
_TRIALS = 6  # simulations for each end of an interval
_CLOSE = 0.03  # share by which the root of the misfit may differ from that at the end


@dataclass(frozen=True)
class Certainty:
    """What is known of the severity of one effect."""

    severity: float
    """Best estimate."""
    error: float
    """Standard error, to first order."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end."""
    absent: float
    """Misfit without the effect minus the smallest misfit, divided by the overdispersion."""


def overdispersion(problem: Problem, fitted: Fit) -> float:
    """Return the misfit of a fit divided by the misfit that noise alone would give.

    Args:
        problem: The residual and the terms.
        fitted: The set of effects.

    Returns:
        The ratio, at least 1.
    """
    samples = problem.inside[problem.samples(problem.fitting)].sum()
    return max(1.0, fitted.misfit / max(int(samples), 1))


def certainty(problem: Problem, fitted: Fit, place: int) -> Certainty:
    """Compute the interval of one effect while all other effects and numbers are fitted again.

    Args:
        problem: The residual and the terms.
        fitted: The set of effects.
        place: Position of the effect in the set, from 0.

    Returns:
        Severity, interval, and misfit without the effect.
    """
    terms, values = fitted.terms, fitted.values
    start = sum(len(group) for group in fitted.groups[:place])
    own = np.arange(start, start + len(fitted.groups[place]))
    over = overdispersion(problem, fitted)
    covariance = over * _covariance(problem, fitted)
    # severity is a sum of the values of the group, each times its weight
    payload = problem.terms[terms[start]].name == PAYLOAD and len(own) > 1
    size = float(np.linalg.norm(values[own]))
    weight = np.zeros(len(values))
    weight[own] = 1.0 if payload or len(own) == 1 else values[own] / max(size, 1e-300)
    severity = float(weight @ values)
    variance = float(weight @ covariance @ weight)
    error = float(np.sqrt(max(variance, 0.0)))
    towards = covariance @ weight / max(variance, 1e-300)
    low, high = bounds_of(problem, terms)

    def worse(step: float) -> float:
        """Misfit beyond the best where the severity is a step off, the rest following it."""
        moved = np.clip(values + step * towards, low, high)
        pairs = zip(terms, moved.tolist(), strict=True)
        change = problem.change([(problem.terms[t], v) for t, v in pairs])
        if change is None:
            return np.inf
        evidence = problem.evidence(problem.residual - change).weighted(fitted.evidence.weight)
        _, _, misfit = evidence.solve(held=terms)
        return max(misfit - fitted.misfit, 0.0) / over

    effect = get_effect(problem.terms[terms[start]].name)
    least = 0.0 if len(own) > 1 else effect.smallest
    return Certainty(
        severity,
        error,
        float(severity - _end(lambda step: worse(-step), error, severity - least)),
        float(severity + _end(worse, error, effect.largest - severity)),
        worse(-severity),
    )


def _covariance(problem: Problem, fitted: Fit) -> np.ndarray:
    """Covariance of the values of all effects, to first order."""
    _, inverse, _ = fitted.evidence.solve(free=fitted.terms)
    scale = np.array([problem.terms[t].prior_std for t in fitted.terms])
    return inverse[np.ix_(fitted.terms, fitted.terms)] * np.outer(scale, scale)


def _end(worse: Callable[[float], float], error: float, most: float) -> float:
    """Step at which the misfit is at the limit, by secants of its root, at most as asked."""
    low, high = (0.0, 0.0), (np.inf, np.inf)
    goal = np.sqrt(_LIMIT)
    step = min(goal * error, most)
    for _ in range(_TRIALS):
        root = float(np.sqrt(worse(step)))
        if abs(root - goal) <= _CLOSE * goal:
            return step
        if root < goal:
            if step >= most:
                return most
            low = step, root
        else:
            high = step, root
        if not np.isfinite(high[0]):  # not yet far enough
            step = min(most, step * float(np.clip(goal / max(root, 1e-9), 1.2, 4.0)))
        elif not np.isfinite(high[1]):
            step = (low[0] + high[0]) / 2
        else:
            share = (goal - low[1]) / max(high[1] - low[1], 1e-300)
            step = low[0] + float(np.clip(share, 0.1, 0.9)) * (high[0] - low[0])
    return high[0] if np.isfinite(high[0]) else step
