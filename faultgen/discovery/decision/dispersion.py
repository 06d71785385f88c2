"""How much larger errors are on motions that were not fitted than the model of them says.

variance = dispersion(problem, difference, fitted, change)

No model of a robot is exact, so that logarithms of odds are too large. They are divided by this
ratio of variances, as in quasi-likelihood (McCullagh and Nelder 1989, 9.2).
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.decision.difference import Difference
from faultgen.discovery.decision.hypotheses import Group
from faultgen.discovery.fit.problem import Problem
from faultgen.inference.model import Fitted

_JUMP = 25.0  # squared error over its expectation of a jump: one sample should not decide
_FEWEST = 50  # samples of an axis that can tell


def dispersion(
    problem: Problem, difference: Difference, fitted: Fitted, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compare the whitened error on the scoring motions with what the model says it should be.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.
        fitted: The numbers beside the effects.
        change: Change of the torque by the effects, shape (samples, n_axes).

    Returns:
        Mean square over its expectation, which is that of the noise and of the numbers' errors,
        and its standard error; shape (n_axes,), nan for an axis that is not compared there.
    """
    columns = [difference.numbers.columns[k] for k in difference.numbers.known]
    left = difference.left(fitted, change)
    white = difference.noise.whiten(left, difference.parts)
    inside = difference.comparable & problem.samples(problem.scoring)[:, None]
    out, error = np.full((2, left.shape[1]), np.nan)
    for axis in range(left.shape[1]):
        rows = inside[:, axis] & (white[:, axis] != 0)
        if rows.sum() < _FEWEST:
            continue
        acts = [k for k, one in enumerate(columns) if one[:, axis].any()]
        own = np.array([columns[k][:, axis] for k in acts]).reshape(len(acts), len(left))
        own = difference.noise.whiten_axis(own, axis + 1, difference.parts)[:, rows].astype(float)
        expected = 1 + np.sum(own * (fitted.covariance[np.ix_(acts, acts)] @ own), axis=0)
        squares = np.minimum(white[rows, axis] ** 2, _JUMP * expected)
        out[axis] = squares.mean() / expected.mean()
        error[axis] = squares.std() / expected.mean() / np.sqrt(len(squares))
    return out, error


def shrunk(variance: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Draw ratios of axes towards their mean, as far as their errors explain that they differ.

    Args:
        variance: From `dispersion`, shape (n_axes,); nan where it is not known.
        error: Their standard errors, same shape.

    Returns:
        The ratios, shape (n_axes,); their mean where one is not known, and 1 if none is. Source:
        empirical Bayes (Efron and Morris 1975, doi 10.1080/01621459.1975.10479864).
    """
    known = np.isfinite(variance)
    if not known.any():
        return np.ones(len(variance))
    mean, spread = float(variance[known].mean()), 0.0
    if known.sum() > 1:
        spread = max(spread, float(variance[known].var(ddof=1) - np.mean(error[known] ** 2)))
    keeps = spread / (spread + error**2 + 1e-12)
    return np.where(known, mean + keeps * (variance - mean), mean)


def of_effect(
    problem: Problem, difference: Difference, group: Group, variance: np.ndarray
) -> float:
    """Average the ratio over the axes whose torque an effect changes.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.
        group: Terms of the effect.
        variance: From `dispersion`, shape (n_axes,).

    Returns:
        The mean, weighted by the squared whitened changes; at least 1.
    """
    changes = difference.whiten(problem.raw[list(group)].astype(np.float32))
    energy = np.sum(changes.astype(float) ** 2, axis=(0, 1))
    if not energy.any():
        return 1.0
    return max(1.0, float(energy @ np.nan_to_num(variance, nan=1.0) / energy.sum()))
