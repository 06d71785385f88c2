"""How a severity goes on, and when it reaches a limit.

forecast = forecast_severity(days, severities, errors, limit=0.15, rng=np.random.default_rng(0))
forecast.remaining(0.1), forecast.remaining(0.5), forecast.remaining(0.9)  # days from the last one

An estimated severity is the sum of a course, of what differs at random, and of its own error:

    y_i = a f(t_i) + w(t_i) + e_i

f is (t - t0)^p, or exp(r (t - t0)) - 1, from its begin t0 on, and 0 before. w is a Wiener process:
wear that grows faster in one week than in another. All forms, begins and sizes of w are weighed by
the likelihood of the data (Bayesian model averaging; Hoeting et al. 1999, doi
10.1214/ss/1009212519). The amplitude a is not negative; given a form it is normal, and all
integrals over it are exact. The time at which the sum first reaches the limit is simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr, ndtr, ndtri

Floats = NDArray[np.float64]

POWERS = (0.5, 1.0, 2.0, 3.0, 4.0)
"""Exponents of the courses: running-in, constant wear, and wear that feeds itself. The schedules of
the thesis grow with the fourth power (eqs. 3.7 and 6.6)."""
RATES = (1.0, 2.0, 4.0, 8.0)
"""Growth of exponential courses, over the time that was seen."""

_BEGINS = 12  # times at which a course may begin, evenly over the time that was seen
_RANDOM = (0.003, 0.03, 0.1, 0.3)  # standard deviation of w after that time, over the severity
_MOST = 120  # points that are used; more are averaged
_STEPS = 400  # into the future
_FAR = 5.0  # horizon, over the time that was seen, unless another one is given


@dataclass(frozen=True, eq=False)
class Forecast:
    """How a severity may go on, as courses that are equally probable."""

    times: Floats
    """Times from the last recording on, shape (times,), in the unit of the data."""
    severities: Floats
    """Severity at these times, shape (samples, times); the first is the present one."""
    times_to_limit: Floats
    """Time from the last recording until the limit, shape (samples,): 0 where it is reached, and
    infinite where it is not reached within the horizon."""

    def remaining(self, quantile: float) -> float:
        """Return a quantile of the time until the limit; infinite beyond the horizon.

        Args:
            quantile: From 0 to 1.
        """
        ordered = np.sort(self.times_to_limit)
        return float(ordered[min(int(quantile * len(ordered)), len(ordered) - 1)])

    def severity(self, quantiles: Sequence[float]) -> Floats:
        """Compute quantiles of the severity.

        Args:
            quantiles: From 0 to 1.

        Returns:
            Shape (quantiles, times).
        """
        return np.asarray(np.quantile(self.severities, quantiles, axis=0))


def forecast_severity(
    times: ArrayLike,
    severities: ArrayLike,
    errors: ArrayLike,
    *,
    limit: float,
    rng: np.random.Generator,
    horizon: float | None = None,
    samples: int = 1000,
    scale_error: float = 0.0,
) -> Forecast:
    """Forecast a severity.

    Args:
        times: Time of each estimate, in ascending order, shape (estimates,), in any unit.
        severities: Estimated severities, same shape; they may be negative by their errors.
        errors: Standard error of each, above 0, same shape. Errors must be independent: judge
            recordings one by one, not by running means.
        limit: Severity that must not be reached, above 0.
        rng: Source of randomness.
        horizon: Time over which the severity is forecast. Default: five times the time seen.
        samples: Number of simulated courses.
        scale_error: Standard deviation of the logarithm of a factor by which all severities may be
            wrong together, because the model by which they are estimated is.

    Returns:
        The forecast, which allows for this factor.

    Raises:
        ValueError: Shapes differ, there are fewer than three times, or a number is impossible.
    """
    t, y, e = (np.asarray(x, float) for x in (times, severities, errors))
    if not t.shape == y.shape == e.shape or t.ndim != 1:
        raise ValueError(
            f"times, severities and errors have shapes {t.shape}, {y.shape}, {e.shape}"
        )
    if len(t) < 3 or np.any(np.diff(t) < 0) or t[-1] == t[0]:
        raise ValueError("times must ascend, and there must be at least three")
    if not (np.all(e > 0) and np.isfinite(t + y + e).all()):
        raise ValueError("times and severities must be finite, and errors above 0")
    if not limit > 0:
        raise ValueError(f"limit must be above 0, got {limit}")
    if not (scale_error >= 0 and np.isfinite(scale_error)):
        raise ValueError(f"scale_error must not be negative, got {scale_error}")
    t, y, e = _averaged(t, y, e)
    span = float(t[-1] - t[0])
    horizon = _FAR * span if horizon is None else horizon
    if not horizon > 0:
        raise ValueError(f"horizon must be above 0, got {horizon}")
    now = (t - t[0]) / span
    ahead = np.linspace(0.0, horizon / span, _STEPS + 1)
    scale = float(max(np.abs(y).max(), e.min()))
    forms = (*((0, p) for p in POWERS), *((1, r) for r in RATES))
    fits = [
        fit
        for begin in np.arange(_BEGINS) / _BEGINS
        for wiener in _RANDOM
        for fit in _fits(now, y, e, forms, begin, wiener * scale, scale)
    ]
    logs = np.array([fit.log_evidence for fit in fits])
    weight = np.exp(logs - logs.max())
    counts = rng.multinomial(samples, weight / weight.sum())
    drawn = [fits[k].draw(ahead, int(counts[k]), rng) for k in np.flatnonzero(counts)]
    courses = np.concatenate(drawn)
    courses *= np.exp(scale_error * rng.standard_normal(len(courses)))[:, None]
    above = courses >= limit
    first = np.argmax(above, axis=1)
    reached = np.where(above.any(axis=1), ahead[first] * span, np.inf)
    return Forecast(ahead * span, courses, reached)


def _averaged(t: Floats, y: Floats, e: Floats) -> tuple[Floats, Floats, Floats]:
    """Weighted means of neighbours, so that no more than `_MOST` points are left."""
    if len(t) <= _MOST:
        return t, y, e
    starts = np.linspace(0, len(t), _MOST + 1).astype(int)[:-1]
    weight = np.add.reduceat(e**-2, starts)
    means = [np.add.reduceat(x * e**-2, starts) / weight for x in (t, y)]
    return means[0], means[1], weight**-0.5


def _course(form: tuple[int, float], since: Floats) -> Floats:
    """A course by the time since its begin, 1 after the time that was seen."""
    kind, number = form
    since = np.maximum(since, 0.0)
    return since**number if kind == 0 else np.expm1(number * since) / np.expm1(number)


@dataclass(frozen=True, eq=False)
class _Fit:
    """One form, begin and size of the Wiener process, with the time that was seen as unit."""

    form: tuple[int, float]
    begin: float
    wiener: float
    log_evidence: float
    amplitude: float
    """Mean of the amplitude."""
    error: float
    """Its standard deviation."""
    level: float
    """Present value of the Wiener process if the amplitude is its mean."""
    slope: float
    """Change of this value by one of the amplitude."""
    spread: float
    """Its standard deviation, given the amplitude."""

    def draw(self, ahead: Floats, count: int, rng: np.random.Generator) -> Floats:
        """Draw courses from the present on, shape (count, times)."""
        share = ndtr(self.amplitude / self.error)  # of the normal distribution above 0
        amplitude = self.amplitude - self.error * ndtri(share * rng.uniform(1e-12, 1.0, count))
        level = self.level + self.slope * (amplitude - self.amplitude)
        level = level + self.spread * rng.standard_normal(count)
        steps = self.wiener * np.sqrt(np.diff(ahead)) * rng.standard_normal((count, len(ahead) - 1))
        random = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, axis=1)], axis=1)
        course = _course(self.form, 1.0 + ahead - self.begin)
        return np.asarray(amplitude[:, None] * course + level[:, None] + random)


def _fits(
    t: Floats,
    y: Floats,
    e: Floats,
    forms: Sequence[tuple[int, float]],
    begin: float,
    wiener: float,
    scale: float,
) -> list[_Fit]:
    """Fit the amplitude of every form, whose prior is half of a normal distribution."""
    since = np.maximum(t - begin, 0.0)
    random = wiener**2 * np.minimum.outer(since, since)
    factor = cho_factor(random + np.diag(e**2), lower=True)
    common = -float(np.log(np.diag(factor[0])).sum())
    across = wiener**2 * since  # covariance of the present value with the others
    spread = wiener**2 * (1 - begin) - float(across @ cho_solve(factor, across))
    courses = np.stack([_course(form, t - begin) for form in forms])
    solved = cho_solve(factor, np.column_stack([y, courses.T]))
    by_y, size = solved[:, 0], 3 * scale / max(1 - begin, 1 / _BEGINS)  # wide: it matters little
    fits = []
    for form, f, by_f in zip(forms, courses, solved[:, 1:].T, strict=True):
        precision = float(f @ by_f) + size**-2
        amplitude, error = float(f @ by_y) / precision, precision**-0.5
        log = common - 0.5 * float(y @ by_y) + 0.5 * amplitude**2 * precision
        log += float(np.log(2 * error / size) + log_ndtr(amplitude / error))
        fits.append(
            _Fit(
                form,
                begin,
                wiener,
                log,
                amplitude,
                error,
                float(across @ (by_y - amplitude * by_f)),
                -float(across @ by_f),
                max(spread, 0.0) ** 0.5,
            )
        )
    return fits


def phm_score(predicted: ArrayLike, true: ArrayLike) -> float:
    """Compute the asymmetric score of the PHM 2008 challenge, in which late is worse than early.

    It is the sum of exp(-d / 13) - 1 for d < 0 and exp(d / 10) - 1 for others, with d = predicted -
    true. Source: Saxena et al. (2008), doi 10.1109/PHM.2008.4711414.

    Args:
        predicted: Predicted remaining lives, in cycles.
        true: True ones, same shape.
    """
    late = np.asarray(predicted, float) - np.asarray(true, float)
    return float(np.sum(np.expm1(np.where(late < 0, -late / 13, late / 10))))
