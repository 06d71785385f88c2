"""Severity of each axis by generalised least squares, and its standard errors.

The healthy spread of the features weighs them. The standard errors are those of healthy cycles that
are left out in turn. `ChangeIsolator` decides from both which axes are worn.

    estimator = SeverityEstimator(runs, directions, covariance="shrunk", window=12)
    mean, end = estimator.summaries(features)
    severity, kernel = estimator.solve(mean)
    estimator.errors(severity, len(features))  # of the severity by mean and by end
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.covariance import ledoit_wolf

from .operating_condition import ROUNDING, least_squares_kernel

Floats = NDArray[np.float64]

_SMALLEST = 1e-9  # standard error of a severity; healthy cycles without any spread have none
_PARTS = 10  # of the healthy cycles that are left out in turn
_ROUNDS = 6  # of covariance and severity, which depend on each other; more change next to nothing


class SeverityEstimator:
    """Linear estimate of severities from features, K (x - mean); see `ChangeIsolator`.

    Attributes:
        mean: Healthy mean of the features, shape (features,).
        scale: Their healthy standard deviation, shape (features,); 1 for a constant feature.
        covariance: Their healthy covariance, shape (features, features).
        observable: Axes whose severity can be observed, shape (n_axes,).
        healthy_error: Standard error of the mean severity of a healthy axis over a window, shape
            (n_axes,); inf if it cannot be observed.
    """

    def __init__(
        self,
        runs: list[Floats],
        directions: Floats,
        spread: Floats | None = None,
        *,
        covariance: str,
        window: int,
    ) -> None:
        """Learn the healthy spread.

        Args:
            runs: Features of healthy cycles of each run, shapes (cycles, features).
            directions: Change of the first n features per unit of the severity of each axis, shape
                (n_axes, n). Wear does not move the other features.
            spread: Standard deviations of the directions, as vectors; shape (n_axes, vectors, n).
                None: directions are exact.
            covariance: 'diagonal' or 'shrunk', as for `ChangeIsolator`.
            window: Number of cycles that are judged together.
        """
        self._kind, self._window, self._n_axes = covariance, window, len(directions)
        cycles = np.vstack(runs)
        self.mean = cycles.mean(axis=0)
        self.scale = cycles.std(axis=0)
        still = self.scale <= ROUNDING * np.abs(cycles).max(axis=0)
        self.scale[still] = 1.0
        self._still = still if not still.all() else np.zeros_like(still)
        # of features in units of their healthy spread
        scaled = self._covariance((cycles - self.mean) / self.scale)
        self._scaled_covariance = scaled
        self.covariance = scaled * np.outer(self.scale, self.scale)
        self._directions = self._scaled(directions)
        # what moves by less than rounding cannot be observed
        self._directions[np.sqrt((self._directions**2).sum(axis=1)) < 1e-9] = 0.0
        self._spread = self._scaled(
            np.zeros((len(directions), 1, directions.shape[1])) if spread is None else spread
        )
        told = (least_squares_kernel(self._directions, scaled) * self._directions).sum(axis=1)
        self.observable = told > 1 - 1e-6
        self._parts = self._left_out([(run - self.mean) / self.scale for run in runs])
        self._moments: dict[int, list[tuple[int, Floats]]] = {}
        self._healthy_errors: dict[int, Floats] = {}
        self._healthy_kernel: Floats | None = None
        healthy = np.zeros(len(directions))
        self._healthy_kernel = self.kernel(healthy)
        self.healthy_error: Floats = self.errors(healthy, window)[0]

    def deviation(self, x: Floats) -> Floats:
        """Compute how far features are from their healthy mean.

        Args:
            x: Features, shape (cycles, features).

        Returns:
            Deviation in units of the healthy spread, shape (cycles, features).
        """
        return (x - self.mean) / self.scale

    def summaries(self, x: Floats) -> Floats:
        """Compute the mean deviation of cycles, and the deviation at the last of them.

        Args:
            x: Features, shape (cycles, features).

        Returns:
            The mean, and the end of a straight line through half a window, in units of the healthy
            spread. Shape (2, features).
        """
        return _weights(len(x), self._window) @ self.deviation(x)

    def kernel(self, severity: Floats, covariance: Floats | None = None) -> Floats:
        """Compute K, which turns deviations into severities.

        Args:
            severity: Severity at which the uncertainty of the directions is evaluated, shape
                (n_axes,).
            covariance: Healthy covariance in units of the healthy spread. Default: that of all
                healthy cycles.

        Returns:
            Shape (n_axes, features); nan if an axis cannot be observed.
        """
        if covariance is None and not severity.any() and self._healthy_kernel is not None:
            return self._healthy_kernel
        vectors = (severity[:, None, None] * self._spread).reshape(-1, len(self.scale))
        healthy = self._scaled_covariance if covariance is None else covariance
        kernel = least_squares_kernel(self._directions, healthy + vectors.T @ vectors)
        kernel[~self.observable] = np.nan
        return kernel

    def solve(self, mean: Floats) -> tuple[Floats, Floats]:
        """Estimate severities at which the uncertainty of the directions is evaluated.

        This uncertainty grows with the severity, so that both are found in turn.

        Args:
            mean: Mean deviation, from `summaries`. Shape (features,).

        Returns:
            Severity, shape (n_axes,), 0 where it may be chance; and the kernel of the last round,
            shape (n_axes, features).
        """
        severity = np.zeros(self._n_axes)
        for _ in range(_ROUNDS):
            kernel = self.kernel(severity)
            severity = np.maximum(np.nan_to_num(kernel @ mean), 0.0)
            # what may be chance says nothing of a direction; most healthy cycles then share K
            severity[severity < 2 * self.healthy_error] = 0.0
        return severity, kernel

    def misfit(self, kernel: Floats) -> Floats:
        """Compute the variance in an axis' estimate that the direction of another causes.

        Args:
            kernel: From `kernel`, shape (n_axes, features).

        Returns:
            Variance at severity 1 of the other axis, shape (n_axes, n_axes).
        """
        return (np.einsum("af,bvf->abv", kernel, self._spread) ** 2).sum(axis=2)

    def errors(self, severity: Floats, length: int) -> Floats:
        """Compute standard errors from healthy cycles, without what uncertain directions add.

        Args:
            severity: Severity at which the estimate weighs the features, shape (n_axes,).
            length: Number of cycles that are judged together.

        Returns:
            Standard errors of the severity by both `summaries`, shape (2, n_axes); inf if an axis
            cannot be observed.
        """
        if not severity.any() and length in self._healthy_errors:
            return self._healthy_errors[length]
        if length not in self._moments:
            weights = _weights(length, self._window)
            self._moments[length] = [_moments(block, weights) for block, _ in self._parts]
        variance = np.zeros((2, len(severity)))
        for (_, covariance), (_, moments) in zip(self._parts, self._moments[length], strict=True):
            kernel = self.kernel(severity, covariance)
            variance += np.einsum("af,wfg,ag->wa", kernel, moments, kernel)
        variance /= sum(count for count, _ in self._moments[length])
        error = np.where(self.observable, np.sqrt(np.maximum(variance, _SMALLEST**2)), np.inf)
        if not severity.any():
            self._healthy_errors[length] = error
        return error

    def _scaled(self, vectors: Floats) -> Floats:
        """Vectors in feature space, in units of the healthy spread; zero where none is given."""
        full = np.zeros((*vectors.shape[:-1], len(self.scale)))
        full[..., : vectors.shape[-1]] = vectors
        full[..., self._still] = 0.0  # how much a feature varies that never did is not known
        return full / self.scale

    def _covariance(self, features: Floats) -> Floats:
        """Covariance of features in units of their healthy spread."""
        if self._kind == "diagonal":
            return np.diag(np.maximum(features.var(axis=0), 1e-12))
        return ledoit_wolf(features)[0] + 1e-9 * np.eye(features.shape[1])

    def _left_out(self, runs: list[Floats]) -> list[tuple[Floats, Floats]]:
        """For each part of the healthy cycles: the part, centred, and the rest's covariance."""
        n = sum(map(len, runs))
        blocks = []
        for run in runs:
            count = min(len(run) // self._window, max(round(_PARTS * len(run) / n), 1))
            blocks += np.array_split(run, count)
        parts = []
        for index, block in enumerate(blocks):
            others = np.vstack(blocks[:index] + blocks[index + 1 :])
            parts.append((block - others.mean(axis=0), self._covariance(others)))
        return parts


def _weights(length: int, window: int) -> Floats:
    """Weights of cycles: their mean, and the end of a line through `window // 2`; (2, length)."""
    line = min(length, max(window // 2, 2))
    t = np.arange(line) - (line - 1) / 2
    weights = np.zeros((2, length))
    weights[0] = 1 / length
    weights[1, length - line :] = 1 / line + t * t[-1] / (t @ t)
    return weights


def _moments(x: Floats, weights: Floats) -> tuple[int, Floats]:
    """Windows in a series, and sums of products of their weighted sums, (weights, f, f)."""
    windows = np.lib.stride_tricks.sliding_window_view(x, weights.shape[1], axis=0)
    sums = np.einsum("cfk,wk->wcf", windows, weights)
    return len(windows), sums.transpose(0, 2, 1) @ sums
