"""What a detector of known effects has learned, and how it judges recordings.

`EffectPosterior` learns it, and explains the model. This part imports quickly: judging a recording
needs no more.

    detector = FittedPosterior(effects, days).restore(state)
    judgement = detector.judge(detector.transform(recordings))
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import expit, logsumexp

from .causes import Days, Effects, Judgement
from .day_scales import day_stds
from .forms import Forms

Floats = NDArray[np.float64]

_FASTER = 1.4  # ratio of the numbers of recordings that are tried, from one to the next
_FINELY = 1.03  # the same, for the begin of an effect
_LEARNED = ("mean_", "count_", "log_scales_", "scale_errors_", "noise_", "directions_", "limit_")
_EDGE = 1e-9  # of information, below which it counts as none


class FittedPosterior:
    """What `EffectPosterior` has learned, without the way in which it learns.

    Args:
        effects: Effects that may be there.
        days: Differences from day to day.
        false_alarms: Rate of false alarms, per recording.
        prior: Probability, before there are data, that the robot has an effect.
        random_state: Seed of the sequences from which the limit is found.
    """

    mean_: Floats
    count_: int
    log_scales_: Floats
    scale_errors_: Floats
    noise_: float
    directions_: Floats
    limit_: float

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

    def _prepare(self) -> None:
        """Compute what follows from the scales and the noise."""
        columns = np.asarray(self.effects.columns, float)
        days = np.concatenate([self.days.columns, self.directions_])
        self.day_stds_ = day_stds(self.days, self.log_scales_)
        std = np.concatenate([self.day_stds_, np.ones(len(self.directions_))])
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
            Each attribute by its name: numbers, and arrays of shape (features,), (groups,) and
            (directions, features).
        """
        self._require_fit()
        return {name: np.asarray(getattr(self, name), float) for name in _LEARNED}

    def restore(self, state: Mapping[str, ArrayLike]) -> Self:
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
            "directions_": (len(values["directions_"]), self.n_features_in_),
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

        Raises:
            ValueError: The features are no finite numbers, or have another shape.
        """
        self._require_fit()
        return np.asarray((_rows(X) - self.mean_) @ self.projection_)

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
        self._require_fit()
        scores = np.atleast_2d(np.asarray(scores, float))
        turned = self._forms.turned(scores)
        total = np.cumsum(turned[::-1], axis=0)
        lengths, tried = lengths_of(len(scores)), []
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

    def strongest(self, scores: ArrayLike) -> tuple[Floats, Floats]:
        """Test many robots at once, each as `judge` tests it after its last recording.

        Args:
            scores: Of `transform`, in the order of time, shape (robots, recordings, columns).

        Returns:
            The statistic of each robot, shape (robots,), above `limit_` if an effect is there; and
            the logarithm of the odds of each cause against a healthy robot, shape (robots, causes).
        """
        self._require_fit()
        scores = np.asarray(scores)
        summed = np.cumsum(scores[:, ::-1], axis=1)
        statistic = np.full(len(scores), -np.inf)
        odds = np.zeros((len(scores), len(self.effects.causes)))
        for length in lengths_of(scores.shape[1]):
            mean = self._forms.turned(summed[:, length - 1] / length)
            logs = self._log_odds(mean, length)
            value = logsumexp(logs, axis=-1)
            more = value > statistic
            statistic[more], odds[more] = value[more], logs[more]
        return statistic, odds

    def _since(self, turned: Floats, cause: int) -> int:
        """Number of the recording from which a cause is there, all at once or growing evenly."""
        best, found, count = -np.inf, len(turned) - 1, len(turned)
        before = np.concatenate([np.zeros((1, *turned.shape[1:])), np.cumsum(turned, axis=0)])
        for length in lengths_of(count, _FINELY):
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

    def evidence(self, scores: ArrayLike) -> Floats:
        """Weigh each cause by recordings in all of which it is there, or nothing is.

        Evidence of independent data about one robot, such as other programs, adds up.

        Args:
            scores: Of `transform`, shape (recordings, columns), at least one.

        Returns:
            Logarithm of the Bayes factor of each cause against a healthy robot, shape (causes,).
        """
        self._require_fit()
        turned = self._forms.turned(np.atleast_2d(np.asarray(scores, float)))
        return self._forms.log_bayes_factors(turned.mean(axis=0), self._variance(len(turned)))

    def severity_path(self, scores: ArrayLike, cause: int) -> Floats:
        """Estimate a severity in each recording alone.

        Args:
            scores: Of `transform`, shape (recordings, columns).
            cause: Number of the cause, from 0.

        Returns:
            Quantiles 0.025, 0.5 and 0.975 of the severity if this is the cause, shape (recordings,
            3).
        """
        self._require_fit()
        rows = self._forms.turned(np.atleast_2d(np.asarray(scores, float)))
        variance = self._variance(1)
        return np.array(
            [[q[cause] for q in self._forms.severities(row, variance)] for row in rows]
        ).reshape(-1, 3)

    def _require_fit(self) -> None:
        if not hasattr(self, "limit_"):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError(f"this {type(self).__name__} has learned nothing; call fit first")

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


def _rows(X: ArrayLike) -> Floats:
    """Features of recordings as finite numbers."""
    rows = np.asarray(X, float)
    if rows.ndim != 2 or not np.isfinite(rows).all():
        raise ValueError(
            f"X must be finite numbers of shape (recordings, features), got shape {rows.shape}"
        )
    return rows


def lengths_of(count: int, faster: float = _FASTER) -> list[int]:
    """Return the numbers of newest recordings since which an effect may be there.

    Args:
        count: Number of recordings.
        faster: Ratio of two numbers that follow each other.
    """
    found, next_one = [], 1.0
    while round(next_one) < count:
        found.append(round(next_one))
        next_one = max(next_one * faster, next_one + 1)
    return [*found, count]
