"""Where a residual occurs, by axis and motion regime, and patterns in the error that remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2
from statsmodels.stats.multitest import multipletests

from faultgen.discovery.regression import Kinematics, Problem
from faultgen.robot import STRIBECK_VELOCITY

FALSE_DISCOVERIES = 0.05
"""Expected share of false discoveries among the reported regimes."""

_AFTER = 0.1  # time that counts as a reversal after a change of direction [s]
_ENRICHED = 1.3  # intensity of a residual in a regime over that of its axis, to be told


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
    slow = robot.model.actuator_biasprm[robot.ids("actuator", "friction"), STRIBECK_VELOCITY]
    moving = speed > 0.2 * slow
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
        "low speed": moving & (speed < 3 * slow),
        "high speed": _top_third(speed, moving),
        "reversal": recent & moving,
        "acceleration": _top_third(np.abs(motion.acceleration), moving),
        "load": _top_third(load, moving),
        "light load": moving & ~_top_third(load, moving, 2 / 3),
    }
    if recording.temperature is not None and np.ptp(recording.temperature) > 5:
        warm = recording.temperature > np.median(recording.temperature)
        named["warm"] = np.broadcast_to(warm[:, None], moving.shape)
        named["cold"] = np.broadcast_to(~warm[:, None], moving.shape)
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
    keep, corrected, _, _ = multipletests(
        [one.p_value for one in found], FALSE_DISCOVERIES, method="fdr_bh"
    )
    told = [
        Share(one.axis, one.regime, one.share, one.intensity, float(p))
        for one, kept, p in zip(found, keep, corrected, strict=True)
        if kept and (one.regime == "all" or one.intensity > _ENRICHED)
    ]
    return sorted(told, key=lambda one: (one.regime != "all", -one.share))


@dataclass(frozen=True)
class Pattern:
    """A pattern in the error that remains."""

    axis: int
    """From 1."""
    along: str
    """Name of the quantity on which the error depends."""
    strength: float
    """Chi-square minus its degrees of freedom."""
    p_value: float
    """Probability that noise alone causes it, corrected for the number of patterns tested."""
    place: float
    """Value of that quantity at which the pattern is strongest, in the unit of the quantity."""


_FAMILIES = (
    ("joint angle", (24, 6)),
    ("motor turn", (16,)),
    ("speed", (16, 6)),
    ("acceleration", (12, 4)),
    ("time", (40, 10)),
)
"""Numbers of bins: many for sharp patterns, few for smooth ones."""


def patterns(
    problem: Problem,
    error: np.ndarray,
    parts: Sequence[int],
    columns: Sequence[tuple[int, np.ndarray]] = (),
) -> list[Pattern]:
    """Test whether the remaining error has a pattern of any form, with means over bins.

    Args:
        problem: The recording.
        error: Whitened error that remains, shape (samples, n_axes).
        parts: Indices of the separate recordings that are tested.
        columns: Axis (from 1) and whitened change, shape (samples, n_axes), of each fitted effect.
            It is tested as well whether the severity of these effects depends on a quantity.

    Returns:
        All patterns that were tested, strongest first.
    """
    motion = problem.motion
    use = problem.samples(parts)
    ones = np.ones(len(error))
    found = []
    for axis in range(error.shape[1]):
        rows = use & problem.inside[:, axis]
        if rows.sum() < 200:
            continue
        found += _along_all(problem, motion, axis, rows, error[:, axis], ones)
        found.append(_unsteady(motion, axis, rows, error[:, axis]))
        found.append(_bursts(problem, axis, error, parts))
    for axis, column in columns:
        rows = use & problem.inside[:, axis - 1]
        if rows.sum() < 200:
            continue
        found += _along_all(
            problem, motion, axis - 1, rows, error[:, axis - 1], column[:, axis - 1]
        )
    tests = max(len(found), 1)
    corrected = [replace(one, p_value=min(1.0, tests * one.p_value)) for one in found]
    return sorted(corrected, key=lambda one: (one.p_value, -one.strength))


def _along_all(
    problem: Problem,
    motion: Kinematics,
    axis: int,
    rows: np.ndarray,
    error: np.ndarray,
    weight: np.ndarray,
) -> list[Pattern]:
    """Patterns of an error along every quantity, for each direction of motion."""
    forward = motion.velocity[rows, axis] > 0
    features = {
        "joint angle": motion.position[rows, axis] / problem.robot.gear_ratio[axis],
        "motor turn": np.mod(motion.position[rows, axis], 2 * np.pi),
        "speed": motion.velocity[rows, axis],
        "acceleration": motion.acceleration[rows, axis],
        "time": np.flatnonzero(rows) * problem.recording.sample_period,
    }
    found = []
    for name, counts in _FAMILIES:
        whole = name in ("speed", "time")
        directions = (np.ones_like(forward),) if whole else (forward, ~forward)
        found += [
            _pattern(axis + 1, name, features[name], error[rows], weight[rows], directions, count)
            for count in counts
        ]
    return found


def _pattern(
    axis: int,
    name: str,
    feature: np.ndarray,
    values: np.ndarray,
    weight: np.ndarray,
    directions: Sequence[np.ndarray],
    count: int,
) -> Pattern:
    """Projection of an error on a weight, in each bin of a feature."""
    statistic, freedom, best, place = 0.0, 0, -1.0, 0.0
    edges = np.unique(np.quantile(feature, np.linspace(0, 1, count + 1)))
    bins = np.clip(np.searchsorted(edges, feature, side="right") - 1, 0, len(edges) - 2)
    length = len(edges) - 1
    least = 0.1 * float(weight @ weight) / (length * len(directions))
    for direction in directions:
        own, w = bins[direction], weight[direction]
        number = np.bincount(own, minlength=length)
        size = np.bincount(own, w * w, minlength=length)
        total = np.bincount(own, w * values[direction], minlength=length)
        kept = (number >= 5) & (size > least)
        part = np.where(kept, total**2 / np.maximum(size, 1e-300), 0.0)
        statistic += float(part.sum())
        freedom += int(kept.sum())
        if part.max() > best:
            best, k = float(part.max()), int(np.argmax(part))
            place = float((edges[k] + edges[k + 1]) / 2)
    return Pattern(axis, name, statistic - freedom, float(chi2.sf(statistic, freedom)), place)


def _unsteady(motion: Kinematics, axis: int, rows: np.ndarray, error: np.ndarray) -> Pattern:
    """Test whether the error is larger while the axis moves: regression of its square.

    Source: Koenker (1981).
    """
    squares = error[rows] ** 2
    speed = np.abs(motion.velocity[rows, axis])
    push = np.abs(motion.acceleration[rows, axis])
    design = np.stack([np.ones_like(speed), speed, push, speed**2, push**2], axis=1)
    design[:, 1:] /= np.maximum(design[:, 1:].max(axis=0), 1e-300)
    answer, *_ = np.linalg.lstsq(design, squares, rcond=None)
    fitted = design @ answer
    explained = float(np.sum((fitted - squares.mean()) ** 2))
    # squares of noise have a variance of 2; less means that the residual lacks some of its noise
    scatter = max(float(np.mean((squares - squares.mean()) ** 2)), 2.0)
    statistic = explained / scatter
    excess = max(float((fitted - fitted.min()).sum()), 0.0)
    place = float(speed[np.argmax(fitted)])
    return Pattern(axis + 1, "motion", excess, float(chi2.sf(statistic, 4)), place)


def _bursts(problem: Problem, axis: int, error: np.ndarray, parts: Sequence[int]) -> Pattern:
    """Periods of time in which the error is larger than the noise."""
    length = max(10, round(0.2 / problem.recording.sample_period))
    worst, place, tests = 1.0, 0.0, 0
    strength = 0.0
    for p in parts:
        part = problem.parts[p]
        squares = np.where(problem.inside[part, axis], error[part, axis] ** 2, 0.0)
        counted = problem.inside[part, axis]
        for start in range(0, len(squares) - length + 1, length):
            count = int(counted[start : start + length].sum())
            if count < length // 2:
                continue
            tests += 1
            total = float(squares[start : start + length].sum())
            chance = float(chi2.sf(total, count))
            if chance < worst:
                worst, strength = chance, total - count
                place = (part.start + start) * problem.recording.sample_period
    return Pattern(axis + 1, "time", strength, min(1.0, tests * worst), place)
