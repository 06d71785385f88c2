"""How large differences from day to day are, learned from recordings of a healthy robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from .causes import Days

Floats = NDArray[np.float64]

LARGEST = 3.5
"""Logarithm of the largest scale, and of the inverse of the smallest."""

_WORTH = 30.0  # number of features that it is worth that their noise should have a variance of 1
_EDGE = 1e-9  # of information, below which it counts as none
_STEP = 0.05  # of the logarithm of a scale, for the curvature


def day_stds(days: Days, log_scales: Floats) -> Floats:
    """Compute the standard deviation of each number.

    Args:
        days: The numbers.
        log_scales: Logarithm of the scale of each group, shape (groups,).

    Returns:
        Shape (numbers,).
    """
    return np.asarray(days.stds * np.exp(log_scales)[days.groups])


def learn_days(days: Days, apart: Floats) -> tuple[Floats, Floats, float]:
    """Find the scales by their marginal likelihood, with a log-normal prior.

    Args:
        days: The numbers.
        apart: Features of healthy recordings less their mean, shape (recordings, features).

    Returns:
        Logarithm of the scale of each group and its standard deviation, shape (groups,) each, and
        the variance of the noise. One recording tells nothing of them.
    """
    spreads = np.log(days.spreads)
    freedom = len(apart) - 1
    log_scales, errors = np.zeros(len(spreads)), spreads.copy()
    if not freedom:
        return log_scales, errors, 1.0
    gram, right = days.columns @ days.columns.T, days.columns @ apart.T
    left, rank = float(np.sum(apart**2)), 0
    if len(days.stds):
        root, _, found, _ = np.linalg.lstsq(gram, right, rcond=_EDGE)
        left, rank = left - float(np.sum(root * right)), int(found)
    free = freedom * max(apart.shape[1] - rank, 0)
    noise = (max(left, 0.0) + _WORTH) / (free + _WORTH)
    if not len(days.stds):
        return log_scales, errors, noise

    def cost(log_scales: Floats) -> float:
        std = day_stds(days, log_scales)
        scaled = right * std[:, None]
        inner = gram * np.outer(std, std) / noise + np.eye(len(std))
        factor = cho_factor(inner, lower=True)
        half = freedom * np.log(np.diag(factor[0])).sum()
        explained = float(np.sum(scaled * cho_solve(factor, scaled))) / noise**2
        return float(half - 0.5 * explained + 0.5 * np.sum((log_scales / spreads) ** 2))

    bounds = [(-LARGEST, LARGEST)] * len(spreads)
    best = minimize(cost, log_scales, method="L-BFGS-B", bounds=bounds)
    log_scales = np.asarray(best.x)
    for k in range(len(spreads)):  # curvature, one scale at a time
        shift = _STEP * np.eye(len(spreads))[k]
        more, less = cost(log_scales + shift), cost(log_scales - shift)
        curved = max((more + less - 2 * float(best.fun)) / _STEP**2, 1 / spreads[k] ** 2)
        errors[k] = curved**-0.5
    return log_scales, errors, noise
