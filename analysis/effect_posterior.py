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

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import expit, logsumexp
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_array, check_is_fitted

from .causes import Days, Effects, Judgement
from .day_scales import LARGEST, day_stds, learn_days
from .forms import Forms

Floats = NDArray[np.float64]

_FASTER = 1.4  # ratio of the numbers of recordings that are tried, from one to the next
_FINELY = 1.03  # the same, for the begin of an effect
_SEQUENCES, _LENGTH = 400, 120  # simulated healthy sequences, and recordings in each
_CHUNK = 20  # sequences that are in memory at once
_TAIL = 0.1  # share of the largest statistics, to which the exponential tail is fitted
_LEARNED = ("mean_", "count_", "log_scales_", "scale_errors_", "noise_", "limit_")
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
        day_stds_: Standard deviation of each number from day to day, shape (numbers,).
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
        found = learn_days(self.days, x - self.mean_)
        self.log_scales_, self.scale_errors_, self.noise_ = found
        self._prepare()
        self._set_limit()
        return self

    def _prepare(self) -> None:
        """Compute what follows from the scales and the noise."""
        days, columns = self.days.columns, np.asarray(self.effects.columns, float)
        std = self.day_stds_ = day_stds(self.days, self.log_scales_)
        inner = (days * std[:, None]) @ days.T * std + self.noise_ * np.eye(len(std))
        across = (days * std[:, None]) @ columns.T
        explained = days.T @ (std[:, None] * cho_solve(cho_factor(inner), across))
        self.projection_ = (columns.T - explained) / self.noise_
        self.information_ = columns @ self.projection_
        self.information_ = (self.information_ + self.information_.T) / 2
        values, vectors = np.linalg.eigh(self.projection_.T @ self.projection_)
        keep = values > _EDGE * max(float(values.max(initial=0.0)), 1e-300)
        self._noise_root = np.sqrt(self.noise_ * values[keep])[:, None] * vectors[:, keep].T
        self._forms = Forms(self.effects.causes, self.information_)
        self._log_prior = self._prior_odds()

    def state(self) -> dict[str, Floats]:
        """Return what was learned, as arrays from which `restore` makes the same estimator.

        Returns:
            Each attribute by its name: numbers, and arrays of shape (features,) and (groups,).
        """
        check_is_fitted(self)
        return {name: np.asarray(getattr(self, name), float) for name in _LEARNED}

    def restore(self, state: Mapping[str, ArrayLike]) -> EffectPosterior:
        """Take over what another estimator with the same effects and days has learned.

        Args:
            state: From `state`.

        Returns:
            Itself.

        Raises:
            KeyError: Something is missing.
            ValueError: The sizes do not suit the effects and days.
        """
        values = {name: np.asarray(state[name], float) for name in _LEARNED}
        self.n_features_in_ = self.effects.columns.shape[1]
        wanted = {
            "mean_": (self.n_features_in_,),
            "log_scales_": self.days.spreads.shape,
            "scale_errors_": self.days.spreads.shape,
        }
        for name, value in values.items():
            if value.shape != wanted.get(name, ()):
                raise ValueError(f"{name} has the shape {value.shape}")
            setattr(self, name, value if name in wanted else float(value))
        self.count_ = int(self.count_)
        self._prepare()
        return self

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
        logs = self._log_odds(self._forms.turned(self.transform(X)), 1)
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
        turned = self._forms.turned(scores)
        total = np.cumsum(turned[::-1], axis=0)
        lengths, tried = _lengths(len(scores)), []
        for length in lengths:
            logs = self._log_odds(total[length - 1 : length] / length, length)
            tried.append((float(np.logaddexp.reduce(logs[0])), length, logs[0]))
        statistic, length, logs = max(tried, key=lambda one: one[0])
        cause = int(np.argmax(logs))
        # the newest recordings that are enough to show the effect: it may grow
        newest = min((n for value, n, _ in tried if value > self.limit_), default=length)
        below, middle, above = self._forms.severities(
            total[newest - 1] / newest, self._variance(newest)
        )
        alarm = statistic > self.limit_
        return Judgement(
            alarm,
            statistic,
            self._since(turned, cause) if alarm else len(scores) - length,
            float(expit(-statistic)),
            logs,
            np.exp(logs - np.logaddexp(0.0, statistic)),
            middle,
            np.stack([below, above], axis=1),
        )

    def _since(self, turned: Floats, cause: int) -> int:
        """Number of the recording from which a cause is there, all at once or growing evenly."""
        best, found, count = -np.inf, len(turned) - 1, len(turned)
        before = np.concatenate([np.zeros((1, *turned.shape[1:])), np.cumsum(turned, axis=0)])
        for length in _lengths(count, _FINELY):
            healthy = self.count_ + count - length  # what came before is healthy as well
            usual = before[count - length] / healthy
            for growth in (np.ones(length), np.arange(1, length + 1) / length):
                size, share = float(growth @ growth), float(growth.sum() / (growth @ growth))
                mean = np.tensordot(growth, turned[count - length :], axes=1) / size
                variance = 1 / size + share**2 / healthy
                odds = self._forms.log_bayes_factors(mean - share * usual, variance, signs=False)
                if odds[cause] > best:
                    best, found = odds[cause], count - length
        return found

    def evidence(self, scores: ArrayLike) -> tuple[Floats, Floats]:
        """Weigh each cause by recordings in all of which it is there, or nothing is.

        Evidence of independent data about one robot, such as other programs, adds up.

        Args:
            scores: Of `transform`, shape (recordings, columns), at least one.

        Returns:
            Logarithm of the Bayes factor of each cause against a healthy robot, shape (causes,);
            and quantiles 0.025, 0.5 and 0.975 of its severity if it is the one, shape (causes, 3).
        """
        check_is_fitted(self)
        turned = self._forms.turned(np.atleast_2d(np.asarray(scores, float)))
        mean, variance = turned.mean(axis=0), self._variance(len(turned))
        logs = self._forms.log_bayes_factors(mean, variance)
        return logs, np.stack(self._forms.severities(mean, variance), axis=1)

    def severity_path(self, scores: ArrayLike, cause: int) -> Floats:
        """Estimate a severity in each recording alone.

        Args:
            scores: Of `transform`, shape (recordings, columns).
            cause: Number of the cause, from 0.

        Returns:
            Quantiles 0.025, 0.5 and 0.975 of the severity if this is the cause, shape (recordings,
            3).
        """
        check_is_fitted(self)
        rows = self._forms.turned(np.atleast_2d(np.asarray(scores, float)))
        variance = self._variance(1)
        return np.array(
            [[q[cause] for q in self._forms.severities(row, variance)] for row in rows]
        ).reshape(-1, 3)

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
        column = self.effects.causes[cause].forms[0].columns[0]
        shift = self.information_[column] * severity
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
        root = self._noise_root.astype(np.float32)
        of_days = (self.days.columns @ self.projection_).astype(np.float32)
        out = np.empty((sequences, length))
        for start in range(0, sequences, _CHUNK):
            count = min(_CHUNK, sequences - start)
            logs = self.log_scales_ + self.scale_errors_ * rng.standard_normal(
                (count, len(self.scale_errors_))
            )
            own = np.log(self.days.unlike) * rng.standard_normal((count, len(self.days.stds)))
            logs = np.clip(logs, -LARGEST, LARGEST)[:, self.days.groups] + own
            std = (self.days.stds * np.exp(logs)).astype(np.float32)
            # recordings, and in the last place the mean of the healthy ones
            each = (count, length + 1)
            noise = rng.standard_normal((*each, len(root)), dtype=np.float32)
            daily = rng.standard_normal((*each, len(of_days)), dtype=np.float32) * std[:, None]
            flat = noise.reshape(-1, len(root)) @ root + daily.reshape(-1, len(of_days)) @ of_days
            scores = flat.reshape(*each, -1)
            scores = scores[:, :-1] - scores[:, -1:] / np.float32(np.sqrt(self.count_))
            if shift is not None:
                scores += shift.astype(np.float32)
            out[start : start + count] = self._statistics(scores)
        return out

    def _statistics(self, scores: Floats) -> Floats:
        """Statistic after each recording; scores of shape (sequences, length, columns)."""
        turned = self._forms.turned(scores)
        count, length = turned.shape[:2]
        total = np.concatenate(
            [np.zeros((count, 1, *turned.shape[2:])), np.cumsum(turned, axis=1)], axis=1
        )
        best = np.full((count, length), -np.inf)
        for n in _lengths(length):
            mean = (total[:, n:] - total[:, :-n]) / n
            logs = self._log_odds(mean, n)
            best[:, n - 1 :] = np.maximum(best[:, n - 1 :], logsumexp(logs, axis=-1))
        return best

    def _prior_odds(self) -> Floats:
        """Logarithm of the prior odds of each cause against a healthy robot, shape (causes,)."""
        families = [cause.family for cause in self.effects.causes]
        members = np.array([families.count(one) for one in families], float)
        shares = 1 / (len(set(families)) * members)
        return np.asarray(np.log(shares * self.prior / (1 - self.prior)))

    def _variance(self, length: int) -> float:
        """Variance of the mean of some recordings less the healthy mean, over that of one."""
        return 1 / length + 1 / self.count_

    def _log_odds(self, turned: Floats, length: int, *, signs: bool = True) -> Floats:
        """Logarithm of the posterior odds of each cause against a healthy robot.

        Args:
            turned: Mean of the scores of some recordings, from `Forms.turned`, shape (..., forms,
                columns).
            length: Number of these recordings.
            signs: Whether it counts that some severities cannot be negative.

        Returns:
            Shape (..., causes).
        """
        factors = self._forms.log_bayes_factors(turned, self._variance(length), signs=signs)
        return np.asarray(factors + self._log_prior)


def _lengths(count: int, faster: float = _FASTER) -> list[int]:
    """Numbers of newest recordings since which an effect may be there."""
    found, next_one = [], 1.0
    while round(next_one) < count:
        found.append(round(next_one))
        next_one = max(next_one * faster, next_one + 1)
    return [*found, count]
