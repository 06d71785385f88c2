"""Which axes are worn, and how far: isolators that may also answer 'none'.

An isolator compares features of recent cycles with the spread that they have on the healthy robot.
It is told in which direction the features move when an axis wears, so that it can tell wear from
what else moves them (temperature, payload): the healthy spread shows how those do.

    isolator = ChangeIsolator(directions=directions).fit(healthy_runs)
    answer = isolator.isolate(features)  # shape (cycles, features), the last cycle is now
    answer.worn, answer.severity, answer.interval, answer.probability
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from sklearn.base import BaseEstimator
from sklearn.covariance import ledoit_wolf

Floats = NDArray[np.float64]

_SMALLEST = 1e-9  # standard error of a severity; healthy cycles without any spread have none
_ROUNDS = 4  # of covariance and severity, which depend on each other; the third changes nothing


@dataclass(frozen=True, eq=False)
class Answer:
    """What an isolator says of a robot now. Arrays have shape (n_axes,)."""

    worn: NDArray[np.bool_]
    """Axes that are named; all False is 'none'."""
    severity: Floats
    """Estimated severity, in the unit of the directions; nan where it cannot be observed."""
    interval: Floats
    """95 % interval of the severity, shape (n_axes, 2)."""
    probability: Floats
    """Probability that the axis is worn."""
    z: Floats
    """Mean severity of the last cycles over its standard error; worn if above the limit."""

    @property
    def axis(self) -> int:
        """The axis named with the largest z, from 0; -1 for none."""
        return int(np.argmax(np.where(self.worn, self.z, -np.inf))) if self.worn.any() else -1


class ChangeIsolator(BaseEstimator):
    """Severity of each axis by generalised least squares against the healthy spread.

        x - mean = sum_a severity_a direction_a + healthy deviation,  estimate = K (x - mean)
        K = (D' C^-1 D)^-1 D' C^-1

    C is the covariance of healthy features. Where they move together for another reason than wear,
    C^-1 gives that motion no weight. With a diagonal covariance and one feature an axis this is
    the axis' own change over its healthy spread.

    Directions are never known exactly (the mix of Coulomb and static wear, the temperature at which
    they hold). `spread` says how they may differ; what this adds to the covariance grows with the
    severity, so the estimate is iterated.

    A measured condition (temperature) may act in a curved way. With `condition` the features that
    wear does not move predict it more precisely than its sensor tells it; its square, cube and
    fourth power join the features, with no direction. Where it leaves the range of the healthy
    cycles, standard errors grow with the leverage of those powers.

    Cycles are judged together: z is that of the mean over the last `window` cycles, severity is the
    end of a straight line through `window // 2` of them, so that growing wear is not
    underestimated. Their standard errors come from the healthy cycles, autocorrelation included.

    Source: Kay (1993), Fundamentals of statistical signal processing I, ch. 6 (best linear unbiased
    estimator); Ledoit and Wolf (2004) for the shrunk covariance. Ours: the use for wear, `spread`.

    Attributes:
        mean_: Healthy mean of the features, shape (features,).
        covariance_: Their covariance, shape (features, features).
        severity_error_: Standard error of the severity of a healthy axis, mean of the last `window`
            cycles, shape (n_axes,); inf where no feature moves with the axis.
        limit_: z above which an axis is named.
    """

    def __init__(
        self,
        *,
        directions: ArrayLike,
        spread: ArrayLike | None = None,
        covariance: str = "shrunk",
        condition: int | None = None,
        window: int = 12,
        false_alarm: float = 0.002,
        prior: float = 0.01,
        largest: float = 0.2,
    ) -> None:
        """Set the isolator up.

        Args:
            directions: Change of the features with the severity of each axis. Shape (n_axes,
                features).
            spread: Standard deviations of the directions, as vectors; shape (n_axes, vectors,
                features). None: directions are exact.
            covariance: 'diagonal': each feature on its own; 'shrunk': all together, shrunk after
                Ledoit and Wolf.
            condition: Which feature is a measured condition that acts in a curved way; None: none.
            window: Cycles that are judged together, at least 2.
            false_alarm: Probability that a healthy robot is called worn in one answer.
            prior: Probability that an axis is worn, before the data are seen.
            largest: Severity to be expected on a worn axis: standard deviation of the half-normal
                prior.
        """
        self.directions = directions
        self.spread = spread
        self.covariance = covariance
        self.condition = condition
        self.window = window
        self.false_alarm = false_alarm
        self.prior = prior
        self.largest = largest

    def fit(self, runs: Sequence[ArrayLike], y: None = None) -> ChangeIsolator:
        """Learn the healthy spread.

        Args:
            runs: Features of healthy cycles, one array for each uninterrupted recording. Shapes
                (cycles, features).
            y: Not used.

        Returns:
            The isolator.

        Raises:
            ValueError: Shapes do not agree, values are not finite, or there are too few cycles.
        """
        directions = np.atleast_2d(np.asarray(self.directions, float))
        healthy = [np.asarray(run, float) for run in runs]
        if not healthy or any(r.ndim != 2 or r.shape[1] != directions.shape[1] for r in healthy):
            raise ValueError(f"runs must have shape (cycles, {directions.shape[1]}) each")
        if self.covariance not in ("diagonal", "shrunk"):
            raise ValueError(f"covariance must be 'diagonal' or 'shrunk', got {self.covariance!r}")
        if self.window < 2:
            raise ValueError(f"window must be at least 2, got {self.window}")
        cycles = np.vstack(healthy)
        if not np.isfinite(cycles).all() or not np.isfinite(directions).all():
            raise ValueError("features and directions must be finite")
        free = len(cycles) - (cycles.shape[1] if self.covariance == "shrunk" else 1)
        if free < 10 or min(len(run) for run in healthy) < self.window:
            raise ValueError(
                f"{len(cycles)} healthy cycles of {cycles.shape[1]} features are too few, or one "
                f"run is shorter than the window of {self.window}"
            )
        self._predictor = None
        if self.condition is not None:
            self._predictor = _Condition(cycles, directions, self.condition)
            healthy = [self._with_powers(run) for run in healthy]
            cycles = np.vstack(healthy)
        self.mean_ = cycles.mean(axis=0)
        self.scale_ = cycles.std(axis=0)
        self.scale_[self.scale_ == 0] = 1.0
        centred = (cycles - self.mean_) / self.scale_
        if self.covariance == "diagonal":
            unit = np.diag(np.maximum(centred.var(axis=0), 1e-12))
        else:
            unit = ledoit_wolf(centred, assume_centered=True)[0] + 1e-9 * np.eye(centred.shape[1])
        self._unit = unit * len(cycles) / free
        self.covariance_ = self._unit * np.outer(self.scale_, self.scale_)
        self._directions = self._scaled(directions)
        # what moves by less than rounding cannot be observed
        self._seen = np.sqrt((self._directions**2).sum(axis=1)) > 1e-9
        self._spread = None if self.spread is None else self._scaled(np.asarray(self.spread, float))
        self._runs = [(run - self.mean_) / self.scale_ for run in healthy]
        self._free = free
        self._kernels: dict[tuple[float, ...], tuple[Floats, Floats]] = {}
        _, error = self._kernel(np.zeros(len(directions)))
        self.severity_error_ = error[:, 0]
        # one-sided, shared out among the axes; few independent healthy windows widen the tail
        windows = max(len(cycles) / self.window, 4.0)
        share = self.false_alarm / max(int(self._seen.sum()), 1)
        self.limit_ = float(stats.t.isf(share, windows - 1))
        return self

    def smallest(self, power: float = 0.95) -> Floats:
        """Smallest wear, mean over the window, that would be found: told from healthy cycles alone.

        Args:
            power: Probability of finding it that is asked for.

        Returns:
            Severity, shape (n_axes,); inf for an axis that cannot be observed.
        """
        return (self.limit_ + stats.norm.isf(1 - power)) * self.severity_error_

    def estimate(self, x: ArrayLike, severity: ArrayLike | None = None) -> Floats:
        """Severity by each cycle alone.

        Args:
            x: Features, shape (cycles, features).
            severity: Severity for which directions are uncertain, shape (n_axes,); default none.

        Returns:
            Shape (cycles, n_axes); nan where an axis cannot be observed.
        """
        deviation = (self._with_powers(np.asarray(x, float)) - self.mean_) / self.scale_
        at = np.zeros(len(self._directions)) if severity is None else np.asarray(severity, float)
        return deviation @ self._kernel(at)[0].T

    def isolate(self, x: ArrayLike) -> Answer:
        """Say which axes are worn now.

        Args:
            x: Features of the cycles up to now, at least 2. Shape (cycles, features).

        Returns:
            The answer. Features that are not finite count as 'no evidence'.

        Raises:
            ValueError: x has another shape, or fewer than 2 cycles.
        """
        x = np.asarray(x, float)
        features = np.atleast_2d(np.asarray(self.directions)).shape[1]
        if x.ndim != 2 or x.shape[1] != features or len(x) < 2:
            raise ValueError(f"x must have shape (cycles > 1, {features}), got {x.shape}")
        recent = x[-self.window :]
        recent = self._with_powers(np.where(np.isfinite(recent), recent, self.mean_[:features]))
        outside = 1.0 if self._predictor is None else self._predictor.outside(recent)
        short = recent[-max(self.window // 2, 2) :]
        severity = np.zeros(len(self._directions))
        for _ in range(_ROUNDS):
            kernel, error = self._kernel(severity)
            error = error * outside
            by_cycle = (recent - self.mean_) / self.scale_ @ kernel.T
            mean = by_cycle.mean(axis=0)
            now = _line_end(by_cycle[-len(short) :])
            severity = np.where(np.isfinite(mean), np.maximum(mean, 0.0), 0.0)
        z = np.where(self._seen, mean / error[:, 0], 0.0)
        half = stats.norm.isf(0.025) * error[:, 1]
        interval = np.stack([np.maximum(now - half, 0.0), np.maximum(now + half, 0.0)], axis=1)
        return Answer(
            worn=self._seen & (z > self.limit_),
            severity=np.where(self._seen, np.maximum(now, 0.0), np.nan),
            interval=np.where(self._seen[:, None], interval, np.nan),
            probability=np.where(self._seen, self._probability(mean, error[:, 0]), self.prior),
            z=z,
        )

    def predict(self, series: Sequence[ArrayLike]) -> NDArray[np.bool_]:
        """Axes named in each of several series, shape (series, n_axes); see `isolate`."""
        return np.array([self.isolate(x).worn for x in series])

    def predict_proba(self, series: Sequence[ArrayLike]) -> Floats:
        """Probability of wear in each of several series, shape (series, n_axes)."""
        return np.array([self.isolate(x).probability for x in series])

    def _with_powers(self, x: Floats) -> Floats:
        return x if self._predictor is None else np.hstack([x, self._predictor.powers(x)])

    def _scaled(self, vectors: Floats) -> Floats:
        """Vectors in feature space, in units of the healthy spread; zero along the powers."""
        full = np.zeros((*vectors.shape[:-1], len(self.scale_)))
        full[..., : vectors.shape[-1]] = vectors
        return full / self.scale_

    def _kernel(self, severity: Floats) -> tuple[Floats, Floats]:
        """K, shape (n_axes, features), and the standard errors of mean and end, (n_axes, 2)."""
        rounded = np.round(severity / self.largest, 2) * self.largest
        key = tuple(rounded.tolist())
        if key in self._kernels:
            return self._kernels[key]
        covariance = self._unit
        model_error = np.zeros_like(covariance)
        if self._spread is not None:
            vectors = (rounded[:, None, None] * self._spread).reshape(-1, covariance.shape[1])
            model_error = vectors.T @ vectors
            covariance = covariance + model_error
        directions = self._directions[self._seen]
        weighted = np.linalg.solve(covariance, directions.T)
        kernel = np.full(self._directions.shape, np.nan)
        kernel[self._seen] = np.linalg.solve(directions @ weighted, weighted.T)
        error = np.full((len(kernel), 2), np.inf)
        seen = kernel[self._seen]
        systematic = np.einsum("af,fg,ag->a", seen, model_error, seen)
        ends, means = [], []
        for run in self._runs:
            by_cycle = run @ seen.T
            means.append(_moving(by_cycle, np.full(self.window, 1 / self.window)))
            ends.append(_moving(by_cycle, _end_weights(max(self.window // 2, 2))))
        inflate = (sum(len(run) for run in self._runs)) / self._free
        for column, parts in enumerate((means, ends)):
            variance = np.mean(np.vstack(parts) ** 2, axis=0) * inflate
            error[self._seen, column] = np.sqrt(np.maximum(variance + systematic, _SMALLEST**2))
        self._kernels[key] = kernel, error
        return kernel, error

    def _probability(self, mean: Floats, error: Floats) -> Floats:
        """Posterior of 'worn' against 'healthy': half-normal prior of severity, Gaussian error."""
        with np.errstate(invalid="ignore"):
            wide = np.hypot(error, self.largest)
            centre = mean * (self.largest / wide) ** 2
            width = error * self.largest / wide
            log_ratio = (
                stats.norm.logpdf(mean, scale=wide)
                - stats.norm.logpdf(mean, scale=error)
                + stats.norm.logcdf(centre / width)
                + np.log(2.0)
            )
            odds = np.log(self.prior / (1 - self.prior)) + log_ratio
            return 1 / (1 + np.exp(-np.clip(odds, -700, 700)))


class _Condition:
    """A measured condition, predicted from the features that wear does not move."""

    _DEGREE = 4

    def __init__(self, healthy: Floats, directions: Floats, column: int) -> None:
        self.mean, self.scale = healthy.mean(axis=0), healthy.std(axis=0)
        self.scale[self.scale == 0] = 1.0
        self.features = healthy.shape[1]
        unit = (healthy - self.mean) / self.scale
        n, features = unit.shape
        towards = directions / self.scale
        towards = towards[np.sqrt((towards**2).sum(axis=1)) > 1e-9]
        covariance = unit.T @ unit / n + 1e-9 * np.eye(features)
        weighted = np.linalg.solve(covariance, towards.T)
        kernel = np.linalg.solve(towards @ weighted, weighted.T)
        without_wear = np.eye(features) - kernel.T @ towards
        others = np.arange(features) != column
        inputs = unit @ without_wear[:, others]
        ridge = 1e-3 * n * np.eye(features - 1)
        slope = np.linalg.solve(inputs.T @ inputs + ridge, inputs.T @ unit[:, column])
        self.weights = without_wear[:, others] @ slope
        powers = self._design(self.value(healthy))
        self.information = np.linalg.inv(powers.T @ powers / n)
        self.largest = float(self._leverage(powers).max())

    def value(self, x: Floats) -> Floats:
        """Predicted condition of each cycle, in units of its spread, shape (cycles,)."""
        return (x[:, : self.features] - self.mean) / self.scale @ self.weights

    def powers(self, x: Floats) -> Floats:
        """Square and higher powers, shape (cycles, degree - 1)."""
        return self._design(self.value(x))[:, 2:]

    def outside(self, x: Floats) -> float:
        """By how much errors grow, since the condition is outside the healthy range; 1 within."""
        mean = float(self._leverage(self._design(self.value(x))).mean())
        return max(1.0, np.sqrt(mean / self.largest))

    def _design(self, value: Floats) -> Floats:
        return np.stack([value**k for k in range(self._DEGREE + 1)], axis=1)

    def _leverage(self, powers: Floats) -> Floats:
        return np.einsum("ck,kl,cl->c", powers, self.information, powers)


def _end_weights(length: int) -> Floats:
    """Weights whose sum with `length` values is the end of a straight line through them."""
    t = np.arange(length) - (length - 1) / 2
    return 1 / length + t * t[-1] / (t @ t)


def _line_end(x: Floats) -> Floats:
    return _end_weights(len(x)) @ x


def _moving(x: Floats, weights: Floats) -> Floats:
    """Weighted sums over all windows of a series, shape (cycles - window + 1, axes)."""
    windows = np.lib.stride_tricks.sliding_window_view(x, len(weights), axis=0)
    return windows @ weights
