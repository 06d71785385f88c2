"""Which axes are worn, and by how much: isolators that may also answer 'none'.

An isolator compares features of recent cycles with the spread that they have on the healthy robot.
The user states in which direction the features move when an axis wears. The isolator can then
distinguish wear from other causes such as temperature and payload, because the healthy spread shows
how those move the features.

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
from sklearn.utils.validation import check_is_fitted

from .operating_condition import Condition
from .severity_estimator import SeverityEstimator

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer:
    """Answer of an isolator about the present state of a robot. Arrays have shape (n_axes,)."""

    worn: NDArray[np.bool_]
    """Axes that are called worn; if all are False, the answer is 'none'."""
    severity: Floats
    """Present severity, at least 0, in the unit of the directions; nan if it cannot be observed."""
    interval: Floats
    """95 % interval of the severity, shape (n_axes, 2)."""
    probability: Floats
    """Probability that the axis is worn."""
    z: Floats
    """Mean severity of the last cycles over its standard error. The axis is worn if it exceeds the
    limit."""

    @property
    def axis(self) -> int:
        """The worn axis with the largest z, from 0; -1 for none."""
        return int(np.argmax(np.where(self.worn, self.z, -np.inf))) if self.worn.any() else -1


class ChangeIsolator(BaseEstimator):
    """Severity of each axis by generalised least squares against the healthy spread.

        x - mean = sum_a severity_a direction_a + healthy deviation,  estimate = K (x - mean)
        K = (D' C^-1 D)^-1 D' C^-1

    C is the covariance of healthy features. If features move together for another reason than wear,
    C^-1 gives that motion no weight. With a diagonal covariance and one feature per axis, the
    estimate is the change of each axis over its own healthy spread.

    Directions are never known exactly. Examples are the shares of Coulomb and static wear, and the
    temperature for which the directions hold. `spread` states how they may differ. The uncertainty
    that this adds to the covariance grows with the severity, so that the estimate is iterated. The
    intervals include it. An axis is named only if a healthy axis would be unlikely to look like
    this. Its own direction plays no part in that test.

    A measured condition such as temperature may act nonlinearly. With `condition`, the features
    that wear does not move predict the condition more precisely than its sensor measures it. Its
    square, cube and fourth power are added to the features, without a direction. If the condition
    leaves the range of 95 % of the healthy cycles, standard errors grow with the leverage of these
    powers, so that the answer soon becomes 'none'.

    Cycles are judged together. z is computed from the mean over the last `window` cycles. The
    severity is the end of a straight line through `window // 2` of them, so that growing wear is
    not underestimated. The standard errors are those of healthy cycles that are left out in turn.
    They therefore include autocorrelation, and the limited precision of mean and covariance. They
    are right if the healthy cycles show everything that moves the features. If recordings are short
    compared with a slow change of temperature, there are more false alarms: several times as many
    for 5 windows.

    Axes whose directions are not independent cannot be distinguished. They are not named, and their
    severity is nan. A feature that is constant while others vary is not used.

    Source: Kay (1993), Fundamentals of statistical signal processing I, ch. 6 (best linear unbiased
    estimator); Ledoit and Wolf (2004) for the shrunk covariance. Ours: the use for wear, `spread`.

    Attributes:
        mean_: Healthy mean of the features, shape (features,).
        covariance_: Their covariance, shape (features, features).
        severity_error_: Standard error of the mean severity of a healthy axis over the last
            `window` cycles, shape (n_axes,); inf if it cannot be observed.
        limit_: An axis is named if z exceeds this limit.
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
        """Store the settings.

        Args:
            directions: Change of the features per unit of the severity of each axis. Shape (n_axes,
                features).
            spread: Standard deviations of the directions, as vectors; shape (n_axes, vectors,
                features). None: directions are exact.
            covariance: 'diagonal': each feature is treated alone; 'shrunk': all features together,
                shrunk as proposed by Ledoit and Wolf.
            condition: Index of the feature that is a measured condition and acts nonlinearly; None:
                none.
            window: Number of cycles that are judged together, at least 2.
            false_alarm: Probability that a healthy robot is called worn in one answer.
            prior: Probability that an axis is worn, before the data are seen.
            largest: Typical severity of a worn axis: standard deviation of the half-normal prior.
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
            ValueError: The shapes do not agree, values are not finite, or there are too few cycles.
        """
        directions = np.atleast_2d(np.asarray(self.directions, float))
        healthy = [np.asarray(run, float) for run in runs]
        if not healthy or any(r.ndim != 2 or r.shape[1] != directions.shape[1] for r in healthy):
            raise ValueError(f"runs must have shape (cycles, {directions.shape[1]}) each")
        if self.covariance not in ("diagonal", "shrunk"):
            raise ValueError(f"covariance must be 'diagonal' or 'shrunk', got {self.covariance!r}")
        if self.spread is not None:
            shape = np.shape(self.spread)
            if len(shape) != 3 or shape[::2] != directions.shape:
                raise ValueError(
                    f"spread must have shape ({len(directions)}, vectors, "
                    f"{directions.shape[1]}), got {shape}"
                )
        for name in ("false_alarm", "prior"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} must be within 0 and 1, got {getattr(self, name)}")
        if self.window < 2:
            raise ValueError(f"window must be at least 2, got {self.window}")
        cycles = np.vstack(healthy)
        if not np.isfinite(cycles).all() or not np.isfinite(directions).all():
            raise ValueError("features and directions must be finite")
        least = (cycles.shape[1] if self.covariance == "shrunk" else 1) + 10
        if len(cycles) < max(least, 2 * self.window) or min(map(len, healthy)) < self.window:
            raise ValueError(
                f"{len(cycles)} healthy cycles of {cycles.shape[1]} features are too few, or one "
                f"run is shorter than the window of {self.window}"
            )
        self._predictor = None
        if self.condition is not None:
            if not 0 <= self.condition < cycles.shape[1]:
                raise ValueError(f"condition must be a feature's index, got {self.condition}")
            self._predictor = Condition(cycles, directions, self.condition)
            healthy = [self._with_powers(run) for run in healthy]
        self._estimator = SeverityEstimator(
            healthy,
            directions,
            None if self.spread is None else np.asarray(self.spread, float),
            covariance=self.covariance,
            window=self.window,
        )
        self.mean_ = self._estimator.mean
        self.scale_ = self._estimator.scale
        self.covariance_ = self._estimator.covariance
        self.severity_error_ = self._estimator.healthy_error
        self._windows = max(len(cycles) / self.window, 4.0)
        # one-sided, shared out among the axes; few independent healthy windows widen the tail
        share = self.false_alarm / max(int(self._estimator.observable.sum()), 1)
        self.limit_ = float(stats.t.isf(share, self._windows - 1))
        return self

    def smallest(self, power: float = 0.95) -> Floats:
        """Predict the smallest wear that would be found, from healthy cycles alone.

        Args:
            power: Required probability of finding it.

        Returns:
            Mean severity over the window, shape (n_axes,); inf for an axis that cannot be observed
            or whose direction is too uncertain. If directions are uncertain by 30 %, the true power
            is .86 instead of .9.
        """
        check_is_fitted(self)
        margin, n_axes = stats.norm.isf(1 - power), len(self.severity_error_)
        found = np.full(n_axes, np.inf)
        for axis in np.flatnonzero(self._estimator.observable):
            severity = np.zeros(n_axes)
            for _ in range(100):  # both errors depend on the severity
                kernel = self._estimator.kernel(severity)
                error = self.standard_error(severity)[axis]
                own = severity[axis] ** 2 * self._estimator.misfit(kernel)[axis, axis]
                before = severity[axis]
                severity[axis] = self.limit_ * error + margin * np.sqrt(error**2 + own)
                if abs(severity[axis] - before) <= 1e-6 * before:
                    found[axis] = severity[axis]
                    break
        return found

    def standard_error(self, severity: ArrayLike) -> Floats:
        """Compute the standard error of the mean severity over the last `window` cycles.

        It includes the spread of healthy cycles, but not what uncertain directions add.

        Args:
            severity: Severity at which the estimate weighs the features, shape (n_axes,).

        Returns:
            Standard error, shape (n_axes,); inf if an axis cannot be observed.
        """
        error: Floats = self._estimator.errors(np.asarray(severity, float), self.window)[0]
        return error

    def estimate(self, x: ArrayLike, severity: ArrayLike | None = None) -> Floats:
        """Estimate the severity from each cycle alone.

        Args:
            x: Features, shape (cycles, features).
            severity: Severity at which the uncertainty of the directions is evaluated, shape
                (n_axes,). Default: 0.

        Returns:
            Severity, shape (cycles, n_axes); nan if an axis cannot be observed.
        """
        check_is_fitted(self)
        deviation = self._estimator.deviation(self._with_powers(np.asarray(x, float)))
        healthy = np.zeros(len(self.severity_error_))
        at = healthy if severity is None else np.asarray(severity, float)
        return deviation @ self._estimator.kernel(at).T

    def isolate(self, x: ArrayLike) -> Answer:
        """Determine which axes are worn now.

        Args:
            x: Features of the cycles up to now, at least 2. Shape (cycles, features).

        Returns:
            The answer. Cycles with features that are not finite are ignored. If fewer than 2 cycles
            of the window remain, the answer is 'none' and severities are nan.

        Raises:
            ValueError: x has another shape, or fewer than 2 cycles.
        """
        check_is_fitted(self)
        x = np.asarray(x, float)
        features = np.atleast_2d(np.asarray(self.directions)).shape[1]
        if x.ndim != 2 or x.shape[1] != features or len(x) < 2:
            raise ValueError(f"x must have shape (cycles > 1, {features}), got {x.shape}")
        recent = x[-self.window :]
        recent = self._with_powers(recent[np.isfinite(recent).all(axis=1)])
        n_axes, length = len(self.severity_error_), len(recent)
        if length < 2:
            nothing = np.full(n_axes, np.nan)
            return Answer(
                worn=np.zeros(n_axes, bool),
                severity=nothing,
                interval=np.stack([nothing, nothing], axis=1),
                probability=np.full(n_axes, self.prior),
                z=np.zeros(n_axes),
            )
        estimator, seen = self._estimator, self._estimator.observable
        mean, end = estimator.summaries(recent)
        severity, kernel = estimator.solve(mean)
        now = kernel @ end
        outside = 1.0 if self._predictor is None else self._predictor.outside(recent)
        errors = estimator.errors(severity, length) * outside
        misfit = np.nan_to_num(estimator.misfit(kernel))
        # squares of estimates are too large by their variance
        squared = np.maximum(severity**2 - errors[0] ** 2, 0.0)
        # whether an axis is worn is asked of a healthy one: its own direction adds no error
        others = (misfit - np.diag(np.diag(misfit))) @ squared
        healthy_error = np.sqrt(errors[0] ** 2 + others)
        half = stats.t.isf(0.025, self._windows - 1) * np.sqrt(
            errors[1] ** 2 + misfit @ np.maximum(np.nan_to_num(now), 0.0) ** 2
        )
        z = np.where(seen, kernel @ mean / healthy_error, 0.0)
        interval = np.stack([np.maximum(now - half, 0.0), np.maximum(now + half, 0.0)], axis=1)
        probability = self._probability(kernel @ mean, healthy_error)
        return Answer(
            worn=seen & (z > self.limit_),
            severity=np.maximum(now, 0.0),
            interval=np.where(seen[:, None], interval, np.nan),
            probability=np.where(seen, probability, self.prior),
            z=z,
        )

    def predict(self, series: Sequence[ArrayLike]) -> NDArray[np.bool_]:
        """Name the worn axes of each of several series.

        Args:
            series: Series as for `isolate`.

        Returns:
            Whether each axis is named. Shape (series, n_axes).
        """
        return np.array([self.isolate(x).worn for x in series])

    def predict_proba(self, series: Sequence[ArrayLike]) -> Floats:
        """Compute the probability of wear of each axis in each of several series.

        Args:
            series: Series as for `isolate`.

        Returns:
            The probabilities. Shape (series, n_axes).
        """
        return np.array([self.isolate(x).probability for x in series])

    def _with_powers(self, x: Floats) -> Floats:
        return x if self._predictor is None else np.hstack([x, self._predictor.powers(x)])

    def _probability(self, mean: Floats, error: Floats) -> Floats:
        """Posterior of 'worn' against 'healthy', with a half-normal prior and a Gaussian error."""
        with np.errstate(invalid="ignore"):
            wide = np.hypot(error, self.largest)
            centre = mean * (self.largest / wide) ** 2
            width = error * self.largest / wide
            log_ratio = (
                stats.norm.logpdf(mean, scale=wide)
                - stats.t.logpdf(mean, self._windows - 1, scale=error)
                + stats.norm.logcdf(centre / width)
                + np.log(2.0)
            )
            odds = np.log(self.prior / (1 - self.prior)) + log_ratio
            return 1 / (1 + np.exp(-np.clip(odds, -700, 700)))
