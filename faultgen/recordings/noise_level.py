"""Noise whose level differs between recordings and with speed and load.

The noise of a sample is the level of this sample times an autoregression. The level of a separate
recording is found from the median size of its innovations, the part of a sample that cannot be
predicted from the samples before it. Within a recording, the variance may also grow with speed and
load. It does so in the model only where this predicts the variance of samples to which it was not
fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from faultgen.recordings.noise import ORDER, Autoregression, autoregression, typical
from faultgen.recordings.varying_noise import VaryingNoise

_FEWEST = 50  # samples from which a level is found
_ROUNDS = 3  # in which colour and level, and variance and weights, are fitted in turn
_CAP = 12.0  # squared innovation over its variance beyond which a sample is a jump
_LEAST = 0.05  # level: where there is no noise at all, a sample still counts for no more than this
_GAIN = 4.0  # log-likelihood that speed and load must add on samples they were not fitted to
_FOLD = 64  # samples of each block that is left out in turn


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of each axis: a level for each sample times an autoregression."""

    colour: Autoregression
    """The autoregression, with the deviation that is typical of the whole recording."""
    level: np.ndarray
    """Level of each sample; its mean square over the samples that are used is 1. Shape (samples,
    n_axes)."""
    before: VaryingNoise | None = None
    """Noise whose colour changes with time; both hold for its innovations. None: there is none."""

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of the noise over the whole recording, shape (n_axes,)."""
        return self.colour.deviation

    def whiten(self, x: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Compute innovations divided by their standard deviation.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the noise.
            parts: Samples of each separate recording.

        Returns:
            Same shape as x, without unit. The first samples of each part, as many as the order of
            the autoregression, are 0, and so are parts that are not longer.
        """
        if self.before is not None:
            x = self.before.whiten(x, parts)
        return self.colour.whiten(x / self.level.astype(x.dtype), parts)

    def whiten_axis(self, x: np.ndarray, axis: int, parts: Sequence[slice]) -> np.ndarray:
        """Compute the innovations of one axis.

        Args:
            x: Shape (..., samples), in the unit of the noise.
            axis: Axis, from 1.
            parts: Samples of each separate recording.

        Returns:
            Same shape as x, as from `whiten`.
        """
        return self.of_axis(axis).whiten(x[..., None], parts)[..., 0]

    def of_axis(self, axis: int) -> Noise:
        """Return the noise of one axis, counted from 1."""
        before = None if self.before is None else self.before.of_axis(axis)
        return Noise(self.colour.of_axis(axis), self.level[:, axis - 1 : axis], before)

    def of_samples(self) -> np.ndarray:
        """Standard deviation of the noise in each sample, shape (samples, n_axes).

        Returns:
            Shape (samples, n_axes).
        """
        size = self.deviation * self.level
        return size if self.before is None else size * self.before.growth[self.before.frame]

    def plain(self) -> Noise:
        """Return white noise of the same deviation and information.

        An autoregression treats long-lasting errors as drifting noise. White noise gives them
        their full weight.
        """
        colour = self.colour
        longer = colour.deviation / colour.innovation  # root of the samples that one is worth
        return self.with_colour(Autoregression(0 * colour.coefficients, colour.deviation * longer))

    def of_order(self, order: int) -> Noise:
        """Return the same noise with an autoregression of a higher order, whose end is 0."""
        coefficients = self.colour.coefficients
        more = np.zeros((len(coefficients), max(order - coefficients.shape[1], 0)))
        longer = np.concatenate([coefficients, more], axis=1)
        return self.with_colour(replace(self.colour, coefficients=longer))

    def at_least(self, innovation: np.ndarray) -> Noise:
        """Return noise whose innovations are no smaller than some values, shape (n_axes,)."""
        larger = np.maximum(self.colour.innovation, innovation)
        return self.with_colour(replace(self.colour, innovation=larger))

    def with_colour(self, colour: Autoregression) -> Noise:
        """Return noise with the same levels and another autoregression."""
        return replace(self, colour=colour)

    def replaced(self, other: Noise, axes: np.ndarray) -> Noise:
        """Return the noise with other noise on some axes.

        Args:
            other: The other noise, of the same order and number of samples, of one colour.
            axes: Axes on which the other noise is used, a mask of shape (n_axes,).

        Returns:
            The combined noise.
        """
        return Noise(
            self.colour.replaced(other.colour, axes),
            np.where(axes, other.level, self.level),
            None if self.before is None else self.before.without(axes),
        )


def levelled(
    residual: np.ndarray,
    inside: np.ndarray,
    parts: Sequence[slice],
    drivers: Sequence[np.ndarray],
    order: int = ORDER,
    before: VaryingNoise | None = None,
    coloured: np.ndarray | None = None,
) -> Noise:
    """Estimate the colour and the level of noise.

    Args:
        residual: What no effect explains, shape (samples, n_axes), in any unit; or draws of it,
            (draws, samples, n_axes).
        inside: Samples that may be used, shape (samples, n_axes).
        parts: Samples of each separate recording.
        drivers: Quantities with which the variance may grow, such as speed and load; not negative,
            each of shape (samples, n_axes).
        order: Order of the autoregression.
        before: Noise whose colour changes with time, which is known.
        coloured: Samples that show the colour, shape (samples, n_axes). None: those of `inside`.

    Returns:
        The noise.

    Raises:
        InputError: An axis has fewer than 50 usable samples.
    """
    if before is not None:
        residual = before.whiten(residual, parts)
    coloured = inside if coloured is None else coloured
    level = np.ones(inside.shape)
    for _ in range(_ROUNDS):
        colour = autoregression(residual / level, coloured, parts, order)
        level = level * level_of(colour.whiten(residual / level, parts), inside, parts, drivers)
        level /= np.sqrt(np.sum(level**2 * inside, axis=0) / np.maximum(inside.sum(axis=0), 1))
        level = np.maximum(level, _LEAST)
    return Noise(autoregression(residual / level, coloured, parts, order), level, before)


def level_of(
    white: np.ndarray, inside: np.ndarray, parts: Sequence[slice], drivers: Sequence[np.ndarray]
) -> np.ndarray:
    """Estimate the level of innovations in each sample.

    Args:
        white: Innovations, shape (samples, n_axes), in any unit; or draws of them.
        inside: Samples that may be used, shape (samples, n_axes).
        parts: Samples of each separate recording.
        drivers: Quantities with which the variance may grow, as for `levelled`.

    Returns:
        The level, in the unit of the innovations, shape (samples, n_axes).
    """
    level = np.ones(inside.shape)
    for axis in range(inside.shape[1]):
        rows = inside[:, axis]
        features = _features([driver[:, axis] for driver in drivers])
        for _ in range(2):
            for part in parts:
                use = rows[part]
                if use.sum() >= _FEWEST:
                    innovation = white[..., part, axis] / level[part, axis]
                    level[part, axis] *= typical(innovation[..., use])
            squares = (white[..., axis] / level[:, axis]) ** 2
            squares = squares.reshape(-1, len(rows)).mean(axis=0)  # of all draws
            growth = _growth(features[rows], squares[rows])
            if growth is None:
                break
            level[:, axis] *= np.sqrt(features @ growth)
    return level


def _features(drivers: Sequence[np.ndarray]) -> np.ndarray:
    """One, and each driver and its square as a share of its largest value."""
    columns = [np.ones(len(drivers[0]))] if drivers else []
    for driver in drivers:
        x = driver / max(float(driver.max()), 1e-300)
        columns += [x, x**2]
    return np.stack(columns, axis=1) if columns else np.ones((0, 1))


def _growth(features: np.ndarray, squares: np.ndarray) -> np.ndarray | None:
    """Coefficients of the variance, or None if speed and load do not predict it."""
    if len(features) < 4 * _FEWEST or np.median(squares) == 0:
        return None
    block = np.arange(len(squares)) // _FOLD % 2
    gain = 0.0
    for fold in (0, 1):
        fit, left = block != fold, block == fold
        capped = np.minimum(squares[left], _CAP)
        constant = float(np.mean(np.minimum(squares[fit], _CAP)))
        variance = features[left] @ _variance(features[fit], squares[fit])
        gain += log_likelihood(capped, variance) - log_likelihood(
            capped, np.full(len(capped), constant)
        )
    return _variance(features, squares) if gain > _GAIN else None


def _variance(features: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Fit a variance that is a sum of features with coefficients that are not negative."""
    variance = np.ones(len(squares))
    for _ in range(_ROUNDS):
        capped = np.minimum(squares, _CAP * variance)
        coefficients, _ = nnls(features / variance[:, None], capped / variance)
        variance = np.maximum(features @ coefficients, 1e-3)
    coefficients[0] = max(coefficients[0], 1e-3)
    return np.asarray(coefficients)


def log_likelihood(squares: np.ndarray, variance: np.ndarray) -> float:
    """Compute the logarithm of the likelihood of normal values, but for a constant.

    Args:
        squares: Squares of the values.
        variance: Variance of each, same shape.
    """
    return float(-0.5 * np.sum(np.log(variance) + squares / variance))
