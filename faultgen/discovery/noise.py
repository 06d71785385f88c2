"""Noise of a gap, told from how it changes within a few samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter

_IMPULSE = np.concatenate([[1.0], np.zeros(4095)])
_SAME = 0.05  # as `SHARED`, of noise that is the same beyond doubt
_CONSIDERABLE = 3e-3  # noise over torque; simulations without any seem to have 0.001
_LARGEST = 0.98  # autocorrelation; beyond it noise cannot be told from a drift


@dataclass(frozen=True, eq=False)
class Autoregression:
    """Noise x_t = sum of a_k x_(t-k) + e_t, by axis."""

    coefficients: np.ndarray
    """Shape (n_axes, order)."""
    innovation: np.ndarray
    """Standard deviation of e, shape (n_axes,)."""

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of the noise, shape (n_axes,)."""
        response = np.array([lfilter([1], [1, *-a], _IMPULSE) for a in self.coefficients])
        return self.innovation * np.sqrt((response**2).sum(axis=1))

    def times(self, factor: float) -> Autoregression:
        """Noise that is larger by a factor."""
        return Autoregression(self.coefficients, factor * self.innovation)

    def replaced(self, other: Autoregression, axes: np.ndarray) -> Autoregression:
        """With other noise on some axes, a mask of shape (n_axes,)."""
        return Autoregression(
            np.where(axes[:, None], other.coefficients, self.coefficients),
            np.where(axes, other.innovation, self.innovation),
        )

    def whiten(self, x: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Innovations over their standard deviation; 0 in the first samples of each part.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the noise.
            parts: Separate recordings.
        """
        out = np.zeros_like(x)
        order = self.coefficients.shape[1]
        for part in parts:
            for axis, (a, scale) in enumerate(zip(self.coefficients, self.innovation, strict=True)):
                b = (np.concatenate([[1.0], -a]) / scale).astype(x.dtype)
                new = lfilter(b, np.ones(1, x.dtype), x[..., part, axis], axis=-1)
                new[..., :order] = 0
                out[..., part, axis] = new
        return out


def noise_of(gap: np.ndarray, inside: np.ndarray, parts: Sequence[slice]) -> Autoregression:
    """Estimate the noise of a gap that also holds effects.

    Effects change slowly beside the sample period, but for jumps, which `inside` is to leave out.
    Second differences take what is slow away; those of a first-order autoregression have a variance
    and a correlation of neighbours from which its two parameters follow. Source: its
    autocovariances, s^2 m^k / (1 - m^2).

    Args:
        gap: Shape (samples, n_axes), in any unit.
        inside: Samples that may be used, same shape.
        parts: Separate recordings.

    Returns:
        The noise, of first order.

    Raises:
        ValueError: An axis has fewer than 50 usable samples.
    """
    axes = gap.shape[1]
    memory, innovation = np.zeros(axes), np.zeros(axes)
    for axis in range(axes):
        squares, products = [], []
        for part in parts:
            x, use = gap[part, axis], inside[part, axis]
            second = x[2:] - 2 * x[1:-1] + x[:-2]
            usable = use[2:] & use[1:-1] & use[:-2]
            squares.append(second[usable] ** 2)
            both = usable[1:] & usable[:-1]
            products.append((second[1:] * second[:-1])[both])
        variance, product = np.concatenate(squares), np.concatenate(products)
        if len(product) < 50:
            raise ValueError(f"axis {axis + 1}: fewer than 50 samples in which it moves steadily")
        ratio = float(product.mean() / variance.mean()) if variance.mean() > 0 else -2 / 3
        memory[axis] = _memory(ratio)
        scale = _covariances(memory[axis])[0]
        innovation[axis] = np.sqrt(variance.mean() / scale)
    return Autoregression(memory[:, None], np.maximum(innovation, 1e-12))


def _covariances(memory: float) -> tuple[float, float]:
    """Variance of second differences and covariance of neighbours, for innovations of 1."""
    g0, g1, g2, g3 = (memory**k / (1 - memory**2) for k in range(4))
    return 6 * g0 - 8 * g1 + 2 * g2, -4 * g0 + 7 * g1 - 4 * g2 + g3


def _memory(ratio: float) -> float:
    """Autocorrelation whose second differences have that correlation of neighbours."""

    def excess(memory: float) -> float:
        variance, covariance = _covariances(memory)
        return covariance / variance - ratio

    if excess(0.0) >= 0:
        return 0.0
    if excess(_LARGEST) <= 0:
        return _LARGEST
    return float(brentq(excess, 0.0, _LARGEST))


def autoregression(
    residual: np.ndarray, inside: np.ndarray, parts: Sequence[slice], order: int = 8
) -> Autoregression:
    """Fit an autoregression to what is left of a gap.

    Noise that is white plus coloured is an autoregression of no finite order; eight steps are so
    near to it that patterns over seconds in healthy robots are as likely as they should be, three
    are not.

    Args:
        residual: Shape (samples, n_axes).
        inside: Samples that may be used, same shape.
        parts: Separate recordings.
        order: Of the autoregression.

    Returns:
        The noise; the innovation's scale is that of its median size, so that rare jumps do not
        count.

    Raises:
        ValueError: An axis has fewer than 50 usable samples.
    """
    axes = residual.shape[1]
    coefficients, innovation = np.zeros((axes, order)), np.zeros(axes)
    for axis in range(axes):
        rows, targets = [], []
        for part in parts:
            x, use = residual[part, axis], inside[part, axis]
            if len(x) <= order:
                continue
            windows = np.lib.stride_tricks.sliding_window_view(x, order + 1)
            usable = np.lib.stride_tricks.sliding_window_view(use, order + 1).all(axis=1)
            rows.append(windows[usable, -2::-1])
            targets.append(windows[usable, -1])
        if sum(len(target) for target in targets) < 50:
            raise ValueError(f"axis {axis + 1}: fewer than 50 samples in which it moves")
        design, target = np.concatenate(rows), np.concatenate(targets)
        coefficients[axis], *_ = np.linalg.lstsq(design, target, rcond=None)
        new = target - design @ coefficients[axis]
        innovation[axis] = max(1.4826 * float(np.median(np.abs(new))), 1e-12)
    return Autoregression(coefficients, innovation)


SHARED = 0.2
"""Size of what cannot be predicted in the difference of two recordings, over that in both, below
which they have the same noise: 0.45 to 0.73 by axis for independent noise, 0.0006 to 0.11 for the
same noise or none (simulated PUMA)."""


def shared_noise(
    first: np.ndarray, second: np.ndarray, parts: Sequence[slice], share: float = SHARED
) -> np.ndarray:
    """Axes on which two recordings of the same motions may have the same noise.

    What a sample has that those before it do not foretell is noise, but for jumps, which the median
    leaves out. Where each recording has noise of its own, their difference has that of both. Of
    motions that are hard to foretell, and noise of less than a thousandth, too much is found.

    Args:
        first: Torque of one recording, shape (samples, n_axes).
        second: Of the other.
        parts: Separate recordings.
        share: Size of the noise in the difference, over that in both, below which it is shared.

    Returns:
        Shape (n_axes,).

    Raises:
        ValueError: There are fewer than 50 samples.
    """
    use = np.ones(first.shape, bool)
    one, other, apart = (
        autoregression(x, use, parts).innovation for x in (first, second, first - second)
    )
    return apart < share * np.hypot(one, other)


def is_same_noise(first: np.ndarray, second: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Axes on which two recordings have noise that is considerable, and the very same.

    Args:
        first: Torque of one recording, shape (samples, n_axes).
        second: Of the other.
        parts: Separate recordings.

    Returns:
        Shape (n_axes,).

    Raises:
        ValueError: There are fewer than 50 samples.
    """
    noise = autoregression(second, np.ones(second.shape, bool), parts).innovation
    considerable = noise > _CONSIDERABLE * np.sqrt(np.mean(second**2, axis=0))
    return considerable & shared_noise(first, second, parts, _SAME)
