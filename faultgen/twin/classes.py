"""Which fault, and how severe: a Gaussian model of features whose mean moves with the severity.

    x = healthy mean + a s + b s^2 + healthy deviation

Each fault, an effect on an axis, has its own vectors a and b. The deviation has one covariance,
shrunk as proposed by Ledoit and Wolf (2004). After whitening and projection onto the space of all a
and b, each hypothesis is a curve in a few dimensions, and its likelihood is computed on a grid of
severities. The vectors are learned from a model and are never exact: the variance grows with the
distance from the healthy mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr
from sklearn.covariance import ledoit_wolf

GRID = np.linspace(0.02, 1.5, 75)
"""Severities of each fault, over the largest one in the data, at which hypotheses are compared."""

INEXACT = 0.15
"""Error of the learned directions, over their length: assumed."""

SCALE = 0.3
"""Standard deviation of the logarithm of a severity that is due to the model: a fault of some
severity changes a real robot by more, or by less, than the same fault changes the model. Assumed;
see docs/twin.md for how often the intervals are right."""

_FOLDS = 5  # parts of the cycles that are left out in turn
_RANK = 1e-6  # singular values below this share of the largest are no direction


@dataclass(frozen=True, eq=False)
class Classes:
    """The fitted model."""

    centre: np.ndarray
    """Healthy mean of the features, shape (features,)."""
    whitener: np.ndarray
    """Inverse root of the covariance, shape (features, features)."""
    basis: np.ndarray
    """Orthonormal basis of the space of the faults, in whitened features; shape (dimensions,
    features)."""
    curves: np.ndarray
    """a and b of each fault in this space, for severities over the largest one; shape (faults, 2,
    dimensions)."""
    rest: np.ndarray
    """Mean and variance of the squared distance from this space in healthy cycles, shape (2,)."""

    def place(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where cycles are in the space of the faults, and their squared distance from it.

        Args:
            x: Features, shape (cycles, features).

        Returns:
            Shape (cycles, dimensions), and shape (cycles,); both without unit.
        """
        white = (x - self.centre) @ self.whitener.T
        inside = white @ self.basis.T
        outside = (white**2).sum(axis=1) - (inside**2).sum(axis=1)
        return inside, np.maximum(outside, 0.0)

    def fitted_to(self, healthy: np.ndarray) -> Classes:
        """Return the model with the mean and the spread that measured healthy recordings have.

        A generated robot may vary less than the real one, or otherwise. The variance of all
        features is multiplied by that of the measured places about their mean, over that of
        generated ones, if this is more than 1. So is the distance from the space of the faults.

        Args:
            healthy: Features of healthy recordings, shape (recordings, features).
        """
        count = len(healthy)
        if not count:
            return self
        moved = replace(self, centre=healthy.mean(axis=0))
        if count == 1:
            return moved
        inside, outside = moved.place(healthy)
        factor = max(float((inside**2).sum() / ((count - 1) * max(len(self.basis), 1))), 1.0)
        mean = self.rest[0] / factor
        seen = float(outside.sum() / (count - 1)) / factor
        more = max(seen / max(mean, 1e-12), 1.0)
        return replace(
            moved,
            whitener=self.whitener / np.sqrt(factor),
            curves=self.curves / np.sqrt(factor),
            rest=np.array([mean * more, self.rest[1] * (more / factor) ** 2]),
        )

    @property
    def means(self) -> np.ndarray:
        """Mean of each fault at each severity of `GRID`, shape (faults, severities, dimensions)."""
        powers = np.stack([GRID, GRID**2])
        return np.asarray(np.einsum("ps,fpd->fsd", powers, self.curves))

    def log_ratio(self, y: np.ndarray, variance: float = 1.0) -> np.ndarray:
        """Compute the log-likelihood of each fault and severity, less that of the healthy robot.

        Args:
            y: Places, shape (cycles, dimensions).
            variance: Variance of the places in healthy cycles; below 1 for means of cycles.

        Returns:
            Shape (cycles, faults, severities).
        """
        means = self.means
        dimensions = max(means.shape[2], 1)
        length = (means**2).sum(axis=2)
        wider = variance + INEXACT**2 * length / dimensions
        size = (y**2).sum(axis=1)[:, None, None]
        product = np.einsum("cd,fsd->cfs", y, means)
        misfit = size - 2 * product + length
        return np.asarray(
            -0.5 * misfit / wider
            - 0.5 * dimensions * np.log(wider / variance)
            + 0.5 * size / variance
        )


def fit_classes(x: np.ndarray, fault: np.ndarray, severity: np.ndarray, count: int) -> Classes:
    """Fit the model.

    The distance from the space of the faults is that of cycles which were left out of the fit: a
    covariance makes the cycles from which it was learned look more alike than others.

    Args:
        x: Features, shape (cycles, features).
        fault: Number of the fault of each cycle, from 0; -1 for healthy ones; shape (cycles,).
        severity: Severity over the largest one of the fault, shape (cycles,).
        count: Number of faults.

    Returns:
        The model.

    Raises:
        ValueError: There are fewer cycles than the curves have numbers.
    """
    design = np.zeros((len(x), 1 + 2 * count))
    design[:, 0] = 1.0
    for number in range(count):
        own = fault == number
        design[own, 1 + 2 * number] = severity[own]
        design[own, 2 + 2 * number] = severity[own] ** 2
    if len(x) - math.ceil(len(x) / _FOLDS) <= design.shape[1] + 2:
        raise ValueError(f"{len(x)} cycles are too few for {count} faults")
    centre, whitener, curves, basis = _fit(x, design, count)
    inside, outside = np.zeros((len(x), len(basis))), np.zeros(len(x))
    for fold in range(_FOLDS):
        left = np.arange(len(x)) % _FOLDS == fold
        solution, root, _, space = _fit(x[~left], design[~left], count)
        apart = x[left] - design[left] @ solution
        white = apart @ root.T
        inside[left] = white @ basis.T
        outside[left] = (white**2).sum(axis=1) - ((white @ space.T) ** 2).sum(axis=1)
    widen = _wider(inside)
    # not mean and variance: a fault whose curve is no quadratic leaves cycles far out
    low, middle, high = np.quantile(np.maximum(outside, 0.0), (0.16, 0.5, 0.84))
    return Classes(
        centre=centre[0],
        whitener=whitener + basis.T @ (widen - np.eye(len(basis))) @ basis @ whitener,
        basis=basis,
        curves=curves @ basis.T @ widen,
        rest=np.array([middle, max((high - low) ** 2 / 4, 1e-9)]),
    )


def _wider(inside: np.ndarray) -> np.ndarray:
    """Symmetric matrix that scales the places of cycles where they vary more than expected.

    With many features, the shrunk covariance makes the few directions in which a robot varies most
    too narrow.

    Args:
        inside: Places of cycles about their means, shape (cycles, dimensions).

    Returns:
        Shape (dimensions, dimensions). It makes no direction larger.
    """
    covariance, _ = ledoit_wolf(inside, assume_centered=True)
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors / np.sqrt(np.maximum(values, 1.0))) @ vectors.T)


def _fit(
    x: np.ndarray, design: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Least squares: coefficients, the whitener of what is left, whitened curves, their basis."""
    solution = np.linalg.lstsq(design, x, rcond=None)[0]
    apart = (x - design @ solution) * np.sqrt(len(x) / (len(x) - design.shape[1]))
    size = np.maximum(apart.std(axis=0), 1e-12)
    covariance, _ = ledoit_wolf(apart / size, assume_centered=True)
    values, vectors = np.linalg.eigh(covariance)
    # symmetric, so that whitened features of different folds are alike
    whitener = (vectors / np.sqrt(np.maximum(values, 1e-9))) @ vectors.T / size
    curves = (solution[1:] @ whitener.T).reshape(count, 2, -1)
    # directions that move at all; the rest would be noise of the fit
    _, lengths, basis = np.linalg.svd(curves.reshape(-1, curves.shape[-1]), full_matrices=False)
    basis = basis[lengths > _RANK * lengths.max(initial=1e-300)]
    return solution, whitener, curves, basis


@dataclass(frozen=True, eq=False)
class Belief:
    """What a place says about the robot."""

    healthy: float
    """Probability that it is healthy, if half of all robots are and all faults are equally
    frequent."""
    faults: np.ndarray
    """Probability of each fault, shape (faults,)."""
    severity: np.ndarray
    """Most probable severity of each fault, over the largest one in the data, shape (faults,)."""
    interval: np.ndarray
    """95 % interval of it, which allows for `SCALE`, shape (faults, 2)."""
    gain: float
    """Two times the log-likelihood ratio of the best fault and the healthy robot."""
    explained: float
    """By how much the squared distance from the healthy mean exceeds that from the best fault."""


def believe(classes: Classes, y: np.ndarray, variance: float) -> Belief:
    """Compute probabilities of faults and severities at one place.

    Args:
        classes: The model.
        y: The place, shape (dimensions,).
        variance: Variance of the place in healthy cycles.

    Returns:
        The probabilities. Severities are equally probable within `GRID` before there are data.
    """
    ratio = classes.log_ratio(y[None], variance)[0]
    best = classes.means[np.unravel_index(np.argmax(ratio), ratio.shape)]
    top = max(float(ratio.max()), 0.0)
    weight = np.exp(ratio - top)
    evidence = weight.mean(axis=1)
    healthy = float(np.exp(-top))
    total = 0.5 * healthy + 0.5 * evidence.mean()
    return Belief(
        healthy=0.5 * healthy / total,
        faults=0.5 * evidence / len(evidence) / total,
        severity=GRID[np.argmax(ratio, axis=1)],
        interval=_interval(weight),
        gain=2 * float(ratio.max()),
        explained=float((y**2).sum() - ((y - best) ** 2).sum()),
    )


def _interval(weight: np.ndarray) -> np.ndarray:
    """95 % interval of the severity of each fault, from the weights of `GRID`."""
    beyond = np.exp(4 * SCALE)
    severity = np.geomspace(GRID[0] / beyond, GRID[-1] * beyond, 400)
    below = ndtr(np.log(severity[:, None] / GRID) / SCALE)
    cumulated = weight @ below.T / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    return np.stack([[np.interp(q, one, severity) for q in (0.025, 0.975)] for one in cumulated])


def gains(classes: Classes, y: np.ndarray, variance: float, chunk: int = 512) -> np.ndarray:
    """Compute `Belief.gain` of many places.

    Args:
        classes: The model.
        y: Places, shape (places, dimensions).
        variance: Their variance in healthy cycles.
        chunk: Number of places that are computed at once; it bounds the memory.

    Returns:
        Shape (places,).
    """
    parts: Sequence[np.ndarray] = [
        2 * classes.log_ratio(y[k : k + chunk], variance).max(axis=(1, 2))
        for k in range(0, len(y), chunk)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)
