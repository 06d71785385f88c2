"""Where a residual occurs: by axis and motion regime."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, false_discovery_control

from faultgen.discovery.fit.problem import Kinematics, Problem
from faultgen.inference.limits import FALSE_DISCOVERIES

_AFTER = 0.1  # time that counts as a reversal after a change of direction [s]


@dataclass(frozen=True)
class Share:
    """The share of a residual that occurs in one regime."""

    axis: int
    """From 1."""
    regime: str
    """Name of the regime; 'all' is the whole axis."""
    share: float
    """Share of the squared residual of all axes, where the residual is in units of the noise."""
    intensity: float
    """Mean squared residual in the regime divided by the mean squared residual of the axis."""
    p_value: float
    """Probability that noise alone causes this much, corrected for the number of regimes."""


def regimes(problem: Problem, motion: Kinematics) -> dict[str, np.ndarray]:
    """Find the samples that belong to each motion regime.

    Args:
        problem: The recording and its model.
        motion: Measured motion, motor side.

    Returns:
        For each regime a mask of shape (samples, n_axes).
    """
    robot, recording = problem.robot, problem.recording
    speed = np.abs(motion.velocity)
    moving = speed > 0.2 * robot.stribeck_velocity
    recent = np.zeros_like(moving)
    steps = max(1, round(_AFTER / recording.sample_period))
    for part in recording.parts:
        turned = np.sign(motion.velocity[part])
        change = np.abs(np.diff(turned, axis=0, prepend=turned[:1])) > 0
        for axis in range(robot.n_axes):
            kernel = np.ones(steps, int)
            recent[part, axis] = np.convolve(change[:, axis], kernel)[: len(change)] > 0
    load = np.abs(problem.base)  # torque of the model is near to the load at most speeds
    named = {
        "all": np.ones_like(moving),
        "forward": moving & (motion.velocity > 0),
        "backward": moving & (motion.velocity < 0),
        "at rest": ~moving,
        "low speed": moving & (speed < 3 * robot.stribeck_velocity),
        "high speed": _top_third(speed, moving),
        "reversal": recent & moving,
        "acceleration": _top_third(np.abs(motion.acceleration), moving),
        "load": _top_third(load, moving),
        "light load": moving & ~_top_third(load, moving, 2 / 3),
    }
    temperature = recording.axis_temperature
    if temperature is not None:
        changes = np.ptp(temperature, axis=0) > 5
        warm = temperature > np.median(temperature, axis=0)
        if changes.any():
            named["warm"], named["cold"] = warm & changes, ~warm & changes
    return named


def _top_third(values: np.ndarray, among: np.ndarray, share: float = 1 / 3) -> np.ndarray:
    limit = np.array(
        [
            np.quantile(values[among[:, k], k], 1 - share) if among[:, k].any() else np.inf
            for k in range(values.shape[1])
        ]
    )
    return among & (values >= limit)


def where(problem: Problem, error: np.ndarray) -> list[Share]:
    """Compute the share of a residual that occurs on each axis and in each regime.

    Args:
        problem: The recording.
        error: Whitened error, shape (samples, n_axes).

    Returns:
        The whole axes, and the regimes in which the error is larger than elsewhere on the axis. The
        false discovery rate is controlled (Benjamini and Hochberg). The largest share comes first.
    """
    motion = problem.motion
    excess = error**2 - 1.0
    by_axis = np.where(problem.inside, excess, 0.0).sum(axis=0)
    total = max(float(np.maximum(by_axis, 0).sum()), 1e-300)
    found = []
    for name, mask in regimes(problem, motion).items():
        for axis in range(error.shape[1]):
            rows = mask[:, axis] & problem.inside[:, axis]
            count = int(rows.sum())
            every = problem.inside[:, axis]
            if count < 20:
                continue
            square = float((error[rows, axis] ** 2).sum())
            whole = max(float(excess[every, axis].mean()), 1e-9)
            found.append(
                Share(
                    axis=axis + 1,
                    regime=name,
                    share=max(float(excess[rows, axis].sum()), 0.0) / total,
                    intensity=float(excess[rows, axis].mean()) / whole,
                    p_value=float(chi2.sf(square, count)),
                )
            )
    if not found:
        return []
    corrected = false_discovery_control([one.p_value for one in found])
    told = [
        Share(one.axis, one.regime, one.share, one.intensity, float(p))
        for one, p in zip(found, corrected, strict=True)
        if p <= FALSE_DISCOVERIES and (one.regime == "all" or one.intensity > 1)
    ]
    return sorted(told, key=lambda one: (one.regime != "all", -one.share))
