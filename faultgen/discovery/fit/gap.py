"""Error of a fitted set of effects on the scoring motions."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.fit.fit import Fit
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.replay.replay import relative_error, relative_errors


def unexplained(problem: Problem, fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Compute what a set and the calibration leave of the residual.

    Args:
        problem: The residual and the terms.
        fitted: The set of effects.

    Returns:
        Torque that they do not explain in N m, shape (samples, n_axes), and the value of every term
        in prior standard deviations, shape (terms,), where those of the set are 0.
    """
    free = fitted.terms
    solution, _, _ = fitted.evidence.solve(held=free)  # they are at the fit already
    solution = solution.copy()
    solution[free] = 0.0
    scale = np.array([term.prior_std for term in problem.terms])
    explained = np.tensordot((solution * scale).astype(np.float32), problem.raw, axes=1)
    return problem.residual - fitted.change - explained, solution


def scored(problem: Problem) -> np.ndarray:
    """Find the samples of the scoring motions that are used.

    Args:
        problem: The recording and the model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    return problem.inside & problem.samples(problem.scoring)[:, None]


def gap(
    problem: Problem, error: np.ndarray, inside: np.ndarray | None = None
) -> tuple[float, list[float]]:
    """Compute the relative error on the scoring motions.

    Args:
        problem: The recording and the model.
        error: Torque error in N m, shape (samples, n_axes).
        inside: Samples that are used, shape (samples, n_axes). Default: those of `scored`.

    Returns:
        The relative error of all axes, and of each axis, without unit.
    """
    inside = scored(problem) if inside is None else inside
    recording = problem.recording
    by_axis = relative_errors(error**2, recording, inside)
    return relative_error(error**2, recording, inside), by_axis.tolist()
