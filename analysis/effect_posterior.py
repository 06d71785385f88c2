"""Which effect does a sequence of recordings show, since when, and how severe is it?

A recording is a row of features, such as the whitened torque of a program:

    x_i = mean + D b_i + A a + n_i

D b_i are differences from day to day of known form, such as the friction of one axis, A a are the
effects that a robot may have, and n_i is white noise of a variance of about 1. All are normal, so
that everything follows from the inner products A C^-1 (x_i - mean), with C = D D' + I, which are a
few hundred numbers a recording, whatever the number of features.

    detector = EffectPosterior(effects, days, false_alarms=0.001).fit(healthy)
    state = detector.judge(detector.transform(recordings))
    state.alarm, state.since, effects.causes[state.best].label, state.severities[state.best]
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_array

from .day_directions import unknown_directions
from .day_scales import LARGEST, learn_days
from .fitted_posterior import FittedPosterior, lengths_of

Floats = NDArray[np.float64]

_SEQUENCES, _LENGTH = 400, 120  # simulated healthy sequences, and recordings in each
_CHUNK = 20  # sequences that are in memory at once
_TAIL = 0.1  # share of the largest statistics, to which the exponential tail is fitted


class EffectPosterior(FittedPosterior, BaseEstimator):
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
        day_stds_: Standard deviation of each number from day to day, shape (numbers,).
        noise_: Variance of the noise; about 1 if the features are whitened.
        directions_: Further differences between healthy recordings, which the known ones do not
            describe: one standard deviation of each, shape (directions, features).
        projection_: C^-1 A', shape (features, columns).
        information_: A C^-1 A', shape (columns, columns).
        limit_: Limit of the statistic.
    """

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
        found = learn_days(self.days, x - self.mean_)
        self.log_scales_, self.scale_errors_, self.noise_ = found
        self.directions_ = np.zeros((0, x.shape[1]))
        self._prepare()
        self.directions_ = self._unknown_directions(x - self.mean_)
        if len(self.directions_):
            self._prepare()
        self._set_limit()
        return self

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
        self._require_fit()
        column = self.effects.causes[cause].forms[0].columns[0]
        shift = self.information_[column] * severity
        statistics = self._simulated(sequences, longest, shift, self._generator(1))
        above = statistics > self.limit_
        return np.where(above.any(axis=1), 1.0 + np.argmax(above, axis=1), np.inf)

    def _unknown_directions(self, apart: Floats) -> Floats:
        """Differences between healthy recordings that are in no column of the days."""
        sizes = np.zeros(len(self.information_))
        for cause in self.effects.causes:
            for form in cause.forms:
                usual = (np.hypot(form.sizes[0], form.mean), *form.sizes[1:])
                np.maximum.at(sizes, list(form.columns), usual)
        rng = self._generator(2)

        def simulated(sets: int) -> Floats:
            scores = self._healthy_scores(sets, self.count_, rng)
            return np.asarray(scores - scores.mean(axis=1, keepdims=True))

        weights = unknown_directions(apart @ self.projection_, self.information_, sizes, simulated)
        return np.asarray(weights @ self.effects.columns)

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
        out = np.empty((sequences, length))
        for start in range(0, sequences, _CHUNK):
            count = min(_CHUNK, sequences - start)
            # recordings, and in the last place the mean of the healthy ones
            scores = self._healthy_scores(count, length + 1, rng)
            scores = scores[:, :-1] - scores[:, -1:] / np.float32(np.sqrt(self.count_))
            if shift is not None:
                scores += shift.astype(np.float32)
            out[start : start + count] = self._statistics(scores)
        return out

    def _healthy_scores(self, robots: int, length: int, rng: np.random.Generator) -> Floats:
        """Draw scores of healthy recordings, shape (robots, length, columns)."""
        columns = np.concatenate([self.days.columns, self.directions_])
        root = self._noise_root.astype(np.float32)
        of_days = (columns @ self.projection_).astype(np.float32)
        errors, numbers, directions = self.scale_errors_, len(self.days.stds), len(self.directions_)
        logs = self.log_scales_ + errors * rng.standard_normal((robots, len(errors)))
        own = np.log(self.days.unlike) * rng.standard_normal((robots, numbers))
        logs = np.clip(logs, -LARGEST, LARGEST)[:, self.days.groups] + own
        # the error of a standard deviation, from as many recordings
        found = rng.standard_normal((robots, directions)) / np.sqrt(2 * max(self.count_ - 1, 1))
        std = np.concatenate([self.days.stds * np.exp(logs), np.exp(found)], axis=1)
        noise = rng.standard_normal((robots, length, len(root)), dtype=np.float32)
        daily = rng.standard_normal((robots, length, len(of_days)), dtype=np.float32)
        daily *= std[:, None].astype(np.float32)
        flat = noise.reshape(-1, len(root)) @ root + daily.reshape(-1, len(of_days)) @ of_days
        return np.asarray(flat.reshape(robots, length, -1))

    def _statistics(self, scores: Floats) -> Floats:
        """Statistic after each recording; scores of shape (sequences, length, columns)."""
        turned = self._forms.turned(scores)
        count, length = turned.shape[:2]
        total = np.concatenate(
            [np.zeros((count, 1, *turned.shape[2:])), np.cumsum(turned, axis=1)], axis=1
        )
        best = np.full((count, length), -np.inf)
        for n in lengths_of(length):
            mean = (total[:, n:] - total[:, :-n]) / n
            logs = self._log_odds(mean, n)
            best[:, n - 1 :] = np.maximum(best[:, n - 1 :], logsumexp(logs, axis=-1))
        return best
