"""Error on the scoring motions."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.replay.torque_error import relative_error, relative_errors


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
