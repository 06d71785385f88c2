"""Which effect does a sequence of recordings show, since when, and how severe is it?

A recording is a row of features, such as the whitened torque of a program:

    x_i = mean + D b_i + A a + n_i

D b_i are differences from day to day of known form, such as the friction of one axis, A a are the
effects that a robot may have, and n_i is white noise. All are normal, so that everything follows
from the inner products A C^-1 (x_i - mean), with C = D D' + I, which are a few hundred numbers a
recording, whatever the number of features.

    detector = EffectPosterior(effects, days, false_alarms=0.001).fit(healthy)
    state = detector.judge(detector.transform(recordings))
    state.alarm, state.since, effects.causes[state.best].label, state.severities[state.best]
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp
from scipy.stats import truncnorm
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_array, check_is_fitted

from .causes import Cause, Days, Effects, Judgement

Floats = NDArray[np.float64]

_LARGEST = 3.5  # logarithm of the largest scale, and of the inverse of the smallest
_FASTER = 1.4  # ratio of the numbers of recordings that are tried, from one to the next
_SEQUENCES, _LENGTH = 400, 120  # simulated healthy sequences, and recordings in each
_CHUNK = 20  # sequences that are in memory at once
_TAIL = 0.1  # share of the largest statistics, to which the exponential tail is fitted
_EDGE = 1e-9  # of information, below which it counts as none


class EffectPosterior(BaseEstimator):
    """Bayesian detector and isolator of known effects in a sequence of recordings.

    The scales of the differences from day to day are found from the healthy recordings by their
    marginal likelihood, with a log-normal prior. The evidence of each cause is that of linear
    regression with a normal prior (Bishop 2006, 3.3). A sequence is tested by a generalised
    likelihood ratio: an effect may be there since any recording (Lai 1995, doi
    10.1111/j.2517-6161.1995.tb02052.x), and the mean over the recordings since then is compared
    with the healthy mean. The limit is that which sequences drawn from the healthy model exceed at
    the stated rate; what the healthy recordings leave open, their mean and the scales, is drawn
    anew for every sequence.

    Args:
        effects: Effects that may be there.
        days: Differences from day to day.
        false_alarms: Rate of false alarms, per recording.
        prior: Probability, before there are data, that the robot has an effect.
        random_state: Seed of the sequences from which the limit is found.

    Attributes:
        mean_: Healthy mean of the features, shape (features,).
        count_: Number of healthy recordings.
        log_scales_: Logarithm of the scale of each group of days, shape (groups,).
        scale_errors_: Its standard deviation, shape (groups,).
        noise_: Variance of the noise; about 1 if the features are whitened.
        projection_: C^-1 A', shape (features, columns).
        information_: A C^-1 A', shape (columns, columns).
        limit_: Limit of the statistic.
    """

    def __init__(
        self,
        effects: Effects,
        days: Days,
        *,
        false_alarms: float = 1e-3,
        prior: float = 0.5,
        random_state: int | None = 0,
    ) -> None:
        """State what may be there."""
        self.effects = effects
        self.days = days
        self.false_alarms = false_alarms
        self.prior = prior
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: object = None) -> EffectPosterior:
        """Learn the healthy mean, the scales and the limit.

        Args:
            X: Features of healthy recordings, shape (recordings, features), at least one.
            y: Not used; scikit-learn passes it.

        Returns:
            Itself.

        Raises:
            ValueError: The number of features differs from that of the columns, or a rate or a
                probability is impossible.
        """
        if not 0 < self.false_alarms < 1:
            raise ValueError(f"false_alarms must be above 0 and below 1, got {self.false_alarms}")
        if not 0 < self.prior < 1:
            raise ValueError(f"prior must be above 0 and below 1, got {self.prior}")
        x = check_array(X, dtype=float)
        if x.shape[1] != self.effects.columns.shape[1]:
            raise ValueError(
                f"X has {x.shape[1]} features, but the effects have {self.effects.columns.shape[1]}"
            )
        self.n_features_in_ = x.shape[1]
        self.count_, self.mean_ = len(x), x.mean(axis=0)
        self._learn_days(x - self.mean_)
        days, columns = self.days.columns, np.asarray(self.effects.columns, float)
        std = self._day_stds(self.log_scales_)
        inner = (days * std[:, None]) @ days.T * std + self.noise_ * np.eye(len(std))
        across = (days * std[:, None]) @ columns.T
        explained = days.T @ (std[:, None] * cho_solve(cho_factor(inner), across))
        self.projection_ = (columns.T - explained) / self.noise_
        self.information_ = columns @ self.projection_
        self.information_ = (self.information_ + self.information_.T) / 2
        self._log_prior = self._prior_odds()
        self._set_limit()
        return self

    def _day_stds(self, log_scales: Floats) -> Floats:
        """Standard deviation of each number, shape (numbers,)."""
        return np.asarray(self.days.stds * np.exp(log_scales)[self.days.groups])

    def _learn_days(self, apart: Floats) -> None:
        """Find the scales from the deviations of recordings from their mean."""
        days, spreads = self.days, np.log(self.days.spreads)
        freedom = len(apart) - 1
        self.log_scales_, self.scale_errors_ = np.zeros(len(spreads)), spreads.copy()
        self.noise_ = 1.0
        if not freedom or not len(days.stds):
            if freedom:
                self.noise_ = float(np.sum(apart**2)) / (freedom * apart.shape[1])
            return
        gram, right = days.columns @ days.columns.T, days.columns @ apart.T
        root = np.linalg.lstsq(gram, right, rcond=None)[0]
        free = freedom * max(apart.shape[1] - len(days.stds), 1)
        left = float(np.sum(apart**2) - np.sum(root * right))
        self.noise_ = max(left / free, 1e-12)

        def cost(log_scales: Floats) -> float:
            std = self._day_stds(log_scales)
            scaled = right * std[:, None]
            inner = gram * np.outer(std, std) / self.noise_ + np.eye(len(std))
            factor = cho_factor(inner, lower=True)
            half = freedom * np.log(np.diag(factor[0])).sum()
            explained = float(np.sum(scaled * cho_solve(factor, scaled))) / self.noise_**2
            return float(half - 0.5 * explained + 0.5 * np.sum((log_scales / spreads) ** 2))

        bounds = [(-_LARGEST, _LARGEST)] * len(spreads)
        best = minimize(cost, self.log_scales_, method="L-BFGS-B", bounds=bounds)
        self.log_scales_ = np.asarray(best.x)
        step = 0.05
        for k in range(len(spreads)):  # curvature, one scale at a time
            shift = step * np.eye(len(spreads))[k]
            more, less = cost(self.log_scales_ + shift), cost(self.log_scales_ - shift)
            curved = max((more + less - 2 * float(best.fun)) / step**2, 1 / spreads[k] ** 2)
            self.scale_errors_[k] = curved**-0.5

    def transform(self, X: ArrayLike) -> Floats:
        """Reduce recordings to the numbers that are judged.

        Args:
            X: Features, shape (recordings, features).

        Returns:
            Shape (recordings, columns).
        """
        check_is_fitted(self)
        return np.asarray((check_array(X, dtype=float) - self.mean_) @ self.projection_)

    def predict_proba(self, X: ArrayLike) -> Floats:
        """Compute the probability of each cause, from one recording alone.

        Args:
            X: Features, shape (recordings, features).

        Returns:
            Shape (recordings, 1 + causes): healthy, then each cause.
        """
        logs = self._log_odds(self.transform(X), 1)
        logs = np.concatenate([np.zeros((len(logs), 1)), logs], axis=1)
        return np.asarray(np.exp(logs - logsumexp(logs, axis=1, keepdims=True)))

    def judge(self, scores: ArrayLike) -> Judgement:
        """Judge a robot by all recordings since it was known to be healthy.

        Args:
            scores: Of `transform`, in the order of time, shape (recordings, columns).

        Returns:
            What they tell of the robot after the last of them.
        """
        check_is_fitted(self)
        scores = np.atleast_2d(np.asarray(scores, float))
        total = np.cumsum(scores[::-1], axis=0)
        lengths, tried = _lengths(len(scores)), []
        for length in lengths:
            logs = self._log_odds(total[length - 1 : length] / length, length)
            tried.append((float(logsumexp(logs)), length, logs[0]))
        statistic, length, logs = max(tried, key=lambda one: one[0])
        cause = self.effects.causes[int(np.argmax(logs))]
        place = lengths.index(length)
        beside = range([0, *lengths][place] + 1, [*lengths, length + 1][place + 1])
        since = max(beside, key=lambda n: self._evidence(cause, total[n - 1] / n, n))
        value, error = self._values(total[length - 1] / length, length)
        probabilities = np.exp(logs - np.logaddexp(0.0, statistic))
        positive = np.array([cause.positive for cause in self.effects.causes], bool)
        low = np.where(positive, -value / error, -np.inf)
        quantiles = truncnorm.ppf(np.array([[0.025], [0.5], [0.975]]), low, np.inf)
        below, middle, above = value + error * quantiles
        return Judgement(
            statistic > self.limit_,
            statistic,
            len(scores) - since,
            float(1 / (1 + np.exp(statistic))),
            probabilities,
            np.where(positive, middle, value),
            error,
            np.stack([below, above], axis=1),
        )

    def delays(
        self, cause: int, severity: float, *, longest: int = _LENGTH, sequences: int = _SEQUENCES
    ) -> Floats:
        """Simulate how many recordings it takes until an effect raises an alarm.

        Args:
            cause: Number of the cause, from 0.
            severity: Its severity, which is there from the first recording on.
            longest: Number of recordings after which a simulation ends.
            sequences: Number of simulated robots.

        Returns:
            Recordings up to the alarm, shape (sequences,); infinite where there was none.
        """
        check_is_fitted(self)
        shift = self.information_[self.effects.causes[cause].columns[0]] * severity
        statistics = self._simulated(sequences, longest, shift, self._generator(1))
        above = statistics > self.limit_
        return np.where(above.any(axis=1), 1.0 + np.argmax(above, axis=1), np.inf)

    def _generator(self, stream: int) -> np.random.Generator:
        seed = check_random_state(self.random_state).randint(2**31 - 1)
        return np.random.default_rng([seed, stream])

    def _set_limit(self) -> None:
        """Find the limit that healthy sequences exceed at the stated rate."""
        statistics = self._simulated(_SEQUENCES, _LENGTH, None, self._generator(0))
        largest = np.sort(statistics.max(axis=1))
        exceeded = -np.expm1(-self.false_alarms * _LENGTH)  # share of sequences with an alarm
        if exceeded >= _TAIL:
            self.limit_ = float(np.quantile(largest, 1 - exceeded))
            return
        first = float(np.quantile(largest, 1 - _TAIL))
        scale = float(np.mean(largest[largest >= first] - first))
        self.limit_ = first + scale * float(np.log(_TAIL / exceeded))

    def _simulated(
        self, sequences: int, length: int, shift: Floats | None, rng: np.random.Generator
    ) -> Floats:
        """Statistic after each recording of sequences of robots, shape (sequences, length)."""
        square = self.projection_.T @ self.projection_
        values, vectors = np.linalg.eigh(square)
        keep = values > _EDGE * max(float(values.max(initial=0.0)), 1e-300)
        root = np.sqrt(self.noise_ * values[keep])[:, None] * vectors[:, keep].T
        of_days = self.days.columns @ self.projection_
        out = np.empty((sequences, length))
        for start in range(0, sequences, _CHUNK):
            count = min(_CHUNK, sequences - start)
            logs = self.log_scales_ + self.scale_errors_ * rng.standard_normal(
                (count, len(self.scale_errors_))
            )
            std = self.days.stds * np.exp(np.clip(logs, -_LARGEST, _LARGEST))[:, self.days.groups]
            # recordings, and in the last place the mean of the healthy ones
            noise = rng.standard_normal((count, length + 1, len(root)))
            daily = rng.standard_normal((count, length + 1, len(of_days))) * std[:, None]
            scores = noise @ root + daily @ of_days
            scores = scores[:, :-1] - scores[:, -1:] / np.sqrt(self.count_)
            if shift is not None:
                scores += shift
            out[start : start + count] = self._statistics(scores)
        return out

    def _statistics(self, scores: Floats) -> Floats:
        """Statistic after each recording; scores of shape (sequences, length, columns)."""
        count, length, columns = scores.shape
        total = np.concatenate([np.zeros((count, 1, columns)), np.cumsum(scores, axis=1)], axis=1)
        best = np.full((count, length), -np.inf)
        for n in _lengths(length):
            mean = (total[:, n:] - total[:, :-n]) / n
            logs = self._log_odds(mean.reshape(-1, columns), n)
            best[:, n - 1 :] = np.maximum(
                best[:, n - 1 :], logsumexp(logs, axis=1).reshape(count, -1)
            )
        return best

    def _prior_odds(self) -> Floats:
        """Logarithm of the prior odds of each cause against a healthy robot, shape (causes,)."""
        families = [cause.family for cause in self.effects.causes]
        members = np.array([families.count(one) for one in families], float)
        shares = 1 / (len(set(families)) * members)
        return np.asarray(np.log(shares * self.prior / (1 - self.prior)))

    def _log_odds(self, mean: Floats, length: int) -> Floats:
        """Logarithm of the posterior odds of each cause against a healthy robot.

        Args:
            mean: Mean of the scores of some recordings, shape (cases, columns).
            length: Number of these recordings.

        Returns:
            Shape (cases, causes).
        """
        variance = 1 / length + 1 / self.count_
        causes = self.effects.causes
        logs = np.empty((len(mean), len(causes)))
        sure = np.zeros_like(logs)
        single = np.array([len(cause.columns) == 1 for cause in causes], bool)
        if single.any():
            own = [cause.columns[0] for cause in causes if len(cause.columns) == 1]
            sizes = np.array([cause.sizes[0] for cause in causes if len(cause.columns) == 1])
            precision = 1 + self.information_[own, own] * sizes**2 / variance
            right = mean[:, own] * (sizes / variance)
            sure[:, single] = right / np.sqrt(precision)
            logs[:, single] = 0.5 * (sure[:, single] ** 2 - np.log(precision))
        for k in np.flatnonzero(~single):
            logs[:, k], sure[:, k] = self._several(causes[k], mean, variance)
        positive = np.array([cause.positive for cause in causes], bool)
        logs[:, positive] += np.log(2.0) + log_ndtr(sure[:, positive])
        return np.asarray(logs + self._log_prior)

    def _several(self, cause: Cause, mean: Floats, variance: float) -> tuple[Floats, Floats]:
        """Log Bayes factor of a cause, and its severity over the standard error; (cases,) each."""
        right, inverse, size = self._regression(cause, mean, variance)
        value = right @ inverse
        logs = 0.5 * np.einsum("ck,ck->c", right, value) + size
        return logs, np.asarray(value[:, 0] / np.sqrt(inverse[0, 0]))

    def _evidence(self, cause: Cause, mean: Floats, length: int) -> float:
        """Log Bayes factor of a cause since some recordings, without its sign."""
        return float(self._several(cause, mean[None], 1 / length + 1 / self.count_)[0][0])

    def _regression(
        self, cause: Cause, mean: Floats, variance: float
    ) -> tuple[Floats, Floats, float]:
        """Regression on the columns of a cause, in units of their sizes.

        Returns:
            Right-hand sides, shape (cases, columns); covariance of the values; and half the
            logarithm of its determinant.
        """
        own, sizes = list(cause.columns), np.array(cause.sizes)
        gram = self.information_[np.ix_(own, own)] * np.outer(sizes, sizes) / variance
        factor = cho_factor(gram + np.eye(len(own)), lower=True)
        inverse = cho_solve(factor, np.eye(len(own)))
        return (
            np.asarray(mean[:, own] * sizes / variance),
            np.asarray(inverse),
            -float(np.log(np.diag(factor[0])).sum()),
        )

    def _values(self, mean: Floats, length: int) -> tuple[Floats, Floats]:
        """Severity of each cause if it is the one, and its standard error, shape (causes,) each."""
        variance = 1 / length + 1 / self.count_
        found = []
        for cause in self.effects.causes:
            right, inverse, _ = self._regression(cause, mean[None], variance)
            found.append((float((right @ inverse)[0, 0]), float(np.sqrt(inverse[0, 0]))))
        sizes = np.array([cause.sizes[0] for cause in self.effects.causes])
        value, error = np.array(found).reshape(-1, 2).T
        return value * sizes, error * sizes


def _lengths(count: int) -> list[int]:
    """Numbers of newest recordings since which an effect may be there."""
    found, next_one = [], 1.0
    while round(next_one) < count:
        found.append(round(next_one))
        next_one = max(next_one * _FASTER, next_one + 1)
    return [*found, count]
